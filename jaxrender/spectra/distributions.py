"""Analytic coefficients of the thesis's lights (T 3.2.1 to 3.2.3), and of the sky.

A light symmetric about an axis a, L(w) = f(w . a), has L_lm = A_l Y_lm(a) with
A_l = 2 pi int f(x) P_l(x) dx: one integral a degree, turned to the axis by the addition theorem.
The directional source (A_l = E for all l) and uniform light (A_0 = 4 pi L, else 0) are its two
ends.  With the axis at +Z only m = 0 is left, and A_l = Lambda_l L_l0 (T 3.14, 3.18).  Everything
is differentiable in its parameters.
"""

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import angles_from_direction, normalise
from jaxrender.harmonics import (
    coefficient_count,
    degrees,
    flat_index,
    orders,
    real_basis,
    transfer_of,
)
from jaxrender.lighting.sky import ClearSky, OvercastSky
from jaxrender.shapes import AnyArray, Array, Float, checked
from jaxrender.spectra.phong import power_transfer

# Gauss nodes of the clear sky on each side of the sun's elevation, and in azimuth away from it.
_SKY_POLAR_NODES = 48
_SKY_AZIMUTH_NODES = 96


@checked
def directional_coefficients(
    direction: Float[AnyArray, "3"], irradiance: Float[AnyArray, "channel"], band_limit: int
) -> Float[Array, "coefficient channel"]:
    """Compute E Y_lm(source) of a directional source (T 3.13), which does not decay with degree."""
    strength = jnp.asarray(irradiance)
    transfer = jnp.broadcast_to(strength[None, :], (band_limit + 1, strength.shape[0]))
    return zonal_coefficients(transfer, direction)


@checked
def zonal_coefficients(
    transfer: Float[AnyArray, "degree channel"], axis: Float[AnyArray, "3"]
) -> Float[Array, "coefficient channel"]:
    """Turn A_l, l = 0 ... F, of a light symmetric about +Z to an axis: L_lm = A_l Y_lm(axis)."""
    by_degree = jnp.asarray(transfer)
    band_limit = by_degree.shape[0] - 1
    basis = real_basis(normalise(jnp.asarray(axis, by_degree.dtype)), band_limit)
    return basis[:, None] * by_degree[degrees(band_limit)]


@checked
def axial_coefficients(
    profile: Callable[[np.ndarray], np.ndarray],
    axis: Float[AnyArray, "3"],
    band_limit: int,
    breakpoints: Sequence[float] = (),
) -> Float[Array, "coefficient 1"]:
    """Compute the coefficients of L(w) = f(w . axis) by a Gauss-Legendre quadrature (T 3.18).

    ``profile`` maps cosines to radiance; ``breakpoints`` are the angles of its kinks and jumps.
    Raises ``ValueError`` as ``harmonics.transfer_of`` does.
    """
    towards = jnp.asarray(axis)
    transfer = jnp.asarray(transfer_of(profile, band_limit, breakpoints), towards.dtype)
    return zonal_coefficients(transfer[:, None], towards)


@checked
def uniform_coefficients(
    radiance: Float[AnyArray, "channel"], band_limit: int
) -> Float[Array, "coefficient channel"]:
    """Compute L_00 = sqrt(4 pi) L and nothing else.

    T 3.19's L_00 = Lambda_0^-1 is therefore a radiance of 1 / (4 pi), not Lambda_0^-1 (ERRATA 15).
    """
    level = jnp.asarray(radiance)
    empty = jnp.zeros((coefficient_count(band_limit), level.shape[0]), level.dtype)
    return empty.at[0].set(float(np.sqrt(4 * np.pi)) * level)


def overcast_coefficients(sky: OvercastSky, band_limit: int) -> Float[Array, "coefficient channel"]:
    """Compute the overcast sky's coefficients in closed form: only m = 0.

    A_l = L_z / 3 (2 pi int_0^1 P_l du + 2 * 2 pi int_0^1 u P_l du).
    """
    zenith = jnp.asarray(sky.zenith)
    exponents = (jnp.asarray(power, zenith.dtype) for power in (0.0, 1.0))
    flat, cosine = (power_transfer(s, band_limit) for s in exponents)
    transfer = (flat + 2 * cosine) / 3
    up = jnp.asarray([0.0, 0.0, 1.0], zenith.dtype)
    return zonal_coefficients(transfer[:, None] * zenith[None, :], up)


