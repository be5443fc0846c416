"""Between a latitude-longitude image and its coefficients: ``analyse`` and ``synthesise``.

    f_lm = sum over texels of weight x image x Y_lm,      image = sum_lm f_lm Y_lm

The sums separate: one along the rows of the image (azimuth), then one down its columns (Legendre).
The azimuthal sum is a matrix product at low degree and an FFT at high; rows at equal height above
and below the equator are folded into their sum and difference, which are all that functions of even
and odd l - m see; orders are taken in blocks, so that the tables hold few of the functions with
m > l, which vanish.  The ``_dense`` twins are the sums as written.

On a grid, synthesise then analyse returns coefficients up to the grid's band limit exactly.
"""

from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics.basis import real_basis
from jaxrender.harmonics.grids import LatLongGrid
from jaxrender.harmonics.indexing import band_limit_of, coefficient_count, degrees, orders
from jaxrender.harmonics.legendre import associated
from jaxrender.shapes import Array, Coefficients, Float, ImageArray, Int

# Measured on two cores: above it the FFT beats the matrix product over the columns.
_HIGHEST_DEGREE_BY_PRODUCT = 63
_ORDERS_PER_BLOCK = 32

_einsum = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


class _Block(NamedTuple):
    """Associated functions of orders [first, first + count) on the northern rows, by parity."""

    first: int
    count: int
    even: Float[np.ndarray, "order step row"]
    """p_lm of l = m, m + 2, ...; zero beyond the band limit."""
    odd: Float[np.ndarray, "order step row"]
    """p_lm of l = m + 1, m + 3, ...; zero beyond the band limit."""


def analyse(
    grid: LatLongGrid, image: ImageArray, band_limit: int
) -> Float[Array, "coefficient channel"]:
    """Return the coefficients f_lm of an image, degrees 0 to F.

    Raises ValueError if the image is not the grid's or if F exceeds the grid's band limit.
    """
    _check_analysis(grid, image, band_limit)
    return _analyse(grid, band_limit, jnp.asarray(image))


def synthesise(grid: LatLongGrid, coefficients: Coefficients) -> Float[Array, "row column channel"]:
    """Return the image of a function given by its coefficients, at any band limit.

    Raises ValueError if the number of coefficients is not a square.
    """
    return _synthesise(grid, band_limit_of(coefficients.shape[0]), jnp.asarray(coefficients))


def analyse_dense(
    grid: LatLongGrid, image: ImageArray, band_limit: int
) -> Float[Array, "coefficient channel"]:
    """Return the same as ``analyse`` by the plain sum over all texels; raises the same."""
    _check_analysis(grid, image, band_limit)
    values = jnp.asarray(image)
    basis = real_basis(jnp.asarray(grid.directions(), values.dtype), band_limit)
    weights = jnp.asarray(grid.weights(), values.dtype)
    return _einsum("hw,hwk,hwc->kc", weights, basis, values)


def synthesise_dense(
    grid: LatLongGrid, coefficients: Coefficients
) -> Float[Array, "row column channel"]:
    """Return the same as ``synthesise`` by the plain sum over all coefficients; raises the same."""
    values = jnp.asarray(coefficients)
    directions = jnp.asarray(grid.directions(), values.dtype)
    return _einsum("hwk,kc->hwc", real_basis(directions, band_limit_of(values.shape[0])), values)


def _check_analysis(grid: LatLongGrid, image: ImageArray, band_limit: int):
    coefficient_count(band_limit)
    if image.shape[:2] != grid.shape:
        raise ValueError(
            f"an image of {image.shape[0]} x {image.shape[1]} texels on a grid of "
            f"{grid.height} x {grid.width}; make the grid from the image's shape"
        )
    if band_limit > grid.band_limit:
        raise ValueError(
            f"degree {band_limit} cannot be told from {grid.height} x {grid.width} texels; "
            f"ask for {grid.band_limit} or less, or give a larger image"
        )


@partial(jax.jit, static_argnums=(0, 1))
def _analyse(grid: LatLongGrid, band_limit: int, image: Array) -> Array:
    channels = image.shape[-1]
    waves = _waves_from_image(grid, band_limit, image)  # [row, trig, order, channel]
    weights = jnp.asarray(grid.row_weights(), image.dtype)
    total, difference = _fold(waves * weights[:, None, None, None])
    parts = []
    for block in _blocks(grid, band_limit):
        own = slice(block.first, block.first + block.count)
        by_parity = [
            _einsum("mdr,rtmc->mdtc", jnp.asarray(table, image.dtype), folded[:, :, own])
            for table, folded in ((block.even, total), (block.odd, difference))
        ]
        parts += [part.reshape(-1, channels) for part in by_parity]
    return jnp.concatenate(parts)[_places(band_limit)]


@partial(jax.jit, static_argnums=(0, 1))
def _synthesise(grid: LatLongGrid, band_limit: int, coefficients: Array) -> Array:
    channels = coefficients.shape[-1]
    packed = jnp.zeros((_packed_size(band_limit), channels), coefficients.dtype)
    packed = packed.at[_places(band_limit)].set(coefficients, unique_indices=True)
    totals, differences, start = [], [], 0
    for block in _blocks(grid, band_limit):
        for table, folded in ((block.even, totals), (block.odd, differences)):
            steps = table.shape[1]
            stop = start + 2 * block.count * steps
            part = packed[start:stop].reshape(block.count, steps, 2, channels)
            folded.append(_einsum("mdr,mdtc->rtmc", jnp.asarray(table, packed.dtype), part))
            start = stop
    total, difference = jnp.concatenate(totals, axis=2), jnp.concatenate(differences, axis=2)
    return _image_from_waves(grid, band_limit, _unfold(total, difference, grid.height))


