"""The nuisances that a fit can free: what each is, its unit, and what is known of it beforehand.

The priors are about what was told.  They are what a careful capture has: the photographs say more,
wherever they say anything.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.nuisances.bumps import SLOPES
from jaxrender.shapes import Float


class Unit(NamedTuple):
    """A unit that a person knows, how many of it make one of the fit's own, and a prior in it."""

    name: str
    per_own: float
    prior: float


class Nuisance(NamedTuple):
    """One thing that may be freed.

    Its numbers come in groups (a rotation has three), each of which has the ``units`` one after the
    other.  ``lowest`` is their least value.
    """

    name: str
    meaning: str
    units: tuple[Unit, ...]
    lowest: float = -np.inf

    def deviations(self, count: int) -> Float[np.ndarray, "number"]:
        """List the standard deviations of the prior, in the fit's own unit."""
        own = [unit.prior / unit.per_own for unit in self.units]
        return np.resize(own, count)

    def in_units(self, numbers: Float[np.ndarray, "number"]) -> Float[np.ndarray, "number"]:
        """Say numbers in their units."""
        return numbers * np.resize([unit.per_own for unit in self.units], len(numbers))


def _rotation(prior: float) -> tuple[Unit, ...]:
    return (Unit("degrees", float(np.degrees(1)), prior),) * 3


def _percent(prior: float) -> tuple[Unit, ...]:
    return (Unit("percent", 100.0, prior),)


# So many numbers, each with this part of a degree as prior, turn normals by one degree (rms).
_PER_BUMP = float(1 / np.sqrt(SLOPES))

NUISANCES = {
    one.name: one
    for one in (
        Nuisance("exposure", "gain of each photograph", _percent(5.0)),
        Nuisance("camera", "rotation of each camera", _rotation(0.1)),
        Nuisance("object", "shift of the object, of its size", _percent(1.0) * 3),
        Nuisance("scale", "enlargement of the object", _percent(1.0)),
        Nuisance("environment", "rotation of each environment", _rotation(1.0)),
        Nuisance(
            "lamps", "rotation and brightness of each source", _rotation(1.0) + _percent(10.0)
        ),
        Nuisance(
            "nearness", "size of the object over a source's distance", (Unit("", 1.0, 0.3),), 0.0
        ),
        Nuisance("black", "black level of each channel, of the radiance", _percent(5.0)),
        Nuisance("response", "exponent of the response", _percent(5.0)),
        Nuisance(
            "normals",
            "displacement of the surface, by harmonics",
            (Unit("degrees", float(np.degrees(1)), _PER_BUMP),),
        ),
        Nuisance("blur", "variance of a blur", (Unit("pixels squared", 1.0, 0.5),), 0.0),
    )
}
