"""What the causes of a misfit are tested on: some samples, and what each part of the light does.

Few samples and a coarse light are enough: it is derivatives that are wanted, to a few per cent.
"""

import dataclasses
from collections.abc import Callable
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Hits, Shape, SurfaceSamples
from jaxrender.inverse.diagnosis.derivatives import Derivatives
from jaxrender.inverse.diagnosis.light_parts import LightParts, filled
from jaxrender.inverse.diagnosis.turning import Turning, lobes_under, turning_of
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.near_light import near_nodes, seen_from
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Stop, values_of
from jaxrender.inverse.rays import Rays, center_of, size_of
from jaxrender.inverse.shadowing import concave, nodes_seen
from jaxrender.lighting import LightNodes
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import AnyArray, Bool, Float, Int

# Cells of the environment, in widths of the lobe.
_CELL_PER_WIDTH = 0.7
# Rays are moved by so much (radians, or sizes of the object) to say how what they see changes.
STEP = 1e-4
# Normals further apart than this cosine are those of different parts of the object.
_SAME_PART = 0.9


class Lamp(NamedTuple):
    """A source as the object's centre and the samples see it.

    ``direction`` is that from the centre, ``towards`` that from each sample, ``distance`` how far
    it is from each, relative to the centre; ``points`` are the samples' places.  A source at
    infinity has the nearness 0.
    """

    direction: Float[np.ndarray, "sample 3"]
    towards: Float[np.ndarray, "sample 3"]
    distance: Float[np.ndarray, "sample 1"]
    points: Float[np.ndarray, "sample 3"] | None


class Part(NamedTuple):
    """One part of the light, and what it makes visible.

    ``lamp`` says where its source lies; None for an environment, and for several sources.
    """

    nodes: LightNodes | FrameNodes
    seen: Bool[np.ndarray, "sample node"] | None
    turning: Turning
    lamp: Lamp | None = None

    def turned(self, axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "sample channel"]:
        """Differentiate by a rotation of this part of the light about the object's centre."""
        lamp = self.lamp
        if lamp is None:
            return self.turning.turned(axis)
        return self._shifted(lamp, np.cross(axis, lamp.direction))

    def nearer(self) -> Float[np.ndarray, "sample channel"] | None:
        """Differentiate by the nearness of its source; None where nobody knows of places."""
        lamp = self.lamp
        if lamp is None or lamp.points is None:
            return None
        return self._shifted(lamp, -lamp.points)

    def _shifted(
        self, lamp: Lamp, by: Float[np.ndarray, "sample 3"]
    ) -> Float[np.ndarray, "sample channel"]:
        """Shift the source: each sample sees it elsewhere, and brighter where it is nearer."""
        axes = np.cross(lamp.towards, by) / lamp.distance
        along = np.sum(lamp.towards * by, axis=1, keepdims=True) / lamp.distance
        return self.turning.turned(axes) - 2 * along * self.turning.value


class Lit(NamedTuple):
    """Nodes of a light, and which of them each sample sees."""

    nodes: LightNodes | FrameNodes
    seen: Bool[np.ndarray, "sample node"] | None


class Movement(NamedTuple):
    """How what a pixel sees changes: derivatives of normals and of directions to the camera."""

    normals: Float[np.ndarray, "sample 3"]
    outgoing: Float[np.ndarray, "sample 3"]


