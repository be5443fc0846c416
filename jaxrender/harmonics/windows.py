"""Windows: weights by degree that take the ringing off a lobe that is cut at a band limit.

A lobe whose degrees end at F swings below zero around its peak, and a small bright source seen
through it is ringed by black.  A window w_l, 1 for degree 0 and falling, trades that for a broader
peak.  ``hann`` and ``lanczos`` reach zero at degree F + 1 whatever the lobe.  ``minimal`` bends as
little as a lobe allows: P. P. Sloan, *Stupid Spherical Harmonics (SH) Tricks* (2008), "Windowing",
minimises the squared error plus ``strength`` times the squared Laplacian.

A lobe is given by its transfer A_l; as a function of the angle from its centre it is

    f(t) = sum_l (2l + 1) / (4 pi) A_l P_l(cos t)                 the inverse of ``transfer_of``

All is on the host, in float64.
"""

from collections.abc import Callable

import numpy as np
from numpy.polynomial.legendre import legval
from scipy.optimize import root_scalar

from jaxrender.harmonics.indexing import coefficient_count
from jaxrender.shapes import AnyArray, Float, checked

# How far below zero a lobe may fall, in parts of its peak.  What Sloan's window makes of a point
# rings to -.014 itself, however strong it is: above -.03 narrow lobes of few degrees lose all
# detail.
TOLERABLE_RINGING = -0.03
# Strengths tried one after the other, in units of the one that halves the highest degree.
_TRIED = np.logspace(-9, 15, 97)
_STRENGTH_ACCURACY = 1e-10
# Angles at which extremes are looked for, and steps of the closer look between two of them.
_ANGLES_PER_DEGREE, _CLOSER = 12, 64


def hann(band_limit: int) -> Float[np.ndarray, " degree"]:
    """Return w_l = (1 + cos(pi l / (F + 1))) / 2 for degrees 0 to F."""
    coefficient_count(band_limit)
    return (1 + np.cos(np.pi * np.arange(band_limit + 1) / (band_limit + 1))) / 2


def lanczos(band_limit: int) -> Float[np.ndarray, " degree"]:
    """Return w_l = sin(x) / x, x = pi l / (F + 1), for degrees 0 to F."""
    coefficient_count(band_limit)
    return np.sinc(np.arange(band_limit + 1) / (band_limit + 1))


def minimal(band_limit: int, strength: float) -> Float[np.ndarray, " degree"]:
    """Return w_l = 1 / (1 + strength l^2 (l + 1)^2) for degrees 0 to F (Sloan 2008).

    ``halving_strength`` and ``minimal_strength`` are strengths to take.  Raises ``ValueError`` for
    one that is negative or not finite.
    """
    coefficient_count(band_limit)
    if not 0 <= strength < np.inf:
        raise ValueError(f"strength={strength}: give a finite number from 0")
    return 1 / (1 + strength * _bending(band_limit))


def halving_strength(band_limit: int) -> float:
    """Return the strength at which ``minimal`` halves degree F; 0 where there is degree 0 alone."""
    coefficient_count(band_limit)
    return 0.0 if band_limit == 0 else float(1 / _bending(band_limit)[-1])


@checked
def minimal_strength(
    transfer: Float[AnyArray, " degree"], lowest: float = TOLERABLE_RINGING
) -> float:
    """Find the smallest strength at which a lobe's lowest value is at least ``lowest`` of its peak.

    0 for a lobe that does not ring more as it is.  A bound of 0 leaves little of a narrow lobe but
    its mean, since the window itself rings.

    Raises ``ValueError`` for a lobe without a positive mean (A_0), which no window lifts, for one
    that is not finite, and for ``lowest`` outside [-1, 0].
    """
    series = _series(transfer)
    if not -1 <= lowest <= 0:
        raise ValueError(f"lowest={lowest}: give a part of the peak from -1 to 0")
    if series[0] <= 0:
        raise ValueError(
            f"a lobe with A_0 = {series[0] * 4 * np.pi:.3g}: its mean is not positive, and no "
            "window lifts it above zero; give a lobe that reflects"
        )
    bending = _bending(len(series) - 1)

    def excess(strength: float) -> float:
        least, peak = _extremes(series / (1 + strength * bending))
        return least - lowest * peak

    low = 0.0
    if excess(low) >= 0:
        return low
    for high in _TRIED * halving_strength(len(series) - 1):
        if excess(high) >= 0:
            least = _STRENGTH_ACCURACY * high
            return root_scalar(excess, bracket=(low, high), method="brentq", xtol=least).root
        low = high
    raise AssertionError("a lobe of a positive mean alone is positive")


