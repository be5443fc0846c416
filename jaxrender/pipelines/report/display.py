"""Pictures in a page: their size, tone curve and margin, PNG as a data URI.

A *picture* is a float array [row, column, channel] of linear radiance (``imaging.display``).
"""

import base64

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from jaxrender.imaging import SRGB
from jaxrender.imaging.display import as_rgb, codes, png_of
from jaxrender.shapes import Bool, Float

Picture = Float[np.ndarray, "row column channel"]

# The longest side of a picture in the page: twelve noisy ones of this size stay below a megabyte.
LONGEST_SIDE = 224
# The grey to which a tone curve takes the mean of an environment's logarithm.
_MIDDLE_GREY = 0.18


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
    return codes(SRGB().encode(np.clip(rgb * 1.25 / (1 + bright), 0, 1)))


def with_alpha(
    pixels: UInt8[np.ndarray, "row column 3"], opacity: Float[np.ndarray, "row column"]
) -> UInt8[np.ndarray, "row column 4"]:
    """Let the page show through where a picture has nothing to show."""
    return np.concatenate([pixels, codes(np.clip(opacity, 0, 1))[..., None]], axis=-1)


def data_uri(pixels: UInt8[np.ndarray, "row column channel"]) -> str:
    """Write 8-bit pixels (three channels, or four with opacity) as a PNG within the page."""
    return "data:image/png;base64," + base64.b64encode(png_of(pixels)).decode("ascii")


def hex_colour(linear: Float[np.ndarray, "channel"]) -> str:
    """Name the display colour of a reflectance between 0 and 1."""
    red, green, blue = codes(SRGB().encode(np.clip(as_rgb(linear), 0, 1))).tolist()
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