@partial(jax.jit, static_argnames="band_limit")
def clear_coefficients(sky: ClearSky, band_limit: int) -> Float[Array, "coefficient channel"]:
    """Compute the clear sky's coefficients: zonal integrals for each order, turned to the sun.

    The sky is symmetric about the plane through zenith and sun, so with the sun at azimuth 0 only
    cos(m phi) is left; the sun's azimuth p turns that to cos(m p), sin(m p).
    """
    zenith = jnp.asarray(sky.zenith)
    sun_polar, sun_azimuth = angles_from_direction(_off_zenith(jnp.asarray(sky.sun, zenith.dtype)))
    sine, cosine = jnp.sin(sun_polar), jnp.cos(sun_polar)
    facing = ClearSky(jnp.stack([sine, 0 * sine, cosine]), jnp.ones_like(zenith), sky.distribution)
    polar, polar_weights = _sky_elevations(sun_polar)
    # Squares put nodes densest at the sun, where the radiance has a kink.
    nodes, weights = _unit_rule(_SKY_AZIMUTH_NODES)
    azimuth = jnp.asarray(np.pi * nodes**2, zenith.dtype)
    weights = jnp.asarray(np.pi * 2 * nodes * weights, zenith.dtype)
    radiance = facing.relative(_directions(polar[:, None], azimuth[None, :]))
    waves = jnp.cos(azimuth[:, None] * jnp.arange(band_limit + 1, dtype=zenith.dtype)[None, :])
    by_order = 2 * jnp.einsum("ta,a,am->tm", radiance, weights, waves, precision="highest")
    meridian = real_basis(_directions(polar, jnp.zeros_like(polar)), band_limit)
    order = np.abs(orders(band_limit))
    # The basis at azimuth 0 is p_lm for m >= 0; the sines of -m share it.
    zonal = meridian[:, np.array([flat_index(int(d), int(m)) for d, m in _pairs(band_limit)])]
    weighted = polar_weights * jnp.sin(polar)
    facing_sun = jnp.einsum("t,tm,tm->m", weighted, by_order[:, order], zonal, precision="highest")
    angle = sun_azimuth * jnp.asarray(order, zenith.dtype)
    turned = jnp.where(orders(band_limit) < 0, jnp.sin(angle), jnp.cos(angle))
    return (facing_sun * turned)[:, None] * zenith[None, :]


def _off_zenith(sun: Float[Array, "3"]) -> Float[Array, "3"]:
    """Turn the sun away from where it has no azimuth, by the root of a rounding."""
    x, y, z = normalise(sun)
    least = float(jnp.finfo(sun.dtype).eps) ** 0.5
    overhead = x * x + y * y < least**2
    return jnp.stack([jnp.where(overhead, x + 2 * least, x), y, z])


def _pairs(band_limit: int) -> zip:
    return zip(degrees(band_limit), np.abs(orders(band_limit)))


def _unit_rule(count: int) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


def _sky_elevations(sun: Float[Array, ""]) -> tuple[Float[Array, "node"], Float[Array, "node"]]:
    """Place polar angles from zenith to the sun and on to the horizon, densest at the sun."""
    nodes, weights = _unit_rule(_SKY_POLAR_NODES)
    nodes, weights = jnp.asarray(nodes, sun.dtype), jnp.asarray(weights, sun.dtype)
    above, below = sun, jnp.pi / 2 - sun
    polar = jnp.concatenate([sun - above * nodes**2, sun + below * nodes**2])
    return polar, jnp.concatenate([above * 2 * nodes * weights, below * 2 * nodes * weights])


def _directions(
    polar: Float[AnyArray, "*#batch"], azimuth: Float[AnyArray, "*#batch"]
) -> Float[Array, "*batch 3"]:
    x, y = jnp.sin(polar) * jnp.cos(azimuth), jnp.sin(polar) * jnp.sin(azimuth)
    return jnp.stack([x, y, jnp.broadcast_to(jnp.cos(polar), x.shape)], axis=-1)
