"""Radiance made visible: exposure, tone curve, sRGB encoding, PNG as a data URI.

A *picture* is a float array [row, column, channel] of linear radiance; one channel is shown as
grey, three as red, green and blue, any other number by its mean.
"""

import base64
import io

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from jaxrender.imaging import SRGB
from jaxrender.shapes import AnyArray, Bool, Float

Picture = Float[np.ndarray, "row column channel"]

# The longest side of a picture in the page: twelve noisy ones of this size stay below a megabyte.
LONGEST_SIDE = 224
# Radiance that an exposure puts just below white, and the percentile of the object that gets it.
_BRIGHT, _BRIGHT_PERCENTILE = 0.8, 95
# The grey to which a tone curve takes the mean of an environment's logarithm.
_MIDDLE_GREY = 0.18


def as_rgb(picture: AnyArray) -> Float[np.ndarray, "*batch 3"]:
    """Show any number of channels as three; what is not finite becomes black."""
    values = np.nan_to_num(np.asarray(picture, float), nan=0.0, posinf=0.0, neginf=0.0)
    if values.shape[-1] != 3:
        values = np.repeat(values.mean(axis=-1, keepdims=True), 3, axis=-1)
    return values


def shrunk(
    picture: Picture, longest: int = LONGEST_SIDE
) -> Float[np.ndarray, "shown_row shown_column channel"]:
    """Average neighbouring pixels until the longest side fits."""
    rows, columns = picture.shape[:2]
    factor = min(1.0, longest / max(rows, columns))
    if factor == 1.0:
        return picture
    size = (max(1, round(columns * factor)), max(1, round(rows * factor)))
    channels = [
        Image.fromarray(np.ascontiguousarray(channel, np.float32)).resize(
            size, Image.Resampling.BOX
        )
        for channel in np.moveaxis(picture, -1, 0)
    ]
    return np.stack([np.asarray(channel, float) for channel in channels], axis=-1)


def exposure_for(radiance: Float[np.ndarray, "*batch"]) -> float:
    """Choose the factor that takes the 95th percentile of the radiance to just below white."""
    finite = radiance[np.isfinite(radiance)]
    bright = float(np.percentile(finite, _BRIGHT_PERCENTILE)) if finite.size else 0.0
    return _BRIGHT / bright if bright > 0 else 1.0


def exposed(picture: Picture, exposure: float) -> UInt8[np.ndarray, "row column 3"]:
    """Encode a picture for the display: linear up to white, then clipped."""
    return _codes(SRGB().encode(np.clip(as_rgb(picture) * exposure, 0, 1)))


def tone_key(radiance: Picture, darkest: float = 1e-4) -> float:
    """Find the factor that takes a panorama's logarithmic mean to middle grey.

    What is under the part ``darkest`` of its mean counts little in it.
    """
    luminance = as_rgb(radiance).mean(axis=-1)
    floor = darkest * luminance.mean()
    if not floor > 0:
        return 1.0
    return _MIDDLE_GREY / float(np.exp(np.mean(np.log(luminance + floor))))


def tone_mapped(radiance: Picture, key: float) -> UInt8[np.ndarray, "row column 3"]:
    """Compress a picture of any contrast, hue kept: L -> L / (1 + L) of its brightness."""
    rgb = np.maximum(as_rgb(radiance), 0) * key
    bright = rgb.mean(axis=-1, keepdims=True)
    return _codes(SRGB().encode(np.clip(rgb * 1.25 / (1 + bright), 0, 1)))


def with_alpha(
    codes: UInt8[np.ndarray, "row column 3"], opacity: Float[np.ndarray, "row column"]
) -> UInt8[np.ndarray, "row column 4"]:
    """Let the page show through where a picture has nothing to show."""
    return np.concatenate([codes, _codes(np.clip(opacity, 0, 1))[..., None]], axis=-1)


def data_uri(codes: UInt8[np.ndarray, "row column channel"]) -> str:
    """Write 8-bit pixels (three channels, or four with opacity) as a PNG within the page."""
    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(codes, np.uint8)).save(stream, "PNG")
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def hex_colour(linear: Float[np.ndarray, "channel"]) -> str:
    """Name the display colour of a reflectance between 0 and 1."""
    red, green, blue = _codes(SRGB().encode(np.clip(as_rgb(linear), 0, 1))).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"


def bounding_box(covered: Bool[np.ndarray, "row column"]) -> tuple[slice, slice]:
    """Crop to what is covered, with a margin; everything where nothing is."""
    if not covered.any():
        return slice(None), slice(None)
    return _extent(np.any(covered, axis=1)), _extent(np.any(covered, axis=0))


def _extent(occupied: Bool[np.ndarray, "line"]) -> slice:
    lines = np.flatnonzero(occupied)
    margin = max(1, round(0.04 * (lines[-1] - lines[0] + 1)))
    return slice(max(0, int(lines[0]) - margin), int(lines[-1]) + 1 + margin)


def _codes(values: Float[np.ndarray, "*batch"]) -> UInt8[np.ndarray, "*batch"]:
    return np.rint(values * 255).astype(np.uint8)
