"""Lights and BRDFs as coefficients by degree: where direction becomes frequency (T 3).

``light``
    harmonic coefficients of any light
``lambertian``
    the clamped cosine, exactly, to any degree
``microfacet``
    the transfer h_l(sigma, mu, exit cosine) of a microfacet lobe, with its Gaussian and
    normal-exitance twins
"""

from jaxrender.spectra.lambertian import lambertian_transfer
from jaxrender.spectra.light import light_coefficients
from jaxrender.spectra.microfacet import (
    TRANSFERS,
    exit_cosine_transfer,
    gaussian_transfer,
    normal_exitance_transfer,
    transfer_of_samples,
)

__all__ = [
    "TRANSFERS",
    "exit_cosine_transfer",
    "gaussian_transfer",
    "lambertian_transfer",
    "light_coefficients",
    "normal_exitance_transfer",
    "transfer_of_samples",
]
