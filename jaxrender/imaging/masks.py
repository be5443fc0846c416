"""Which pixels are measurements, and an account of why the others are not.

Masks are True where the named thing holds: ``saturated`` is True on saturated pixels, an eroded
coverage mask on pixels that are safely inside the object.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from jaxrender.shapes import checked

Mask = Bool[np.ndarray, "row column"]

# Neighbours of a pixel -> the order of connectivity that scipy.ndimage calls it.
_CONNECTIVITY = {4: 1, 8: 2}


class Selection(NamedTuple):
    """The usable pixels, and how many each rule took, in the order in which they were applied."""

    usable: Mask
    considered: int
    removed: dict[str, int]


@checked
def erode(mask: Mask, pixels: int, neighbours: int = 8) -> Mask:
    """The pixels whose 4- or 8-neighbourhoods of the given radius lie wholly inside the mask.

    Beyond the image's border counts as outside.  ValueError for a negative radius or other
    neighbourhoods.
    """
    if pixels < 0:
        raise ValueError(f"cannot erode by {pixels} pixels: give 0 or more")
    if pixels == 0:  # which SciPy takes as "until nothing changes"
        return mask.copy()
    return ndimage.binary_erosion(mask, _structure(neighbours), iterations=pixels)


@checked
def dilate(mask: Mask, pixels: int, neighbours: int = 8) -> Mask:
    """The pixels within the given radius of the mask; the inverse errors of ``erode``."""
    if pixels < 0:
        raise ValueError(f"cannot dilate by {pixels} pixels: give 0 or more")
    if pixels == 0:
        return mask.copy()
    return ndimage.binary_dilation(mask, _structure(neighbours), iterations=pixels)


@checked
def saturated(
    values: Float[np.ndarray, "row column channel"],
    level: float | Float[np.ndarray, "channel"],
    grow: int = 0,
) -> Mask:
    """Pixels with any channel at or above the level, or its own, grown by ``grow`` pixels.

    Growing by 1 also takes the neighbours that a demosaicing or resampling filter mixed with them.
    """
    return dilate(np.any(values >= level, axis=-1), grow)


@checked
def below_black(values: Float[np.ndarray, "row column channel"], level: float) -> Mask:
    """Pixels with any channel below the level, which the sensor's black clips."""
    return np.any(values < level, axis=-1)


@checked
def usable_pixels(covered: Mask, rejected: Mapping[str, Bool[np.ndarray, "_ _"]]) -> Selection:
    """The covered pixels that no rule rejects; each pixel is counted by the first that does.

    Hence considered = usable + the sum over the rules.
    """
    usable = covered.copy()
    removed = {}
    for rule, mask in rejected.items():
        if mask.shape != covered.shape:
            raise ValueError(
                f"the mask of rule {rule!r} is {mask.shape}, the photograph {covered.shape}: "
                "masks and photographs must have the same size"
            )
        removed[rule] = int((usable & mask).sum())
        usable &= ~mask
    return Selection(usable, int(covered.sum()), removed)


def _structure(neighbours: int) -> np.ndarray:
    if neighbours not in _CONNECTIVITY:
        raise ValueError(f"{neighbours} neighbours: choose one of {sorted(_CONNECTIVITY)}")
    return ndimage.generate_binary_structure(2, _CONNECTIVITY[neighbours])
