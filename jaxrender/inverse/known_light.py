"""Known light made ready for a fit: split for the dual model, as point masses for the integral."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.near_light import Nearness, near_nodes
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import MOST_DIFFUSE_DEGREES
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    FunctionLight,
    Light,
    LightNodes,
    LightSplit,
    candidates,
    condensed,
    split_to_energy,
    take,
)
from jaxrender.reflection import (
    DualGoal,
    DualLight,
    FrameNodes,
    SourcesNeeded,
    dual_light,
    sources_needed,
)
from jaxrender.shapes import AnyArray, Float, Int, checked

# exp(-(sigma l)^2) is below 4e-5 at this multiple of 1 / sigma: no higher degree passes the lobe.
_BAND_LIMIT_TIMES_SIGMA = 3.2
_HIGHEST_BAND_LIMIT = 128
# The dual model's specular column is to be this accurate (relative rms) ...
DUAL_ERROR = 0.007
# ... at no more than this many sources; the rough first pass makes do with fewer.
_MOST_SOURCES = 1024
_ROUGH_SOURCES = 64
_SAMPLES_FOR_SPLIT = 128
# Light that is not split is told to this degree; what it would be split for does not matter.
_SHOWN_BAND_LIMIT, _ANY_WIDTH = 20, 0.5
# Light that is a function is sampled at the texels of an image of so many rows.
_SAMPLED_ROWS = 128
# Environments above this size are condensed for the exact integral, to cells this narrow.
_MOST_NODES = 2**15
_NODE_ANGLE_PER_SIGMA = 1 / 6


class KnownLight(eqx.Module):
    """All that lights the object: an environment, sources, and sources of single photographs.

    ``of`` makes one of any light.  ``turn`` is a rotation of the environment, and ``near`` says
    that sources have a place: the exact integral alone knows of these two.  Raises ``ValueError``
    when all of it is dark, and for an environment that is no image.
    """

    environment: Environment | None
    directional: DirectionalSources
    per_frame: tuple[DirectionalSources, ...] | None = None
    turn: Float[AnyArray, "3 3"] | None = None
    near: Nearness | None = None

    def __check_init__(self):
        if not isinstance(self.environment, Environment | None):
            kind = type(self.environment).__name__
            raise ValueError(f"environment is a {kind}, not an image; use KnownLight.of(light)")
        parts = [self.environment, self.directional, *(self.per_frame or ())]
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

    def of_frame(self, frame: int) -> "KnownLight":
        """Pick the light of one photograph."""
        if self.per_frame is None:
            return self
        near = self.near
        if near is not None:
            own = np.full(len(self.per_frame[frame].directions), near.of_frames)
            every = np.concatenate([np.asarray(near.of_sources), own])
            near = Nearness(every, 0.0, near.center, near.size)
        return KnownLight(self.environment, self.sources_of(frame), None, self.turn, near)

    def sources_of(self, frame: int) -> DirectionalSources:
        """Join the sources that all photographs share and those of one photograph, if any."""
        if self.per_frame is None:
            return self.directional
        channels = self.directional.irradiance.shape[1]
        return _joined([self.directional, self.per_frame[frame]], channels)

    def of_frames(self, frames: Sequence[int]) -> "KnownLight":
        """Keep the photographs of these numbers."""
        if self.per_frame is None:
            return self
        kept = tuple(self.per_frame[frame] for frame in frames)
        return KnownLight(self.environment, self.directional, kept, self.turn, self.near)

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
        return KnownLight(self.environment, self.directional, self.per_frame, self.turn)

    @property
    def upright(self) -> "KnownLight":
        """The same with the environment's image itself turned, if it is."""
        if self.turn is None or self.environment is None:
            return self
        turned = self.environment.turned(np.asarray(self.turn))
        return KnownLight(turned, self.directional, self.per_frame, near=self.near)

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
        most = max(source.directions.shape[0] for source in self.per_frame)
        channels = self.directional.irradiance.shape[1]
        directions = np.tile([0.0, 0.0, 1.0], (len(self.per_frame), most, 1))
        irradiance = np.zeros((len(self.per_frame), most, channels))
        for frame, source in enumerate(self.per_frame):
            directions[frame, : source.directions.shape[0]] = source.directions
            irradiance[frame, : source.directions.shape[0]] = source.irradiance
        return FrameNodes(directions, irradiance, np.asarray(frame_of_sample))

    @property
    def diffuse_degrees(self) -> int:
        """The degree to which the environment is followed into the shadows of a concave shape."""
        if self.environment is None:
            return 0
        return min(MOST_DIFFUSE_DEGREES, self.environment.grid.band_limit)


def _joined(sources: list[DirectionalSources], channels: int) -> DirectionalSources:
    """Put directional sources together; none where there are none."""
    if not sources:
        return DirectionalSources.none(channels)
    return DirectionalSources(
        np.concatenate([np.asarray(part.directions) for part in sources]),
        np.concatenate([np.asarray(part.irradiance) for part in sources]),
    )


