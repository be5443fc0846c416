"""Where a sensor saturates, found from the values themselves: many of them at one top value."""

from collections.abc import Sequence

import numpy as np

from jaxrender.shapes import Float, checked

# So many values at the top, and so many times as many as in each of the next steps.
_FEWEST, _TIMES, _NEXT = 8, 5, 6
# Values this close, relative to the top, are the same.
SAME_VALUE = 1e-5


@checked
def clipped_at(values: Float[np.ndarray, "*any"]) -> float | None:
    """Find the value at which values were clipped; None where nothing piles up at their top.

    Compression spreads a pile over a few steps below it, whose lowest is returned.
    """
    if not values.size or not values.max() > 0:
        return None
    top = float(values.max())
    # Values in steps of what counts as the same.  Of quantised ones, and about a smooth maximum
    # without noise, as many stand in the next steps as in the first.
    below = (top - values) // (top * SAME_VALUE)
    steps, counts = np.unique(below, return_counts=True)
    if len(steps) == 1:  # one value everywhere: there is no top to be seen
        return None
    piled = 0
    while piled < len(counts) - 1 and _is_pile(counts[piled:]):
        piled += 1
    if not piled:
        return None
    return float(values[below <= steps[piled - 1]].min())


def _is_pile(counts: np.ndarray) -> bool:
    """Whether the first count stands out from the next."""
    return bool(counts[0] >= _FEWEST and counts[0] > _TIMES * np.mean(counts[1 : 1 + _NEXT]))


@checked
def saturation_levels(
    images: Sequence[Float[np.ndarray, "row column channel"]],
) -> list[Float[np.ndarray, "channel"]]:
    """Find from which value on each channel of each photograph is saturated; infinite: nowhere.

    A photograph in which too few values are clipped to be seen has the level of another, if its
    highest value is just that.
    """
    found = [
        np.array([clipped_at(channel) or np.inf for channel in np.moveaxis(image, -1, 0)])
        for image in images
    ]
    known = np.array(found)
    for levels, image in zip(found, images):
        tops = image.reshape(-1, image.shape[-1]).max(axis=0)
        for channel, top in enumerate(tops):
            others = known[:, channel][np.isfinite(known[:, channel])]
            same = others[np.abs(others - top) <= SAME_VALUE * top]
            if len(same) and not np.isfinite(levels[channel]):
                levels[channel] = same.min()
    return found
