"""Ringing of a spectrum that is cut at (F, P), and the windows that take it off.

A lobe cut in the degrees of the light or of the viewer falls below zero beside its peak and towards
grazing, and a map of it shows black specks around bright sources.  ``harmonics.windows`` has the
windows for one degree; here they weigh both.
"""

import numpy as np
from scipy.optimize import root_scalar

from jaxrender.harmonics import (
    TOLERABLE_RINGING,
    WINDOWS,
    halving_strength,
    minimal,
    window_named,
)
from jaxrender.shapes import Float
from jaxrender.spectra.central import CentralSpectrum, meridian_table

# Angles per degree at which a lobe is looked at: of the light, of the viewer and of the azimuth.
_ANGLES_PER_DEGREE = (12, 8, 8)
# How well the share of the halving strength is found.
_SHARE_ACCURACY = 1e-3


def lobe_ringing(spectrum: CentralSpectrum) -> float:
    """Return the lowest value of rho^(i', o') relative to its peak, of the channel that rings most.

    Over all directions of light and viewer, on a grid that misses a hundredth of it.  Raises
    ``ValueError`` for a lobe that is nowhere positive.
    """
    least, peak = _extremes(spectrum)
    if np.any(peak <= 0):
        raise ValueError(f"a lobe whose highest value is {peak.min():.3g}: give one that reflects")
    return float(np.min(least / peak))


def windowed_spectrum(
    spectrum: CentralSpectrum, name: str, lowest: float = TOLERABLE_RINGING
) -> CentralSpectrum:
    """Weigh both degrees of a spectrum by the window of that name.

    ``minimal`` is just so strong that ``lobe_ringing`` is at least ``lowest``, and no stronger than
    halves degree F and degree P: what rings then is the window itself.

    Raises ``ValueError`` for a name that is not in ``harmonics.WINDOWS``, and for ``lowest``
    outside [-1, 0].
    """
    if name not in WINDOWS:
        window_named(name, np.ones(1))
    if name != "minimal":
        points = (np.ones(limit + 1) for limit in spectrum.band_limits)
        return spectrum.windowed(*(window_named(name, point) for point in points))
    if not -1 <= lowest <= 0:
        raise ValueError(f"lowest={lowest}: give a part of the peak from -1 to 0")

    def of(share: float) -> CentralSpectrum:
        limits = spectrum.band_limits
        return spectrum.windowed(*(minimal(n, share * halving_strength(n)) for n in limits))

    def excess(share: float) -> float:
        return lobe_ringing(of(share)) - lowest

    if excess(0.0) >= 0:
        return spectrum
    if excess(1.0) <= 0:
        return of(1.0)
    # A little stronger than the root, which is known to so much.
    root = root_scalar(excess, bracket=(0.0, 1.0), method="brentq", xtol=_SHARE_ACCURACY).root
    return of(min(root + _SHARE_ACCURACY, 1.0))


def _extremes(
    spectrum: CentralSpectrum,
) -> tuple[Float[np.ndarray, "channel"], Float[np.ndarray, "channel"]]:
    """Evaluate sum rho_lpq Y_lq(i') Y_pq(o') at t'_i, t'_o and phi, each 0 to pi."""
    rho = np.asarray(spectrum.coefficients, float)
    orders = np.arange(rho.shape[2])
    light, viewer = (
        meridian_table(np.linspace(0, np.pi, many * count), (count, len(orders)))
        for many, count in zip(_ANGLES_PER_DEGREE, rho.shape[:2])
    )
    azimuths = np.linspace(0, np.pi, _ANGLES_PER_DEGREE[2] * len(orders))
    by_viewer = np.einsum("opq,lpqc->loqc", viewer, rho)
    by_both = np.einsum("ilq,loqc->ioqc", light, by_viewer)
    values = np.einsum("ioqc,aq->ioac", by_both, np.cos(azimuths[:, None] * orders))
    return values.min(axis=(0, 1, 2)), values.max(axis=(0, 1, 2))
