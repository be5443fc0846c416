"""Where the object is in a photograph that has no mask: what differs from the picture's border.

The border's median is the background, and the threshold is Otsu's, on the root of the difference:
an object's dark side counts, too.
"""

import numpy as np
from scipy import ndimage

from jaxrender.shapes import Bool, Float, checked

# The border is this part of the picture's shorter side, at least one pixel.
_BORDER = 0.03
_LEVELS = 256
# What differs by less than this many deviations of the border is background.
_DEVIATIONS = 6.0
# An object takes more of the picture than this, and less than all but this.
_LEAST = 2e-4


@checked
def outlined(pixels: Float[np.ndarray, "row column channel"]) -> Bool[np.ndarray, "row column"]:
    """Guess the pixels of the largest object; none where nothing stands out from the border."""
    values = np.nan_to_num(np.maximum(pixels, 0), posinf=0.0)
    width = max(1, round(_BORDER * min(values.shape[:2])))
    inside = np.zeros(values.shape[:2], bool)
    inside[width:-width, width:-width] = True
    border = values[~inside]
    background = np.median(border, axis=0)
    spread = 1.4826 * np.median(np.abs(border - background), axis=0)
    difference = np.sqrt(np.abs(values - background).max(axis=-1))
    least = np.sqrt(_DEVIATIONS * float(spread.max()))
    # A black background has no spread, and what is a thousandth of the brightest is there.
    floor = max(least, np.sqrt(1e-3) * float(np.percentile(difference, 99.5)))
    threshold = max(floor, min(_otsu(difference), 4 * floor))
    found = np.asarray(ndimage.binary_fill_holes(difference > threshold))
    labels = np.zeros(found.shape, np.int32)
    count = int(ndimage.label(ndimage.binary_opening(found), output=labels))  # type: ignore
    if not count:
        return np.zeros(found.shape, bool)
    sizes = np.bincount(labels.ravel())[1:]
    mask = labels == 1 + int(np.argmax(sizes))
    return mask if _LEAST < mask.mean() < 1 - _LEAST else np.zeros(found.shape, bool)


def _otsu(values: Float[np.ndarray, "row column"]) -> float:
    """Find the threshold that parts values with the largest variance between the parts."""
    counts, edges = np.histogram(values, _LEVELS)
    centres = (edges[1:] + edges[:-1]) / 2
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * centres)
    parted = (below > 0) & (above > 0)
    if not parted.any():
        return 0.0
    means = sums[parted] / below[parted] - (sums[-1] - sums[parted]) / above[parted]
    between = below[parted] * above[parted] * means**2
    return float(centres[parted][int(np.argmax(between))])
