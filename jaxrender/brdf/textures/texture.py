"""Textures whose texels are BRDFs: an image of indices into a list of trees (L 7, case 3).

Trees are those of ``brdf.wavelet``: rho over Nusselt's square for either direction, in 1/sr.  Row 0
of the image lies at v = 1.  Equal trees are kept once, whatever the number of their texels.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.compression.compressed import cell_table
from jaxrender.brdf.compression.squares import Goal, compression_of
from jaxrender.brdf.tables.cell_means import CELL_SAMPLES
from jaxrender.shapes import AnyArray, Int
from jaxrender.wavelets import (
    CoefficientTree,
    Structure,
    Wavelet,
    haar,
    keep_within,
)

_AXES = 4


class BRDFTexture(NamedTuple):
    """``index`` names each texel's tree; ``BRDFTexture.of`` makes a checked one."""

    index: Int[np.ndarray, "row column"]
    trees: tuple[CoefficientTree, ...]

    @classmethod
    def of(
        cls, index: Int[AnyArray, "row column"], trees: Sequence[CoefficientTree]
    ) -> "BRDFTexture":
        """Join equal trees, and drop those that no texel names.

        Raises ``ValueError`` for an empty image, indices that there is no tree for, and trees of
        other than four axes or that differ in wavelet, size or channels.
        """
        index = np.asarray(index)
        if not index.size or index.min() < 0 or index.max() >= len(trees):
            raise ValueError(
                f"indices {index.min(initial=0)} to {index.max(initial=-1)} in an image of "
                f"{index.shape} and {len(trees)} trees: give texels, and each an index from 0"
            )
        refuse_unlike(trees)
        used, row = np.unique(index, return_inverse=True)
        store = TreeStore()
        numbers = np.array([store.add(trees[k]) for k in used])
        return cls(numbers[row].reshape(index.shape), tuple(store.trees))


class TreeStore:
    """A growing list of trees in which equal ones have one number."""

    def __init__(self):
        self.trees: list[CoefficientTree] = []
        self._numbers: dict[tuple[Structure, bytes, bytes], int] = {}

    def add(self, tree: CoefficientTree) -> int:
        """Return the number of a tree, a new one if it is not there yet."""
        root, values = (np.asarray(part).tobytes() for part in (tree.root, tree.values))
        key = tree.structure, root, values
        if key not in self._numbers:
            self._numbers[key] = len(self.trees)
            self.trees.append(tree)
        return self._numbers[key]


def refuse_unlike(trees: Sequence[CoefficientTree]) -> None:
    """Raise ``ValueError`` for trees that are no BRDFs, or differ in more than coefficients."""
    for tree in trees:
        if tree.axes != _AXES:
            raise ValueError(f"a tree of {tree.axes} axes; a BRDF has {_AXES}")
        mine, first = ((t.wavelet.name, t.size, t.channels, t.offset) for t in (tree, trees[0]))
        if mine != first:
            raise ValueError(
                f"trees of (wavelet, size, channels, offset) {first} and {mine}; make them alike"
            )


def tree_of(
    brdf: BRDF,
    size: int = 16,
    keep: float = 1.0,
    wavelet: Wavelet | None = None,
    cell_samples: int = CELL_SAMPLES,
) -> CoefficientTree:
    """Make the tree of a BRDF over two squares, as ``brdf.compression.compressed`` does.

    All coefficients of its table are kept by default, in JAX's default precision.  Raises
    ``ValueError`` for a size that is no power of two, a fraction outside (0, 1] and a BRDF that is
    negative or not finite somewhere.
    """
    dtype = jax.dtypes.canonicalize_dtype(float).type
    table, masked = cell_table(brdf, size, dtype=dtype, cell_samples=cell_samples)
    if masked:
        raise ValueError(f"{masked} means of values that are negative or not finite; mend the BRDF")
    return compression_of(table, wavelet or haar(), Goal(keep)).tree


class Thresholded(NamedTuple):
    """A tree of fewer coefficients, and the rms error that they cost."""

    tree: CoefficientTree
    rms: float


def thresholded(tree: CoefficientTree, rms: float) -> Thresholded:
    """Leave out as many coefficients as cost at most this rms error.

    The rms is over the unit cube of places, channels' squares added up; exact for an orthonormal
    wavelet.  Raises ``ValueError`` for an error that is negative or NaN.
    """
    entries = tree.entries()
    count = max(len(entries.values), 1)
    # A tree's coefficients squared add up to an integral over the cube, not to a mean of samples.
    kept = keep_within(entries.values, rms / np.sqrt(count), joint=True)
    held = np.any(np.asarray(kept.coefficients) != 0, axis=1)
    fewer = CoefficientTree.of_entries(
        tree.wavelet,
        tree.size,
        tree.axes,
        entries.chosen(held),
        tree.root,
    )
    missing = kept.predicted_rms * np.sqrt(count)
    return Thresholded(dataclasses.replace(fewer, offset=tree.offset), float(missing))