class PreparedLight(NamedTuple):
    """Light split at one roughness, and how well the dual model does with it."""

    dual: DualLight
    split: LightSplit | None
    needed: SourcesNeeded | None


def prepare_light(
    light: KnownLight,
    observations: Observations,
    brdf: Glossy,
    split: str | float,
    band_limit: int | None,
    *,
    transfer: str = "exit-cosine",
) -> PreparedLight:
    """Split the light at the roughness of ``brdf``, as finely as the dual model needs it.

    ``split`` is ``"auto"``, ``"rough"`` (a first pass: the strongest sources, unchecked), ``"off"``
    or the fraction of the energy to leave in the slow part.  ``transfer`` is how the dual model is
    going to filter that.
    """
    frames = light.frame_nodes(np.asarray(observations.frame))
    if light.environment is None:
        return PreparedLight(dual_light(None, light.directional, 0, frames), None, None)
    sigma = float(brdf.sigma)
    degrees = band_limit_for(light.environment, sigma) if band_limit is None else band_limit
    degrees = min(degrees, light.environment.grid.band_limit)
    if split == "auto":
        goal = DualGoal(DUAL_ERROR, _MOST_SOURCES, degrees, transfer)
        divided, needed = _divide_as_needed(light.environment, observations.samples, brdf, goal)
    else:
        divided, needed = _divide(light.environment, float(brdf.sigma), split), None
    return PreparedLight(dual_light(divided, light.directional, degrees, frames), divided, needed)


def undivided(
    light: KnownLight, observations: Observations, band_limit: int | None
) -> PreparedLight:
    """Analyse light as it is, for a material that the dual model does not know."""
    frames = light.frame_nodes(np.asarray(observations.frame))
    if light.environment is None:
        return PreparedLight(dual_light(None, light.directional, 0, frames), None, None)
    highest = light.environment.grid.band_limit
    degrees = min(_SHOWN_BAND_LIMIT if band_limit is None else band_limit, highest)
    whole = take(light.environment, candidates(light.environment, _ANY_WIDTH), 0, _ANY_WIDTH)
    return PreparedLight(dual_light(whole, light.directional, degrees, frames), None, None)


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
    if light.environment is not None:
        nodes = light.environment.nodes()
        if angle_per_sigma is not None or nodes.directions.shape[0] > _MOST_NODES:
            angle = (angle_per_sigma or _NODE_ANGLE_PER_SIGMA) * sigma
            nodes = condensed(light.environment, angle)
        lit = np.any(np.asarray(nodes.irradiance) > 0, axis=1)
        directions = np.asarray(nodes.directions)[lit]
        if light.turn is not None:
            directions = directions @ np.asarray(light.turn).T
        shared.append(LightNodes(directions, np.asarray(nodes.irradiance)[lit]))
    if shared:
        directions, irradiance = (np.concatenate(arrays) for arrays in zip(*shared))
        if len(directions):
            parts.append(LightNodes(directions, irradiance))
    if light.near is None:
        frames = light.frame_nodes(np.asarray(frame_of_sample))
        return tuple(parts) if frames is None else (*parts, frames)
    if points is None:
        raise ValueError("sources that are near need to know where the samples lie: give points")
    return (*parts, *light.near_parts(np.asarray(frame_of_sample), points))


def band_limit_for(environment: Environment, sigma: float) -> int:
    """Choose the degree up to which a lobe of roughness ``sigma`` passes the light at all."""
    # Rounded up to a few values, so that few programs are ever compiled.
    wanted = 16 * math.ceil(_BAND_LIMIT_TIMES_SIGMA / sigma / 16)
    return min(wanted, environment.grid.band_limit, _HIGHEST_BAND_LIMIT)


def _divide(environment: Environment, sigma: float, split: str | float) -> LightSplit:
    if isinstance(split, float):
        return split_to_energy(environment, sigma, split)
    sources = {"off": 0, "rough": _ROUGH_SOURCES}
    if split not in sources:
        raise ValueError(f"split={split!r}: choose auto, off, or the energy left in the slow part")
    return take(environment, candidates(environment, sigma), sources[split], sigma)


def _divide_as_needed(
    environment: Environment,
    samples: SurfaceSamples,
    brdf: Glossy,
    goal: DualGoal,
) -> tuple[LightSplit, SourcesNeeded]:
    """Split so that the dual model is as accurate as it is to be."""
    sigma = float(brdf.sigma)
    found = candidates(environment, sigma)
    step = max(1, samples.normals.shape[0] // _SAMPLES_FOR_SPLIT)
    some = SurfaceSamples(samples.normals[::step], samples.outgoing[::step])
    needed = sources_needed(environment, found.sources, brdf.as_metal(), some, goal)
    return take(environment, found, needed.count, sigma), needed
