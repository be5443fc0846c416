"""From light and BRDF to a spherical harmonic reflection map, in three steps (T 5.6.2).

1. light and BRDF become coefficients L_lm and rho_lpq (``spectra``),
2. their products are the reflected light's, L_lm rho_lpq (T 5.23, without Lambda_l: ERRATA 37),
3. summed over l at each polar angle, then over m around each row (T 5.24):

       B_pq(alpha, beta) = sum_m exp(i m beta) sum_l L_lm rho_lpq d^l_mq(alpha)

in real harmonics throughout: with a, b the light's coefficients of cos(m phi) and sin(m phi), the
map of q > 0 has the waves (T+ rho a) cos(m beta) + (T+ rho b) sin(m beta), that of -q the waves
(T- rho b) cos(m beta) - (T- rho a) sin(m beta), where T+- = (-1)^q ((-1)^m d_mq +- d_-mq).

The cost is F^2 P^2 S for the first sum and F P^2 S^2 for the second.  ``central_coefficients`` is
the slow twin: the light rotated into each texel's frame, all degrees and orders.
"""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import rotation
from jaxrender.harmonics import (
    LatLongGrid,
    band_limit_of,
    coefficient_count,
    degrees,
    orders,
    quarter_turn,
    rotate,
    rotation_matrices,
)
from jaxrender.lighting import Light
from jaxrender.reflection.shrm.maps import GlobalShrm, LocalShrm, check_columns, least_rows
from jaxrender.shapes import AnyArray, Array, Coefficients, Float, checked
from jaxrender.spectra import CentralSpectrum
from jaxrender.spectra.light import coefficients_of

_einsum = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


@checked
def local_shrm(
    light: Coefficients | Light, spectrum: CentralSpectrum, grid: LatLongGrid
) -> LocalShrm:
    """Prefilter light; of coefficients to the same degree F as the spectrum.


    Differentiable in the light and in the spectrum.
    Raises ``ValueError`` for different degrees, for a grid whose rows would alias, and for one with
    an odd number of columns.
    """
    light = coefficients_of(light, spectrum.band_limits[0])
    limits = _check(light, spectrum)
    check_rows(grid, limits)
    check_columns(grid)
    maps = _prefilter(grid, limits, jnp.asarray(light), jnp.asarray(spectrum.coefficients))
    return LocalShrm(maps, grid, limits[0], spectrum.weighted)


def global_shrm(local: LocalShrm) -> GlobalShrm:
    """Turn every texel's function of the viewer into the world's frame (T 5.14)."""
    grid = local.grid
    assert isinstance(grid, LatLongGrid), "local maps are made on this kind of grid alone"
    maps = _turned(grid, local.order, jnp.asarray(local.maps), True)
    return GlobalShrm(maps, grid, local.band_limit, local.weighted)


def local_from_global(shrm: GlobalShrm) -> LocalShrm:
    """Turn back: the inverse of ``global_shrm``.  Raises ``ValueError`` on a cube."""
    if not isinstance(shrm.grid, LatLongGrid):
        raise ValueError("texels of a cube have no frames of T 2.10: go to a LatLongGrid first")
    maps = _turned(shrm.grid, shrm.order, jnp.asarray(shrm.maps), False)
    return LocalShrm(maps, shrm.grid, shrm.band_limit, shrm.weighted)


