"""Harmonic coefficients L_lm of a light (T 4.13)."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.harmonics import analyse, coefficient_count, real_basis
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.lighting.base import Light, LightNodes, LightSum
from jaxrender.lighting.coefficients import HarmonicLight
from jaxrender.lighting.sky import ClearSky, OvercastSky
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Coefficients, Float
from jaxrender.spectra.distributions import clear_coefficients, overcast_coefficients


def light_coefficients(light: Light, band_limit: int) -> Float[Array, "coefficient channel"]:
    """Compute L_lm = integral of L Y_lm for every degree up to ``band_limit``.

    Environments by the quadrature of their own grid, which is exact up to its band limit (higher:
    ``ValueError``); skies by their own integrals; light given by coefficients by cutting or
    filling them up; directional sources, and any other light, as the point masses that they are; a
    sum of lights part by part.
    """
    if isinstance(light, Environment):
        return analyse(light.grid, jnp.asarray(light.radiance), band_limit)
    if isinstance(light, OvercastSky):
        return overcast_coefficients(light, band_limit)
    if isinstance(light, ClearSky):
        return clear_coefficients(light, band_limit)
    if isinstance(light, HarmonicLight):
        missing = max(coefficient_count(band_limit) - light.coefficients.shape[0], 0)
        filled = jnp.pad(jnp.asarray(light.coefficients), ((0, missing), (0, 0)))
        return filled[: coefficient_count(band_limit)]
    if isinstance(light, LightSum):
        parts = [light_coefficients(part, band_limit) for part in light.parts]
        return jnp.sum(jnp.stack(parts), axis=0)
    nodes = light.nodes()
    if isinstance(light, DirectionalSources) and not isinstance(light.directions, Tracer):
        nodes = _filled_up(nodes)
    return _sum_of_basis(*nodes, band_limit)


def coefficients_of(light: Light | Coefficients, band_limit: int) -> Coefficients:
    """Expand a light; coefficients are returned as they are, to whatever degree they have."""
    return light_coefficients(light, band_limit) if isinstance(light, Light) else light


def _filled_up(nodes: LightNodes) -> LightNodes:
    """Add dark sources up to a power of two, so that few shapes are ever compiled."""
    count = nodes.directions.shape[0]
    missing = ((0, (1 << max(count - 1, 0).bit_length()) - count), (0, 0))
    directions = np.pad(np.asarray(nodes.directions), missing, constant_values=1)
    irradiance = np.pad(np.asarray(nodes.irradiance), missing)
    return LightNodes(jnp.asarray(directions), jnp.asarray(irradiance))


@stored(partial(jax.jit, static_argnames="band_limit"), effort="less")
def _sum_of_basis(
    directions: Float[AnyArray, "source 3"],
    irradiance: Float[AnyArray, "source channel"],
    band_limit: int,
) -> Float[Array, "coefficient channel"]:
    basis = real_basis(directions, band_limit)
    return jnp.einsum("ji,jc->ic", basis, irradiance, precision="highest")
