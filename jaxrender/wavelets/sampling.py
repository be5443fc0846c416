"""Random places with the density of a Haar tree, some of its variables held fixed (L chapter 8).

A tree reduced to one channel is constant in cells.  Its density over the axes that are not fixed,

    q(place | fixed) = max(f(fixed, place), 0) / integral of the same over the place,

is per unit of their unit cube.  A thresholded tree is negative in places, so it is clamped
(ERRATA 76), at its finest cells: coarser ones hold sums of clamped ones.  Where nothing is left,
the density is uniform.  ``levels`` coarsens by leaving out the tree's finer levels along all axes:
weights 1 / q stay right, and "only a coarse representation of q is required" (L 8.2).

The search is dyadic from the whole cube (L fig. 8.1, mended as in ERRATA 78): in each cell the half
along the first axis is chosen, in it the one along the second, and so on.  Every axis has a uniform
number of its own, stretched after each choice, which in the end says where in the finest cell: one
number for all axes (L 8.4) would be out of digits in float32 with four axes of 32 cells.

With variables held fixed, coefficients of every finer level have means over the others that are not
zero (ERRATA 79), so the search needs the slice at the fixed place.  It depends on the fixed cell
alone: ``TabulatedDensities`` holds all of them, ``SlicedDensities`` contracts the tree at each
place, which is the slower twin and needs no table.
"""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.shapes import AnyArray, Array, Bool, Float, Int
from jaxrender.wavelets.algebra import resampled
from jaxrender.wavelets.nodes import separated
from jaxrender.wavelets.supports import is_stepwise
from jaxrender.wavelets.tree import CoefficientTree

Points = Float[AnyArray, "point axis"]
FixedPoints = Float[AnyArray, "point fixed"]
Pyramid = tuple[Float[AnyArray, "row _"], ...]
"""Probabilities of the cells of each level in Morton's order, the coarsest first."""

# Cells of a table: 128 along each of four axes would be four times as many, 2 GiB in float64.
_MOST_CELLS = 1 << 26


class Prepared(NamedTuple):
    """A tree of one channel, the share of each cell that counts, and what is only rounding."""

    tree: CoefficientTree
    support: Float[AnyArray, "cell"]
    nothing: Float[AnyArray, ""]


class Slices(NamedTuple):
    """Probabilities of cells, a row a slice, and the share of each finest cell that exists."""

    pyramid: Pyramid
    support: Float[AnyArray, "cell"]


class Drawn(NamedTuple):
    """Places along the axes not fixed, and their density per unit of those axes' cube.

    A place is uniform in its whole cell: where only a share exists, whoever knows its shape moves
    the place there.
    """

    places: Float[Array, "point axis"]
    density: Float[Array, "point"]


