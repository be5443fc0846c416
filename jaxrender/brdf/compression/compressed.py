"""A BRDF to its tree, in either embedding, as ``jaxrender compress`` makes it."""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.compression.energy import Energy, conserving
from jaxrender.brdf.compression.isotropic import Isotropic, Judge, compress_isotropic
from jaxrender.brdf.compression.judged_pairs import Estimate
from jaxrender.brdf.compression.squares import Compression, Goal, compression_of
from jaxrender.brdf.half_difference_tree import HalfDifferenceTree
from jaxrender.brdf.parameters import refuse_unlisted
from jaxrender.brdf.tables.cell_means import CELL_SAMPLES, Samples, tabulate
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.brdf.wavelet import WaveletBRDF
from jaxrender.geometry import NUSSELT
from jaxrender.wavelets import CoefficientTree, Wavelet, haar, linear_spline

EMBEDDINGS = ("nusselt", "half-difference")


class Compressed(NamedTuple):
    """A tree, the BRDF that it is, what it misses of the first one, and its energy.

    ``masked`` cells had no value that is finite and not negative; the nearest filled them.
    ``lost`` is the share of uniform light that the BRDF reflects and, by ``conserve``, no longer.
    """

    tree: CoefficientTree
    brdf: WaveletBRDF | HalfDifferenceTree
    errors: dict[str, Estimate]
    energy: Energy
    masked: int
    lost: float
    details: Compression | Isotropic


def compressed(
    brdf: BRDF,
    size: int = 32,
    goal: Goal | None = None,
    *,
    embedding: str = "nusselt",
    transform: str = "cube-root",
    wavelet: Wavelet | None = None,
    cell_samples: int = CELL_SAMPLES,
    conserve: bool = False,
) -> Compressed:
    """Make the tree of a BRDF, ``size`` samples along each axis, by default 1 % of coefficients.

    Over ``nusselt`` squares (``WaveletBRDF``; shading, sampling and textures take these) samples
    are exact means over cells, the wavelet Haar's by default.  Over ``half-difference`` angles
    (``HalfDifferenceTree``, isotropic) the tree holds a ``transform`` of values, by default in the
    linear spline, and ``goal.fraction`` is of all samples.  ``conserve`` dims a BRDF that creates
    light (``conserving``).  Host side.

    Raises ``ValueError`` for an unlisted embedding or transform, a size that is no power of two, a
    goal out of range, an anisotropic BRDF over half and difference angles, and one without light.
    """
    refuse_unlisted("embedding", embedding, EMBEDDINGS)
    goal, lost, limit = goal or Goal(), 0.0, None
    truth = brdf
    if conserve:
        done = conserving(brdf)
        brdf, lost, limit = done.brdf, done.lost, 1.0
    if embedding == "half-difference":
        count, judge = max(round(goal.fraction * size**3), 1), Judge.of(truth)
        chosen = wavelet or linear_spline()
        found = compress_isotropic(brdf, judge, chosen, size, transform, count, goal.error, limit)
        return Compressed(found.tree, found.brdf, found.errors, found.energy, 0, lost, found)
    table, masked = cell_table(brdf, size, cell_samples=cell_samples)
    if not table.any():
        raise ValueError("the BRDF reflects nothing anywhere; there is nothing to compress")
    squares = compression_of(table, wavelet or haar(), goal, limit)
    tree = WaveletBRDF(squares.tree)
    errors = Judge.of(truth).errors(tree)
    return Compressed(squares.tree, tree, errors, squares.energy, masked, lost, squares)


def cell_table(
    brdf: BRDF,
    size: int,
    fill: str = "nearest",
    dtype: type = np.float32,
    cell_samples: int = CELL_SAMPLES,
) -> Samples:
    """Tabulate what a tree over squares is made of; cells that a BRDF already has are taken."""
    return tabulate(brdf, size, fill, dtype, 1 if _has_cells(brdf, size) else cell_samples)


def _has_cells(brdf: BRDF, size: int) -> bool:
    if isinstance(brdf, WaveletBRDF):
        return brdf.tree.size == size and brdf.embedding == NUSSELT
    own = (size,) * 4, NUSSELT
    return isinstance(brdf, TabulatedBRDF) and (brdf.size, brdf.embedding) == own
