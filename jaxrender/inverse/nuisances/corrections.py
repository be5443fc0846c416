"""Corrections of a capture: numbers of each nuisance, applied to samples and to the light.

Pixels are blurred radiance times the photograph's gain plus a black level, raised to an exponent.
All of that is taken off the pixels, so that they are those of the capture as it was told.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from jaxrender.geometry import (
    Camera,
    Shape,
    SurfacePlaces,
    SurfaceSamples,
    SurfaceView,
    observe,
)
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.near_light import Nearness
from jaxrender.inverse.nuisances.bumps import BUMPS, bumps
from jaxrender.inverse.nuisances.sources import source_groups
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.rays import Rays, center_of, size_of
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import AnyArray, Bool, Float

# Samples that a mended camera sees at less than this part of the least exit cosine are left out.
_LEAST_COSINE = 0.5
# Values below this part of the level say no more of a response than those at it.
_DARK = 1e-3


class Softening(NamedTuple):
    """What a blur adds to each sample, per variance in pixels squared.

    ``inside`` marks the samples around which the same part of the object is seen.  What a blur adds
    to the others nobody knows.
    """

    added: Float[np.ndarray, "sample channel"]
    inside: Bool[np.ndarray, "sample"]


class Told(NamedTuple):
    """A capture as it was told: samples, the light (None where it is unknown), the shape.

    What a blur does depends on all of what is seen.  Where one is corrected, ``softening`` says it
    of each sample, by what was found so far.
    """

    observations: Observations
    light: KnownLight | None
    shape: Shape | None
    softening: Softening | None = None

    @property
    def placed(self) -> bool:
        """Whether it is known where the samples lie."""
        return self.observations.places is not None and self.shape is not None


class Corrections(NamedTuple):
    """What is wrong with a capture; zero where it is as told.

    ``exposure`` log of the gains, ``camera`` rotation vectors, ``object`` its shift in sizes,
    ``scale`` log of its scale, ``environment`` rotation vectors, ``lamps`` of each group of
    sources a rotation vector and the log of its brightness, ``nearness`` of each of those,
    ``black`` relative to ``level``, the mean radiance (rms), ``response`` log of the exponent,
    which leaves a value of 1 as it is, ``normals`` a displacement, ``blur`` a variance in pixels
    squared.  Rotations are in radians.
    """

    exposure: Float[np.ndarray, "frame"]
    camera: Float[np.ndarray, "frame 3"]
    object: Float[np.ndarray, "3"]
    scale: Float[np.ndarray, "1"]
    environment: Float[np.ndarray, "image 3"]
    lamps: Float[np.ndarray, "group 4"]
    nearness: Float[np.ndarray, "group"]
    black: Float[np.ndarray, "channel"]
    response: Float[np.ndarray, "1"]
    normals: Float[np.ndarray, "harmonic"]
    blur: Float[np.ndarray, "1"]
    level: float = 1.0

    @classmethod
    def none(cls, told: Told) -> "Corrections":
        """Make those of a capture in which nothing is wrong."""
        frames = told.observations.frames
        groups = 0 if told.light is None else len(source_groups(told.light))
        images = 1 if told.light is None else max(1, len(told.light.images))
        radiance = np.asarray(told.observations.radiance, float)
        return cls(
            np.zeros(frames),
            np.zeros((frames, 3)),
            np.zeros(3),
            np.zeros(1),
            np.zeros((images, 3)),
            np.zeros((groups, 4)),
            np.zeros(groups),
            np.zeros(radiance.shape[1]),
            np.zeros(1),
            np.zeros(BUMPS),
            np.zeros(1),
            float(np.sqrt(np.mean(radiance**2))),
        )

    def of(self, name: str) -> Float[np.ndarray, "number"]:
        """List the numbers of one nuisance."""
        return np.asarray(getattr(self, name)).ravel()

    def moved(self, name: str, by: Float[np.ndarray, "number"]) -> "Corrections":
        """Move one nuisance by a step; rotations follow upon each other."""
        now = getattr(self, name)
        step = by.reshape(now.shape)
        if name in ("camera", "environment"):
            moved = _turned_further(now, step)
        elif name == "lamps":
            turned = _turned_further(now[:, :3], step[:, :3])
            moved = np.concatenate([turned, (now + step)[:, 3:]], axis=1)
        else:
            moved = now + step
        return self._replace(**{name: moved})

    def observations(self, told: Told) -> Observations:
        """Correct samples; those that a mended camera does not see stand for no pixel.

        Neither do those beside a rim, where a blur is taken off.
        """
        observed = self.geometry(told)
        frame = np.asarray(observed.frame)
        values = np.asarray(observed.radiance, float)
        if np.any(self.response):
            values = np.maximum(values, 0) ** np.exp(-self.response[0])
        values = (values - self.level * self.black) / np.exp(self.exposure)[frame, None]
        if not np.any(self.blur):
            return observed._replace(radiance=values)
        assert told.softening is not None
        return observed._replace(
            radiance=values - self.blur * told.softening.added,
            stands_for=np.where(told.softening.inside, observed.pixels, 0.0),
        )

    def slopes(self, told: Told) -> Float[np.ndarray, "sample channel"]:
        """Say how much farther apart corrected values lie than those that were told."""
        values = np.asarray(told.observations.radiance, float)
        slopes = np.ones_like(values)
        if np.any(self.response):
            exponent = np.exp(-self.response[0])
            slopes = exponent * np.maximum(values, _DARK * self.level) ** (exponent - 1)
        return slopes / np.exp(self.exposure)[np.asarray(told.observations.frame), None]

    def geometry(self, told: Told) -> Observations:
        """Correct what samples see, and leave their values."""
        observed = told.observations
        if self.moves_rays:
            observed = self._retraced(told, observed)
        if np.any(self.normals):
            turned = self._bent(np.asarray(observed.samples.normals, float))
            observed = observed._replace(samples=SurfaceSamples(turned, observed.samples.outgoing))
        return observed

    @property
    def moves_rays(self) -> bool:
        """Whether pixels show other places than they were told to show."""
        return bool(np.any(self.camera) or np.any(self.object) or np.any(self.scale))

    def _retraced(self, told: Told, observed: Observations) -> Observations:
        """Find what moved rays meet."""
        shape = told.shape
        assert shape is not None
        assert observed.places is not None
        rays = self.rays(observed, shape)
        hits = rays.meet(shape)
        outgoing = -rays.directions
        exits = np.sum(hits.normals * outgoing, axis=1)
        facing = np.sum(hits.geometric_normals * outgoing, axis=1)
        least = _LEAST_COSINE * np.min(observed.samples.exit_cosines, initial=1)
        kept = hits.hit & (exits > least) & (facing > 0)

        def chosen(new: np.ndarray, old: AnyArray) -> np.ndarray:
            return np.where(kept[:, None], new, np.asarray(old, float))

        samples, places = observed.samples, observed.places
        return observed._replace(
            samples=SurfaceSamples(
                chosen(hits.normals, samples.normals), chosen(outgoing, samples.outgoing)
            ),
            places=SurfacePlaces(
                chosen(hits.points, places.points),
                chosen(hits.geometric_normals, places.geometric_normals),
            ),
            stands_for=np.where(kept, observed.pixels, 0.0),
            transfer=None,
            eyes=None if observed.eyes is None else self.eyes(np.asarray(observed.eyes), shape),
        )

    def rays(self, observed: Observations, shape: Shape) -> Rays:
        """Mend the rays of samples: the camera turns, then all are shifted."""
        rays = Rays.of(observed, shape)
        if np.any(self.camera):
            turns = Rotation.from_rotvec(self.camera).as_matrix()
            rays = rays.turned(turns[np.asarray(observed.frame)])
        if rays.eyes is None:
            return rays.shifted(-size_of(shape) * self.object)
        return rays.shifted(self.eyes(rays.eyes, shape) - rays.eyes)

    def eyes(
        self, told: Float[np.ndarray, "camera 3"], shape: Shape
    ) -> Float[np.ndarray, "camera 3"]:
        """Say where cameras stand, relative to the object as it was told."""
        center = center_of(shape)
        moved = told - size_of(shape) * self.object
        return center + (moved - center) * np.exp(-self.scale[0])

    def camera_of(self, told: Camera, frame: int, shape: Shape) -> Camera:
        """Mend the pose of a photograph's camera."""
        pose = np.array(told.world_from_camera, float)
        pose[:3, :3] = rotation(self.camera[frame]) @ pose[:3, :3]
        pose[:3, 3] = self.eyes(pose[None, :3, 3], shape)[0]
        return eqx.tree_at(lambda camera: camera.world_from_camera, told, pose)

    def view(self, told: Camera, frame: int, shape: Shape) -> SurfaceView:
        """See the object as a photograph's camera does, mended like the surface's normals."""
        seen = observe(self.camera_of(told, frame, shape), shape)
        if not np.any(self.normals):
            return seen
        normals, hit = np.array(seen.normals), seen.hit
        normals[hit] = self._bent(normals[hit])
        exits = np.sum(normals * seen.outgoing, axis=-1)
        return seen._replace(normals=normals, exit_cosines=exits)

    def photographed(
        self,
        radiance: Float[np.ndarray, "*image channel"],
        frame: int,
        seen: Bool[np.ndarray, "*image"] | None = None,
    ) -> Float[np.ndarray, "*image channel"]:
        """Say which pixels radiance makes in a photograph: what ``observations`` takes off.

        A blur mixes what is ``seen`` of the object, and nothing else; None is all of an image.
        """
        if np.any(self.blur):
            seen = np.ones(radiance.shape[:2], bool) if seen is None else seen
            radiance = _blurred(radiance, seen, float(np.sqrt(self.blur[0])))
        values = radiance * np.exp(self.exposure[frame]) + self.level * self.black
        return np.maximum(values, 0) ** np.exp(self.response[0])

    def _bent(self, normals: Float[np.ndarray, "sample 3"]) -> Float[np.ndarray, "sample 3"]:
        """Turn normals as the displacement does."""
        turned = normals - np.einsum("h,hsi->si", self.normals, bumps(normals))
        return turned / np.linalg.norm(turned, axis=1, keepdims=True)

    def light(self, told: Told) -> KnownLight:
        """Correct the light that was told."""
        light = told.light
        assert light is not None
        directional = light.directional
        directions = np.array(directional.directions, float)
        irradiance = np.array(directional.irradiance, float)
        per_frame, nearness, of_frames = light.per_frame, np.zeros(len(directions)), 0.0
        stated = light.near is not None and light.near.stated
        for group, lamp, near in zip(source_groups(light), self.lamps, self.nearness):
            turn, bright = rotation(lamp[:3]), np.exp(lamp[3])
            if group.index is not None:
                directions[group.index] = directions[group.index] @ turn.T
                irradiance[group.index] *= bright
                nearness[group.index] = near
            elif per_frame is not None:
                of_frames = float(near)
                per_frame = tuple(
                    DirectionalSources(
                        np.asarray(own.directions) @ turn.T, bright * np.asarray(own.irradiance)
                    )
                    for own in per_frame
                )
        turn = turns = None
        if np.any(self.environment):
            each = Rotation.from_rotvec(self.environment).as_matrix()
            if light.environments is None:
                turn = each[0]
            else:
                turns = each[light.image_of_frame]
        # Lamps that have a place turn about the object's centre, and stay as far as they are.
        near = light.near if stated else None
        if not stated and np.any(self.nearness):
            assert told.shape is not None
            every = np.full((1, 1), of_frames)
            near = Nearness(nearness, every, center_of(told.shape), size_of(told.shape))
        sources = DirectionalSources(directions, irradiance)
        return dataclasses.replace(
            light, directional=sources, per_frame=per_frame, turn=turn, turns=turns, near=near
        )


def rotation(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Make the matrix of a rotation vector (radians)."""
    return Rotation.from_rotvec(vector).as_matrix()


def _blurred(
    image: Float[np.ndarray, "row column channel"], seen: Bool[np.ndarray, "row column"], by: float
) -> Float[np.ndarray, "row column channel"]:
    """Blur what is seen by a Gaussian of a standard deviation in pixels."""
    part = gaussian_filter(seen.astype(float), by)[..., None]
    mixed = gaussian_filter(np.where(seen[..., None], image, 0.0), (by, by, 0))
    return np.where(seen[..., None], mixed / np.where(part > 0, part, 1), image)


def _turned_further(
    now: Float[np.ndarray, "*many 3"], step: Float[np.ndarray, "*many 3"]
) -> Float[np.ndarray, "*many 3"]:
    """Follow one rotation by another."""
    first, second = Rotation.from_rotvec(now), Rotation.from_rotvec(step)
    return (second * first).as_rotvec()
