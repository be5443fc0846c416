"""Filters that are symmetric about an axis: they scale each degree (T 2.62, the convolution).

A filter's transfer is A_l = 2 pi int_0^pi f(cos t) P_l(cos t) sin t dt.  This is Lambda_l rho_l of
the thesis, Lambda_l = sqrt(4 pi / (2l + 1)) (ERRATA 42): the clamped cosine has pi, 2 pi / 3,
pi / 4, 0, -pi / 24 (T 4.11 as corrected by ERRATA 18 and 19), and a filter of unit integral has
A_0 = 1.
"""

from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.special import roots_legendre

from jaxrender.harmonics.indexing import band_limit_of, coefficient_count, degrees
from jaxrender.shapes import AnyArray, Array, Coefficients, Float, checked

# Beyond the nodes that the Legendre polynomials themselves need: resolves profiles down to a width
# of about .02 radian in one panel.
_PROFILE_NODES = 256


@checked
def apply_transfer(
    coefficients: Coefficients,
    transfer: Float[AnyArray, " degree"] | Float[AnyArray, "degree channel"],
) -> Float[Array, "coefficient channel"]:
    """Return A_l f_lm, with one transfer for all channels or one for each.

    Raises ValueError unless the transfer has one entry for each degree of the coefficients.
    """
    light, scale = jnp.asarray(coefficients), jnp.asarray(transfer)
    band_limit = band_limit_of(light.shape[0])
    if scale.shape[0] != band_limit + 1:
        raise ValueError(
            f"a transfer of {scale.shape[0]} degrees for coefficients of {band_limit + 1}; "
            "cut or extend one of them to the other's band limit"
        )
    by_channel = scale[:, None] if scale.ndim == 1 else scale
    return light * by_channel[degrees(band_limit)]


def transfer_of(
    profile: Callable[[np.ndarray], np.ndarray], band_limit: int, breakpoints: Sequence[float] = ()
) -> Float[np.ndarray, " degree"]:
    """Return A_l, l = 0 ... F, of a profile f(cos t), on the host by Gauss-Legendre quadrature.

    ``profile`` maps an array of cosines to values; ``breakpoints`` are the polar angles, radians,
    at which it has a kink or a jump (pi / 2 for a clamped cosine): the rule is split there.

    Raises ValueError for a breakpoint outside (0, pi) and for a profile that is not finite.
    """
    coefficient_count(band_limit)
    angles = np.sort(np.asarray(breakpoints, dtype=np.float64).reshape(-1))
    if not np.all((angles > 0.0) & (angles < np.pi)):
        raise ValueError(f"breakpoints {angles.tolist()} must be polar angles between 0 and pi")
    cosines, weights = _panels(np.concatenate([[1.0], np.cos(angles), [-1.0]]), band_limit)
    values = np.broadcast_to(np.asarray(profile(cosines), dtype=np.float64), cosines.shape)
    if not np.all(np.isfinite(values)):
        worst = cosines[~np.isfinite(values)][0]
        raise ValueError(f"the profile is not finite at cosine {worst:.6g}; give a bounded one")
    return 2.0 * np.pi * (weights * values) @ legvander(cosines, band_limit)


def _panels(edges: np.ndarray, band_limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss-Legendre nodes and weights in the cosine on the panels between falling edges."""
    nodes, weights = roots_legendre(band_limit + _PROFILE_NODES)
    upper, lower = edges[:-1, None], edges[1:, None]
    half = 0.5 * (upper - lower)
    return (0.5 * (upper + lower) + half * nodes[None, :]).ravel(), (half * weights).ravel()