class Suspect(NamedTuple):
    """A fit that may be wrong: what it is of, what it has found, and how that may change.

    ``told`` are its samples as they were told, and ``pool`` all pixels; ``seed`` is that of the
    samples that are tested.  ``gain`` is that of exposures and of an unknown scale, which
    ``predicted`` contains and ``light`` does not.  ``derivatives`` are those of samples of given
    indices.  ``freed`` are nuisances that the fit has freed: ``observations`` and the light are
    corrected by them.  ``unknown`` are causes that the fit does not take for granted.  ``paint``
    are the amplitudes at each sample, where they are not the same everywhere, and ``by_place`` how
    the prediction changes with the place that a pixel shows, as they do.
    """

    observations: Observations
    predicted: Float[np.ndarray, "sample channel"]
    gain: Float[np.ndarray, "sample"]
    material: Parametric
    light: LightParts
    shape: Shape | None
    told: Observations
    pool: Observations
    derivatives: Callable[[Int[np.ndarray, "sample"]], Derivatives]
    seed: int = 0
    freed: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    paint: Float[np.ndarray, "sample lobe channel"] | None = None
    by_place: Float[np.ndarray, "sample channel 3"] | None = None

    @classmethod
    def of(
        cls,
        stop: Stop,
        material: Parametric,
        light: KnownLight,
        shape: Shape | None,
        told: Observations,
        pool: Observations,
        seed: int = 0,
        freed: tuple[str, ...] = (),
    ) -> "Suspect":
        """Suspect a fit under known light of where it ended."""
        return cls(
            stop.observations,
            np.asarray(stop.fit.predicted),
            gain_of(stop, np.asarray(stop.data.frame)),
            material,
            LightParts.known(light),
            shape,
            told,
            pool,
            partial(Derivatives.of, stop),
            seed,
            freed,
        )


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
    light: LightParts
    shape: Shape | None
    paint: Float[np.ndarray, "sample lobe channel"] | None = None
    by_place: Float[np.ndarray, "sample channel 3"] | None = None

    @classmethod
    def of(cls, suspect: "Suspect", index: Int[np.ndarray, "sample"]) -> "Grounds":
        """Take some samples of a fit."""
        return cls(
            suspect.observations.take(index),
            suspect.predicted[index],
            suspect.gain[index, None],
            suspect.material,
            suspect.light,
            suspect.shape,
            None if suspect.paint is None else suspect.paint[index],
            None if suspect.by_place is None else suspect.by_place[index],
        )

    @cached_property
    def environment(self) -> Part | None:
        """What surrounds the object does, if there is anything."""
        if self.light.surrounding is None:
            return None
        cell = _CELL_PER_WIDTH * float(self.material.width)
        return self._part(self.light.surrounding(cell, self.frame))

    def thinned(self, count: int) -> "Grounds":
        """Keep so many of the samples, evenly."""
        kept = np.linspace(0, len(self.frame) - 1, min(count, len(self.frame))).astype(int)
        return dataclasses.replace(
            self,
            observations=self.observations.take(kept),
            predicted=self.predicted[kept],
            gain=self.gain[kept],
            paint=None if self.paint is None else self.paint[kept],
            by_place=None if self.by_place is None else self.by_place[kept],
        )

    @cached_property
    def sources(self) -> tuple[Part, ...]:
        """What each group of sources does: those that turn together (``source_groups``)."""
        found = []
        for nodes, nearness in self.light.sources(self.frame):
            at = np.asarray(nodes.frame_of_sample) if isinstance(nodes, FrameNodes) else None
            every = self._at_each(nodes.directions, at)
            lamp = None
            if every.shape[1] == 1:
                points = self.points if self.placed else None
                lamp = Lamp(every[:, 0], every[:, 0], np.ones((len(every), 1)), points)
            if self.placed and np.any(nearness):
                near = self._at_each(nearness[..., None], at)[..., 0]
                energy = self._at_each(nodes.irradiance, at)
                if lamp is not None:
                    seen = seen_from(self.points, every, near)
                    lamp = lamp._replace(towards=seen.towards[:, 0], distance=seen.distance[:, 0])
                nodes = near_nodes(self.points, every, energy, near)
            found.append(self._part(nodes, lamp))
        return tuple(found)

    def _at_each(
        self, values: Float[AnyArray, "*frame node k"], at: Int[np.ndarray, "sample"] | None
    ) -> Float[np.ndarray, "sample node k"]:
        """Give each sample the values of its photograph, or those that all photographs share."""
        own = np.asarray(values, float)
        own = own if at is None else own[at]
        return np.broadcast_to(own, (len(self.frame), *own.shape[-2:]))

    def _part(self, nodes: LightNodes | FrameNodes, lamp: Lamp | None = None) -> Part:
        traced = nodes_seen(concave(self.shape), self.observations, (nodes,))
        seen = None if traced is None else traced[0]
        turning = turning_of(self.material, self.observations.samples, nodes, seen, self.paint)
        return Part(nodes, seen, turning, lamp)

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
    def painted(self) -> bool:
        """Whether samples have amplitudes of their own."""
        return self.paint is not None

    @property
    def placed(self) -> bool:
        """Whether it is known where the samples lie."""
        return self.observations.places is not None and self.shape is not None

    @property
    def points(self) -> Float[np.ndarray, "sample 3"]:
        """Where the samples lie, from the object's centre, in units of its size."""
        assert self.observations.places is not None
        assert self.shape is not None
        points = np.asarray(self.observations.places.points, float)
        return (points - center_of(self.shape)) / size_of(self.shape)

    @property
    def rays(self) -> Rays:
        """The rays on which the samples are seen, from the cameras where these are known."""
        assert self.shape is not None
        return Rays.of(self.observations, self.shape)

    def moved(self, movement: Movement) -> Float[np.ndarray, "sample channel"]:
        """Differentiate the prediction along a movement of what is seen."""
        found = [part.turning.moved(*movement) for part in self.parts]
        return self.gain * np.sum(found, axis=0)

    def lobe_of(self, material: Parametric) -> Float[np.ndarray, "sample channel"]:
        """Evaluate another material's last lobe under the whole light.

        It has the amplitude one, on average where samples have amplitudes of their own.
        """
        found = np.zeros_like(self.predicted)
        for nodes, seen in self.whole:
            found = found + np.asarray(lobes_under(material, self.samples, nodes, seen))[:, -1]
        if self.paint is None:
            return found
        return found * self.paint[:, -1] / max(float(np.mean(self.paint[:, -1])), 1e-12)

    @property
    def whole(self) -> list[Lit]:
        """All that lights the samples: what all photographs share together, and each one's own."""
        shared = [part for part in self.parts if isinstance(part.nodes, LightNodes)]
        own = [part for part in self.parts if isinstance(part.nodes, FrameNodes)]
        found = [Lit(part.nodes, part.seen) for part in own]
        if shared:
            nodes = LightNodes(*(np.concatenate(a) for a in zip(*(part.nodes for part in shared))))
            nodes = filled(nodes)
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
        before, hits = self.rays.meet(self.shape), rays.meet(self.shape)
        # Normals may have been mended since they were traced: what counts is how they change.
        same = same_part(before, hits)[:, None]
        changes = (hits.normals - before.normals, -rays.directions - self.outgoing)
        found = self.moved(Movement(*(np.where(same, c, 0) / STEP for c in changes)))
        if self.by_place is None:
            return found
        aside = np.where(same, hits.points - before.points, 0) / STEP
        return found + self.gain * np.einsum("sci,si->sc", self.by_place, aside)


def gain_of(stop: Stop, frame: Int[np.ndarray, "sample"]) -> Float[np.ndarray, "sample"]:
    """Multiply the unknown scale and the exposures that a fit has found."""
    gains = np.asarray(values_of(stop).gains)
    return float(values_of(stop).scale) * (gains[frame] if len(gains) > 1 else np.ones(len(frame)))


def same_part(before: Hits, hits: Hits) -> Bool[np.ndarray, "sample"]:
    """Tell which rays that were moved a little still meet the same part of the object."""
    facing = np.sum(hits.normals * before.normals, axis=1)
    return hits.hit & before.hit & (facing > _SAME_PART)
