"""Known light: what lights all photographs, what lights single ones, and its point masses."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from jaxrender.inverse.near_light import Nearness, near_nodes
from jaxrender.inverse.shadowing import MOST_DIFFUSE_DEGREES
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    FunctionLight,
    Light,
    LightNodes,
    condensed,
)
from jaxrender.reflection import (
    FrameNodes,
)
from jaxrender.shapes import AnyArray, Float, Int, checked

# Light that is a function is sampled at the texels of an image of so many rows.
_SAMPLED_ROWS = 128
# Environments above this size are condensed for the exact integral, to cells this narrow.
_MOST_NODES = 2**15
_NODE_ANGLE_PER_SIGMA = 1 / 6


class KnownLight(eqx.Module):
    """All that lights the object: an environment, sources, and those of single photographs.

    ``of`` makes one of any light, and ``joined`` one of several captures' lights.  Photographs
    have an ``environment`` in common, or each its own of ``environments``.  ``turn`` is a rotation
    of the environment, ``turns`` are those of ``environments``, and ``near`` says that sources have
    a place.  The exact integral alone knows of all but the first.  Raises ``ValueError`` when all
    of it is dark, and for an environment that is no image.
    """

    environment: Environment | None
    directional: DirectionalSources
    per_frame: tuple[DirectionalSources, ...] | None = None
    turn: Float[AnyArray, "3 3"] | None = None
    near: Nearness | None = None
    environments: tuple[Environment | None, ...] | None = None
    turns: Float[AnyArray, "frame 3 3"] | None = None

    def __check_init__(self):
        if not isinstance(self.environment, Environment | None):
            kind = type(self.environment).__name__
            raise ValueError(f"environment is a {kind}, not an image; use KnownLight.of(light)")
        if self.environment is not None and self.environments is not None:
            raise ValueError("give one environment for all photographs, or one for each, not both")
        images = self.environments or (self.environment,)
        parts = [*images, self.directional, *(self.per_frame or ())]
        energies = [np.asarray(p.nodes().irradiance) for p in parts if p is not None]
        energy = sum(float(np.sum(of_part)) for of_part in energies)
        if not energy > 0:
            raise ValueError("the light is zero: give an environment or sources with radiance")

    @classmethod
    def of(
        cls,
        light: Light,
        per_frame: tuple[DirectionalSources, ...] | None = None,
        height: int | None = None,
    ) -> "KnownLight":
        """Sort any light, sums too, into an image and directional sources.

        Light that is a function of direction is sampled at the rows of the image that is there, or
        at ``height`` rows, 128 unless said otherwise.

        Raises ``ValueError`` for images of different sizes, for lights that can be no image, and
        when all is dark.
        """
        parts = light.parts
        sources = [part for part in parts if isinstance(part, DirectionalSources)]
        images = [part for part in parts if isinstance(part, Environment)]
        rows = sorted({image.grid.shape[0] for image in images} | ({height} if height else set()))
        if len(rows) > 1:
            raise ValueError(
                f"images of {' and '.join(map(str, rows))} rows; bring them to one size, as by "
                "read_environment(..., height=...)"
            )
        rest = [part for part in parts if not isinstance(part, DirectionalSources | Environment)]
        for part in rest:
            if not isinstance(part, FunctionLight):
                raise ValueError(
                    f"a fit cannot use a light of the kind {type(part).__name__}; give "
                    "environments, directional sources, skies, smooth lobes, or light by its "
                    "coefficients"
                )
            images.append(part.to_environment(rows[0] if rows else _SAMPLED_ROWS))
        environment = None
        if len(images) == 1:
            environment = images[0]
        elif images:
            stacked = np.stack([np.asarray(image.radiance) for image in images])
            environment = Environment(stacked.sum(axis=0))
        channels = light.nodes().irradiance.shape[1]
        return cls(environment, _joined(sources, channels), per_frame)

    @classmethod
    def joined(cls, lights: Sequence["KnownLight"], frames: Sequence[int]) -> "KnownLight":
        """Put the lights of several captures together, of which each has so many photographs.

        What all photographs of a capture share is then what each of them has.
        """
        if len(lights) == 1:
            return lights[0]
        environments, per_frame = [], []
        for light, count in zip(lights, frames, strict=True):
            environments += [light.environment_of(frame) for frame in range(count)]
            per_frame += [light.sources_of(frame) for frame in range(count)]
        channels = lights[0].directional.irradiance.shape[1]
        images = None if all(one is None for one in environments) else tuple(environments)
        return cls(None, DirectionalSources.none(channels), tuple(per_frame), environments=images)

    @property
    def varies(self) -> bool:
        """Whether the light differs from photograph to photograph."""
        return self.per_frame is not None or self.environments is not None

    @property
    def frames(self) -> int:
        """How many photographs have a light of their own; 1 where one light is that of all."""
        return len(self.per_frame or self.environments or (None,))

    @property
    def has_environment(self) -> bool:
        """Whether there is an environment, in any photograph."""
        return self.environment is not None or self.environments is not None

    def environment_of(self, frame: int) -> Environment | None:
        """Find what surrounds the object in one photograph."""
        return self.environment if self.environments is None else self.environments[frame]

    def of_frame(self, frame: int) -> "KnownLight":
        """Pick the light of one photograph.  Raises ``ValueError`` where that is dark."""
        if not self.varies:
            return self
        near = self.near
        if near is not None and self.per_frame is not None:
            own = np.full(len(self.per_frame[frame].directions), near.of_frames)
            every = np.concatenate([np.asarray(near.of_sources), own])
            near = Nearness(every, 0.0, near.center, near.size)
        turn = self.turn if self.turns is None else np.asarray(self.turns)[frame]
        return KnownLight(self.environment_of(frame), self.sources_of(frame), None, turn, near)

    def sources_of(self, frame: int) -> DirectionalSources:
        """Join the sources that all photographs share and those of one photograph, if any."""
        if self.per_frame is None:
            return self.directional
        channels = self.directional.irradiance.shape[1]
        return _joined([self.directional, self.per_frame[frame]], channels)

    def of_frames(self, frames: Sequence[int]) -> "KnownLight":
        """Keep the photographs of these numbers."""
        if not self.varies:
            return self
        sources = self.per_frame and tuple(self.per_frame[frame] for frame in frames)
        images = self.environments and tuple(self.environments[frame] for frame in frames)
        if images is not None and not any(images):
            images = None
        turns = None if self.turns is None else np.asarray(self.turns)[list(frames)]
        return dataclasses.replace(self, per_frame=sources, environments=images, turns=turns)

    @checked
    def near_parts(
        self, frame_of_sample: Int[np.ndarray, "sample"], points: Float[np.ndarray, "sample 3"]
    ) -> list[FrameNodes]:
        """List near sources as each sample sees them: those of all photographs, and its own."""
        if self.near is None:
            return []
        points, found = self.near.relative(points), []
        directions, irradiance = (np.asarray(a, float) for a in self.directional.nodes())
        if len(directions):
            every = np.broadcast_to(irradiance, (len(points), *irradiance.shape))
            towards = np.broadcast_to(directions, (len(points), *directions.shape))
            found.append(near_nodes(points, towards, every, np.asarray(self.near.of_sources)))
        frames = self.frame_nodes(frame_of_sample)
        if frames is not None:
            at = frame_of_sample
            own = np.asarray(frames.directions)[at], np.asarray(frames.irradiance)[at]
            found.append(near_nodes(points, *own, np.full(1, self.near.of_frames)))
        return found

    @property
    def far(self) -> "KnownLight":
        """The same with all sources infinitely far, as the object's centre sees them."""
        return dataclasses.replace(self, near=None)

    @property
    def upright(self) -> "KnownLight":
        """The same with the images of environments themselves turned, if they are."""
        if self.turn is not None and self.environment is not None:
            turned = self.environment.turned(np.asarray(self.turn))
            return dataclasses.replace(self, environment=turned, turn=None)
        if self.turns is None or self.environments is None:
            return self
        turns, numbers = np.asarray(self.turns), self.image_of_frame
        first = [int(np.flatnonzero(numbers == at)[0]) for at in range(len(self.images))]
        images = [image.turned(turns[k]) for image, k in zip(self.images, first)]
        environments = tuple(None if at < 0 else images[at] for at in numbers.tolist())
        return dataclasses.replace(self, environments=environments, turns=None)

    @property
    def images(self) -> list[Environment]:
        """The environments, each once."""
        every = self.environments or (self.environment,)
        return list({id(image): image for image in every if image is not None}.values())

    @property
    def image_of_frame(self) -> Int[np.ndarray, "frame"]:
        """The number of each photograph's own environment among ``images``; -1 for none."""
        numbers = {id(image): at for at, image in enumerate(self.images)}
        return np.array([numbers.get(id(image), -1) for image in self.environments or ()], int)

    @property
    def shared(self) -> Light:
        """What lights all photographs, as one light: the environment as it stands, and sources."""
        upright = self.upright
        if upright.environment is None:
            return self.directional
        return upright.environment + self.directional

    @checked
    def frame_nodes(self, frame_of_sample: Int[np.ndarray, "sample"]) -> FrameNodes | None:
        """Stack the sources of all photographs, with dark ones where a photograph has fewer."""
        if self.per_frame is None:
            return None
        return stacked([source.nodes() for source in self.per_frame], np.asarray(frame_of_sample))

    @property
    def diffuse_degrees(self) -> int:
        """The degree to which the environment is followed into the shadows of a concave shape."""
        degrees = [image.grid.band_limit for image in self.images]
        return min(MOST_DIFFUSE_DEGREES, max(degrees, default=0))

    @checked
    def environment_nodes(
        self,
        sigma: float,
        angle_per_sigma: float | None,
        frame_of_sample: Int[np.ndarray, "sample"],
    ) -> LightNodes | FrameNodes | None:
        """List the point masses of what surrounds the object, for ``exact_nodes``."""
        found = [_nodes_of(image, sigma, angle_per_sigma) for image in self.images]
        if self.environment is not None:
            return found[0] if self.turn is None else _turned(found[0], self.turn)
        if self.environments is None:
            return None
        channels = self.directional.irradiance.shape[1]
        dark = LightNodes(np.zeros((0, 3)), np.zeros((0, channels)))
        own = [dark if at < 0 else found[at] for at in self.image_of_frame.tolist()]
        if self.turns is not None:
            own = [_turned(nodes, turn) for nodes, turn in zip(own, self.turns)]
        return stacked(own, np.asarray(frame_of_sample))