@checked
def central_coefficients(
    light: Coefficients | Light,
    spectrum: CentralSpectrum,
    world_from_central: Float[AnyArray, "point 3 3"],
) -> Float[Array, "point outgoing channel"]:
    """Compute B_pq in given frames by rotating the light into each (T 5.9): the twin of the map.

    Raises ``ValueError`` for different degrees.
    """
    light = coefficients_of(light, spectrum.band_limits[0])
    limits = _check(light, spectrum)
    local = rotate(jnp.asarray(light), jnp.swapaxes(jnp.asarray(world_from_central), -1, -2))
    rho = jnp.asarray(spectrum.coefficients)
    degree, order = degrees(limits[1]), np.abs(orders(limits[1]))
    exists = order <= min(limits)
    by_outgoing = rho[:, degree, np.where(exists, order, 0)]
    by_outgoing = by_outgoing * jnp.asarray(exists[None, :, None], rho.dtype)
    light_degree = np.arange(limits[0] + 1)[:, None]
    inside = np.abs(orders(limits[1]))[None, :] <= light_degree
    place = np.where(inside, light_degree * (light_degree + 1) + orders(limits[1])[None, :], 0)
    seen = local[:, place] * jnp.asarray(inside, local.dtype)[None, :, :, None]
    return _einsum("xlkc,lkc->xkc", seen, jnp.broadcast_to(by_outgoing, seen.shape[1:]))


def check_rows(grid: LatLongGrid, limits: tuple[int, int]):
    """Raise ``ValueError`` where a map of degrees (F, P) would alias on a grid."""
    least = least_rows(*limits)
    if grid.band_limit < sum(limits):
        raise ValueError(
            f"a map of {grid.height} x {grid.width} texels aliases: degrees (F, P) = {limits} "
            f"need {least} rows and columns or more, and about {10 * max(limits[0], 1)} rows to "
            "interpolate between; give a finer map, or keep fewer degrees"
        )


def _check(light: Coefficients, spectrum: CentralSpectrum) -> tuple[int, int]:
    limits = spectrum.band_limits
    if band_limit_of(light.shape[0]) != limits[0]:
        raise ValueError(
            f"light to degree {band_limit_of(light.shape[0])} and a BRDF to {limits[0]}: cut or "
            "extend one of them to the other's band limit"
        )
    return limits


@partial(jax.jit, static_argnums=(0, 1))
def _prefilter(
    grid: LatLongGrid,
    limits: tuple[int, int],
    light: Float[Array, "coefficient #channel"],
    rho: Float[Array, "degree outgoing_degree order #channel"],
) -> Float[Array, "row column outgoing channel"]:
    first, second = limits
    cosine, sine = _by_order(light)
    channels = max(light.shape[1], rho.shape[3])
    parts, places = [], []
    for q in range(second + 1):
        kept = np.arange(q, second + 1)
        if q > first:
            dark = jnp.zeros((grid.height, first + 1, 2, len(kept), channels), light.dtype)
            parts += [dark, dark]
        else:
            even, odd = (jnp.asarray(t, light.dtype) for t in _tables(grid, first, q))
            # [order, degree, trig, outgoing degree, channel]
            product = jnp.stack([cosine, sine], axis=2)[:, :, :, None] * rho[None, :, None, q:, q]
            parts.append(_einsum("mlr,mltpc->rmtpc", even, product))
            turned = jnp.stack([product[:, :, 1], -product[:, :, 0]], axis=2)
            parts.append(_einsum("mlr,mltpc->rmtpc", odd, turned))
        places += [kept * (kept + 1) + q, kept * (kept + 1) - q]
    # The map of -0 is that of 0 again, and dark: it is left out.
    del parts[1], places[1]
    order = np.argsort(np.concatenate(places))
    waves = jnp.concatenate(parts, axis=3)[:, :, :, order]
    count = coefficient_count(second)
    # Rows stay where they are and maps stay innermost: a product over the waves, and no transposing
    # of the maps, which are by far the largest array here.
    flat = waves.reshape(grid.height, 2 * (first + 1), count * channels)
    angles = np.multiply.outer(grid.azimuths(), np.arange(first + 1))
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(grid.width, -1)
    maps = _einsum("jw,rwk->rjk", jnp.asarray(around, flat.dtype), flat)
    return maps.reshape(*grid.shape, count, channels)


