"""Pre-filtered BRDF textures: a MIP pyramid of coefficient trees (L 7.2-7.4).

Light from a surface of several BRDFs is linear in them while light and view are the same all over
the pixel, and a tree's coefficients are linear in its BRDF, so that

    F^{l+1}_(u,v) = 1/4 sum of F^l_(2u+i, 2v+j),  i, j = 0, 1          (L 7.8, 7.12)

is a mean of coefficients; level 0 is the finest (``mip``, ERRATA 71).  Equal blocks share a tree,
so a checkerboard has as many trees as it has different blocks.  Means do not know of shadows that
one texel casts on another (L 7.3): ``measured`` takes the trees of every level from a measurement
of the level's own piece of geometry.

The filtered BRDF itself is never made: eight texels are evaluated at the one pair of directions
(L 7.10), all through one ``CellForest``.  ``tree_at`` makes it, the slow twin.  Sums are clamped
at 0 as ``WaveletBRDF`` does, after the mean, which keeps level and mean linear up to there.
"""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.textures.mip import Levels, MipShape, Places, TexelTaps, blocks
from jaxrender.brdf.textures.texture import BRDFTexture, TreeStore, refuse_unlike, thresholded
from jaxrender.geometry import NUSSELT
from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.wavelets import CellForest, CoefficientTree, weighted_sum

Measure = Callable[[int, float, float, float, float], CoefficientTree]
"""The tree of level l and of the rectangle u0, v0, u1, v1 of the texture's unit square."""

# Cells times channels of all trees: 2 GiB of averages in float64.
_MOST_NUMBERS = 1 << 28


class BRDFPyramid(eqx.Module):
    """Levels of a BRDF texture, of Haar trees; ``texels`` numbers the trees through all levels."""

    shape: MipShape = eqx.field(static=True)
    texels: np.ndarray
    trees: tuple[CoefficientTree, ...]
    forest: CellForest
    errors: tuple[float, ...] = eqx.field(static=True)
    """Of each level, what thresholds left out of its worst texel: an upper bound of the rms over
    the cube of places, in 1/sr, channels' squares added up.  What the texture's own trees had lost
    before is not in it."""

    @classmethod
    def averaging(
        cls, texture: BRDFTexture, wrap: str = "repeat", rms: float | None = None
    ) -> "BRDFPyramid":
        """Build every level from means of the one below it; ``rms`` thresholds each mean.

        Raises ``ValueError`` for sides that are no powers of two, trees other than Haar's, and more
        different means than memory should hold.
        """
        rows, columns = texture.index.shape
        levels, store = [texture.index], _Means(texture.trees, rms)
        for _ in MipShape(rows, columns, wrap).sizes[1:]:
            below = blocks(levels[-1])
            lists = below.reshape(-1, below.shape[2]).tolist()
            means = [store.mean(tuple(sorted(block))) for block in lists]
            levels.append(np.array(means).reshape(below.shape[:2]))
        errors = tuple(max(store.errors[k] for k in np.unique(level)) for level in levels)
        return cls._of(levels, store.store.trees, wrap, errors)

    @classmethod
    def of_levels(cls, textures: Sequence[BRDFTexture], wrap: str = "repeat") -> "BRDFPyramid":
        """Take every level as it is, the finest first, as measured from micro-geometry (L 7.3).

        Raises ``ValueError`` for levels that are not halves of each other down to one texel, and
        as ``BRDFTexture.of`` and ``averaging`` do.
        """
        if not textures:
            raise ValueError("no level; give at least one")
        rows, columns = textures[0].index.shape
        shape = MipShape(rows, columns, wrap)
        given = tuple(texture.index.shape for texture in textures)
        if given != shape.sizes:
            raise ValueError(
                f"levels of (rows, columns) {given}: give {shape.sizes}, the finest first"
            )
        store, levels = TreeStore(), []
        refuse_unlike([tree for texture in textures for tree in texture.trees])
        for texture in textures:
            numbers = np.array([store.add(tree) for tree in texture.trees])
            levels.append(numbers[texture.index])
        return cls._of(levels, store.trees, wrap, (0.0,) * len(levels))

    @classmethod
    def measured(
        cls, measure: Measure, size: tuple[int, int], wrap: str = "repeat"
    ) -> "BRDFPyramid":
        """Measure each texel of each level, ``size`` (rows, columns) of them at the finest.

        ``measure(level, u0, v0, u1, v1)`` is called once a texel, the finest level first.  Raises
        as ``of_levels`` does.
        """
        textures = []
        for level, (rows, columns) in enumerate(MipShape(*size, wrap).sizes):
            trees = []
            for row, column in np.ndindex(rows, columns):
                u0, v0 = column / columns, 1 - (row + 1) / rows
                u1, v1 = (column + 1) / columns, 1 - row / rows
                trees.append(measure(level, u0, v0, u1, v1))
            index = np.arange(rows * columns).reshape(rows, columns)
            textures.append(BRDFTexture.of(index, trees))
        return cls.of_levels(textures, wrap)

    @classmethod
    def _of(
        cls,
        levels: Sequence[np.ndarray],
        trees: Sequence[CoefficientTree],
        wrap: str,
        errors: tuple[float, ...],
    ) -> "BRDFPyramid":
        _refuse_many(sum(_numbers(tree) for tree in trees), len(trees))
        texels = np.concatenate([level.ravel() for level in levels]).astype(np.int32)
        shape = MipShape(levels[0].shape[0], levels[0].shape[1], wrap)
        return cls(shape, texels, tuple(trees), CellForest.of(trees), errors)

    @property
    def channels(self) -> int:
        """Of the trees."""
        return self.trees[0].channels

    def level(self, level: int) -> BRDFTexture:
        """Take one level out; raises ``ValueError`` for one that there is not."""
        if not 0 <= level < len(self.shape.sizes):
            raise ValueError(f"level {level} of {len(self.shape.sizes)}; 0 is the finest")
        start, stop = self.shape.starts[level : level + 2]
        index = self.texels[start:stop].reshape(self.shape.sizes[level])
        return BRDFTexture.of(index, self.trees)

    def evaluate(
        self,
        places: Places,
        levels: Levels,
        incoming: Float[AnyArray, "point 3"],
        outgoing: Float[AnyArray, "point 3"],
        chosen: str = "trilinear",
    ) -> Float[Array, "point channel"]:
        """Evaluate rho in 1/sr at (u, v) and levels of detail; 0 below the horizon.

        Directions are local.  ``mip.level_of`` turns sizes of pixel footprints into levels, and
        ``chosen`` is one of ``mip.FILTERS``.  Raises ``ValueError`` for another one.
        """
        taps = self.shape.taps(jnp.asarray(places), jnp.asarray(levels), chosen)
        pair = jnp.asarray(incoming), jnp.asarray(outgoing)
        return _evaluate(self.forest, jnp.asarray(self.texels), taps, *pair)

    def tree_at(
        self, place: tuple[float, float], level: float, chosen: str = "trilinear"
    ) -> CoefficientTree:
        """Make the filtered BRDF of one place (L 7.9), which ``evaluate`` only evaluates."""
        taps = self.shape.taps(np.array([place]), np.array([level]), chosen)
        texels, weights = (np.asarray(part)[0] for part in taps)
        return weighted_sum([self.trees[self.texels[k]] for k in texels], weights.tolist())


