"""Sources near enough to have a place: each point of the object sees them elsewhere.

A source in direction d at the distance D has the nearness k = s / D, s being the size of the
object: k = 0 is infinitely far.  From the point p, in sizes of the object from its centre, it lies
along o = d - k p, and its irradiance there is that at the centre over |o|^2.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.reflection import FrameNodes
from jaxrender.shapes import AnyArray, Float, checked


class Nearness(eqx.Module):
    """How near sources are: ``of_sources`` those of all photographs, ``of_frames`` the others.

    Points of the world are taken relative to ``center``, in units of ``size``.  Raises
    ``ValueError`` for a source inside the object, or behind infinity.
    """

    of_sources: Float[AnyArray, "source"]
    of_frames: float
    center: Float[AnyArray, "3"]
    size: float

    def __check_init__(self):
        for value in (*np.asarray(self.of_sources), self.of_frames):
            if not 0 <= value < 1:
                raise ValueError(
                    f"a source of nearness {value:g}: it is the object's size over the source's "
                    "distance; give 0 or more, and less than 1"
                )

    def relative(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 3"]:
        """Put points of the world into units of the object."""
        return (np.asarray(points, float) - np.asarray(self.center)) / self.size


class Seen(NamedTuple):
    """Sources as each point sees them: unit directions, and how far they are.

    ``distance`` is relative to that from the object's centre.
    """

    towards: Float[np.ndarray, "point node 3"]
    distance: Float[np.ndarray, "point node 1"]


@checked
def seen_from(
    points: Float[np.ndarray, "point 3"],
    directions: Float[np.ndarray, "*point node 3"],
    nearness: Float[np.ndarray, "#node"],
) -> Seen:
    """Look at sources from points, in units of the object; each may have directions of its own."""
    offset = directions - nearness[:, None] * points[:, None, :]
    distance = np.linalg.norm(offset, axis=-1, keepdims=True)
    return Seen(offset / distance, distance)


@checked
def near_nodes(
    points: Float[np.ndarray, "point 3"],
    directions: Float[np.ndarray, "*point node 3"],
    irradiance: Float[np.ndarray, "*point node channel"],
    nearness: Float[np.ndarray, "#node"],
) -> FrameNodes:
    """Make each point a light of its own, as a photograph may have; ``irradiance`` at the centre.

    ``points`` are in units of the object.
    """
    seen = seen_from(points, directions, nearness)
    return FrameNodes(seen.towards, irradiance / seen.distance**2, np.arange(len(points)))