class CellDensities(eqx.Module):
    """A density over the axes not fixed for every place on the fixed ones, constant in cells.

    Numbers come and go in ascending order of axes and in the precision of the argument.
    """

    axes: eqx.AbstractVar[int]
    """Of the tree."""
    fixed_axes: eqx.AbstractVar[tuple[int, ...]]

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """How many finest cells there are along an axis."""

    @classmethod
    @abc.abstractmethod
    def of(
        cls,
        tree: CoefficientTree,
        fixed_axes: tuple[int, ...] = (),
        levels: int | None = None,
        weights: Float[AnyArray, "channel"] | None = None,
        support: Float[np.ndarray, "*size"] | Bool[np.ndarray, "*size"] | None = None,
    ) -> "CellDensities":
        """Take ``levels`` of a tree, by default all.

        Channels are added with ``weights``, by default their mean.  ``support`` is the share of
        each cell of the axes not fixed that places exist in, 0 to 1: the density is that of the
        parts that exist, where it is as high as in a whole cell, and 0 where there is none.
        Raises ``ValueError`` for a tree that is not Haar's, axes, levels, weights and a support
        that do not fit it, and coefficients that are not finite.
        """

    @abc.abstractmethod
    def with_slices(self, function: Callable, fixed: FixedPoints, numbers: Points) -> Any:
        """Apply ``function(slices, row, numbers)``, the row of each point that of its slice."""

    def draw(self, uniforms: Points, fixed: FixedPoints | None = None) -> Drawn:
        """Turn uniform numbers of [0, 1), one for each axis not fixed, into places.

        Raises ``ValueError`` for another number of axes or of points.
        """
        return _apply(self, _search, self._checked(uniforms, fixed), jnp.asarray(uniforms))

    def density(self, places: Points, fixed: FixedPoints | None = None) -> Float[Array, "point"]:
        """Evaluate the density at places: that of their cell, 0 outside the cube; raises the same.

        Fixed places outside count as the nearest inside.
        """
        return _apply(self, _look_up, self._checked(places, fixed), jnp.asarray(places))

    def _checked(self, numbers: Points, fixed: FixedPoints | None) -> FixedPoints:
        free, held = self.axes - len(self.fixed_axes), len(self.fixed_axes)
        given = np.zeros((len(numbers), 0), numbers.dtype) if fixed is None else fixed
        if numbers.shape[1] != free or given.shape[1] != held or len(given) != len(numbers):
            raise ValueError(
                f"numbers of shape {numbers.shape} with fixed places of shape {given.shape}; give "
                f"a row of {free} and one of {held} for each point"
            )
        return jnp.asarray(given)


class TabulatedDensities(CellDensities):
    """The pyramids of all fixed cells, one a row: a draw takes two or three looks a level."""

    axes: int = eqx.field(static=True)
    fixed_axes: tuple[int, ...] = eqx.field(static=True)
    slices: Slices

    @classmethod
    def of(
        cls,
        tree: CoefficientTree,
        fixed_axes: tuple[int, ...] = (),
        levels: int | None = None,
        weights: Float[AnyArray, "channel"] | None = None,
        support: Float[np.ndarray, "*size"] | Bool[np.ndarray, "*size"] | None = None,
    ) -> "TabulatedDensities":
        """Lay out a tree's densities; raises ``ValueError`` also for more than 2^26 cells."""
        ready = prepared(tree, fixed_axes, levels, weights, support)
        tree = ready.tree
        if tree.size**tree.axes > _MOST_CELLS:
            raise ValueError(
                f"a table of {tree.size}^{tree.axes} cells is above {_MOST_CELLS}: ask for fewer "
                "levels, or use SlicedDensities"
            )
        order = fixed_axes + free_axes(tree.axes, fixed_axes)
        samples = jnp.transpose(tree.samples()[..., 0], order)
        held = len(fixed_axes)
        table = samples.reshape(tree.size**held, -1)
        table = table[_morton(tree.size, held)][:, _morton(tree.size, tree.axes - held)]
        shares = jnp.asarray(ready.support)
        rows = probabilities(table, shares, ready.nothing)
        return cls(tree.axes, fixed_axes, Slices(pyramid_over(rows, tree.axes - held), shares))

    @property
    def size(self) -> int:
        """Of the table."""
        return 1 << (len(self.slices.pyramid) - 1)

    def with_slices(self, function: Callable, fixed: FixedPoints, numbers: Points) -> Any:
        """Apply it to the table, each point with the row of its fixed cell."""
        return function(self.slices, _code(fixed, len(self.slices.pyramid) - 1), numbers)


@eqx.filter_jit
def _apply(
    densities: CellDensities, function: Callable, fixed: FixedPoints, numbers: Points
) -> Any:
    return densities.with_slices(function, fixed, numbers)


