"""The cells of a table over two directions: sizes, directions, weights, and values for all pairs.

Directions lie on the unit square by an ``Embedding`` and are sampled at the centres of its cells.
Host side.
"""

import operator
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.ndimage import distance_transform_edt

from jaxrender.brdf.parameters import refuse_unlisted
from jaxrender.geometry import Embedding
from jaxrender.shapes import AnyArray, Array, Bool, Float, checked

Size = tuple[int, int, int, int]
Table = Float[AnyArray, "kappa_i lambda_i kappa_r lambda_r channel"]

# Cells beyond the horizon take the value of the direction with this cosine: nearer to it models
# that grow there without bound spoil their neighbours (a Ward table of 24^4 errs by 3.1 % with .1,
# 3.8 % with .2, 4.7 % with .05, and 16 % with zeros).
_ABOVE_HORIZON = 0.1
# Pairs of directions that are evaluated at once: what a pass needs stays below 100 MB.
_PAIRS_AT_ONCE = 2**18
# Samples are counted by 32-bit integers.
_MOST_PAIRS = 2**31 - 1


class Masked(NamedTuple):
    """Values without holes, and how many were replaced."""

    values: Table
    replaced: int


@checked
def masked(values: Table, fill: str = "nearest") -> Masked:
    """Replace negative and not finite values, by the ``nearest`` valid sample or by ``zero``.

    Nearest in cells along the four axes, taken as open, within a channel; a channel without any
    valid sample becomes 0.  Host side.  Raises ``ValueError`` for an unlisted ``fill``.
    """
    refuse_unlisted("fill", fill, ("nearest", "zero"))
    values = np.asarray(values)
    broken = ~(np.isfinite(values) & (values >= 0))
    filled = np.where(broken, 0, values)
    if fill == "nearest":
        for channel in np.flatnonzero(broken.any(axis=(0, 1, 2, 3))):
            _fill_from_nearest(filled[..., channel], broken[..., channel])
    return Masked(filled, int(broken.sum()))


def exchanged(values: Table) -> Table:
    """Exchange the two directions of a table."""
    return values.transpose(2, 3, 0, 1, 4)


def size_of(size: int | tuple[int, ...]) -> Size:
    """Write a size as four numbers; ``ValueError`` for others, empty ones and too many pairs."""
    given = (size,) * 4 if isinstance(size, int) else tuple(operator.index(n) for n in size)
    if len(given) != 4 or min(given) < 1:
        raise ValueError(f"size={size}: give one positive number or four, a number for each axis")
    pairs = int(np.prod(np.array(given, object)))
    if pairs > _MOST_PAIRS:
        raise ValueError(f"size={size} is {pairs:,} pairs of directions; at most {_MOST_PAIRS:,}")
    return given


def cell_weights(embedding: Embedding, size: tuple[int, int]) -> Float[np.ndarray, "row column"]:
    """Evaluate each cell's projected solid angle, in sum pi; 0 where its centre is no direction.

    Raises ``ValueError`` when no centre is a direction.
    """
    measure = np.asarray(embedding.projected_solid_angle(embedding.centres(size)), float)
    if not measure.any():
        raise ValueError(f"no cell of {size[0]} x {size[1]} has a direction; give more samples")
    return np.pi * measure / measure.sum()


def above_horizon(embedding: Embedding, size: tuple[int, int]) -> Float[np.ndarray, "cell 3"]:
    """List the cells' directions, those of centres beyond the horizon raised a little above it."""
    directions = embedding.cell_directions(size).reshape(-1, 3).copy()
    outside = ~covered(embedding, size).ravel()
    directions[outside, :2] *= np.sqrt(1 - _ABOVE_HORIZON**2)
    directions[outside, 2] = _ABOVE_HORIZON
    return directions


def values_of_pairs(
    evaluate: Callable[[Array, Array], Array],
    incoming: Float[np.ndarray, "incoming axis"],
    outgoing: Float[np.ndarray, "outgoing axis"],
) -> Float[np.ndarray, "incoming outgoing channel"]:
    """Evaluate all pairs, some incoming ones at a time; the last pass overlaps the one before."""
    dtype = jax.dtypes.canonicalize_dtype(float)
    leaving = jnp.asarray(outgoing, dtype)
    step = min(max(_PAIRS_AT_ONCE // len(outgoing), 1), len(incoming))
    values = np.empty(0)
    for start in range(0, len(incoming), step):
        first = min(start, len(incoming) - step)
        some = jnp.asarray(incoming[first : first + step], dtype)
        pairs = jnp.repeat(some, len(outgoing), axis=0), jnp.tile(leaving, (step, 1))
        found = np.asarray(evaluate(*pairs)).reshape(step, len(outgoing), -1)
        if start == 0:
            values = np.empty((len(incoming), *found.shape[1:]), found.dtype)
        values[first : first + step] = found
    return values


def covered(embedding: Embedding, size: tuple[int, int]) -> Bool[np.ndarray, "row column"]:
    """Say which cells' centres are directions."""
    return np.asarray(embedding.covers(embedding.centres(size)))


def refuse_unknown(values: Float[np.ndarray, "..."]) -> None:
    """Raise ``ValueError`` that names the first value which is not finite."""
    broken = ~np.isfinite(values)
    if broken.any():
        place = tuple(int(i) for i in np.argwhere(broken)[0])
        raise ValueError(
            f"values{list(place)} is {values[place]} ({broken.sum()} such): values are finite; "
            "fill entries that were not measured with `masked`"
        )


def _fill_from_nearest(values: np.ndarray, broken: np.ndarray) -> None:
    if broken.all():
        return
    found = distance_transform_edt(broken, return_distances=False, return_indices=True)
    places = np.asarray(found)
    values[broken] = values[tuple(axis[broken] for axis in places)]
