"""A ball under a probe and a lamp, seen by a ring of cameras: as it is, and as the fit is told.

The truth is the integral over all texels of the probe and the lamp, at the surface that each pixel
of the true camera sees of the true object; noise of 1 % comes on top.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scenes import probe, unit
from scipy.ndimage import gaussian_filter

from jaxrender.brdf import Microfacet, Parametric
from jaxrender.geometry import (
    Camera,
    Pinhole,
    Shape,
    Sphere,
    SurfacePlaces,
    SurfaceSamples,
    look_at,
    observe,
    world_from_local,
)
from jaxrender.harmonics import evaluate
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.factorization import Factorization
from jaxrender.lighting import Environment
from jaxrender.reflection import integral_columns, radiance

VIEWS, SIZE, DISTANCE, LOWEST_COSINE, NOISE = 12, 48, 5.0, 0.15, 0.01
TRUE = Microfacet(np.array([0.12, 0.17, 0.21]), np.full(3, 0.1), 0.12, 1.5)
ROWS = 64


class World(NamedTuple):
    """How photographs are taken, or said to be taken.

    ``bump`` are coefficients of a displacement whose gradient turns the normals (radians).  A lamp
    of ``nearness`` 0 is infinitely far; else it stands at 1 / nearness.  ``patch`` is another
    material, and ``where`` says which part of it is at each point.  ``defocus`` is the standard
    deviation of the blur at the rim, in pixels, where cameras are focused on the nearest point.
    """

    cameras: list[Camera]
    shape: Shape
    environment: Environment
    lamp: np.ndarray
    irradiance: np.ndarray
    material: Parametric
    gains: np.ndarray
    nearness: float = 0.0
    black: float = 0.0
    exponent: float = 1.0
    clip: float = np.inf
    bump: np.ndarray | None = None
    blur: float = 0.0
    defocus: float = 0.0
    patch: Parametric | None = None
    where: Callable[[np.ndarray], np.ndarray] = lambda points: points[:, 0] > 0.6
    turn: np.ndarray = np.eye(3)
    # Of the whole light, in each photograph.
    moves: np.ndarray | None = None


def clean(seed: int, kind: str = "interior") -> World:
    """Make a ring of cameras about a ball under a probe and a lamp."""
    cameras = []
    for number in range(VIEWS):
        azimuth = 2 * np.pi * number / VIEWS + 0.1
        elevation = np.radians((10, 35, 60)[number % 3])
        level = np.cos(elevation)
        towards = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        pose = look_at(DISTANCE * towards, np.zeros(3), np.array([0.0, 0, 1]))
        focal = 0.95 * SIZE / 2 * np.sqrt(DISTANCE**2 - 1)
        cameras.append(Pinhole(SIZE, SIZE, pose, fl_x=focal))
    environment = probe(kind, seed, ROWS)
    # Radiances of order one.
    level = float(np.mean(np.asarray(environment.radiance)))
    environment = Environment(np.asarray(environment.radiance) / level)
    rng = np.random.default_rng(1000 + seed)
    lamp = unit(rng.normal(size=3) + np.array([0, 0, 1.5]))
    energy = np.array([1.0, 0.9, 0.8]) * rng.uniform(2, 4)
    return World(cameras, Sphere(np.zeros(3), 1.0), environment, lamp, energy, TRUE, np.ones(VIEWS))


def photographs(world: World, told: World, seed: int) -> Observations:
    """Take photographs of one world; the geometry is that of another, which the fit is told."""
    rng = np.random.default_rng(2000 + seed)
    parts = []
    for frame, (camera, said) in enumerate(zip(world.cameras, told.cameras)):
        true, given = observe(camera, world.shape), observe(said, told.shape)
        usable = (given.exit_cosines > LOWEST_COSINE) & true.hit
        image = np.zeros((*usable.shape, 3))
        hit, seen = true.hit, (true.points, true.normals, true.outgoing)
        if world.moves is not None:
            # To turn the light is to turn all else the other way.
            seen = tuple(part @ world.moves[frame] for part in seen)
        image[hit] = _radiance(world, *(part[hit] for part in seen))
        if world.blur:
            image = _blurred(image, world.blur)
            inside = _blurred(np.repeat(true.hit[..., None], 3, -1).astype(float), world.blur)
            usable &= inside[..., 0] > 0.999
        if world.defocus:
            image, inside = _defocused(image, true.hit, true.points - camera.position, world)
            usable &= inside
        image = world.gains[frame] * image + world.black
        image = NoiseModel(NOISE, 0.0).add(image, rng)
        image = np.minimum(np.maximum(image, 0) ** world.exponent, world.clip)
        rows, columns = np.nonzero(usable)
        parts.append(
            (
                given.normals[usable],
                given.outgoing[usable],
                image[usable],
                np.full(len(rows), frame),
                given.points[usable],
                given.geometric_normals[usable],
                np.stack([rows, columns], axis=1),
            )
        )
    normals, outgoing, values, frame, points, facing, pixel = map(np.concatenate, zip(*parts))
    samples, places = SurfaceSamples(normals, outgoing), SurfacePlaces(points, facing)
    eyes = np.stack([one.position for one in told.cameras])
    return Observations(samples, values, frame, places, pixel=pixel, eyes=eyes)


def _radiance(
    world: World, points: np.ndarray, normals: np.ndarray, outgoing: np.ndarray
) -> np.ndarray:
    """Integrate over every texel, and over the lamp wherever it stands."""
    if world.bump is not None:
        normals = bumpy(world.bump, normals)
        outgoing = np.asarray(outgoing)
    whole = integrated(world, world.material, points, normals, outgoing)
    if world.patch is None:
        return whole
    other = integrated(world, world.patch, points, normals, outgoing)
    part = world.where(points)[:, None]
    return part * other + (1 - part) * whole


def integrated(
    world: World, brdf: Parametric, points: np.ndarray, normals: np.ndarray, outgoing: np.ndarray
) -> np.ndarray:
    samples = SurfaceSamples(*(jnp.asarray(part) for part in (normals, outgoing)))
    nodes = world.environment.nodes()
    nodes = nodes._replace(directions=np.asarray(nodes.directions) @ world.turn.T)
    columns = integral_columns(brdf, samples, nodes)
    total = np.asarray(radiance(brdf, columns))
    # One lamp: the BRDF itself times the cosine and the irradiance there.
    offset = world.lamp[None] - world.nearness * points
    squared = np.sum(offset**2, axis=1, keepdims=True)
    frames = np.asarray(world_from_local(jnp.asarray(normals)))
    incoming = np.einsum("sji,sj->si", frames, offset / np.sqrt(squared))
    seen = np.einsum("sji,sj->si", frames, outgoing)
    rho = np.asarray(brdf.evaluate(jnp.asarray(incoming), jnp.asarray(seen)))
    return total + rho * np.maximum(incoming[:, 2:], 0) * world.irradiance / squared


def bumpy(bump: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Turn normals by minus the gradient of a displacement given by harmonics."""
    step = 1e-4
    gradient = np.stack(
        [
            (_height(bump, normals + step * axis) - _height(bump, normals - step * axis))
            / (2 * step)
            for axis in np.eye(3)
        ],
        axis=1,
    )
    gradient -= np.sum(gradient * normals, axis=1, keepdims=True) * normals
    return unit(normals - gradient)


