"""Pixels as measurements: what a stored number says about radiance, and how surely.

A ``Response`` (``response``) turns stored values into linear radiance, ``exposure`` brings
photographs to one scale, ``masks`` selects the pixels that measured something and keeps account of
the others, ``noise`` says how far a measurement may lie from the truth, ``sensor`` how far a stored
value may.  ``brackets`` merges photographs of one scene at several exposures, ``agreement`` holds
them against one another, ``registration`` finds how far one lies beside another, and
``response_recovery`` finds the response from them, by pixels of ``bracket_samples``.  ``white``
reads grey cards and colour charts, ``calibration_frames`` dark frames and flat fields.
``saturation`` finds where a sensor clips, ``silhouette`` the circle of a ball by its
mask, and ``ball_edges`` by its edges.  ``colour`` turns spectra into red, green and blue.  Host
side, float64.
"""

from jaxrender.imaging.agreement import (
    MeasuredExposures,
    aligned,
    check_shifts,
    measure_exposures,
    measure_shifts,
)
from jaxrender.imaging.ball_edges import circle_of_edges
from jaxrender.imaging.brackets import Bracket, BracketRules, Merged, merge_brackets
from jaxrender.imaging.calibration_frames import (
    Dark,
    Vignetting,
    above_black,
    dark_of,
    fit_vignetting,
    flat_field_gain,
)
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
from jaxrender.imaging.response_recovery import RecoveredResponse, recover_response
from jaxrender.imaging.saturation import clipped_at, saturation_levels
from jaxrender.imaging.sensor import SensorNoise, rounding
from jaxrender.imaging.silhouette import Circle, circle_of, outline_of
from jaxrender.imaging.similarity import Similarity, similarity
from jaxrender.imaging.white import (
    PATCHES,
    ColourFit,
    Rectangle,
    WhiteBalance,
    chart_colours,
    chart_patches,
    fit_colours,
    white_balance,
)

__all__ = [
    "Similarity",
    "similarity",
    "ILLUMINANTS",
    "PATCHES",
    "SRGB",
    "Bracket",
    "BracketRules",
    "Circle",
    "ColourFit",
    "Curve",
    "Dark",
    "Linear",
    "MeasuredExposures",
    "Merged",
    "NoiseModel",
    "RecoveredResponse",
    "Rectangle",
    "Response",
    "Selection",
    "SensorNoise",
    "Shift",
    "Vignetting",
    "WhiteBalance",
    "above_black",
    "aligned",
    "below_black",
    "chart_colours",
    "chart_patches",
    "check_shifts",
    "circle_of",
    "circle_of_edges",
    "clipped_at",
    "colour_matching",
    "dark_of",
    "dilate",
    "erode",
    "estimate_noise",
    "fit_colours",
    "fit_vignetting",
    "flat_field_gain",
    "measure_exposures",
    "measure_shifts",
    "merge_brackets",
    "outline_of",
    "recover_response",
    "relative_exposures",
    "response_named",
    "rgb_of_reflectance",
    "rgb_weights",
    "saturation_levels",
    "rounding",
    "saturated",
    "shift_between",
    "to_radiance",
    "usable_pixels",
    "white_balance",
]
