"""Light reflected by a plane, from coefficients of the radiance on it and of its BRDF (L 6.3).

    L_r(u, v, k_r, l_r) = 4 int int F(k, l, k_r, l_r) L_i(u, v, k, l) dk dl            (L 4.2, 6.8)

for any numbers of points and directions at once.  Directions are places on Nusselt's square, whose
area is the projected solid angle, hence the 4 and no cosine.  The radiance L_i, in the frame of the
surface, is in Haar's wavelet, over (u, v, kappa, lambda); the BRDF F in 1/sr is in any wavelet,
over (kappa, lambda, kappa_r, lambda_r).  Channels multiply; one channel serves all.  The integrals
are exact for the functions that the trees stand for.

The BRDF seen from a direction is a function of (kappa, lambda): its integral over each of the
radiance's cells, then by halving over each of the Haar functions (``projections``).  With
these projections p the reflected radiance is a sum over the radiance's coefficients,

    L_r = 4 sum over k of b_k G_k(u) G_k(v) p_{l,s,m}:

- from one direction (an orthographic view) each coefficient is multiplied by its projection once,
  and what is left is a function of (u, v), the radiance that leaves each cell of the surface;
- from many, the coefficients that reach a cell of the surface (``slices``) are added up to
  a sparse pyramid, which meets the projections for each pixel.  A direction's are a weighted mean
  of those for four samples of the tree, or one sample's.

Work grows with the number of coefficients that the trees hold; memory is bounded, pixels go in
pieces.  Differentiable in both trees' roots and values, which enter linearly; not in places and
directions, which are host arrays.  Slow twin: ``traversal``.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.reflection.wavelet_shading.overlaps import check_trees, taps
from jaxrender.reflection.wavelet_shading.projections import (
    HALVES,
    Opened,
    opened,
    padded,
    power_of_two,
    projections,
)
from jaxrender.reflection.wavelet_shading.slices import added_up, columns, levels_apart, pairs_at
from jaxrender.shapes import AnyArray, Array, Float, Int
from jaxrender.wavelets.nodes import interleaved
from jaxrender.wavelets.tree import CoefficientTree

# In one go: pairs of a pixel and a coefficient, and numbers in the table of projections.
_PAIRS_AT_ONCE = 1 << 20
_PROJECTED_AT_ONCE = 1 << 24


def reflected_radiance(
    light: CoefficientTree,
    brdf: CoefficientTree,
    places: Float[AnyArray, "pixel 2"],
    directions: Float[AnyArray, "direction 2"],
) -> Float[Array, "pixel channel"]:
    """Reflect the radiance at each place towards its direction, or towards the only one given.

    Places (u, v) and directions (k_r, l_r) outside the unit square count as the nearest inside.
    Raises ``ValueError`` for trees that ``check_trees`` refuses, and for another number of
    directions than one or one a pixel.
    """
    check_trees(light, brdf)
    places, directions = np.asarray(places, float), np.asarray(directions, float)
    if len(directions) not in (1, len(places)):
        raise ValueError(
            f"{len(directions)} directions and {len(places)} places; give one, or one for each"
        )
    if not len(places):
        return _opened(light, brdf)[1].values[:0]
    cells = np.clip(np.floor(places * light.size), 0, light.size - 1).astype(np.int64)
    if len(directions) == 1:
        index = (cells[:, 0] * light.size + cells[:, 1]).astype(np.int32)
        return _looked_up(reflected_cells(light, brdf, directions[0]), index)
    return _towards_many(light, brdf, cells, directions)


def reflected_cells(
    light: CoefficientTree, brdf: CoefficientTree, direction: Float[AnyArray, "2"]
) -> Float[Array, "u v channel"]:
    """Reflect the radiance of every cell of the surface, [u, v], towards one direction.

    Raises ``ValueError`` for trees that ``check_trees`` refuses.
    """
    check_trees(light, brdf)
    arriving, reflecting = _opened(light, brdf)
    samples, weights = taps(brdf, np.asarray(direction, float)[None])
    projected = projections(reflecting, samples[0], light.size)
    seen = jnp.einsum("t,tpc->pc", jnp.asarray(weights[0], projected.dtype), projected)
    slices = arriving.slices
    parts = slices.coefficient, slices.column, slices.held_column
    indices = (part.astype(np.int32) for part in parts)
    return _one_direction(light.size, arriving.values, seen, *indices)


@partial(jax.jit, static_argnums=0)
def _one_direction(
    size: int,
    values: Float[Array, "coefficient channel"],
    projected: Float[Array, "column channel"],
    coefficient: Int[Array, "value"],
    column: Int[Array, "value"],
    held_column: Int[Array, "value"],
) -> Float[Array, "u v channel"]:
    reflected = added_up(values[coefficient] * projected[column], held_column, columns(size))
    return 4 * jnp.moveaxis(_cells_of(reflected.T, size), 0, -1)


@jax.jit
def _looked_up(
    cells: Float[Array, "u v channel"], index: Int[Array, "pixel"]
) -> Float[Array, "pixel channel"]:
    return cells.reshape(-1, cells.shape[-1])[index]


def _cells_of(pyramid: Float[Array, "channel column"], size: int) -> Float[Array, "channel u v"]:
    """Evaluate a sum of Haar functions in every cell, from coarse to fine."""
    levels = levels_apart(pyramid)
    if size == 1:
        return levels[0][:, 0, 0]
    cells = jnp.zeros((len(pyramid), 1, 1), pyramid.dtype)
    halves = jnp.asarray(HALVES, pyramid.dtype)
    for level, part in enumerate(levels):
        detail = jnp.einsum("cbamn,ah,bg->cmhng", part, halves, halves, precision="highest")
        finer = (len(pyramid), 2 << level, 2 << level)
        cells = jnp.repeat(jnp.repeat(cells, 2, axis=1), 2, axis=2)
        cells = cells + 2**level * detail.reshape(finer)
    return cells


def _towards_many(
    light: CoefficientTree,
    brdf: CoefficientTree,
    cells: Int[np.ndarray, "pixel 2"],
    directions: Float[np.ndarray, "pixel 2"],
) -> Float[Array, "pixel channel"]:
    arriving, reflecting = _opened(light, brdf)
    samples, weights = taps(brdf, directions)
    seen = samples[..., 0] * brdf.size + samples[..., 1]
    # Neighbours on the surface share coefficients, and under a camera directions.
    order = np.argsort(interleaved(cells, light.levels), kind="stable")
    costs = arriving.slices.counts(cells)
    most = max(_PROJECTED_AT_ONCE // (columns(light.size) * reflecting.values.shape[1]), 4)
    found = [
        _piece(arriving, reflecting, cells[some], seen[some], weights[some])
        for some in _pieces(order, costs, seen, most)
    ]
    back = np.argsort(order, kind="stable")
    return jnp.concatenate(found)[back]


def _pieces(
    order: Int[np.ndarray, "some"],
    costs: Int[np.ndarray, "pixel"],
    seen: Int[np.ndarray, "pixel tap"],
    most: int,
) -> list[np.ndarray]:
    """Halve the pixels until each piece is cheap and looks from no more samples than ``most``."""
    cheap = costs[order].sum() <= _PAIRS_AT_ONCE and len(np.unique(seen[order])) <= most
    if cheap or len(order) <= 1:
        return [order]
    half = len(order) // 2
    parts = order[:half], order[half:]
    return [piece for part in parts for piece in _pieces(part, costs, seen, most)]


class _Merged(NamedTuple):
    """Which coefficient adds how much to which entry of the sparse pyramids."""

    coefficient: Int[AnyArray, "pair"]
    entry: Int[AnyArray, "pair"]
    weight: Float[AnyArray, "pair"]


class _Meetings(NamedTuple):
    """Which pixel meets which entry, and the pyramid's column of each entry."""

    pixel: Int[AnyArray, "met"]
    entry: Int[AnyArray, "met"]
    column: Int[AnyArray, "entry"]


