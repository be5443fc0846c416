"""A Haar tree as the cells in which it is constant: the quick way to many points.

Haar's functions are constant on the 2^axes children of their node, so a node and a child have one
value, the average of the function there, and going down is following one number a level:

    average(node, b) = average above + 2^(l axes / 2) sum over nu of f_nu (-1)^(bits of nu and b)

(a wavelet is positive in the first half of its support).  Where there is no further child the
function is constant, and the way down ends early; a directory of the coarse levels starts it in
their midst.  Every cell on the way has its average, so that a coarser level of detail is a shorter
way.  ``traversal`` is the slow twin.

A forest holds several trees, such as those of a texture's texels; each point says which it asks.
"""

from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Float, Int
from jaxrender.wavelets.nodes import Structure
from jaxrender.wavelets.supports import is_stepwise
from jaxrender.wavelets.traversal import Points, levels_to_look_at
from jaxrender.wavelets.tree import CoefficientTree

# Entries of the directory, for all trees together, so that it stays in a processor's cache.
_LARGEST_DIRECTORY = 1 << 16


class CellForest(eqx.Module):
    """Haar trees of one size, made ready for evaluation; links are host or device arrays."""

    size: int = eqx.field(static=True)
    axes: int = eqx.field(static=True)
    directory_levels: int = eqx.field(static=True)
    directory: Int[AnyArray, "entry"]
    """For each tree and cell of the directory's level, the cell that it ends in."""
    below: Int[AnyArray, "cell"]
    """The first cell of the node below a cell, or -1 where the function is constant."""
    averages: Float[AnyArray, "cell channel"]
    first: Int[AnyArray, "tree"]
    roots: Float[AnyArray, "tree channel"]

    @classmethod
    def of(cls, trees: Sequence[CoefficientTree]) -> "CellForest":
        """Make trees ready; differentiable in their values.

        Raises ``ValueError`` for no tree, a wavelet other than Haar's, and trees that differ in
        size, axes or channels.
        """
        if not trees:
            raise ValueError("no tree; give at least one")
        first = trees[0]
        for tree in trees:
            if not is_stepwise(tree.wavelet):
                raise ValueError(
                    f"a tree of wavelet {tree.wavelet.name} is not constant in cells; use Haar's, "
                    "or `traversal.evaluate`"
                )
            if (tree.size, tree.axes, tree.channels) != (first.size, first.axes, first.channels):
                raise ValueError(
                    f"trees of size {first.size} and {tree.size}, {first.axes} and {tree.axes} "
                    f"axes, {first.channels} and {tree.channels} channels; resample them alike"
                )
        structures = [tree.structure for tree in trees]
        starts = np.cumsum([0, *(len(s.level) << first.axes for s in structures)])
        below = np.concatenate(
            [_below(s, first.axes, int(start)) for s, start in zip(structures, starts)]
        )
        averages = jnp.concatenate([_averages(t, s) for t, s in zip(trees, structures)])
        levels = _directory_levels(first, len(trees))
        directory = _directory(below, starts[:-1], (first.axes, levels))
        roots = jnp.stack([jnp.asarray(tree.root) for tree in trees])
        links = (jnp.asarray(part.astype(np.int32)) for part in (directory, below, starts[:-1]))
        entries, below, firsts = links
        return cls(first.size, first.axes, levels, entries, below, averages, firsts, roots)

    @property
    def levels(self) -> int:
        """How many levels the trees have room for."""
        return self.size.bit_length() - 1

    def evaluate(
        self,
        points: Points,
        tree: Int[AnyArray, "point"] | None = None,
        levels: int | None = None,
    ) -> Float[Array, "point channel"]:
        """Evaluate at points, of the first tree or of one for each point; as ``traversal`` does.

        Raises ``ValueError`` for points of another number of axes and levels out of range.
        """
        count = levels_to_look_at(self.axes, self.levels, points, levels)
        numbers = jnp.zeros(len(points), np.int32) if tree is None else jnp.asarray(tree)
        return _evaluate(self, count, jnp.asarray(points), numbers.astype(np.int32))


