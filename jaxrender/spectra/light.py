"""Harmonic coefficients L_lm of a light (T 4.13)."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

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
    if isinstance(light.directions, Tracer):
        return _sum_of_basis(light.directions, light.irradiance, band_limit)
    # Filled up with dark sources to a power of two, so that few shapes are ever compiled.
    count = light.directions.shape[0]
    missing = ((0, (1 << max(count - 1, 0).bit_length()) - count), (0, 0))
    directions = np.pad(np.asarray(light.directions), missing, constant_values=1)
    irradiance = np.pad(np.asarray(light.irradiance), missing)
    return _sum_of_basis(jnp.asarray(directions), jnp.asarray(irradiance), band_limit)


@partial(jax.jit, static_argnames="band_limit")
def _sum_of_basis(
    directions: Float[Array, "source 3"],
    irradiance: Float[Array, "source channel"],
    band_limit: int,
) -> Float[Array, "coefficient channel"]:
    basis = real_basis(directions, band_limit)
    return jnp.einsum("ji,jc->ic", basis, irradiance, precision="highest")
