"""Lamps: what stands out of the slow light of an environment, gathered."""

import math
from typing import NamedTuple

import numpy as np

from jaxrender.lighting import Environment, candidates, take
from jaxrender.shapes import Float

# Sources closer than this, in units of sigma, are one lamp, and lamps have this part of the energy.
_ONE_LAMP, _LEAST_ENERGY, _MOST_LAMPS = 1.5, 0.02, 12


class Lamp(NamedTuple):
    """Part of the light that stands out: its direction and irradiance."""

    direction: Float[np.ndarray, "3"]
    irradiance: Float[np.ndarray, "channel"]


def lamps_of(environment: Environment, sigma: float) -> tuple[list[Lamp], float]:
    """Gather what stands out of the slow light into lamps; the second result is the slow part."""
    found = candidates(environment, sigma)
    split = take(environment, found, len(found.cell), sigma)
    directions = np.asarray(found.sources.directions)
    irradiance = np.asarray(found.sources.irradiance)
    total = float(np.sum(np.asarray(environment.nodes().irradiance)))
    lamps, left = [], np.ones(len(directions), bool)
    while left.any() and len(lamps) < _MOST_LAMPS and total > 0:
        strongest = int(np.argmax(np.where(left, irradiance.sum(axis=-1), -1)))
        near = left & (directions @ directions[strongest] > math.cos(_ONE_LAMP * sigma))
        left &= ~near
        own = irradiance[near].sum(axis=0)
        centre = irradiance[near].sum(axis=-1) @ directions[near]
        if own.sum() >= _LEAST_ENERGY * total:
            lamps.append(Lamp(centre / np.linalg.norm(centre), own))
    lamps.sort(key=lambda lamp: -float(lamp.irradiance.sum()))
    return lamps, split.slow_energy