def _joined(sources: list[DirectionalSources], channels: int) -> DirectionalSources:
    """Put directional sources together; none where there are none."""
    if not sources:
        return DirectionalSources.none(channels)
    return DirectionalSources(
        np.concatenate([np.asarray(part.directions) for part in sources]),
        np.concatenate([np.asarray(part.irradiance) for part in sources]),
    )


def exact_nodes(
    light: KnownLight,
    frame_of_sample: Int[np.ndarray, "sample"],
    sigma: float,
    angle_per_sigma: float | None = None,
    points: Float[np.ndarray, "sample 3"] | None = None,
) -> tuple[LightNodes | FrameNodes, ...]:
    """List the light's point masses: every texel with light in it, and every source.

    Environments of more than 32,768 texels are condensed to cells of sigma / 6, and any to cells
    of ``angle_per_sigma`` times sigma where that is given.  ``points`` are where the samples lie,
    which sources that are near ask for.
    """
    parts: list[LightNodes | FrameNodes] = []
    shared = [light.directional.nodes()] if light.near is None else []
    surrounding = light.environment_nodes(sigma, angle_per_sigma, frame_of_sample)
    if isinstance(surrounding, LightNodes):
        shared.append(surrounding)
    if shared:
        directions, irradiance = (np.concatenate(arrays) for arrays in zip(*shared))
        if len(directions):
            parts.append(LightNodes(directions, irradiance))
    if isinstance(surrounding, FrameNodes):
        parts.append(surrounding)
    if light.near is None:
        frames = light.frame_nodes(np.asarray(frame_of_sample))
        return tuple(parts) if frames is None else (*parts, frames)
    if points is None:
        raise ValueError("sources that are near need to know where the samples lie: give points")
    return (*parts, *light.near_parts(np.asarray(frame_of_sample), points))