@partial(jax.jit, static_argnums=1)
def _evaluate(
    forest: CellForest, levels: int, points: Array, tree: Array
) -> Float[Array, "point channel"]:
    if levels == 0:
        return forest.roots[tree]
    cells = jnp.clip((points * forest.size).astype(np.int32), 0, forest.size - 1)
    start = min(forest.directory_levels, levels)
    code = _code(forest, cells, range(start))
    if start == forest.directory_levels:
        cell = forest.directory[(tree << (forest.axes * start)) + code]
    else:
        # A shorter way than the directory's: one step a level from the root's first cell.
        cell = forest.first[tree] + _code(forest, cells, range(1))
        start = 1
    for level in range(start, levels):
        child = jnp.asarray(forest.below)[cell]
        cell = jnp.where(child < 0, cell, child + _code(forest, cells, range(level, level + 1)))
    return jnp.asarray(forest.averages)[cell]


def _code(forest: CellForest, cells: Int[Array, "point axis"], levels: range) -> Array:
    """Interleave the bits of cells that belong to some levels, the coarsest highest."""
    code = jnp.zeros(len(cells), np.int32)
    for level in levels:
        shift = forest.levels - 1 - level
        for axis in reversed(range(forest.axes)):
            code = (code << 1) | ((cells[:, axis] >> shift) & 1)
    return code


def _below(structure: Structure, axes: int, start: int) -> Int[np.ndarray, "cell"]:
    """Link the cells of a tree whose own first cell is at ``start``."""
    below = np.full(len(structure.level) << axes, -1, np.int64)
    if len(structure.level) > 1:
        children = np.arange(1, len(structure.level))
        parents = np.repeat(
            np.arange(len(structure.level)), np.bitwise_count(structure.child_masks)
        )
        bit = structure.code[children] & ((1 << axes) - 1)
        below[(parents << axes) + bit] = start + (children << axes)
    return below


def _averages(tree: CoefficientTree, structure: Structure) -> Float[Array, "cell channel"]:
    """Add up each node's coefficients on its children, on top of the average above."""
    children = 1 << tree.axes
    nodes = len(structure.level)
    node, selector = structure.value_nodes, structure.value_selectors
    both = np.arange(children)[:, None] & np.arange(children)
    signs = 1.0 - 2.0 * (np.bitwise_count(both) % 2)
    values = jnp.asarray(tree.values)
    dense = jnp.zeros((nodes, children, tree.channels), values.dtype)
    dense = dense.at[node, selector].set(values)
    scale = 2.0 ** (structure.level * tree.axes / 2)
    details = jnp.einsum(
        "nsc,sb->nbc", dense, jnp.asarray(signs, values.dtype), precision="highest"
    ) * jnp.asarray(scale, values.dtype).reshape(-1, 1, 1)
    above = jnp.asarray(tree.root, values.dtype).reshape(1, 1, -1)
    found = []
    for level in range(int(structure.level.max(initial=0)) + 1):
        held = np.flatnonzero(structure.level == level)
        found.append(details[held[0] : held[-1] + 1] + above)
        bits = np.nonzero((structure.child_masks[held][:, None] >> np.arange(children)) & 1)
        above = found[-1][bits[0], bits[1]][:, None]
    return jnp.concatenate(found).reshape(-1, tree.channels)


def _directory_levels(tree: CoefficientTree, trees: int) -> int:
    """Choose as many levels as leave the directory small, at least one."""
    room = (_LARGEST_DIRECTORY // trees).bit_length() - 1
    return int(np.clip(room // tree.axes, 1, max(tree.levels, 1)))


def _directory(
    below: Int[np.ndarray, "cell"], starts: Int[np.ndarray, "tree"], shape: tuple[int, int]
) -> Int[np.ndarray, "entry"]:
    """Go down the first levels from every tree's root, for every cell of the last of them."""
    axes, levels = shape
    cell = starts[:, None] + np.arange(1 << axes)
    for _ in range(1, levels):
        child = below[cell][..., None]
        finer = np.where(child < 0, cell[..., None], child + np.arange(1 << axes))
        cell = finer.reshape(len(starts), -1)
    return cell.ravel()
