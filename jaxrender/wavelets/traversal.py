"""A tree at points, by going down from the root (L fig. 4.2; masks as ERRATA 63 and 59 have them).

At each level the nodes whose functions reach a point are the children of those that reached it one
level before: one for Haar's wavelet, a few along each axis for wider ones (``supports``).  Work and
memory grow with the number of levels, never with the number of samples.  Batched over points under
jit; differentiable in the tree's values and in the points (where functions are linear).
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Float, Int
from jaxrender.wavelets.filters import Wavelet
from jaxrender.wavelets.supports import Window, is_stepwise, windows
from jaxrender.wavelets.tree import CoefficientTree

Points = Float[AnyArray, "point axis"]

# Coefficients looked at in one go: bounds the memory of a batch.
_AT_ONCE = 1 << 22


class Traversal(eqx.Module):
    """A tree made ready for evaluation; an absent node and an absent value stand at the end."""

    wavelet: Wavelet = eqx.field(static=True)
    size: int = eqx.field(static=True)
    axes: int = eqx.field(static=True)
    offset: float = eqx.field(static=True)
    root: Float[AnyArray, "channel"]
    values: Float[AnyArray, "value channel"]
    child_masks: Int[AnyArray, "node"]
    value_masks: Int[AnyArray, "node"]
    first_child: Int[AnyArray, "node"]
    first_value: Int[AnyArray, "node"]

    @classmethod
    def of(cls, tree: CoefficientTree) -> "Traversal":
        """Make a tree ready; differentiable in its values."""
        structure = tree.structure
        masks = (
            structure.child_masks,
            structure.value_masks,
            structure.first_child,
            structure.first_value,
        )
        return cls(
            tree.wavelet,
            tree.size,
            tree.axes,
            tree.offset,
            jnp.asarray(tree.root),
            jnp.pad(jnp.asarray(tree.values), ((0, 1), (0, 0))),
            *(jnp.asarray(np.append(part, 0).astype(np.int32)) for part in masks),
        )

    @property
    def levels(self) -> int:
        """How many levels of coefficients the size has room for."""
        return self.size.bit_length() - 1

    def evaluate(self, points: Points, levels: int | None = None) -> Float[Array, "point channel"]:
        """Evaluate at points of the unit cube; those outside count as the nearest inside.

        With ``levels`` only so many levels of coefficients are looked at, the coarsest ones; 0
        leaves the mean.  Raises ``ValueError`` for points of another number of axes and levels out
        of range.
        """
        count = levels_to_look_at(self.axes, self.levels, points, levels)
        return _evaluate(self, count, jnp.asarray(points))


class _Reached(NamedTuple):
    """The nodes of one level that may reach each point, and the first of their places."""

    nodes: Int[Array, "point place"]
    first: Int[Array, "point axis"]
    width: int


def evaluate(
    tree: CoefficientTree, points: Points, levels: int | None = None
) -> Float[Array, "point channel"]:
    """Evaluate a tree once, as ``Traversal.evaluate`` does; raises the same."""
    return Traversal.of(tree).evaluate(points, levels)


def levels_to_look_at(axes: int, most: int, points: Points, levels: int | None) -> int:
    """Check points and levels against what a tree has; raises as ``evaluate`` does."""
    if points.shape[1] != axes:
        raise ValueError(f"points of {points.shape[1]} axes and a tree of {axes}")
    if levels is None:
        return most
    if not 0 <= levels <= most:
        raise ValueError(f"{levels} levels of a tree that has {most}; ask for 0 to that")
    return levels


@partial(jax.jit, static_argnums=1)
def _evaluate(tree: Traversal, levels: int, points: Array) -> Float[Array, "point channel"]:
    width = max([w.width for w in windows(tree.wavelet, tree.size)], default=1)
    at_once = max(_AT_ONCE // (width**tree.axes << tree.axes), 1)
    return jax.lax.map(
        lambda point: _at_points(tree, levels, point[None])[0],
        points,
        batch_size=min(at_once, max(len(points), 1)),
    )


def _at_points(tree: Traversal, levels: int, points: Array) -> Float[Array, "point channel"]:
    place = between_samples(tree.wavelet, tree.size, tree.offset, points)
    root, values = jnp.asarray(tree.root), jnp.asarray(tree.values)
    total = jnp.broadcast_to(root[None], (len(points), len(root))).astype(values.dtype)
    reached = None
    for level, window in enumerate(windows(tree.wavelet, tree.size)[:levels]):
        reached = _descend(tree, level, reached, window, place.sample)
        total = total + _sum_of(tree, level, reached, window, place)
    return total


class BetweenSamples(NamedTuple):
    """The sample at or before each coordinate, and how far it is on the way to the next one."""

    sample: Int[Array, "point axis"]
    fraction: Float[Array, "point axis"]


def between_samples(wavelet: Wavelet, size: int, offset: float, points: Array) -> BetweenSamples:
    """Find points of the unit cube among the samples."""
    if is_stepwise(wavelet):
        cell = jnp.floor(jax.lax.stop_gradient(points) * size)
        sample = jnp.clip(cell, 0, size - 1).astype(np.int32)
        return BetweenSamples(sample, jnp.zeros_like(points))
    place = jnp.clip((points - offset) * size, 0, size - 1)
    sample = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)), 0, max(size - 2, 0))
    return BetweenSamples(sample.astype(np.int32), place - sample.astype(place.dtype))


def _descend(
    tree: Traversal,
    level: int,
    above: _Reached | None,
    window: Window,
    sample: Int[Array, "point axis"],
) -> _Reached:
    """Follow the children of the nodes reached before."""
    first = jnp.asarray(window.first.astype(np.int32))[sample]
    if above is None:
        return _Reached(jnp.zeros((len(sample), 1), np.int32), first, 1)
    absent = len(tree.child_masks) - 1
    places, run = 1 << level, jnp.arange(window.width, dtype=np.int32)[None]
    parent, child = jnp.zeros((len(sample), 1), np.int32), jnp.zeros((len(sample), 1), np.int32)
    for axis in range(tree.axes):
        place = (first[:, axis, None] + run) % places
        row = (place // 2 - above.first[:, axis, None]) % max(places // 2, 1)
        parent = _joined(parent * above.width, row)
        child = _joined(child, (place % 2) << axis)
    nodes = jnp.take_along_axis(above.nodes, parent, axis=1)
    masks = tree.child_masks[nodes]
    there = (masks >> child) & 1
    before = jax.lax.population_count(masks & ((1 << child) - 1))
    following = tree.first_child[nodes] + before
    return _Reached(jnp.where(there == 1, following, absent), first, window.width)


def _sum_of(
    tree: Traversal,
    level: int,
    reached: _Reached,
    window: Window,
    place: BetweenSamples,
) -> Float[Array, "point channel"]:
    """Sum the coefficients of the nodes reached times their functions."""
    values = jnp.asarray(tree.values)
    weights = weights_of(level, reached.first, window, place, values.dtype)
    masks, first = tree.value_masks[reached.nodes], tree.first_value[reached.nodes]
    selector = jnp.arange(1 << tree.axes, dtype=masks.dtype)[None, :, None]
    masks, first = masks[:, None], first[:, None]
    row = first + jax.lax.population_count(masks & ((1 << selector) - 1))
    weights = jnp.where((masks >> selector) & 1 == 1, weights, 0)
    return jnp.einsum("psn,psnc->pc", weights, values[row], precision="highest")


def weights_of(
    level: int,
    first: Int[Array, "point axis"],
    window: Window,
    place: BetweenSamples,
    dtype: np.dtype,
) -> Float[Array, "point selector place"]:
    """Evaluate the products of functions of the window's places, for every selector.

    Places run over the window along each axis, the last axis fastest; bit a of a selector is axis
    a's, as in ``tree``.
    """
    along = jnp.stack(_values_along(level, first, window, place, dtype), axis=2)
    points, axes = first.shape
    weights = jnp.ones((points, 1, 1), dtype)
    for axis in range(axes):
        product = along[:, axis, :, None, None, :] * weights[:, None, :, :, None]
        weights = product.reshape(points, 2 * weights.shape[1], -1)
    return weights


def _values_along(
    level: int,
    first: Int[Array, "point axis"],
    window: Window,
    place: BetweenSamples,
    dtype: np.dtype,
) -> tuple[Float[Array, "point axis place"], Float[Array, "point axis place"]]:
    """Evaluate the scaling functions and the wavelets of the window at each coordinate."""
    sample, fraction = place
    run = jnp.arange(window.width, dtype=first.dtype)[None, None]
    rows = (first[..., None] + run) % (1 << level)
    fraction = fraction.astype(dtype)[..., None]
    following = jnp.minimum(sample + 1, window.scaling.shape[1] - 1)[..., None]
    found = []
    for table in (window.scaling, window.wavelet):
        held = jnp.asarray(table, dtype)
        here, there = held[rows, sample[..., None]], held[rows, following]
        found.append(here + fraction * (there - here))
    return found[0], found[1]


def _joined(index: Int[Array, "point place"], row: Int[Array, "point row"]) -> Array:
    return (index[:, :, None] + row[:, None, :]).reshape(len(index), -1)
