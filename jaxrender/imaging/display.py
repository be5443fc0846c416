"""Radiance made visible: exposure, sRGB encoding, PNG.

A *picture* is a float array [row, column, channel] of linear radiance; one channel is shown as
grey, three as red, green and blue, any other number by its mean.
"""

import io

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from jaxrender.imaging.response import SRGB
from jaxrender.shapes import AnyArray, Float

# Radiance that an exposure puts just below white, and the percentile of the object that gets it.
_BRIGHT, _BRIGHT_PERCENTILE = 0.8, 95


def as_rgb(picture: AnyArray) -> Float[np.ndarray, "*batch 3"]:
    """Show any number of channels as three; what is not finite becomes black."""
    values = np.nan_to_num(np.asarray(picture, float), nan=0.0, posinf=0.0, neginf=0.0)
    if values.shape[-1] != 3:
        values = np.repeat(values.mean(axis=-1, keepdims=True), 3, axis=-1)
    return values


def exposure_for(radiance: Float[np.ndarray, "*batch"]) -> float:
    """Choose the factor that takes the 95th percentile of the radiance to just below white."""
    finite = radiance[np.isfinite(radiance)]
    bright = float(np.percentile(finite, _BRIGHT_PERCENTILE)) if finite.size else 0.0
    return _BRIGHT / bright if bright > 0 else 1.0


def exposed(
    picture: Float[np.ndarray, "row column channel"], exposure: float
) -> UInt8[np.ndarray, "row column 3"]:
    """Encode a picture for the display: linear up to white, then clipped."""
    return codes(SRGB().encode(np.clip(as_rgb(picture) * exposure, 0, 1)))


def codes(values: Float[np.ndarray, "*batch"]) -> UInt8[np.ndarray, "*batch"]:
    """Round values between 0 and 1 to 8 bits."""
    return np.rint(values * 255).astype(np.uint8)


def png_of(pixels: UInt8[np.ndarray, "row column channel"]) -> bytes:
    """Write 8-bit pixels (three channels, or four with opacity) as the content of a PNG file."""
    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels, np.uint8)).save(stream, "PNG")
    return stream.getvalue()