class _Means:
    """Means of trees by the numbers they are of, each made once."""

    def __init__(self, trees: Sequence[CoefficientTree], rms: float | None):
        self.store, self.rms = TreeStore(), rms
        self.errors = [0.0] * len(trees)
        self.made: dict[tuple[int, ...], int] = {}
        self.numbers = sum(_numbers(tree) for tree in trees)
        if [self.store.add(tree) for tree in trees] != list(range(len(trees))):
            raise ValueError("two of the texture's trees are equal; make it by BRDFTexture.of")

    def mean(self, block: tuple[int, ...]) -> int:
        """Average the trees of these numbers, in any order."""
        if len(set(block)) == 1:
            return block[0]
        if block not in self.made:
            self.made[block] = self._add(block)
        return self.made[block]

    def _add(self, block: tuple[int, ...]) -> int:
        held, counts = np.unique(block, return_counts=True)
        trees, shares = [self.store.trees[k] for k in held], counts / len(block)
        tree, error = weighted_sum(trees, shares.tolist()), 0.0
        if self.rms is not None:
            tree, error = thresholded(tree, self.rms)
        error += float(sum(share * self.errors[k] for k, share in zip(held, shares, strict=True)))
        number = self.store.add(tree)
        if number == len(self.errors):
            self.errors.append(error)
            self.numbers += _numbers(tree)
            _refuse_many(self.numbers, len(self.errors))
        self.errors[number] = max(self.errors[number], error)
        return number


@eqx.filter_jit
def _evaluate(
    forest: CellForest, numbers: Array, taps: TexelTaps, incoming: Array, outgoing: Array
) -> Float[Array, "point channel"]:
    count = taps.texel.shape[1]
    pair = [NUSSELT.square_from_direction(part) for part in (incoming, outgoing)]
    points = jnp.repeat(jnp.concatenate(pair, axis=1), count, axis=0)
    found = forest.evaluate(points, numbers[taps.texel.ravel()])
    found = found.reshape(len(taps.texel), count, -1).astype(incoming.dtype)
    weight = taps.weight.astype(incoming.dtype)
    total = jnp.einsum("ptc,pt->pc", found, weight, precision="highest")
    visible = (incoming[:, 2] > 0) & (outgoing[:, 2] > 0)
    return jnp.where(visible[:, None], jnp.maximum(total, 0), 0)


def _numbers(tree: CoefficientTree) -> int:
    return (len(tree.structure) << tree.axes) * tree.channels


def _refuse_many(numbers: int, trees: int) -> None:
    if numbers > _MOST_NUMBERS:
        raise ValueError(
            f"{trees} different trees of {numbers:,} numbers in all, above {_MOST_NUMBERS:,}: "
            "threshold them (rms), or give a coarser texture or fewer different BRDFs"
        )
