"""Irradiance as a sum of harmonics of the normal (T 4.10): the frequency view of diffuse light."""

import jax.numpy as jnp

from jaxrender.harmonics import apply_transfer, band_limit_of, evaluate
from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.spectra.lambertian import lambertian_transfer

# The clamped cosine's coefficients fall as l^(-5/2): beyond this degree they are under 3e-4 of A_0.
_DIFFUSE_BAND_LIMIT = 32


def irradiance(
    coefficients: Float[AnyArray, "coefficient channel"], normals: Float[AnyArray, "sample 3"]
) -> Float[Array, "sample channel"]:
    """Compute E(n) = sum_lm A_l L_lm Y_lm(n), exactly for light known by its coefficients.

    Degrees above 32 are left out: the clamped cosine passes less than 1e-3 of them.
    """
    band_limit = min(band_limit_of(coefficients.shape[0]), _DIFFUSE_BAND_LIMIT)
    kept = jnp.asarray(coefficients)[: (band_limit + 1) ** 2]
    transfer = jnp.asarray(lambertian_transfer(band_limit), kept.dtype)
    return evaluate(apply_transfer(kept, transfer), jnp.asarray(normals))
