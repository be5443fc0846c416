"""Between an image and its coefficients: ``analyse`` and ``synthesise``, on any grid.

    f_lm = sum over texels of weight x image x Y_lm,      image = sum_lm f_lm Y_lm

On a separable grid the sums separate: one along the rows of the image (``azimuth``), then one down
its columns (Legendre).  Rows at equal height above and below the equator are folded into their sum
and difference, which are all that functions of even and odd l - m see; orders are taken in blocks,
so that the tables hold few of the functions with m > l, which vanish.  On other grids the harmonics
are evaluated a chunk of texels at a time.  The ``_dense`` twins are the sums as written.

Where the grid is exact, synthesise then analyse returns coefficients up to its band limit exactly.
"""

from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics.azimuth import image_from_waves, waves_from_image
from jaxrender.harmonics.basis import evaluate, real_basis
from jaxrender.harmonics.grids import Grid, SeparableGrid
from jaxrender.harmonics.indexing import band_limit_of, coefficient_count, degrees, orders
from jaxrender.harmonics.legendre import associated
from jaxrender.programs import stored
from jaxrender.shapes import Array, Coefficients, Float, ImageArray, Int, checked

_ORDERS_PER_BLOCK = 32
# Up to here there are so few functions that what counts is to read the image once.
_HIGHEST_DEGREE_IN_ONE_PASS = 2

_einsum = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


class _Block(NamedTuple):
    """Associated functions of orders [first, first + count) on the northern rows, by parity."""

    first: int
    count: int
    even: Float[np.ndarray, "order step row"]
    """p_lm of l = m, m + 2, ...; zero beyond the band limit."""
    odd: Float[np.ndarray, "order step row"]
    """p_lm of l = m + 1, m + 3, ...; zero beyond the band limit."""


@checked
def analyse(grid: Grid, image: ImageArray, band_limit: int) -> Float[Array, "coefficient channel"]:
    """Return the coefficients f_lm of an image, degrees 0 to F.

    Raises ValueError if the image is not the grid's or if F exceeds the grid's band limit.
    """
    _check_analysis(grid, image, band_limit)
    # A call of jnp.asarray takes as long as reading a small image does.
    values = image if isinstance(image, jax.Array) else jnp.asarray(image)
    if not isinstance(grid, SeparableGrid):
        return _analyse_directly(grid, band_limit, values)
    return _analyse(grid, band_limit, values)


@checked
def synthesise(grid: Grid, coefficients: Coefficients) -> Float[Array, "row column channel"]:
    """Return the image of a function given by its coefficients, at any band limit.

    Raises ValueError if the number of coefficients is not a square.
    """
    band_limit = band_limit_of(coefficients.shape[0])
    if not isinstance(grid, SeparableGrid):
        return _synthesise_directly(grid, jnp.asarray(coefficients))
    return _synthesise(grid, band_limit, jnp.asarray(coefficients))


@checked
def analyse_dense(
    grid: Grid, image: ImageArray, band_limit: int
) -> Float[Array, "coefficient channel"]:
    """Return the same as ``analyse`` by the plain sum over all texels; raises the same."""
    _check_analysis(grid, image, band_limit)
    values = jnp.asarray(image)
    basis = real_basis(jnp.asarray(grid.directions(), values.dtype), band_limit)
    weights = jnp.asarray(grid.weights(), values.dtype)
    return _einsum("hw,hwk,hwc->kc", weights, basis, values)


@checked
def synthesise_dense(grid: Grid, coefficients: Coefficients) -> Float[Array, "row column channel"]:
    """Return the same as ``synthesise`` by the plain sum over all coefficients; raises the same."""
    values = jnp.asarray(coefficients)
    directions = jnp.asarray(grid.directions(), values.dtype)
    return _einsum("hwk,kc->hwc", real_basis(directions, band_limit_of(values.shape[0])), values)


def check_image(grid: Grid, image: ImageArray):
    """Raise ValueError unless the image is the grid's."""
    if image.shape[:2] != grid.shape:
        raise ValueError(
            f"an image of {image.shape[0]} x {image.shape[1]} texels on a grid of "
            f"{grid.shape[0]} x {grid.shape[1]}; make the grid from the image's shape"
        )


def _check_analysis(grid: Grid, image: ImageArray, band_limit: int):
    coefficient_count(band_limit)
    check_image(grid, image)
    if band_limit > grid.band_limit:
        raise ValueError(
            f"degree {band_limit} cannot be determined from {grid.shape[0]} x {grid.shape[1]} "
            f"texels; ask for {grid.band_limit} or less, or give a larger image"
        )


@partial(jax.jit, static_argnums=(0, 1))
def _analyse_directly(grid: Grid, band_limit: int, image: Array) -> Array:
    """Return the weighted adjoint of ``_synthesise_directly``."""
    channels = image.shape[-1]
    start = jnp.zeros((coefficient_count(band_limit), channels), image.dtype)
    _, adjoint = jax.vjp(partial(_synthesise_directly, grid), start)
    return adjoint(image * jnp.asarray(grid.weights(), image.dtype)[:, :, None])[0]


