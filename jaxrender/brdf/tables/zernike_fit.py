"""Irregular measurements of reflectance to a Zernike series, with its error (T 5.7.2).

The coefficients a minimise

    sum_j (sum_f a_f H_f(j) - rho_j)^2 + s N sum_f (w_f a_f)^2,  w_nkm = n (n + 2) + k (k + 2),

for N measurements: w is the eigenvalue of the disc's own differential operator, so that roughness
is what costs.  The smoothing s is the one of ``SMOOTHINGS`` with the least error left out: every
measurement is predicted by a fit to all the others, r_j / (1 - h_j) with the diagonal h of the
projection, which is exact for linear fits.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.brdf.tables.zernike import ZernikeBRDF, zernike_functions, zernike_indices
from jaxrender.geometry import Components
from jaxrender.shapes import Float, Int, checked

# Of measurements in units of their own root mean square; 0 is plain least squares.
SMOOTHINGS = (0.0, *(10.0**k for k in range(-10, -1)))

# A measurement whose prediction without it is more than this times its residual is not predicted.
_SMALLEST_FREEDOM = 1e-6
# Singular values below this part of the largest are zero.
_ROUNDING = 1e-11

_functions = eqx.filter_jit(zernike_functions)


class ZernikeFit(NamedTuple):
    """A series, and what is known of its error, for each channel.

    ``relative_rms`` is sqrt(sum r^2 / sum v^2) of measurements left out of the fit one by one;
    ``residual`` is the same at the fit itself.  ``used`` and ``masked`` count measurements.
    """

    brdf: ZernikeBRDF
    relative_rms: Float[np.ndarray, "channel"]
    residual: Float[np.ndarray, "channel"]
    smoothing: Float[np.ndarray, "channel"]
    used: Int[np.ndarray, "channel"]
    masked: Int[np.ndarray, "channel"]


class _ChannelFit(NamedTuple):
    coefficients: Float[np.ndarray, "function"]
    relative_rms: float
    residual: float
    smoothing: float


@checked
def fit_zernike(
    incoming: Float[np.ndarray, "measurement 3"],
    outgoing: Float[np.ndarray, "measurement 3"],
    values: Float[np.ndarray, "measurement channel"],
    order: int = 8,
    smoothings: Sequence[float] = SMOOTHINGS,
) -> ZernikeFit:
    """Fit a series to values in 1/sr; the best of the smoothings, for each channel.

    Directions are local unit vectors away from the surface.  Values that are negative or not finite
    are left out, and counted.  Raises ``ValueError`` for directions below the horizon, smoothings
    that are negative, a channel without a usable value, and where no smoothing determines the
    coefficients (too few measurements for smoothing 0 alone).
    """
    incoming, outgoing, values = (np.asarray(a, float) for a in (incoming, outgoing, values))
    for name, directions in (("incoming", incoming), ("outgoing", outgoing)):
        wrong = ~((abs(np.linalg.norm(directions, axis=1) - 1) < 1e-3) & (directions[:, 2] > 0))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ValueError(
                f"{name}[{row}] is {directions[row]}: give unit vectors above the horizon, away "
                "from the surface, +Z the normal"
            )
    if not smoothings or min(smoothings) < 0:
        raise ValueError(f"smoothings={tuple(smoothings)}: give numbers from 0 on")
    found = _functions(Components.of(incoming), Components.of(outgoing), order)
    design = np.stack([np.asarray(function, float) for function in found], axis=-1)
    penalty = np.array([n * (n + 2.0) + k * (k + 2.0) for n, k, _ in zernike_indices(order)])
    valid = np.isfinite(values) & (values >= 0)
    fits = []
    for channel in range(values.shape[1]):
        rows = valid[:, channel]
        if not rows.any():
            raise ValueError(f"channel {channel} has no value that is finite and not negative")
        fits.append(_best(design[rows], values[rows, channel], penalty, smoothings))
    coefficients, *errors = zip(*fits, strict=True)
    relative_rms, residual, smoothing = (np.array(e, float) for e in errors)
    used = valid.sum(0)
    brdf = ZernikeBRDF(np.stack(coefficients, axis=-1), order)
    return ZernikeFit(brdf, relative_rms, residual, smoothing, used, len(valid) - used)


def _best(
    design: Float[np.ndarray, "measurement function"],
    values: Float[np.ndarray, "measurement"],
    penalty: Float[np.ndarray, "function"],
    smoothings: Sequence[float],
) -> _ChannelFit:
    tried = [_regularised(design, values, penalty, s) for s in smoothings]
    determined = [fit for fit in tried if fit is not None]
    if not determined:
        raise ValueError(
            f"{len(values)} measurements do not determine {design.shape[1]} functions: measure "
            "more pairs, lower the order, or allow a smoothing above 0"
        )
    return min(determined, key=lambda fit: fit.relative_rms)


def _regularised(
    design: Float[np.ndarray, "measurement function"],
    values: Float[np.ndarray, "measurement"],
    penalty: Float[np.ndarray, "function"],
    smoothing: float,
) -> _ChannelFit | None:
    """Solve the stacked least squares; nothing if it leaves a coefficient or an error open."""
    count = len(values)
    below = np.diag(np.sqrt(smoothing * count) * penalty)
    u, s, vt = np.linalg.svd(np.concatenate([design, below]), full_matrices=False)
    if len(s) < design.shape[1] or s[-1] < _ROUNDING * s[0]:
        return None
    projection = u[:count]
    coefficients = vt.T @ ((projection.T @ values) / s)
    residual = values - design @ coefficients
    freedom = 1 - np.sum(projection**2, axis=1)
    if freedom.min() < _SMALLEST_FREEDOM:
        return None
    size = np.sqrt(np.sum(values**2)) or 1.0
    left_out = np.linalg.norm(residual / freedom) / size
    return _ChannelFit(
        coefficients, float(left_out), float(np.linalg.norm(residual) / size), smoothing
    )
