"""Pixels as measurements: what a stored number says about radiance, and how surely.

A ``Response`` (``response``) turns stored values into linear radiance, ``exposure`` brings
photographs to one scale, ``masks`` selects the pixels that measured something and keeps account of
the others, ``noise`` says how far a measurement may lie from the truth, ``sensor`` how far a stored
value may.  ``brackets`` merges photographs of one scene at several exposures, ``agreement`` holds
them against one another, and ``registration`` finds how far one lies beside another.
``silhouette`` finds the circle of a ball, ``similarity`` compares a
prediction with a photograph, and ``colour`` turns spectra into red, green and blue.
Host side, float64.
"""

from jaxrender.imaging.agreement import (
    MeasuredExposures,
    check_shifts,
    measure_exposures,
    measure_shifts,
)
from jaxrender.imaging.brackets import Bracket, BracketRules, Merged, merge_brackets
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
from jaxrender.imaging.registration import Shift, shift_between
from jaxrender.imaging.response import SRGB, Curve, Linear, Response, response_named
from jaxrender.imaging.sensor import SensorNoise, rounding
from jaxrender.imaging.silhouette import Circle, circle_of
from jaxrender.imaging.similarity import Similarity, similarity

__all__ = [
    "Similarity",
    "similarity",
    "ILLUMINANTS",
    "SRGB",
    "Bracket",
    "BracketRules",
    "Circle",
    "Curve",
    "Linear",
    "MeasuredExposures",
    "Merged",
    "NoiseModel",
    "Response",
    "Selection",
    "SensorNoise",
    "Shift",
    "below_black",
    "check_shifts",
    "circle_of",
    "colour_matching",
    "dilate",
    "erode",
    "estimate_noise",
    "measure_exposures",
    "measure_shifts",
    "merge_brackets",
    "relative_exposures",
    "response_named",
    "rgb_of_reflectance",
    "rgb_weights",
    "rounding",
    "saturated",
    "shift_between",
    "to_radiance",
    "usable_pixels",
]