@partial(jax.jit, static_argnums=0)
def _synthesise_directly(grid: Grid, coefficients: Array) -> Array:
    """Return the image on a grid whose sums do not separate, a chunk of texels at a time."""
    directions = jnp.asarray(grid.directions().reshape(-1, 3), coefficients.dtype)
    return evaluate(coefficients, directions).reshape(*grid.shape, -1)


@stored(partial(jax.jit, static_argnums=(0, 1)), effort="less")
def _analyse(grid: SeparableGrid, band_limit: int, image: Array) -> Array:
    if band_limit <= _HIGHEST_DEGREE_IN_ONE_PASS:
        return _analyse_in_one_pass(grid, band_limit, image)
    channels = image.shape[-1]
    weights = jnp.asarray(grid.row_weights(), image.dtype)
    waves = waves_from_image(grid, band_limit, image) * weights[None, None, None, :]
    total, difference = _fold(waves)
    parts = []
    for block in _blocks(grid, band_limit):
        own = slice(block.first, block.first + block.count)
        for table, folded in ((block.even, total), (block.odd, difference)):
            # Few rows times a wide table: measured 2.5 times faster than the table first.
            falling = jnp.asarray(np.swapaxes(table, 1, 2), image.dtype)
            part = _einsum("mtcr,mrd->mtcd", folded[own], falling)
            parts.append(jnp.transpose(part, (0, 3, 1, 2)).reshape(-1, channels))
    return jnp.concatenate(parts)[_places(band_limit)]


def _analyse_in_one_pass(grid: SeparableGrid, band_limit: int, image: Array) -> Array:
    """Return the same by one matrix product over the image as it lies, down its columns first.

    The associated functions to degree F are sums of 2F + 1 waves of the polar angle: five products
    a texel make nine coefficients.
    """
    polar, weights = grid.polar_angles(), grid.row_weights()
    down = jnp.asarray(_polar_waves(polar, band_limit) * weights, image.dtype)
    columns = jnp.matmul(down, image.reshape(grid.height, -1), precision="highest")
    signed = orders(band_limit)[:, None]
    angles = np.abs(signed) * grid.azimuths()
    along = np.where(signed < 0, np.sin(angles), np.cos(angles))
    across = np.einsum("ik,iw->ikw", _waves_of_functions(band_limit), along)
    across = jnp.asarray(across.reshape(len(across), -1), image.dtype)
    return jnp.matmul(across, columns.reshape(across.shape[1], -1), precision="highest")


def _polar_waves(polar: Float[np.ndarray, "row"], band_limit: int) -> Float[np.ndarray, "wave row"]:
    """Evaluate 1, cos, sin, ..., cos F t, sin F t."""
    angles = np.arange(1, band_limit + 1)[:, None] * polar
    pairs = np.stack([np.cos(angles), np.sin(angles)], axis=1).reshape(-1, len(polar))
    return np.concatenate([np.ones((1, len(polar))), pairs])


def _waves_of_functions(band_limit: int) -> Float[np.ndarray, "coefficient wave"]:
    """Return what each wave counts in the associated function of every coefficient."""
    count = 2 * band_limit + 1
    polar = np.pi * (2 * np.arange(count) + 1) / (2 * count)
    table = associated(np.cos(polar), np.sin(polar), band_limit)
    functions = table[degrees(band_limit), np.abs(orders(band_limit))]
    return np.linalg.solve(_polar_waves(polar, band_limit).T, functions.T).T


@stored(partial(jax.jit, static_argnums=(0, 1)), effort="less")
def _synthesise(grid: SeparableGrid, band_limit: int, coefficients: Array) -> Array:
    channels = coefficients.shape[-1]
    packed = jnp.zeros((_packed_size(band_limit), channels), coefficients.dtype)
    packed = packed.at[_places(band_limit)].set(coefficients, unique_indices=True)
    totals, differences, start = [], [], 0
    for block in _blocks(grid, band_limit):
        for table, folded in ((block.even, totals), (block.odd, differences)):
            steps = table.shape[1]
            stop = start + 2 * block.count * steps
            part = packed[start:stop].reshape(block.count, steps, 2, channels)
            part = jnp.transpose(part, (0, 2, 3, 1))
            folded.append(_einsum("mtcd,mdr->mtcr", part, jnp.asarray(table, packed.dtype)))
            start = stop
    total, difference = jnp.concatenate(totals), jnp.concatenate(differences)
    return image_from_waves(grid, band_limit, _unfold(total, difference, grid.height))


def _fold(waves: Array) -> tuple[Array, Array]:
    """Return north plus south and north minus south; the equator's row, its own mirror, once."""
    height = waves.shape[-1]
    north, south = waves[..., : (height + 1) // 2], waves[..., ::-1][..., : height // 2]
    if height % 2:
        south = jnp.pad(south, ((0, 0), (0, 0), (0, 0), (0, 1)))
    return north + south, north - south


def _unfold(total: Array, difference: Array, height: int) -> Array:
    """Return all rows, north first, from the parts even and odd about the equator."""
    south = (total - difference)[..., : height // 2]
    return jnp.concatenate([total + difference, south[..., ::-1]], axis=-1)


@lru_cache(maxsize=8)
def _blocks(grid: SeparableGrid, band_limit: int) -> tuple[_Block, ...]:
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