def _search(slices: Slices, row: Int[Array, "point"], uniforms: Points) -> Drawn:
    """Choose halves from the coarsest level to the finest; never one of no probability."""
    pyramid = slices.pyramid
    points, axes = uniforms.shape
    code, cells = jnp.zeros(points, np.int32), [jnp.zeros(points, np.int32)] * axes
    rest = [jnp.clip(u, 0, 1 - np.finfo(u.dtype).epsneg) for u in jnp.moveaxis(uniforms, 1, 0)]
    for sums in pyramid[1:]:
        children = jnp.reshape(sums, (len(sums), -1, 1 << axes))[row, code]
        children = children.astype(uniforms.dtype)
        code = code << axes
        for axis in range(axes):
            # Bit ``axis`` of a child is the lowest of those that are left.
            halves = children.reshape(points, children.shape[1] // 2, 2)
            first, second = jnp.moveaxis(halves.sum(axis=1), 1, 0)
            scaled = rest[axis] * (first + second)
            upper = (scaled >= first) & (second > 0)
            bit, chosen = upper.astype(np.int32), jnp.where(upper, second, first)
            rest[axis] = jnp.where(upper, scaled - first, scaled) / jnp.where(chosen > 0, chosen, 1)
            children = jnp.where(upper[:, None], halves[..., 1], halves[..., 0])
            cells[axis] = 2 * cells[axis] + bit
            code = code | bit << axis
    places = [_inside(cell, u, len(pyramid) - 1) for cell, u in zip(cells, rest, strict=True)]
    return Drawn(jnp.stack(places, axis=1), _of_cell(slices, row, code).astype(uniforms.dtype))


def _inside(cell: Int[Array, "point"], rest: Float[Array, "point"], levels: int) -> Array:
    """Go into a cell, but not by rounding into the next one."""
    start, width = cell.astype(rest.dtype), 0.5**levels
    return jnp.minimum((start + rest) * width, jnp.nextafter((start + 1) * width, start * width))


def _look_up(slices: Slices, row: Int[Array, "point"], places: Points) -> Float[Array, "point"]:
    inside = jnp.all((places >= 0) & (places <= 1), axis=1)
    found = _of_cell(slices, row, _code(places, len(slices.pyramid) - 1))
    return jnp.where(inside, found, 0).astype(places.dtype)


def _of_cell(slices: Slices, row: Int[Array, "point"], code: Int[Array, "point"]) -> Array:
    finest = jnp.asarray(slices.pyramid[-1])
    share = jnp.asarray(slices.support)[code].astype(finest.dtype)
    return finest[row, code] * finest.shape[1] / jnp.where(share > 0, share, 1)


def prepared(
    tree: CoefficientTree,
    fixed_axes: tuple[int, ...],
    levels: int | None,
    weights: Float[AnyArray, "channel"] | None,
    support: Float[np.ndarray, "*size"] | Bool[np.ndarray, "*size"] | None,
) -> Prepared:
    """Check, coarsen and reduce a tree to one channel; its support in Morton's order."""
    if not is_stepwise(tree.wavelet):
        raise ValueError(
            f"a tree of wavelet {tree.wavelet.name} is not constant in cells; analyse its samples "
            "with Haar's"
        )
    if list(fixed_axes) != sorted(set(fixed_axes) & set(range(tree.axes))) or (
        len(fixed_axes) == tree.axes
    ):
        raise ValueError(
            f"fixed axes {fixed_axes} of a tree of {tree.axes}: give them ascending, each once, "
            "and leave one to draw"
        )
    if levels is not None and not 0 <= levels <= tree.levels:
        raise ValueError(f"{levels} levels of a tree that has {tree.levels}; ask for 0 to that")
    tree = resampled(tree, 1 << (tree.levels if levels is None else levels))
    tree = _reduced(tree, weights)
    free = tree.axes - len(fixed_axes)
    cells = np.ones((tree.size,) * free) if support is None else np.asarray(support, float)
    if cells.shape != (tree.size,) * free or not cells.any():
        raise ValueError(
            f"a support of shape {cells.shape} with {np.count_nonzero(cells)} cells; give "
            f"{tree.size} along each of {free} axes, some of them true"
        )
    if not (cells.min() >= 0 and cells.max() <= 1):
        raise ValueError(f"shares of {cells.min()} to {cells.max()}; give 0 to 1")
    return Prepared(tree, cells.ravel()[_morton(tree.size, free)], _rounding(tree))


def _rounding(tree: CoefficientTree) -> Float[Array, ""]:
    """Bound what is left of a zero when a tree of one channel is added up, generously."""
    structure, root = tree.structure, jnp.asarray(tree.root)
    values = jnp.abs(jnp.asarray(tree.values)[:, 0])
    sums = jnp.zeros(len(structure), values.dtype).at[structure.value_nodes].add(values)
    scale = jnp.asarray(2.0 ** (structure.level * tree.axes / 2), values.dtype)
    highest = jnp.zeros(tree.levels + 1, values.dtype).at[structure.level].max(sums * scale)
    return 4 * jnp.finfo(root.dtype).eps * (jnp.abs(root[0]) + highest.sum())


def _reduced(tree: CoefficientTree, weights: AnyArray | None) -> CoefficientTree:
    given = np.full(tree.channels, 1 / tree.channels) if weights is None else weights
    fine = given.shape == tree.root.shape
    if fine and not isinstance(given, Tracer):
        fine = bool(np.all(np.isfinite(given)) and np.all(np.asarray(given) >= 0))
    if not fine:
        raise ValueError(f"weights {given}; give {tree.channels}, finite and not negative")
    known = (part for part in (tree.root, tree.values) if not isinstance(part, Tracer))
    if not all(np.all(np.isfinite(part)) for part in known):
        raise ValueError("some of the tree's coefficients are not finite; mend the samples")
    given = given.astype(tree.root.dtype)[:, None]
    return dataclasses.replace(tree, root=tree.root @ given, values=tree.values @ given)


def probabilities(
    values: Float[Array, "row cell"], support: Float[AnyArray, "cell"], nothing: Float[AnyArray, ""]
) -> Float[Array, "row cell"]:
    """Clamp and normalise each row; the support alone where the mean is nothing but rounding."""
    clamped = jnp.asarray(support)[None].astype(values.dtype) * jnp.maximum(values, 0)
    total = clamped.sum(axis=1, keepdims=True)
    least = jnp.maximum(nothing * len(support), jnp.finfo(values.dtype).tiny)
    empty = total <= least.astype(values.dtype)
    held = jnp.asarray(support).astype(values.dtype)
    uniform = held / held.sum()
    return jnp.where(empty, uniform[None], clamped / jnp.where(empty, 1, total))


def pyramid_over(finest: Float[Array, "row cell"], axes: int) -> Pyramid:
    """Add up the cells of each coarser level."""
    found = [finest]
    while found[-1].shape[1] > 1:
        found.append(found[-1].reshape(len(finest), -1, 1 << axes).sum(axis=2))
    return tuple(reversed(found))


def cells_at(places: Float[AnyArray, "*batch"], levels: int) -> Int[Array, "*batch"]:
    """Find the cell of each coordinate, the nearest for those outside."""
    return jnp.clip(jnp.floor(places * (1 << levels)), 0, (1 << levels) - 1).astype(np.int32)


def _code(places: Points, levels: int) -> Int[Array, "point"]:
    cells = cells_at(places, levels)
    code = jnp.zeros(len(cells), np.int32)
    for axis in range(cells.shape[1]):
        for bit in range(levels):
            code = code | ((cells[:, axis] >> bit) & 1) << (bit * cells.shape[1] + axis)
    return code


def _morton(size: int, axes: int) -> Int[np.ndarray, "cell"]:
    """Find the row-major places of cells in Morton's order."""
    if not axes:
        return np.zeros(1, np.int64)
    places = separated(np.arange(size**axes), axes)
    return np.asarray(np.ravel_multi_index(tuple(places.T), (size,) * axes))


def free_axes(axes: int, fixed_axes: tuple[int, ...]) -> tuple[int, ...]:
    """List the axes that are not fixed."""
    return tuple(axis for axis in range(axes) if axis not in fixed_axes)