@checked
def ringing(transfer: Float[AnyArray, " degree"]) -> float:
    """Return the lowest value of a lobe of degrees 0 to F, relative to its peak.

    -.13 for a point (A_l = 1) cut at any degree; above 0 where the lobe never falls to zero.

    Raises ``ValueError`` for a lobe that is nowhere positive, or not finite.
    """
    least, peak = _extremes(_series(transfer))
    if peak <= 0:
        raise ValueError(f"a lobe whose highest value is {peak:.3g}: give one that reflects")
    return least / peak


def _least_bending(transfer: Float[AnyArray, " degree"]) -> Float[np.ndarray, " degree"]:
    return minimal(len(transfer) - 1, minimal_strength(transfer))


# The window of a lobe, by name.
WINDOWS: dict[str, Callable[[Float[AnyArray, " degree"]], Float[np.ndarray, " degree"]]] = {
    "hann": lambda transfer: hann(len(transfer) - 1),
    "lanczos": lambda transfer: lanczos(len(transfer) - 1),
    "minimal": _least_bending,
}


@checked
def window_named(name: str, transfer: Float[AnyArray, " degree"]) -> Float[np.ndarray, " degree"]:
    """Return w_l of the window of that name for a lobe; ``minimal`` is no stronger than it needs.

    Raises ``ValueError`` for a name that is not in ``WINDOWS``.
    """
    if name not in WINDOWS:
        raise ValueError(f"no window is named {name!r}; choose one of {', '.join(WINDOWS)}")
    return WINDOWS[name](transfer)


def _bending(band_limit: int) -> Float[np.ndarray, " degree"]:
    """Return l^2 (l + 1)^2, the square of the Laplacian's eigenvalue."""
    degree = np.arange(band_limit + 1, dtype=float)
    return (degree * (degree + 1)) ** 2


def _series(transfer: Float[AnyArray, " degree"]) -> Float[np.ndarray, " degree"]:
    """Return the coefficients of P_l(cos t)."""
    values = np.asarray(transfer, float)
    if not np.isfinite(values).all():
        degree = int(np.argmin(np.isfinite(values)))
        raise ValueError(f"A_{degree} of a lobe is {values[degree]}; give finite numbers")
    return values * (2 * np.arange(len(values)) + 1) / (4 * np.pi)


def _extremes(series: Float[np.ndarray, " degree"]) -> tuple[float, float]:
    """Return the lowest and the highest value over all angles."""
    return _lowest(series), -_lowest(-series)


def _lowest(series: Float[np.ndarray, " degree"]) -> float:
    """Look at many angles, closer around the lowest of them, and take the parabola's vertex there.

    What is left out is a part in 1e8 of the peak.
    """
    angles = np.linspace(0, np.pi, _ANGLES_PER_DEGREE * len(series) + 1)
    for _ in range(2):
        values = legval(np.cos(angles), series)
        least = int(np.argmin(values))
        around = angles[max(least - 1, 0)], angles[min(least + 1, len(angles) - 1)]
        angles = np.linspace(*around, _CLOSER + 1)
    before, here, after = values[[max(least - 1, 0), least, min(least + 1, len(values) - 1)]]
    bend = before - 2 * here + after
    # At an end of the closer look the lowest value is a pole's, where no slope is left.
    inside = 0 < least < len(values) - 1 and bend > 0
    return float(here - (after - before) ** 2 / (8 * bend) if inside else here)
