"""Densities of a tree without a table: the slice at each fixed place, contracted when asked for.

With some variables held fixed, a Haar tree of few coefficients becomes a function of the others by
going down the nodes whose support holds the fixed place: all their places along the other axes, one
along the fixed ones.  It is the slower, leaner twin of ``sampling.TabulatedDensities``.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Bool, Float, Int
from jaxrender.wavelets.sampling import (
    CellDensities,
    FixedPoints,
    Points,
    Slices,
    cells_at,
    free_axes,
    prepared,
    probabilities,
    pyramid_over,
)
from jaxrender.wavelets.traversal import Traversal
from jaxrender.wavelets.tree import CoefficientTree

# Numbers looked at in one go: bounds the memory of a batch of slices.
_AT_ONCE = 1 << 22


class SlicedDensities(CellDensities):
    """The tree itself: each point's slice is contracted from the nodes that its fixed place is in.

    Work for each point grows with the number of cells of a slice.
    """

    axes: int = eqx.field(static=True)
    fixed_axes: tuple[int, ...] = eqx.field(static=True)
    levels: int = eqx.field(static=True)
    nothing: Float[AnyArray, ""]
    links: Traversal
    support: Float[AnyArray, "cell"]

    @classmethod
    def of(
        cls,
        tree: CoefficientTree,
        fixed_axes: tuple[int, ...] = (),
        levels: int | None = None,
        weights: Float[AnyArray, "channel"] | None = None,
        support: Float[np.ndarray, "*size"] | Bool[np.ndarray, "*size"] | None = None,
    ) -> "SlicedDensities":
        """Take a tree as it is; raises as the base says."""
        ready = prepared(tree, fixed_axes, levels, weights, support)
        cells, tree = jnp.asarray(ready.support), ready.tree
        shape = tree.axes, fixed_axes, tree.levels, ready.nothing
        return cls(*shape, Traversal.of(tree), cells)

    @property
    def size(self) -> int:
        """Of the levels that are looked at."""
        return 1 << self.levels

    def slice_at(self, place: Float[AnyArray, "fixed"]) -> Float[Array, "cell"]:
        """Evaluate the tree in all cells of the axes not fixed, in Morton's order, not clamped.

        In half b of a cell of level l (a bit for each axis) the coefficient of selector nu counts
        2^(l axes / 2) (-1)^popcount(nu & b); means over coarser cells would lack the finer levels'
        (ERRATA 79).
        """
        cell = cells_at(place, self.levels)
        free = free_axes(self.axes, self.fixed_axes)
        children = np.arange(1 << len(free))
        children = sum((children >> k & 1) << axis for k, axis in enumerate(free))
        value, node = jnp.asarray(self.links.root), jnp.zeros(1, np.int32)
        for level in range(self.levels):
            half = (cell >> (self.levels - 1 - level)) & 1
            child = jnp.asarray(children, np.int32)
            for k, axis in enumerate(self.fixed_axes):
                child = child | half[k] << axis
            added = self._added(node, child) * 2.0 ** (level * self.axes / 2)
            value = (value[:, None] + added).ravel()
            node = self._children(node, child).ravel()
        return value

    def _added(self, node: Int[Array, "node"], child: Int[Array, "child"]) -> Array:
        selector = np.arange(1, 1 << self.axes, dtype=np.int32)
        masks = self.links.value_masks[node][:, None]
        row = self.links.first_value[node][:, None]
        row = row + jax.lax.population_count(masks & ((1 << selector) - 1)[None])
        held = jnp.asarray(self.links.values).at[row, 0].get(mode="fill", fill_value=0)
        held = jnp.where((masks >> selector[None]) & 1 == 1, held, 0)
        odd = jax.lax.population_count(selector[:, None] & child[None]) & 1
        return jnp.matmul(held, (1 - 2 * odd).astype(held.dtype), precision="highest")

    def _children(self, node: Int[Array, "node"], child: Int[Array, "child"]) -> Array:
        masks, child = self.links.child_masks[node][:, None], child[None]
        before = jax.lax.population_count(masks & ((1 << child) - 1))
        following = self.links.first_child[node][:, None] + before
        absent = len(self.links.child_masks) - 1
        return jnp.where((masks >> child) & 1 == 1, following, absent)

    def with_slices(self, function: Callable, fixed: FixedPoints, numbers: Points) -> Any:
        """Apply it to one slice after another, in batches that memory bounds."""

        def at_point(pair: tuple[Array, Array]):
            rows = probabilities(self.slice_at(pair[0])[None], self.support, self.nothing)
            slices = Slices(pyramid_over(rows, self.axes - len(self.fixed_axes)), self.support)
            found = function(slices, jnp.zeros(1, np.int32), pair[1][None])
            return jax.tree.map(lambda leaf: leaf[0], found)

        at_once = max((_AT_ONCE >> self.axes) // len(self.support), 1)
        return jax.lax.map(at_point, (fixed, numbers), batch_size=min(at_once, len(numbers)) or 1)
