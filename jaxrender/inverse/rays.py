"""The rays on which samples are seen, and what they meet when cameras or the object move.

The object stays where it is: shifting it is shifting all cameras the other way, and enlarging it is
bringing them nearer.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Hits, Shape
from jaxrender.inverse.observations import Observations
from jaxrender.shapes import Float, checked

# Rays that pass their camera by more than this part of its distance are not those of a pinhole.
_ASIDE = 1e-6


class Rays(NamedTuple):
    """The rays on which the samples are seen: a point of each before the object, and where to.

    ``eyes`` are where the cameras stand, if that is known.
    """

    origins: Float[np.ndarray, "sample 3"]
    directions: Float[np.ndarray, "sample 3"]
    eyes: Float[np.ndarray, "sample 3"] | None

    @classmethod
    def of(cls, observations: Observations, shape: Shape) -> "Rays":
        """Find the rays of samples that have places."""
        assert observations.places is not None
        points = np.asarray(observations.places.points, float)
        outgoing = np.asarray(observations.samples.outgoing, float)
        if observations.eyes is None:
            return cls(points + shape.diagonal() * outgoing, -outgoing, None)
        eyes = np.asarray(observations.eyes, float)[np.asarray(observations.frame)]
        depth = np.sum((eyes - points) * outgoing, axis=1, keepdims=True)
        return cls(points + depth * outgoing, -outgoing, eyes)

    @property
    def parallel(self) -> bool:
        """Whether the rays of a camera are parallel, so that nearer is no larger."""
        if self.eyes is None:
            return False
        aside = np.cross(self.directions, self.eyes - self.origins)
        return bool(np.max(np.linalg.norm(aside, axis=1)) > _ASIDE * np.max(np.abs(self.eyes)))

    @checked
    def turned(self, rotations: Float[np.ndarray, "*sample 3 3"]) -> "Rays":
        """Turn rays about their cameras."""
        assert self.eyes is not None
        from_eye = self.origins - self.eyes
        return self._replace(
            origins=self.eyes + np.einsum("...ij,...j->...i", rotations, from_eye),
            directions=np.einsum("...ij,...j->...i", rotations, self.directions),
        )

    @checked
    def shifted(self, by: Float[np.ndarray, "*sample 3"]) -> "Rays":
        """Shift rays, and their cameras."""
        eyes = None if self.eyes is None else self.eyes + by
        return Rays(self.origins + by, self.directions, eyes)

    def meet(self, shape: Shape) -> Hits:
        """Find where the rays meet the object first."""
        return shape.first_hits(self.origins, self.directions)


def center_of(shape: Shape) -> Float[np.ndarray, "3"]:
    """The middle of the object's bounding box."""
    return shape.bounds().mean(axis=0)


def size_of(shape: Shape) -> float:
    """Half the longest side of the object's bounding box."""
    lower, upper = shape.bounds()
    return float(np.max(upper - lower)) / 2
