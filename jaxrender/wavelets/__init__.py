"""Wavelets over any number of axes: a measured BRDF has four, two for each direction (L chapter 4).

``filters``
    Haar, the linear spline CDF(2,2), Daubechies; by name
``layout``
    standard and non-standard decompositions, and where their coefficients stand
``transform``
    samples to coefficients and back, by ``passes`` along long axes, ``products`` along short ones
``dense``
    the same by a matrix for every step
``threshold``
    the largest coefficients, by fraction, count or error, and what leaving out the others costs
``tree``
    the coefficients that are left, as flat sorted arrays; ``nodes`` says how they are numbered
``traversal``
    a tree at points, from the root down, over the ``supports`` of its functions
``cells``
    the same for Haar's wavelet, quickly, for one tree or many
``hashing``
    the same from a table of coefficients, the trees' twin
``importance``
    coefficients in order of importance, and bounds on what stopping early leaves out
``algebra``
    sums, multiples and other resolutions of trees
``sampling`` ``slices``
    random places with a tree's density, some axes held: from a table, and from the tree itself
"""

from jaxrender.wavelets.algebra import resampled, scaled, weighted_sum
from jaxrender.wavelets.cells import CellForest
from jaxrender.wavelets.dense import (
    analyse_nonstandard_dense,
    analyse_standard_dense,
    analysis_matrix,
    synthesis_matrix,
    synthesise_nonstandard_dense,
    synthesise_standard_dense,
)
from jaxrender.wavelets.filters import (
    WAVELETS,
    Wavelet,
    daubechies,
    haar,
    linear_spline,
    wavelet_named,
)
from jaxrender.wavelets.hashing import CoefficientHash
from jaxrender.wavelets.importance import Importance, importance, most_important
from jaxrender.wavelets.nodes import Entries, Structure
from jaxrender.wavelets.sampling import CellDensities, Drawn, TabulatedDensities
from jaxrender.wavelets.slices import SlicedDensities
from jaxrender.wavelets.supports import is_stepwise
from jaxrender.wavelets.threshold import Thresholded, keep_fraction, keep_largest, keep_within
from jaxrender.wavelets.transform import (
    analyse_nonstandard,
    analyse_standard,
    analyse_step,
    synthesise_nonstandard,
    synthesise_standard,
    synthesise_step,
)
from jaxrender.wavelets.traversal import Traversal, evaluate
from jaxrender.wavelets.tree import CoefficientTree

__all__ = [
    "WAVELETS",
    "CellDensities",
    "CellForest",
    "CoefficientHash",
    "CoefficientTree",
    "Drawn",
    "Entries",
    "Importance",
    "SlicedDensities",
    "Structure",
    "TabulatedDensities",
    "Thresholded",
    "Traversal",
    "Wavelet",
    "analyse_nonstandard",
    "analyse_nonstandard_dense",
    "analyse_standard",
    "analyse_standard_dense",
    "analyse_step",
    "analysis_matrix",
    "daubechies",
    "evaluate",
    "haar",
    "importance",
    "is_stepwise",
    "keep_fraction",
    "keep_largest",
    "keep_within",
    "linear_spline",
    "most_important",
    "resampled",
    "scaled",
    "synthesis_matrix",
    "synthesise_nonstandard",
    "synthesise_nonstandard_dense",
    "synthesise_standard",
    "synthesise_standard_dense",
    "synthesise_step",
    "wavelet_named",
    "weighted_sum",
]