def _nodes_of(image: Environment, sigma: float, angle_per_sigma: float | None) -> LightNodes:
    """List the texels of an image with light in them, or its cells."""
    nodes = image.nodes()
    if angle_per_sigma is not None or nodes.directions.shape[0] > _MOST_NODES:
        nodes = condensed(image, (angle_per_sigma or _NODE_ANGLE_PER_SIGMA) * sigma)
    lit = np.any(np.asarray(nodes.irradiance) > 0, axis=1)
    return LightNodes(np.asarray(nodes.directions)[lit], np.asarray(nodes.irradiance)[lit])


def _turned(nodes: LightNodes, turn: Float[AnyArray, "3 3"]) -> LightNodes:
    return nodes._replace(directions=np.asarray(nodes.directions) @ np.asarray(turn).T)


def stacked(nodes: Sequence[LightNodes], frame_of_sample: Int[np.ndarray, "sample"]) -> FrameNodes:
    """Stack the nodes of all photographs, with dark ones where a photograph has fewer."""
    most = max(len(own.directions) for own in nodes)
    channels = nodes[0].irradiance.shape[1]
    directions = np.tile([0.0, 0.0, 1.0], (len(nodes), most, 1))
    irradiance = np.zeros((len(nodes), most, channels))
    for frame, own in enumerate(nodes):
        directions[frame, : len(own.directions)] = own.directions
        irradiance[frame, : len(own.directions)] = own.irradiance
    return FrameNodes(directions, irradiance, frame_of_sample)
