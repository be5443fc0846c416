"""Values that were clipped although nobody said so: many of them at one and the same top value."""

import numpy as np

from jaxrender.inverse.observations import Observations
from jaxrender.shapes import Bool, Float

# So many values at the top, and so many times as many as at each of the next ones.
_FEWEST, _TIMES, _NEXT = 8, 5, 6
# Values this close, relative to the top, are the same.
_SAME = 1e-5


def clipped_values(
    observations: Observations, pool: Observations
) -> Bool[np.ndarray, "sample channel"]:
    """Mark what stands at the value at which a photograph's channel was clipped.

    ``pool`` are all pixels: whether values pile up is seen among them.
    """
    found = np.zeros(np.shape(observations.radiance), bool)
    frame, every = np.asarray(observations.frame), np.asarray(pool.frame)
    for photograph in np.unique(frame):
        own, all_of_it = frame == photograph, np.asarray(pool.radiance)[every == photograph]
        for channel, values in enumerate(all_of_it.T):
            top = _clipped_at(np.asarray(values, float))
            if top is not None:
                near = np.asarray(observations.radiance)[own, channel] >= top * (1 - _SAME)
                found[own, channel] = near
    return found


def saturation_sentence(pool: Observations) -> str | None:
    """Say that values are clipped, and what to do about it; None where none are."""
    share = float(np.mean(clipped_values(pool, pool).any(axis=1))) if pool.count else 0.0
    if not share:
        return None
    return (
        f"{100 * share:.2g} % of the pixels stand at the highest value of their photograph: they "
        "are clipped, and capture.saturation leaves them out"
    )


def _clipped_at(values: Float[np.ndarray, "pixel"]) -> float | None:
    """Find the value at which a channel was clipped; None where nothing piles up at its top."""
    if not len(values) or not values.max() > 0:
        return None
    top = float(values.max())
    at_top = int(np.sum(values >= top * (1 - _SAME)))
    below = np.sort(values[values < top * (1 - _SAME)])[::-1]
    # Quantised values repeat as well, but at their top no more often than next to it.
    levels = np.unique(below[: at_top * _NEXT])[::-1][:_NEXT]
    usual = np.mean([np.sum(values == level) for level in levels]) if len(levels) else 0
    return top if at_top >= _FEWEST and at_top > _TIMES * usual else None
