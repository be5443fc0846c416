"""Known light: what lights all photographs, what lights single ones, and its point masses."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from jaxrender.geometry import Shape
from jaxrender.inverse.near_light import Nearness, by_frame, centred, joined_sources
from jaxrender.inverse.rays import center_of, size_of
from jaxrender.inverse.shadowing import MOST_DIFFUSE_DEGREES
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    FunctionLight,
    Light,
    PointSources,
)
from jaxrender.shapes import AnyArray, Bool, Float, Int

# Light that is a function is sampled at the texels of an image of so many rows.
_SAMPLED_ROWS = 128


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
        per_frame: Sequence[Light] | None = None,
        height: int | None = None,
        shape: Shape | None = None,
    ) -> "KnownLight":
        """Sort any light, sums too, into an image and sources.

        Light that is a function of direction is sampled at the rows of the image that is there, or
        at ``height`` rows, 128 unless said otherwise.  ``per_frame`` are directional and point
        sources of each photograph; point sources ask for the ``shape``.

        Raises ``ValueError`` for images of different sizes, for lights that can be no image, for
        point sources within the object, and when all is dark.
        """
        parts = light.parts
        images = [part for part in parts if isinstance(part, Environment)]
        rows = sorted({image.grid.shape[0] for image in images} | ({height} if height else set()))
        if len(rows) > 1:
            raise ValueError(
                f"images of {' and '.join(map(str, rows))} rows; bring them to one size, as by "
                "read_environment(..., height=...)"
            )
        sources = DirectionalSources | PointSources
        for part in (p for p in parts if not isinstance(p, sources | Environment)):
            if not isinstance(part, FunctionLight):
                raise ValueError(
                    f"a fit cannot use a light of the kind {type(part).__name__}; give "
                    "environments, directional sources, point sources, skies, smooth lobes, or "
                    "light by its coefficients"
                )
            images.append(part.to_environment(rows[0] if rows else _SAMPLED_ROWS))
        environment = None
        if len(images) == 1:
            environment = images[0]
        elif images:
            stacked = np.stack([np.asarray(image.radiance) for image in images])
            environment = Environment(stacked.sum(axis=0))
        channels = _channels_of(light, per_frame)
        shared = centred(light, shape, channels)
        own = None if per_frame is None else [centred(one, shape, channels) for one in per_frame]
        near = None
        of_frames = by_frame([one.nearness for one in own or []])
        if np.any(shared.nearness) or np.any(of_frames):
            assert shape is not None
            near = Nearness(shared.nearness, of_frames, center_of(shape), size_of(shape), True)
        moving = None if own is None else tuple(one.sources for one in own)
        return cls(environment, shared.sources, moving, near=near)

    @classmethod
    def joined(cls, lights: Sequence["KnownLight"], frames: Sequence[int]) -> "KnownLight":
        """Put the lights of several captures together, of which each has so many photographs.

        What all photographs of a capture share is then what each of them has.
        """
        if len(lights) == 1:
            return lights[0]
        environments, per_frame, nearness = [], [], []
        for light, count in zip(lights, frames, strict=True):
            environments += [light.environment_of(frame) for frame in range(count)]
            per_frame += [light.sources_of(frame) for frame in range(count)]
            nearness += [light.nearness_of(frame) for frame in range(count)]
        channels = lights[0].directional.irradiance.shape[1]
        images = None if all(one is None for one in environments) else tuple(environments)
        told = next((light.near for light in lights if light.near is not None), None)
        near = told and Nearness(
            np.zeros(0), by_frame(nearness), told.center, told.size, told.stated
        )
        none = DirectionalSources.none(channels)
        return cls(None, none, tuple(per_frame), near=near, environments=images)

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
        if near is not None:
            near = dataclasses.replace(
                near, of_sources=self.nearness_of(frame), of_frames=np.zeros((1, 1))
            )
        turn = self.turn if self.turns is None else np.asarray(self.turns)[frame]
        return KnownLight(self.environment_of(frame), self.sources_of(frame), None, turn, near)

    def sources_of(self, frame: int) -> DirectionalSources:
        """Join the sources that all photographs share and those of one photograph, if any."""
        if self.per_frame is None:
            return self.directional
        return joined_sources([self.directional, self.per_frame[frame]])

    def nearness_of(self, frame: int) -> Float[np.ndarray, "source"]:
        """How near each of ``sources_of`` is; 0 at infinity."""
        near, shared = self.near, len(self.directional.directions)
        own = 0 if self.per_frame is None else len(self.per_frame[frame].directions)
        if near is None:
            return np.zeros(shared + own)
        each = np.asarray(near.of_frames)
        row = each[frame if len(each) > 1 else 0]
        row = np.broadcast_to(row, own) if len(row) == 1 else row[:own]
        return np.concatenate([np.asarray(near.of_sources), row])

    @property
    def distant(self) -> "KnownLight | None":
        """All but the sources that have a place; None where nothing else is there."""
        if self.near is None:
            return self
        directional = _some(self.directional, np.asarray(self.near.of_sources) == 0)
        shared, per_frame = len(self.directional.directions), None
        if self.per_frame is not None:
            per_frame = tuple(
                _some(own, self.nearness_of(frame)[shared:] == 0)
                for frame, own in enumerate(self.per_frame)
            )
        parts = (directional, *(per_frame or ()))
        if not self.has_environment and not any(np.any(part.irradiance) for part in parts):
            return None
        return dataclasses.replace(self, directional=directional, per_frame=per_frame, near=None)

    def far_of(self, frame: int) -> DirectionalSources:
        """List a photograph's sources that are infinitely far."""
        return _some(self.sources_of(frame), self.nearness_of(frame) == 0)

    def points_of(self, frame: int) -> PointSources | None:
        """List a photograph's sources that have a place; None where there are none."""
        near, nearness = self.near, self.nearness_of(frame)
        if near is None or not np.any(nearness):
            return None
        away = near.size / nearness[nearness > 0, None]
        seen = _some(self.sources_of(frame), nearness > 0)
        places = np.asarray(near.center, float) + away * np.asarray(seen.directions, float)
        return PointSources(places, away**2 * np.asarray(seen.irradiance, float))

    def of_frames(self, frames: Sequence[int]) -> "KnownLight":
        """Keep the photographs of these numbers."""
        if not self.varies:
            return self
        sources = self.per_frame and tuple(self.per_frame[frame] for frame in frames)
        images = self.environments and tuple(self.environments[frame] for frame in frames)
        if images is not None and not any(images):
            images = None
        turns = None if self.turns is None else np.asarray(self.turns)[list(frames)]
        near = self.near
        if near is not None and len(near.of_frames) > 1:
            kept = np.asarray(near.of_frames)[list(frames)]
            near = dataclasses.replace(near, of_frames=kept)
        return dataclasses.replace(
            self, per_frame=sources, environments=images, turns=turns, near=near
        )

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

    @property
    def diffuse_degrees(self) -> int:
        """The degree to which the environment is followed into the shadows of a concave shape."""
        degrees = [image.grid.band_limit for image in self.images]
        return min(MOST_DIFFUSE_DEGREES, max(degrees, default=0))


def _some(sources: DirectionalSources, which: Bool[np.ndarray, "source"]) -> DirectionalSources:
    return DirectionalSources(*(np.asarray(part)[which] for part in sources.nodes()))


def _channels_of(light: Light, per_frame: Sequence[Light] | None) -> int:
    """Count the channels of lights, which have as many each; ``ValueError`` where they do not."""
    counts = set()
    for part in (part for one in (light, *(per_frame or ())) for part in one.parts):
        lit = part.intensity if isinstance(part, PointSources) else part.nodes().irradiance
        counts.add(lit.shape[1])
    if len(counts) > 1:
        raise ValueError(
            f"lights of {' and '.join(map(str, sorted(counts)))} channels; give all alike"
        )
    return counts.pop()
