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
"""

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
from jaxrender.wavelets.threshold import Thresholded, keep_fraction, keep_largest, keep_within
from jaxrender.wavelets.transform import (
    analyse_nonstandard,
    analyse_standard,
    analyse_step,
    synthesise_nonstandard,
    synthesise_standard,
    synthesise_step,
)

__all__ = [
    "WAVELETS",
    "Thresholded",
    "Wavelet",
    "analyse_nonstandard",
    "analyse_nonstandard_dense",
    "analyse_standard",
    "analyse_standard_dense",
    "analyse_step",
    "analysis_matrix",
    "daubechies",
    "haar",
    "keep_fraction",
    "keep_largest",
    "keep_within",
    "linear_spline",
    "synthesis_matrix",
    "synthesise_nonstandard",
    "synthesise_nonstandard_dense",
    "synthesise_standard",
    "synthesise_standard_dense",
    "synthesise_step",
    "wavelet_named",
]