def _height(bump: np.ndarray, directions: np.ndarray) -> np.ndarray:
    return np.asarray(evaluate(bump[:, None], unit(directions)))[:, 0]


def _blurred(image: np.ndarray, width: float) -> np.ndarray:
    return gaussian_filter(image, (width, width, 0))


def _defocused(
    image: np.ndarray, hit: np.ndarray, from_camera: np.ndarray, world: World
) -> tuple[np.ndarray, np.ndarray]:
    """Blur each pixel by how far it is behind the nearest; interpolate between even blurs."""
    distance = np.where(hit, np.linalg.norm(from_camera, axis=-1), 0)
    nearest = distance[hit].min()
    width = world.defocus * (distance - nearest) / (np.sqrt(DISTANCE**2 - 1) - nearest)
    widths = np.linspace(0, 1.2 * world.defocus, 9)
    whole = hit[..., None].astype(float)
    even = np.stack([_blurred(image, one) for one in widths])
    inside = np.stack([_blurred(whole, one)[..., 0] for one in widths])
    at = np.clip(np.searchsorted(widths, width) - 1, 0, len(widths) - 2)
    part = np.clip((width - widths[at]) / (widths[1] - widths[0]), 0, 1)
    rows, columns = np.indices(hit.shape)
    mixed = [
        (1 - part[..., None]) * one[at, rows, columns]
        + part[..., None] * one[at + 1, rows, columns]
        for one in (even, inside[..., None])
    ]
    return mixed[0], mixed[1][..., 0] > 0.999


class Judged(NamedTuple):
    """A factorization beside the material that was photographed."""

    found: Factorization
    truth: Microfacet

    @property
    def off(self) -> dict[str, float]:
        """The errors of sigma, mu and the specular share, in standard errors."""
        kd, ks = np.asarray(self.truth.kd), np.asarray(self.truth.ks)
        truth = {"sigma": self.truth.sigma, "mu": self.truth.mu, "ks": ks / (kd + ks)}
        value, error = self.found.parameters.value, self.found.parameters.standard_error
        return {
            name: float(np.max(np.abs(np.asarray(value.of(name)) - one) / error.of(name)))
            for name, one in truth.items()
        }

    def honest(self, most: float) -> bool:
        """Whether all is within so many standard errors, or said not to be identifiable."""
        told = self.found.identifiable
        return all(off < most or not told.get(name, True) for name, off in self.off.items())