def _by_order(light: Float[Array, "coefficient channel"]) -> tuple[Array, Array]:
    """Take the coefficients of cos(m phi) and sin(m phi) as [order, degree, channel]."""
    band_limit = band_limit_of(light.shape[0])
    degree, order = degrees(band_limit), orders(band_limit)
    size = (band_limit + 1, band_limit + 1, light.shape[1])
    both = []
    for chosen in (order >= 0, order < 0):
        empty = jnp.zeros(size, light.dtype)
        place = (np.abs(order[chosen]), degree[chosen])
        both.append(empty.at[place].set(light[np.flatnonzero(chosen)], unique_indices=True))
    return both[0], both[1]


@lru_cache(maxsize=64)
def _tables(
    grid: LatLongGrid, band_limit: int, q: int
) -> tuple[Float[np.ndarray, "order degree row"], Float[np.ndarray, "order degree row"]]:
    """Tabulate T+ and T- of one q at the rows' polar angles, orders m >= 0."""
    quarter = quarter_turn(band_limit)
    order = np.arange(-band_limit, band_limit + 1)
    turns = np.multiply.outer(order, grid.polar_angles())
    both = quarter * quarter[:, band_limit + q][:, None, :]
    # cos(k alpha + (m - q) pi / 2) with k alpha in ``turns``.
    shift = (order - q) % 4
    cosine, sine = both @ np.cos(turns), both @ np.sin(turns)
    pick = np.array([1.0, 0.0, -1.0, 0.0])[shift], np.array([0.0, -1.0, 0.0, 1.0])[shift]
    small_d = pick[0][None, :, None] * cosine + pick[1][None, :, None] * sine
    up, down = small_d[:, band_limit:], small_d[:, band_limit::-1]
    m = np.arange(band_limit + 1)
    signed = np.where(m % 2 == 0, 1.0, -1.0)[None, :, None] * up
    half = np.where(m == 0, np.sqrt(0.5), 1.0) * (np.sqrt(0.5) if q == 0 else 1.0)
    sign = (-1.0) ** q
    even = sign * half[None, :, None] * (signed + down)
    odd = sign * (signed - down)
    even, odd = (np.ascontiguousarray(np.swapaxes(t, 0, 1)) for t in (even, odd))
    return even, odd


@partial(jax.jit, static_argnums=(0, 1, 3))
def _turned(
    grid: LatLongGrid,
    order: int,
    maps: Float[Array, "row column outgoing channel"],
    outwards: bool,
) -> Float[Array, "row column outgoing channel"]:
    """Rotate every texel's coefficients by Rz(beta) Ry(alpha), or back."""
    tilts = jnp.asarray(_tilts(grid, order), maps.dtype)
    signed = orders(order)
    turns = np.multiply.outer(grid.azimuths(), signed)
    cosine, sine = (jnp.asarray(wave(turns), maps.dtype) for wave in (np.cos, np.sin))
    cosine, sine = cosine[None, :, :, None], sine[None, :, :, None]
    partner = np.arange(len(signed)) - 2 * signed
    if outwards:
        tilted = _einsum("rks,rcsd->rckd", tilts, maps)
        return cosine * tilted - sine * tilted[:, :, partner]
    spun = cosine * maps + sine * maps[:, :, partner]
    return _einsum("rsk,rcsd->rckd", tilts, spun)


@lru_cache(maxsize=16)
def _tilts(grid: LatLongGrid, order: int) -> Float[np.ndarray, "row outgoing outgoing"]:
    """The matrices of Ry(alpha) of each row, all degrees side by side."""
    with jax.ensure_compile_time_eval():
        alpha = jnp.asarray(grid.polar_angles())
        zero = jnp.zeros_like(alpha)
        blocks = np.asarray(rotation_matrices(rotation(alpha, zero, zero), order))
    degree, m = degrees(order), orders(order)
    same = degree[:, None] == degree[None, :]
    index = m + order
    picked = blocks[:, degree[:, None], index[:, None], index[None, :]]
    return np.where(same[None], picked, 0.0)
