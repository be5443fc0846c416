"""Reflectance as a function of two directions.

``base``
    what a BRDF is: lobes times amplitudes, seen through its transfer function
``fresnel`` ``masking``
    the factors that microfacet models share
``lambertian`` ``microfacet``
    one model a file
"""

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.fresnel import FRESNEL_ANGLES, fresnel, normalised_fresnel
from jaxrender.brdf.lambertian import Lambertian
from jaxrender.brdf.masking import MASKINGS, smith_masking
from jaxrender.brdf.microfacet import Microfacet, microfacet_distribution

__all__ = [
    "BRDF",
    "FRESNEL_ANGLES",
    "MASKINGS",
    "Lambertian",
    "Microfacet",
    "fresnel",
    "microfacet_distribution",
    "normalised_fresnel",
    "smith_masking",
]