class _View(NamedTuple):
    """Which of the projections each pixel sees, and with which weights."""

    samples: Int[AnyArray, "pixel tap"]
    weights: Float[AnyArray, "pixel tap"]


def _piece(
    arriving: Opened,
    reflecting: Opened,
    cells: Int[np.ndarray, "pixel 2"],
    seen: Int[np.ndarray, "pixel tap"],
    weights: Float[np.ndarray, "pixel tap"],
) -> Float[Array, "pixel channel"]:
    """Multiply what arrives at some cells, added up to sparse pyramids, by the projections."""
    size = arriving.slices.size
    corners, corner = np.unique(cells[:, 0] * size + cells[:, 1], return_inverse=True)
    pairs = pairs_at(arriving.slices, np.stack(np.divmod(corners, size), axis=1))
    places, entry = np.unique(pairs.row * columns(size) + pairs.column, return_inverse=True)
    row, column = np.divmod(places, columns(size))
    start = np.searchsorted(row, np.arange(len(corners) + 1))
    counts = (start[1:] - start[:-1])[corner]
    pixel = np.repeat(np.arange(len(cells)), counts)
    met = np.arange(len(pixel)) + np.repeat(start[corner] - np.cumsum(counts) + counts, counts)
    samples, sample = np.unique(seen, return_inverse=True)
    side = reflecting.slices.size
    table = projections(reflecting, np.stack(np.divmod(samples, side), axis=1), size)
    dtype = table.dtype
    merged = _Merged(padded(pairs.coefficient), padded(entry), padded(pairs.weight.astype(dtype)))
    # Programs are compiled for so many pixels; what goes beyond the last is dropped.
    pixels = power_of_two(len(cells))
    rows = ((0, pixels - len(cells)), (0, 0))
    meetings = _Meetings(padded(pixel, pixels), padded(met), padded(column))
    view = _View(
        np.pad(sample.reshape(seen.shape).astype(np.int32), rows),
        np.pad(weights.astype(dtype), rows),
    )
    return _inner_products(arriving.values, table, merged, meetings, view)[: len(cells)]


@jax.jit
def _inner_products(
    values: Float[Array, "coefficient channel"],
    table: Float[Array, "sample column channel"],
    merged: _Merged,
    meetings: _Meetings,
    view: _View,
) -> Float[Array, "pixel channel"]:
    coefficient, entry, weight = merged
    pixel, met, column = meetings
    light = added_up(weight[:, None] * values[coefficient], entry, len(column))
    samples, weights = view
    total = jnp.zeros((len(met), values.shape[1]), values.dtype)
    for tap in range(samples.shape[1]):
        projected = table[samples[pixel, tap], column[met]]
        total = total + weights[pixel, tap][:, None] * projected
    return 4 * added_up(total * light[met], pixel, len(samples))


def _opened(light: CoefficientTree, brdf: CoefficientTree) -> tuple[Opened, Opened]:
    """Sort both trees, in one precision and with as many channels."""
    dtype = np.result_type(*(part.dtype for t in (light, brdf) for part in (t.root, t.values)))
    channels = max(light.channels, brdf.channels)
    return opened(light, (0, 1), channels, dtype), opened(brdf, (2, 3), channels, dtype)
