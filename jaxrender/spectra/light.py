"""Harmonic coefficients L_lm of a light (T 4.13)."""

from functools import partial

import jax
import jax.numpy as jnp

from jaxrender.harmonics import analyse, real_basis
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.shapes import Array, Float


def light_coefficients(
    light: Environment | DirectionalSources, band_limit: int
) -> Float[Array, "coefficient channel"]:
    """Compute L_lm = integral of L Y_lm for every degree up to ``band_limit``.

    Environments by the quadrature of their own grid, which is exact up to its band limit (higher:
    ``ValueError``); directional sources as the point masses they are, to any degree.
    """
    if isinstance(light, Environment):
        return analyse(light.grid, jnp.asarray(light.radiance), band_limit)
    return _sum_of_basis(jnp.asarray(light.directions), jnp.asarray(light.irradiance), band_limit)


@partial(jax.jit, static_argnames="band_limit")
def _sum_of_basis(
    directions: Float[Array, "source 3"],
    irradiance: Float[Array, "source channel"],
    band_limit: int,
) -> Float[Array, "coefficient channel"]:
    basis = real_basis(directions, band_limit)
    return jnp.einsum("ji,jc->ic", basis, irradiance, precision="highest")
