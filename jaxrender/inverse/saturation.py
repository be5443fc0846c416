"""Values that were clipped although nobody said so: many of them at one and the same top value."""

import numpy as np

from jaxrender.imaging.saturation import SAME_VALUE, clipped_at
from jaxrender.inverse.observations import Observations
from jaxrender.shapes import Bool


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
            top = clipped_at(np.asarray(values, float))
            if top is not None:
                near = np.asarray(observations.radiance)[own, channel] >= top * (1 - SAME_VALUE)
                found[own, channel] = near
    return found


def clipped_share(pool: Observations) -> float:
    """Say which part of all values is clipped: all of them where they are one and the same."""
    radiance = np.asarray(pool.radiance, float)
    if radiance.size and np.ptp(radiance) <= SAME_VALUE * radiance.max():
        return 1.0
    return float(np.mean(clipped_values(pool, pool))) if radiance.size else 0.0


def saturation_sentence(pool: Observations) -> str | None:
    """Say that values are clipped, and what to do about it; None where none are."""
    share = float(np.mean(clipped_values(pool, pool).any(axis=1))) if pool.count else 0.0
    if not share:
        return None
    return (
        f"{100 * share:.2g} % of the pixels stand at the highest value of their photograph: they "
        "are clipped, and capture.saturation: auto leaves them out"
    )
