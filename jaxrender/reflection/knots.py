"""Where a function is known that is joined in between: knots of a spline, nodes of a polynomial."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import chebyshev

from jaxrender.shapes import Array, Float, Int

# Knots beyond the range, so that the spline's end conditions do not reach into it.
_EXTRA_KNOTS = 3


class SplineTaps(NamedTuple):
    """The first of the four coefficients that matter at a place, and the weights of all four."""

    first: Int[Array, ""]
    weights: Float[Array, "four"]


class KnotRange(eqx.Module):
    """Equally spaced knots: ``count`` from ``first`` by ``step``."""

    first: Float[np.ndarray, ""]
    step: Float[np.ndarray, ""]
    count: int = eqx.field(static=True)

    @classmethod
    def over(cls, low: float, high: float, count: int) -> "KnotRange":
        """Cover [low, high] with ``count`` knots, some of them to spare on either side."""
        step = (high - low) / (count - 1 - 2 * _EXTRA_KNOTS)
        return cls(np.asarray(low - _EXTRA_KNOTS * step), np.asarray(step), count)

    def values(self) -> Float[np.ndarray, "knot"]:
        """List the knots."""
        return np.asarray(self.first + self.step * np.arange(self.count))

    def spline_from_values(self) -> Float[np.ndarray, "coefficient knot"]:
        """The matrix that turns values at the knots into B-spline coefficients (natural ends)."""
        size = self.count + 2
        system = np.zeros((size, size))
        for k in range(self.count):
            system[k, k : k + 3] = [1 / 6, 4 / 6, 1 / 6]
        system[self.count, :3] = system[self.count + 1, -3:] = [1, -2, 1]
        return np.linalg.inv(system)[:, : self.count]

    def locate(self, x: Float[Array, ""]) -> SplineTaps:
        """Find the coefficients that matter at ``x``."""
        first, step = (jnp.asarray(a, x.dtype) for a in (self.first, self.step))
        position = (x - first) / step
        cell = jnp.clip(jnp.floor(position), 0, self.count - 2)
        t = position - cell
        weights = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
        return SplineTaps(cell.astype(int), jnp.stack(weights) / 6)


class ChebyshevNodes(eqx.Module):
    """Where a function is known that a polynomial follows: ``count`` nodes from low to high.

    One node is in the middle, and stands for a function that does not change.
    """

    low: Float[np.ndarray, ""]
    high: Float[np.ndarray, ""]
    count: int = eqx.field(static=True)

    @classmethod
    def over(cls, low: float, high: float, count: int) -> "ChebyshevNodes":
        """Cover [low, high] with ``count`` nodes, or with one where both are the same."""
        return cls(np.asarray(low), np.asarray(high), count if high > low else 1)

    def values(self) -> Float[np.ndarray, "node"]:
        """List the nodes."""
        low, high = np.asarray(self.low), np.asarray(self.high)
        return (low + high) / 2 + (high - low) / 2 * chebyshev.chebpts1(self.count)

    def weights(self, x: Float[Array, ""]) -> Float[Array, "node"]:
        """Say how much the value at each node counts at ``x``."""
        if self.count == 1:
            return jnp.ones(1, x.dtype)
        low, high = (jnp.asarray(end, x.dtype) for end in (self.low, self.high))
        place = (2 * x - low - high) / (high - low)
        powers = jnp.stack([place**k for k in range(self.count)])
        inverse = np.linalg.inv(np.vander(chebyshev.chebpts1(self.count), increasing=True))
        return jnp.matmul(powers, jnp.asarray(inverse, x.dtype), precision="highest")