def _waves_from_image(grid: LatLongGrid, band_limit: int, image: Array) -> Array:
    """Return the sums over each row of image x (cos, sin)(m phi): [row, trig, order, channel]."""
    if _by_product(grid, band_limit):
        return _einsum(
            "tmw,hwc->htmc", jnp.asarray(_trigonometry(grid, band_limit), image.dtype), image
        )
    spectrum = jnp.fft.rfft(image, axis=1)[:, : band_limit + 1]
    # The first column lies half a texel from azimuth 0.
    turned = spectrum * _half_texel(grid, band_limit, spectrum.dtype)
    return jnp.stack([turned.real, -turned.imag], axis=1)


def _image_from_waves(grid: LatLongGrid, band_limit: int, waves: Array) -> Array:
    """Return the sum of waves x (cos, sin)(m phi): the adjoint of ``_waves_from_image``."""
    if _by_product(grid, band_limit):
        return _einsum(
            "tmw,htmc->hwc", jnp.asarray(_trigonometry(grid, band_limit), waves.dtype), waves
        )
    turned = jax.lax.complex(waves[:, 0], -waves[:, 1])
    turned = turned * jnp.conj(_half_texel(grid, band_limit, turned.dtype))
    # irfft counts every order but 0 twice, for its conjugate.
    share = jnp.asarray(np.where(np.arange(band_limit + 1) == 0, 1.0, 0.5), turned.dtype)
    spectrum = turned * share[None, :, None]
    return jnp.fft.irfft(spectrum, n=grid.width, axis=1) * grid.width


def _by_product(grid: LatLongGrid, band_limit: int) -> bool:
    # An order of width / 2 or more, which only synthesis meets, has no place of its own in the FFT.
    return band_limit <= _HIGHEST_DEGREE_BY_PRODUCT or 2 * band_limit >= grid.width


def _half_texel(grid: LatLongGrid, band_limit: int, dtype) -> Array:
    angles = np.arange(band_limit + 1) * np.pi / grid.width
    return jnp.asarray(np.exp(-1j * angles), dtype)[None, :, None]


def _fold(waves: Array) -> tuple[Array, Array]:
    """Return north plus south and north minus south; the equator's row, its own mirror, once."""
    height = waves.shape[0]
    north, south = waves[: (height + 1) // 2], waves[::-1][: height // 2]
    if height % 2:
        south = jnp.pad(south, ((0, 1), (0, 0), (0, 0), (0, 0)))
    return north + south, north - south


def _unfold(total: Array, difference: Array, height: int) -> Array:
    """Return all rows, north first, from the parts even and odd about the equator."""
    south = (total - difference)[: height // 2]
    return jnp.concatenate([total + difference, south[::-1]])


@lru_cache(maxsize=32)
def _trigonometry(grid: LatLongGrid, band_limit: int) -> Float[np.ndarray, "trig order column"]:
    angles = np.multiply.outer(np.arange(band_limit + 1), grid.azimuths())
    return np.stack([np.cos(angles), np.sin(angles)])


@lru_cache(maxsize=8)
def _blocks(grid: LatLongGrid, band_limit: int) -> tuple[_Block, ...]:
    """Tabulate the associated functions on the northern rows, in blocks of orders."""
    polar = grid.polar_angles()[: (grid.height + 1) // 2]
    table = associated(np.cos(polar), np.sin(polar), band_limit)
    return tuple(
        _Block(first, count, *(_aligned(table, first, count, parity) for parity in (0, 1)))
        for first, count in _block_orders(band_limit)
    )


def _aligned(table: np.ndarray, first: int, count: int, parity: int) -> np.ndarray:
    """Return [order, step, row] of p_{m + 2 step + parity, m}, zero beyond the band limit."""
    degree, order = _block_degrees(table.shape[0] - 1, first, count, parity)
    inside = degree < table.shape[0]
    return np.where(inside[..., None], table[np.where(inside, degree, 0), order], 0.0)


def _block_orders(band_limit: int) -> list[tuple[int, int]]:
    """Return the first order and the number of orders of each block."""
    firsts = range(0, band_limit + 1, _ORDERS_PER_BLOCK)
    return [(first, min(_ORDERS_PER_BLOCK, band_limit + 1 - first)) for first in firsts]


def _block_degrees(
    band_limit: int, first: int, count: int, parity: int
) -> tuple[Int[np.ndarray, "order step"], Int[np.ndarray, "order step"]]:
    """Return degree and order of each entry of a block's table of one parity."""
    steps = (band_limit - first - parity) // 2 + 1
    order = first + np.arange(count)[:, None] + np.zeros((1, steps), int)
    return order + parity + 2 * np.arange(steps)[None, :], order


def _packed_size(band_limit: int) -> int:
    """Return the number of entries [order, step, trig] of all blocks and both parities."""
    blocks = _block_orders(band_limit)
    return sum(2 * _block_degrees(band_limit, *b, p)[0].size for b in blocks for p in (0, 1))


@lru_cache(maxsize=32)
def _places(band_limit: int) -> Int[np.ndarray, " coefficient"]:
    """Return where each flat coefficient stands among the packed [order, step, trig] entries."""
    place = np.zeros((band_limit + 1, band_limit + 1, 2), int)
    start = 0
    for first, count in _block_orders(band_limit):
        for parity in (0, 1):
            degree, order = _block_degrees(band_limit, first, count, parity)
            entry = start + 2 * np.arange(degree.size).reshape(degree.shape)
            inside = degree <= band_limit
            place[degree[inside], order[inside], 0] = entry[inside]
            place[degree[inside], order[inside], 1] = entry[inside] + 1
            start += 2 * degree.size
    order = orders(band_limit)
    return place[degrees(band_limit), np.abs(order), (order < 0).astype(int)]
