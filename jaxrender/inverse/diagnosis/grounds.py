"""What the causes of a misfit are tested on: some samples, and what each part of the light does.

Few samples and a coarse light are enough: it is derivatives that are wanted, to a few per cent.
"""

import dataclasses
from functools import cached_property
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape, SurfaceSamples
from jaxrender.inverse.diagnosis.turning import Turning, lobe_under, turning_of
from jaxrender.inverse.known_light import KnownLight, exact_nodes
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import concave, nodes_seen
from jaxrender.lighting import DirectionalSources, LightNodes
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import Bool, Float

# Cells of the environment, in widths of the lobe.
_CELL_PER_WIDTH = 0.7
# Nodes are filled up with dark ones to a multiple of this, so that few programs are compiled.
_NODES = 1024
# More sources than this turn together.
_MOST_SOURCES = 6
# Rays are moved by so much (radians, or sizes of the object) to say how what they see changes.
_STEP = 1e-4
# Normals further apart than this cosine are those of different parts of the object.
_SAME_PART = 0.9


class Part(NamedTuple):
    """One part of the light, and what it makes visible.

    ``direction`` is that of each sample's source; None for an environment, and for several.
    """

    nodes: LightNodes | FrameNodes
    seen: Bool[np.ndarray, "sample node"] | None
    turning: Turning
    direction: Float[np.ndarray, "sample 3"] | None = None


class Lit(NamedTuple):
    """Nodes of a light, and which of them each sample sees."""

    nodes: LightNodes | FrameNodes
    seen: Bool[np.ndarray, "sample node"] | None


class Movement(NamedTuple):
    """How what a pixel sees changes: derivatives of normals and of directions to the camera."""

    normals: Float[np.ndarray, "sample 3"]
    outgoing: Float[np.ndarray, "sample 3"]


class Rays(NamedTuple):
    """The rays on which the samples are seen: a point of each before the object, and where to."""

    origins: Float[np.ndarray, "sample 3"]
    directions: Float[np.ndarray, "sample 3"]


