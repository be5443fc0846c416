"""A BRDF as coefficients from photographs under known light (T 6.4.2, fig. 6.2).

``basis``
    which coefficients there are, and how each sample measures them
``recovery``
    streamed normal equations, the prior, and their solution with its covariance
``left_out`` ``examination``
    errors that know of misfit; what is left above the noise, and whether the order explains it
``harmonic_brdf``
    the recovered coefficients as a BRDF like any other
``estimate``
    the whole recovery from photographs, and what it found: printed and saved
"""

from jaxrender.inverse.brdf_spectrum.basis import SpectrumBasis
from jaxrender.inverse.brdf_spectrum.estimate import (
    DegreeOfLobe,
    SpectrumEstimate,
    SpectrumSettings,
    estimate_spectrum,
    lobe_error,
)
from jaxrender.inverse.brdf_spectrum.harmonic_brdf import HarmonicBRDF
from jaxrender.inverse.brdf_spectrum.recovery import BRDFSpectrum, Prior, fit_brdf_spectrum

__all__ = [
    "BRDFSpectrum",
    "DegreeOfLobe",
    "HarmonicBRDF",
    "Prior",
    "SpectrumBasis",
    "SpectrumEstimate",
    "SpectrumSettings",
    "estimate_spectrum",
    "fit_brdf_spectrum",
    "lobe_error",
]
