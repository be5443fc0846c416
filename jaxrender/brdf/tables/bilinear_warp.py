"""Densities on the unit square, bilinear between nodes, and the map that makes each one uniform.

A table [*parameters, row, column] has its nodes at x = column / (n - 1), y = row / (n - 1).  For
the density f of one table, scaled to integral 1, with m(y) = int f(x, y) dx,

    flatten(x, y) = (int_0^x f(x', y) dx' / m(y),  int_0^y m(y') dy').

Between parameters the tables are mixed linearly: density and both integrals alike.
"""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import cumulative_trapezoid

from jaxrender.shapes import AnyArray, Array, Float, Int

# Of a density of mean 1: keeps quotients finite where it vanishes.
_TINY = 1e-30


class Blend(NamedTuple):
    """Which of the tables are mixed, by flat index, and with what weight."""

    index: Int[Array, "*batch"]
    weight: Float[Array, "*batch"]


class Place(NamedTuple):
    """A point of the unit square."""

    x: Float[Array, "*batch"]
    y: Float[Array, "*batch"]


class BilinearWarp(eqx.Module):
    """Densities with their integrals along rows up to each node, and of whole rows."""

    density: Float[AnyArray, "table row column"]
    along: Float[AnyArray, "table row column"]
    below: Float[AnyArray, "table row"]

    @classmethod
    def of(cls, values: Float[np.ndarray, "table row column"]) -> "BilinearWarp":
        """Scale tables to integral 1 and integrate them.

        Raises ``ValueError`` for values that are negative or not finite, tables that are zero
        everywhere, and fewer than 2 x 2 nodes.
        """
        if min(values.shape[1:]) < 2:
            raise ValueError(f"{values.shape[1]} x {values.shape[2]} nodes: give at least 2 x 2")
        if not (np.isfinite(values).all() and np.all(values >= 0)):
            raise ValueError("a density is negative or not finite: it is neither")
        exact = values.astype(float)
        rows, columns = values.shape[1:]
        along = cumulative_trapezoid(exact, dx=1 / (columns - 1), initial=0)
        below = cumulative_trapezoid(along[..., -1], dx=1 / (rows - 1), initial=0)
        total = below[:, -1]
        if not np.all(total > 0):
            raise ValueError(f"table {int(np.argmin(total > 0))} is zero everywhere")
        parts = exact / total[:, None, None], along / total[:, None, None], below / total[:, None]
        return cls(*(part.astype(values.dtype) for part in parts))

    def flatten(self, place: Place, blends: tuple[Blend, ...]) -> Place:
        """Map a place of the square to where the mixed density is uniform."""
        rows, columns = self.density.shape[1:]
        (i, t), (j, s) = _cell(place.y, rows), _cell(place.x, columns)

        def node(table: AnyArray, *at: Array) -> Array:
            return mixed([jnp.asarray(table)[(b.index, *at)] for b in blends], blends)

        left = _lerp(node(self.density, i, j), node(self.density, i + 1, j), t)
        right = _lerp(node(self.density, i, j + 1), node(self.density, i + 1, j + 1), t)
        along = _lerp(node(self.along, i, j), node(self.along, i + 1, j), t)
        along = along + s * _lerp(left, right, s / 2) / (columns - 1)
        last = jnp.full_like(j, columns - 1)
        low, high = node(self.along, i, last), node(self.along, i + 1, last)
        below = node(self.below, i) + t * _lerp(low, high, t / 2) / (rows - 1)
        return Place(along / jnp.maximum(_lerp(low, high, t), _TINY), below)


def interpolated(
    tables: Float[AnyArray, "table row column"], place: Place, blends: tuple[Blend, ...]
) -> Float[Array, "*batch"]:
    """Interpolate mixed tables bilinearly at places of the square."""
    rows, columns = tables.shape[1:]
    (i, t), (j, s) = _cell(place.y, rows), _cell(place.x, columns)
    tables = jnp.asarray(tables)

    def node(i: Array, j: Array) -> Array:
        return mixed([tables[b.index, i, j] for b in blends], blends)

    low = _lerp(node(i, j), node(i, j + 1), s)
    return _lerp(low, _lerp(node(i + 1, j), node(i + 1, j + 1), s), t)


def blended(
    parameters: tuple[Float[Array, "*batch"], ...], nodes: tuple[Float[AnyArray, "_"], ...]
) -> tuple[Blend, ...]:
    """Find the tables about parameters and their weights; held beyond the first and last node."""
    sides = []
    for parameter, at in zip(parameters, nodes, strict=True):
        at = jnp.asarray(at, parameter.dtype)
        if at.size == 1:
            sides.append([Blend(jnp.zeros(parameter.shape, np.int32), jnp.ones_like(parameter))])
            continue
        found = jnp.searchsorted(at, jax.lax.stop_gradient(parameter), side="right")
        low = jnp.clip(found - 1, 0, at.size - 2).astype(np.int32)
        weight = jnp.clip((parameter - at[low]) / (at[low + 1] - at[low]), 0, 1)
        sides.append([Blend(low, 1 - weight), Blend(low + 1, weight)])
    return tuple(_product(chosen, nodes) for chosen in itertools.product(*sides))


def mixed(values: list[Array], blends: tuple[Blend, ...]) -> Array:
    """Add up the values of each table by weight."""
    weighted = [b.weight * value.astype(b.weight.dtype) for value, b in zip(values, blends)]
    return sum(weighted[1:], weighted[0])


def _product(chosen: tuple[Blend, ...], nodes: tuple[Float[AnyArray, "_"], ...]) -> Blend:
    """Join one side of each parameter: the last one's tables lie next to each other."""
    index, weight = chosen[0]
    for side, at in zip(chosen[1:], nodes[1:], strict=True):
        index, weight = index * at.size + side.index, weight * side.weight
    return Blend(index, weight)


def _cell(position: Float[Array, "*batch"], count: int) -> tuple[Array, Array]:
    scaled = jnp.clip(position, 0, 1) * (count - 1)
    low = jnp.clip(jnp.floor(jax.lax.stop_gradient(scaled)), 0, count - 2).astype(np.int32)
    return low, scaled - low.astype(scaled.dtype)


def _lerp(start: Array, end: Array, fraction: Array) -> Array:
    return start + (end - start) * fraction
