"""A BRDF seen from a direction, integrated over every Haar function of the incident direction.

    p_{l,s,m} = int int F(k, l, k_r, l_r) G_{l,m_0,s[0]}(k) G_{l,m_1,s[1]}(l) dk dl

in the columns of a pyramid (``slices``), for samples (k_r, l_r) of the tree.  What the
BRDF's coefficients leave with the direction held is integrated over the cells of the finest Haar
functions, exactly (``overlaps``); those of coarser levels are sums and differences.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.reflection.wavelet_shading.overlaps import cell_integrals
from jaxrender.reflection.wavelet_shading.slices import (
    Samples,
    Slices,
    added_up,
    columns,
    levels_apart,
    pairs_at,
    sliced,
)
from jaxrender.shapes import Array, Float, Int
from jaxrender.wavelets.tree import CoefficientTree

# Haar's functions on their two halves, but for their size: the scaling function, the wavelet.
HALVES = np.array([[1.0, 1.0], [1.0, -1.0]])

# Pairs of a direction and a coefficient in one go.
_PAIRS_AT_ONCE = 1 << 21


class Opened(NamedTuple):
    """A tree that is sorted by two axes, and its values, the root's first."""

    tree: CoefficientTree
    slices: Slices
    values: Float[Array, "coefficient channel"]


def opened(tree: CoefficientTree, held: tuple[int, int], channels: int, dtype: np.dtype) -> Opened:
    """Sort a tree by the places along two axes, and repeat a single channel."""
    root, values = jnp.asarray(tree.root, dtype), jnp.asarray(tree.values, dtype)
    values = jnp.concatenate([root[None], values])
    return Opened(tree, sliced(tree, held), jnp.broadcast_to(values, (values.shape[0], channels)))


def projections(brdf: Opened, samples: Samples, cells: int) -> Float[Array, "row column channel"]:
    """Project the BRDF seen from samples of its reflected axes on Haar functions of ``cells``.

    There may be more rows, of zeros, up to a power of two.
    """
    costs = np.cumsum(brdf.slices.counts(samples))
    parts = np.split(samples, np.flatnonzero(np.diff(costs // _PAIRS_AT_ONCE)) + 1)
    integrals = tuple(
        jnp.asarray(table, brdf.values.dtype) for table in cell_integrals(brdf.tree, cells)
    )
    found = [_projections(brdf, some, integrals) for some in parts]
    if len(found) == 1:
        return found[0]
    return jnp.concatenate([part[: len(some)] for part, some in zip(found, parts)])


def power_of_two(length: int) -> int:
    """Round up."""
    return 1 << (length - 1).bit_length()


def padded(indices: np.ndarray, fill: int = 0) -> np.ndarray:
    """Lengthen a list to a power of two, so that few programs serve all lengths; int32 if int."""
    length = power_of_two(max(len(indices), 256))
    dtype = np.int32 if indices.dtype.kind == "i" else indices.dtype
    longer = np.full(length, fill, dtype)
    longer[: len(indices)] = indices
    return longer


def _projections(
    brdf: Opened, samples: Samples, integrals: tuple[Float[Array, "2 _ cell"], ...]
) -> Float[Array, "row column channel"]:
    pairs = pairs_at(brdf.slices, samples)
    held = columns(brdf.slices.size)
    weights = padded(pairs.weight).astype(brdf.values.dtype)
    slot, coefficient = padded(pairs.row * held + pairs.column), padded(pairs.coefficient)
    rows = power_of_two(len(samples))
    return _project(rows, integrals, brdf.values, slot, coefficient, weights)[: len(samples)]


@partial(jax.jit, static_argnums=0)
def _project(
    rows: int,
    integrals: tuple[Float[Array, "2 _ cell"], ...],
    values: Float[Array, "coefficient channel"],
    slot: Int[Array, "pair"],
    coefficient: Int[Array, "pair"],
    weights: Float[Array, "pair"],
) -> Float[Array, "row column channel"]:
    width = 4 * sum(table.shape[1] ** 2 for table in integrals)
    held = added_up(weights[:, None] * values[coefficient], slot, rows * width)
    pyramid = jnp.moveaxis(held.reshape(rows, width, -1), 2, 1)
    total = None
    for table, part in zip(integrals, levels_apart(pyramid)):
        over = jnp.einsum("rcbamn,ami,bnj->rcij", part, table, table, precision="highest")
        total = over if total is None else total + over
    assert total is not None
    return jnp.moveaxis(_halved(total), 1, 2)


def _halved(cells: Float[Array, "row channel i j"]) -> Float[Array, "row channel column"]:
    """From integrals over cells to those over Haar functions, from fine to coarse."""
    rows, channels, size, _ = cells.shape
    if size == 1:
        return jnp.pad(cells[..., 0], ((0, 0), (0, 0), (0, 3)))
    halves = jnp.asarray(HALVES, cells.dtype)
    found = []
    while size > 1:
        size //= 2
        halved = cells.reshape(rows, channels, size, 2, size, 2)
        four = jnp.einsum("rcmhng,ah,bg->rcbamn", halved, halves, halves, precision="highest")
        found.append(size * four.reshape(rows, channels, -1))
        cells = four[:, :, 0, 0]
    return jnp.concatenate(found[::-1], axis=-1)
