"""Sources near enough to have a place: each point of the object sees them elsewhere.

A source in direction d at the distance D has the nearness k = s / D, s being the size of the
object: k = 0 is infinitely far.  From the point p, in sizes of the object from its centre, it lies
along o = d - k p, and its irradiance there is that at the centre over |o|^2.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.geometry import Shape
from jaxrender.inverse.rays import center_of, size_of
from jaxrender.lighting import DirectionalSources, Light, PointSources
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import AnyArray, Float, checked


class Nearness(eqx.Module):
    """How near sources are: ``of_sources`` those of all photographs, ``of_frames`` those of each.

    Points of the world are taken relative to ``center``, in units of ``size``.  ``stated`` says
    that the places of the sources are known.  Raises ``ValueError`` for a source inside the object,
    or behind infinity.
    """

    of_sources: Float[AnyArray, "source"]
    of_frames: Float[AnyArray, "#frame #own"]
    center: Float[AnyArray, "3"]
    size: float
    stated: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        every = (*np.asarray(self.of_sources), *np.asarray(self.of_frames).ravel())
        wrong = next((value for value in every if not 0 <= value < 1), None)
        if wrong is None:
            return
        if self.stated:
            raise ValueError(
                f"a source lies {self.size / wrong:g} from the object's centre "
                f"{np.asarray(self.center).tolist()}, of which half the size is {self.size:g}; "
                "give one farther away"
            )
        raise ValueError(
            f"a source of nearness {wrong:g}: it is the object's size over the source's "
            "distance; give 0 or more, and less than 1"
        )

    def relative(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 3"]:
        """Put points of the world into units of the object."""
        return (np.asarray(points, float) - np.asarray(self.center)) / self.size


class Centred(NamedTuple):
    """Sources as the object's centre sees them, and how near each is."""

    sources: DirectionalSources
    nearness: Float[np.ndarray, "source"]


def centred(light: Light, shape: Shape | None, channels: int) -> Centred:
    """Join directional and point sources of a light, as the object's centre sees them.

    Raises ``ValueError`` for point sources without a shape, or at its centre.
    """
    found, nearness = [DirectionalSources.none(channels)], [np.zeros(0)]
    for part in light.parts:
        if isinstance(part, PointSources):
            if shape is None:
                raise ValueError("point sources ask where the object is: give its shape")
            center = center_of(shape)
            found.append(part.seen_from(center))
            away = np.linalg.norm(np.asarray(part.positions, float) - center, axis=1)
            nearness.append(size_of(shape) / away)
        elif isinstance(part, DirectionalSources):
            found.append(part)
            nearness.append(np.zeros(len(part.directions)))
    return Centred(joined_sources(found), np.concatenate(nearness))


def joined_sources(sources: list[DirectionalSources]) -> DirectionalSources:
    """Put directional sources together, of which there is one at least."""
    return DirectionalSources(
        np.concatenate([np.asarray(part.directions) for part in sources]),
        np.concatenate([np.asarray(part.irradiance) for part in sources]),
    )


def by_frame(rows: list[Float[np.ndarray, "_"]]) -> Float[np.ndarray, "frame source"]:
    """Stack the nearness of the sources of each photograph, 0 where one has fewer."""
    found = np.zeros((max(len(rows), 1), max((1, *(len(row) for row in rows)))))
    for number, row in enumerate(rows):
        found[number, : len(row)] = row
    return found


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
    nearness: Float[np.ndarray, "*#point #node"],
) -> Seen:
    """Look at sources from points, in units of the object; each may have sources of its own."""
    offset = directions - nearness[..., None] * points[:, None, :]
    distance = np.linalg.norm(offset, axis=-1, keepdims=True)
    return Seen(offset / distance, distance)


@checked
def near_nodes(
    points: Float[np.ndarray, "point 3"],
    directions: Float[np.ndarray, "*point node 3"],
    irradiance: Float[np.ndarray, "*point node channel"],
    nearness: Float[np.ndarray, "*#point #node"],
) -> FrameNodes:
    """Make each point a light of its own, as a photograph may have; ``irradiance`` at the centre.

    ``points`` are in units of the object.
    """
    seen = seen_from(points, directions, nearness)
    return FrameNodes(seen.towards, irradiance / seen.distance**2, np.arange(len(points)))