@dataclasses.dataclass(frozen=True)
class Grounds:
    """Samples, the material found, where things stand, and what each part of the light does.

    ``gain`` is that of exposures and of an unknown scale, which ``predicted`` contains and the
    parts of the light do not.  These are differentiated when somebody asks for them.
    """

    observations: Observations
    predicted: Float[np.ndarray, "sample channel"]
    gain: Float[np.ndarray, "sample 1"]
    material: Parametric
    light: KnownLight
    shape: Shape | None

    @cached_property
    def environment(self) -> Part | None:
        """What the environment does, if there is one."""
        if self.light.environment is None:
            return None
        dark = DirectionalSources.none(self.predicted.shape[1])
        alone = KnownLight(self.light.environment, dark)
        (nodes,) = exact_nodes(alone, self.frame, float(self.material.width), _CELL_PER_WIDTH)
        assert isinstance(nodes, LightNodes)
        return self._part(_filled(nodes))

    @cached_property
    def sources(self) -> tuple[Part, ...]:
        """What each source does, and what the sources of single photographs do together."""
        found = []
        for one in _sources(self.light.directional):
            direction = np.asarray(one.directions)
            alone = len(direction) == 1
            every = np.tile(direction, (len(self.frame), 1)) if alone else None
            found.append(self._part(one.nodes(), every))
        own = self.light.frame_nodes(self.frame)
        if own is not None:
            alone = own.directions.shape[1] == 1
            every = np.asarray(own.directions)[self.frame, 0] if alone else None
            found.append(self._part(own, every))
        return tuple(found)

    def _part(
        self,
        nodes: LightNodes | FrameNodes,
        direction: Float[np.ndarray, "sample 3"] | None = None,
    ) -> Part:
        traced = nodes_seen(concave(self.shape), self.observations, (nodes,))
        seen = None if traced is None else traced[0]
        turning = turning_of(self.material, self.observations.samples, nodes, seen)
        return Part(nodes, seen, turning, direction)

    @property
    def samples(self) -> SurfaceSamples:
        """Normals and directions to the camera."""
        return SurfaceSamples(self.normals, self.outgoing)

    @property
    def normals(self) -> Float[np.ndarray, "sample 3"]:
        """The normals of the samples."""
        return np.asarray(self.observations.samples.normals, float)

    @property
    def outgoing(self) -> Float[np.ndarray, "sample 3"]:
        """The directions to the camera."""
        return np.asarray(self.observations.samples.outgoing, float)

    @property
    def frame(self) -> np.ndarray:
        """The photograph of each sample."""
        return np.asarray(self.observations.frame)

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts of the light."""
        return self.sources if self.environment is None else (self.environment, *self.sources)

    @property
    def placed(self) -> bool:
        """Whether it is known where the samples lie."""
        return self.observations.places is not None and self.shape is not None

    @property
    def center(self) -> Float[np.ndarray, "3"]:
        """The middle of the object's bounding box."""
        assert self.shape is not None
        return self.shape.bounds().mean(axis=0)

    @property
    def size(self) -> float:
        """Half the longest side of the object's bounding box."""
        assert self.shape is not None
        lower, upper = self.shape.bounds()
        return float(np.max(upper - lower)) / 2

    @property
    def points(self) -> Float[np.ndarray, "sample 3"]:
        """Where the samples lie, from the object's centre, in units of its size."""
        assert self.observations.places is not None
        return (np.asarray(self.observations.places.points, float) - self.center) / self.size

    @property
    def eyes(self) -> Float[np.ndarray, "sample 3"] | None:
        """Where the camera of each sample stands, if that is known."""
        eyes = self.observations.eyes
        return None if eyes is None or not self.placed else np.asarray(eyes, float)[self.frame]

    @property
    def rays(self) -> Rays:
        """The rays on which the samples are seen, from the cameras where these are known."""
        outgoing, eyes = self.outgoing, self.eyes
        assert self.observations.places is not None
        assert self.shape is not None
        points = np.asarray(self.observations.places.points, float)
        if eyes is None:
            return Rays(points + self.shape.diagonal() * outgoing, -outgoing)
        depth = np.sum((eyes - points) * outgoing, axis=1, keepdims=True)
        return Rays(points + depth * outgoing, -outgoing)

    def moved(self, movement: Movement) -> Float[np.ndarray, "sample channel"]:
        """Differentiate the prediction along a movement of what is seen."""
        found = [part.turning.moved(*movement) for part in self.parts]
        return self.gain * np.sum(found, axis=0)

    def lobe_of(self, material: Parametric) -> Float[np.ndarray, "sample channel"]:
        """Evaluate another material's last lobe at amplitude one, under the whole light."""
        found = np.zeros_like(self.predicted)
        for nodes, seen in self.whole:
            found = found + lobe_under(material, self.samples, nodes, seen)
        return found

    @property
    def whole(self) -> list[Lit]:
        """All that lights the samples: what all photographs share together, and each one's own."""
        shared = [part for part in self.parts if isinstance(part.nodes, LightNodes)]
        own = [part for part in self.parts if isinstance(part.nodes, FrameNodes)]
        found = [Lit(part.nodes, part.seen) for part in own]
        if shared:
            nodes = LightNodes(*(np.concatenate(a) for a in zip(*(part.nodes for part in shared))))
            nodes = _filled(nodes)
            seen = [part.seen for part in shared if part.seen is not None]
            if not seen:
                return [*found, Lit(nodes, None)]
            every = np.concatenate(seen, axis=1)
            dark = np.zeros((len(every), len(nodes.directions) - every.shape[1]), bool)
            found.append(Lit(nodes, np.concatenate([every, dark], axis=1)))
        return found

    def seen_along(self, rays: Rays) -> Float[np.ndarray, "sample channel"]:
        """Differentiate the prediction along rays that were moved by one step.

        A ray that leaves the surface, or meets another part of it, changes nothing.
        """
        assert self.shape is not None
        directions = rays.directions / np.linalg.norm(rays.directions, axis=1, keepdims=True)
        hits = self.shape.first_hits(rays.origins, directions)
        same = hits.hit & (np.sum(hits.normals * self.normals, axis=1) > _SAME_PART)
        changes = (hits.normals - self.normals, -directions - self.outgoing)
        return self.moved(Movement(*(np.where(same[:, None], c, 0) / _STEP for c in changes)))


def turned_rays(rays: Rays, eyes: Float[np.ndarray, "sample 3"], axis: np.ndarray) -> Rays:
    """Turn rays by one step about an axis through their cameras."""
    from_eye = rays.origins - eyes
    return Rays(
        rays.origins + _STEP * np.cross(axis, from_eye),
        rays.directions + _STEP * np.cross(axis, rays.directions),
    )


def shifted_rays(rays: Rays, by: Float[np.ndarray, "*sample 3"]) -> Rays:
    """Shift rays by one step of ``by``."""
    return Rays(rays.origins + _STEP * by, rays.directions)


def _sources(directional: DirectionalSources) -> list[DirectionalSources]:
    """Take few sources one by one, and many together."""
    directions, irradiance = (np.asarray(part) for part in directional.nodes())
    lit = np.any(irradiance > 0, axis=1)
    directions, irradiance = directions[lit], irradiance[lit]
    if len(directions) > _MOST_SOURCES:
        return [DirectionalSources(directions, irradiance)]
    return [DirectionalSources(d[None], e[None]) for d, e in zip(directions, irradiance)]


def _filled(nodes: LightNodes) -> LightNodes:
    """Add dark nodes up to a round number."""
    directions, irradiance = (np.asarray(part) for part in nodes)
    more = -len(directions) % _NODES
    dark = np.tile([0.0, 0.0, 1.0], (more, 1))
    return LightNodes(
        np.concatenate([directions, dark]),
        np.concatenate([irradiance, np.zeros((more, irradiance.shape[1]))]),
    )
