"""Values that were clipped although nobody said so: many of them at one and the same top value."""

import numpy as np

from jaxrender.inverse.observations import Observations
from jaxrender.shapes import Bool, Float

# So many values at the top, and so many times as many as in each of the next steps.
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


def clipped_share(pool: Observations) -> float:
    """Say which part of all values is clipped: all of them where they are one and the same."""
    radiance = np.asarray(pool.radiance, float)
    if radiance.size and np.ptp(radiance) <= _SAME * radiance.max():
        return 1.0
    return float(np.mean(clipped_values(pool, pool))) if radiance.size else 0.0


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
    # Values in steps of what counts as the same.  Of quantised ones, and about a smooth maximum
    # without noise, as many stand in the next steps as in the first.
    steps, counts = np.unique((top - values) // (top * _SAME), return_counts=True)
    if len(steps) == 1:  # one value everywhere: there is no top to be seen
        return None
    piled = counts[0] >= _FEWEST and counts[0] > _TIMES * np.mean(counts[1 : 1 + _NEXT])
    return top if piled else None
