"""Pixels as measurements: what a stored number says about radiance, and how surely.

A ``Response`` (``response``) turns stored values into linear radiance, ``exposure`` brings
photographs to one scale, ``masks`` selects the pixels that measured something and keeps account of
the others, ``noise`` says how far a measurement may lie from the truth, ``silhouette`` finds the
circle of a ball, ``similarity`` compares a prediction with a photograph, and ``colour`` turns
spectra into red, green and blue.  Host side, float64.
"""

from jaxrender.imaging.colour import (
    ILLUMINANTS,
    colour_matching,
    rgb_of_reflectance,
    rgb_weights,
)
from jaxrender.imaging.exposure import relative_exposures, to_radiance
from jaxrender.imaging.masks import (
    Selection,
    below_black,
    dilate,
    erode,
    saturated,
    usable_pixels,
)
from jaxrender.imaging.noise import NoiseModel, estimate_noise
from jaxrender.imaging.response import SRGB, Curve, Linear, Response, response_named
from jaxrender.imaging.silhouette import Circle, circle_of
from jaxrender.imaging.similarity import Similarity, similarity

__all__ = [
    "ILLUMINANTS",
    "SRGB",
    "Curve",
    "Linear",
    "NoiseModel",
    "Response",
    "Selection",
    "below_black",
    "colour_matching",
    "dilate",
    "erode",
    "estimate_noise",
    "relative_exposures",
    "response_named",
    "rgb_of_reflectance",
    "rgb_weights",
    "saturated",
    "to_radiance",
    "usable_pixels",
    "Circle",
    "circle_of",
    "Similarity",
    "similarity",
]
