"""Where a MIP pyramid is read: texels and weights for a place and a level (Williams 1983).

Level 0 is the finest.  Level l + 1 has half of its rows and columns, where there are two, down to
one texel: the counting of L 7.8 and 7.12 (in L 7.3's, levels grow finer; ERRATA 71).  Texel
(row, column) of level l is a part of (row // 2, column // 2) of level l + 1: indices are halved
from one level to the next, where L 7.9-7.10 keep (u, v).  Otherwise as there,

    value(u, v, mu) = (1 - f) value_l(u, v) + f value_{l+1}(u, v),    f = mu - l,    l = floor(mu)

Texture coordinates are the house's, u to the right and v upwards in the unit square, so row 0 of an
image lies at v = 1; value_l is bilinear between the texels' centres, or that of the texel itself.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.parameters import refuse_unlisted
from jaxrender.shapes import AnyArray, Array, Float, ImageArray, Int

Places = Float[AnyArray, "point 2"]
Levels = Float[AnyArray, "point"]


class Filter(NamedTuple):
    """What is interpolated: between neighbouring texels, and between the two nearest levels."""

    between_texels: bool
    between_levels: bool


FILTERS = {
    "trilinear": Filter(True, True),
    # What L 7.9 does.
    "levels": Filter(False, True),
    "nearest": Filter(False, False),
}

WRAPS: dict[str, Callable[[Array, Array], Array]] = {
    "repeat": lambda index, count: index % count,
    "clamp": lambda index, count: jnp.clip(index, 0, count - 1),
}


class TexelTaps(NamedTuple):
    """The texels that a place reads, numbered through all levels, and weights of sum one."""

    texel: Int[Array, "point tap"]
    weight: Float[Array, "point tap"]


@dataclass(frozen=True)
class MipShape:
    """How many texels each level has, and what is beyond the unit square.

    Texels are numbered level by level, the finest first, each row by row.  Raises ``ValueError``
    for sides that are no powers of two and an unlisted ``wrap``.
    """

    rows: int
    columns: int
    wrap: str = "repeat"

    def __post_init__(self):
        refuse_unlisted("wrap", self.wrap, tuple(WRAPS))
        for side in (self.rows, self.columns):
            if side < 1 or side & (side - 1):
                raise ValueError(
                    f"a texture of {self.columns} x {self.rows} texels has a side that is no power "
                    "of two; resample it"
                )

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Rows and columns of each level, the finest first."""
        count = max(self.rows, self.columns).bit_length()
        return tuple((max(self.rows >> k, 1), max(self.columns >> k, 1)) for k in range(count))

    @property
    def starts(self) -> tuple[int, ...]:
        """The number of each level's first texel, and how many there are in all."""
        return tuple(int(n) for n in np.cumsum([0, *(r * c for r, c in self.sizes)]))

    def taps(self, places: Places, levels: Levels, chosen: str = "trilinear") -> TexelTaps:
        """Find what places (u, v) at levels of detail read; levels out of range count as the ends.

        Raises ``ValueError`` for a filter that is not in ``FILTERS``.
        """
        refuse_unlisted("filter", chosen, tuple(FILTERS))
        places = jnp.asarray(places)
        if self.wrap == "repeat":
            places = places - jnp.floor(jax.lax.stop_gradient(places))
        texels, weights = [], []
        for level, share in self._levels(jnp.asarray(levels, places.dtype), FILTERS[chosen]):
            found = self._texels(places, level, FILTERS[chosen])
            texels.append(found.texel)
            weights.append(found.weight * share[:, None])
        return TexelTaps(jnp.concatenate(texels, axis=1), jnp.concatenate(weights, axis=1))

    def _levels(self, levels: Float[Array, "point"], chosen: Filter) -> list[tuple[Array, Array]]:
        top = len(self.sizes) - 1
        levels = jnp.clip(levels, 0, top)
        if not chosen.between_levels:
            return [(jnp.round(levels).astype(np.int32), jnp.ones_like(levels))]
        fine = jnp.clip(jnp.floor(jax.lax.stop_gradient(levels)), 0, max(top - 1, 0))
        fraction, fine = levels - fine, fine.astype(np.int32)
        return [(fine, 1 - fraction), (jnp.minimum(fine + 1, top), fraction)]

    def _texels(self, places: Array, level: Int[Array, "point"], chosen: Filter) -> TexelTaps:
        """Find the texels of one level for each place: the four about it, or the one it is in."""
        rows, columns = (jnp.asarray(side, np.int32)[level] for side in np.transpose(self.sizes))
        start = jnp.asarray(self.starts[:-1], np.int32)[level]
        down = (1 - places[:, 1]) * rows.astype(places.dtype)
        across = places[:, 0] * columns.astype(places.dtype)
        texels, weights = [], []
        for row, row_weight in _neighbours(down, chosen):
            for column, column_weight in _neighbours(across, chosen):
                wrapped = WRAPS[self.wrap](row, rows), WRAPS[self.wrap](column, columns)
                texels.append(start + wrapped[0] * columns + wrapped[1])
                weights.append(row_weight * column_weight)
        return TexelTaps(jnp.stack(texels, axis=1), jnp.stack(weights, axis=1))


def level_of(sizes: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """Turn footprints' sizes in finest texels into levels at which they are one texel: log2."""
    return jnp.log2(jnp.maximum(jnp.asarray(sizes), 1))


def blocks(index: Int[np.ndarray, "row column"]) -> Int[np.ndarray, "half_row half_column texel"]:
    """Collect what lies under each texel of the next coarser level: four texels, or two, or one."""
    rows, columns = index.shape
    down, across = min(rows, 2), min(columns, 2)
    cut = index.reshape(rows // down, down, columns // across, across)
    return cut.transpose(0, 2, 1, 3).reshape(rows // down, columns // across, down * across)


class ColourPyramid(eqx.Module):
    """A colour map and its averages, linear numbers: what modulates one BRDF (L chapter 7, case 1).

    The radiance of a modulated surface is linear in the colour, so averages of colours will do.
    """

    shape: MipShape = eqx.field(static=True)
    values: Float[AnyArray, "texel channel"]

    @classmethod
    def of(cls, image: ImageArray, wrap: str = "repeat") -> "ColourPyramid":
        """Average an image level by level; raises ``ValueError`` as ``MipShape`` does."""
        shape = MipShape(image.shape[0], image.shape[1], wrap)
        levels = [np.asarray(image).reshape(-1, image.shape[2])]
        for size in shape.sizes[:-1]:
            below = blocks(np.arange(len(levels[-1])).reshape(size))
            levels.append(levels[-1][below.reshape(-1, below.shape[2])].mean(axis=1))
        return cls(shape, np.concatenate(levels))

    def evaluate(
        self, places: Places, levels: Levels, chosen: str = "trilinear"
    ) -> Float[Array, "point channel"]:
        """Look colours up at (u, v) and levels; ``ValueError`` for an unlisted filter."""
        taps = self.shape.taps(places, levels, chosen)
        found = jnp.asarray(self.values)[taps.texel]
        return jnp.einsum("ptc,pt->pc", found, taps.weight.astype(found.dtype), precision="highest")


def _neighbours(place: Float[Array, "point"], chosen: Filter) -> list[tuple[Array, Array]]:
    """Find the texels on either side of a coordinate in texels, and their weights."""
    if not chosen.between_texels:
        return [(jnp.floor(place).astype(np.int32), jnp.ones_like(place))]
    before = jnp.floor(jax.lax.stop_gradient(place) - 0.5)
    fraction, index = place - 0.5 - before, before.astype(np.int32)
    return [(index, 1 - fraction), (index + 1, fraction)]
