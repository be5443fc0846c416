"""A table's values between its samples: constant, linear, cubic and B-spline (L 3.3.2).

Samples stand at the cells' centres, (i + 1/2) / n.  Every reconstruction is a tensor product: along
an axis a place has 1, 2 or 4 *taps*, samples with weights; over a pair of directions the taps
multiply to 1, 16 or 256.  With f the fraction of the way from sample i to sample i + 1:

``constant``  the nearest sample;
``linear``    1 - f, f: continuous;
``cubic``     Hermite's cubic whose slopes are central differences (Catmull-Rom), on i - 1 to i + 2:
              continuous slopes, through the samples, exact for quadratics; overshoots at edges and
              may be negative where no sample is;
``b-spline``  the uniform cubic B-spline whose control mesh is the samples: continuous curvature,
              never negative, not through the samples, exact for linear functions.

An axis that closes upon itself goes round; the others repeat their end samples.  The pole of the
polar map is no end: a step beyond it is the other side, half a turn on; with an odd number of
azimuths that is midway between two samples, and reconstructed like any other azimuth.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxrender.geometry import Embedding
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int


class Kernel(NamedTuple):
    """One reconstruction: weights by fraction, the first tap, and where a cell's samples stand."""

    weights: Callable[[Float[Array, "*batch"]], tuple[Float[Array, "*batch"], ...]]
    first: int
    centre: float


class Taps(NamedTuple):
    """Samples that a value is made of: index in the flattened axes, and weight."""

    index: Int[Array, "tap *batch"]
    weight: Float[Array, "tap *batch"]


def _constant(f: Float[Array, "*batch"]) -> tuple[Float[Array, "*batch"], ...]:
    return (jnp.ones_like(f),)


def _linear(f: Float[Array, "*batch"]) -> tuple[Float[Array, "*batch"], ...]:
    return 1 - f, f


def _cubic(f: Float[Array, "*batch"]) -> tuple[Float[Array, "*batch"], ...]:
    return (
        f * (-1 + f * (2 - f)) / 2,
        1 + f * f * (3 * f - 5) / 2,
        f * (1 + f * (4 - 3 * f)) / 2,
        f * f * (f - 1) / 2,
    )


def _b_spline(f: Float[Array, "*batch"]) -> tuple[Float[Array, "*batch"], ...]:
    g = 1 - f
    return (
        g * g * g / 6,
        (4 + f * f * (3 * f - 6)) / 6,
        (4 + g * g * (3 * g - 6)) / 6,
        f * f * f / 6,
    )


RECONSTRUCTIONS: dict[str, Kernel] = {
    "constant": Kernel(_constant, 0, 0.0),
    "linear": Kernel(_linear, 0, 0.5),
    "cubic": Kernel(_cubic, -1, 0.5),
    "b-spline": Kernel(_b_spline, -1, 0.5),
}


def axis_taps(name: str, places: Float[AnyArray, "*batch"], count: int) -> Taps:
    """Find the taps of places in [0, 1] along an axis; indices may lie beyond its ends."""
    kernel = RECONSTRUCTIONS[name]
    position = jnp.asarray(places) * count - kernel.centre
    cell = jnp.floor(jax.lax.stop_gradient(position))
    weights = jnp.stack(kernel.weights(position - cell))
    index = cell.astype(jnp.int32) + kernel.first
    return Taps(jnp.stack([index + k for k in range(len(weights))]), weights)


class PolarTaps(NamedTuple):
    """Taps along an axis that begins at the pole, and which of them are on its other side."""

    taps: Taps
    beyond: Bool[Array, "tap *batch"]


def polar_taps(name: str, places: Float[AnyArray, "*batch"], count: int) -> PolarTaps:
    """Find the taps of places in [0, 1] along an axis that begins at the pole."""
    taps = axis_taps(name, places, count)
    beyond = taps.index < 0
    index = _clamped(jnp.where(beyond, -1 - taps.index, taps.index), count)
    return PolarTaps(Taps(index, taps.weight), beyond)


def direction_taps(
    name: str, embedding: Embedding, size: tuple[int, int], places: Float[AnyArray, "*batch 2"]
) -> Taps:
    """Find the taps of places on the square among the row-major samples of one direction."""
    along, across = jnp.moveaxis(jnp.asarray(places), -1, 0)
    # A closing second axis is an azimuth, and then the first begins at the pole.
    if not embedding.periodic[1]:
        rows, columns = (axis_taps(name, *pair) for pair in ((along, size[0]), (across, size[1])))
        row, column = (_clamped(taps.index, n) for taps, n in zip((rows, columns), size))
        index, weight = row[:, None] * size[1] + column[None], columns.weight[None]
    else:
        rows, beyond = polar_taps(name, along, size[0])
        here, there = (axis_taps(name, across + turn, size[1]) for turn in (0, 0.5))
        column = jnp.where(beyond[:, None], there.index[None], here.index[None]) % size[1]
        weight = jnp.where(beyond[:, None], there.weight[None], here.weight[None])
        index = rows.index[:, None] * size[1] + column
    return product_taps(Taps(index, rows.weight[:, None] * weight))


def product_taps(taps: Taps) -> Taps:
    """Put the two leading axes of taps of taps into one."""
    return Taps(*(part.reshape(-1, *part.shape[2:]) for part in taps))


@jax.jit
def weighted_sum(
    rows: Float[AnyArray, "row channel"], outer: Taps, inner: Taps
) -> Float[Array, "*batch channel"]:
    """Evaluate sum_jk u_j v_k rows[i_j + i_k], one outer tap at a time, in the weights' precision.

    Memory is that of the inner taps alone, also under differentiation.
    """
    rows = jnp.asarray(rows)

    def add(total: Float[Array, "*batch channel"], tap: Taps):
        index = tap.index[None] + inner.index
        found = rows.at[index].get(mode="promise_in_bounds").astype(inner.weight.dtype)
        part = jnp.sum(inner.weight[..., None] * found, axis=0)
        return total + tap.weight[..., None] * part, None

    batch = jnp.broadcast_shapes(outer.index.shape[1:], inner.index.shape[1:])
    start = jnp.zeros((*batch, rows.shape[1]), inner.weight.dtype)
    # The gathered samples are gathered again for the derivatives: kept, they would be all the taps.
    return jax.lax.scan(jax.checkpoint(add), start, outer)[0]


def _clamped(index: Int[Array, "*batch"], count: int) -> Int[Array, "*batch"]:
    return jnp.clip(index, 0, count - 1)
