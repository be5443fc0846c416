"""Photographs of a ball with one thing wrong: what the fit is told is not how they were taken.

The truth is the integral over all texels of a probe and one lamp, at the surface that each pixel
of the true camera sees of the true object; noise of 1 % comes on top.  The fit is told the clean
camera, object, light and exposures.  ``planted`` makes one case, ``painted`` one of
a ball of two paints; ``FAULTS`` lists what can be wrong, each by its size in its own unit, from
detectable to gross.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scenes import probe, unit
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from jaxrender.brdf import Microfacet, Parametric, Phong, material_named
from jaxrender.geometry import (
    Camera,
    Mesh,
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
from jaxrender.inverse import KnownLight, Observations
from jaxrender.lighting import DirectionalSources, Environment
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


class Case(NamedTuple):
    """What a fit is given, and the truth."""

    pool: Observations
    light: KnownLight
    shape: Shape
    cameras: list[Camera]
    truth: Parametric


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
        normals = _bumpy(world.bump, normals)
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


def _bumpy(bump: np.ndarray, normals: np.ndarray) -> np.ndarray:
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


def _axes(rng: np.random.Generator, count: int) -> np.ndarray:
    return unit(rng.normal(size=(count, 3)))


def camera(world: World, size: float, rng: np.random.Generator) -> World:
    """Turn each camera by ``size`` degrees about an axis of its own."""
    turned = []
    for one, axis in zip(world.cameras, _axes(rng, VIEWS)):
        pose = one.world_from_camera.copy()
        pose[:3, :3] = Rotation.from_rotvec(np.radians(size) * axis).as_matrix() @ pose[:3, :3]
        turned.append(Pinhole(SIZE, SIZE, pose, fl_x=one.fl_x))
    return world._replace(cameras=turned)


def position(world: World, size: float, rng: np.random.Generator) -> World:
    """Shift the object by ``size`` radii."""
    return world._replace(shape=Sphere(size * _axes(rng, 1)[0], 1.0))


def scale(world: World, size: float, rng: np.random.Generator) -> World:
    """Make the object larger by a part ``size``."""
    return world._replace(shape=Sphere(np.zeros(3), 1 + size * rng.choice([-1, 1])))


def exposure(world: World, size: float, rng: np.random.Generator) -> World:
    """Let exposures differ by a part ``size``."""
    return world._replace(gains=np.exp(size * rng.normal(size=VIEWS)))


def environment(world: World, size: float, rng: np.random.Generator) -> World:
    """Turn the environment by ``size`` degrees; the lamp stays."""
    turn = Rotation.from_rotvec(np.radians(size) * _axes(rng, 1)[0]).as_matrix()
    return world._replace(turn=turn)


def lamp(world: World, size: float, rng: np.random.Generator) -> World:
    """Move the lamp aside by ``size`` degrees."""
    axis = unit(np.cross(world.lamp, rng.normal(size=3)))
    turn = Rotation.from_rotvec(np.radians(size) * axis).as_matrix()
    return world._replace(lamp=turn @ world.lamp)


def energy(world: World, size: float, rng: np.random.Generator) -> World:
    """Make the lamp brighter by a part ``size``."""
    return world._replace(irradiance=world.irradiance * (1 + size * rng.choice([-1, 1])))


def nearness(world: World, size: float, _: np.random.Generator) -> World:
    """Stand the lamp at 1 / ``size`` radii."""
    return world._replace(nearness=size)


def black(world: World, size: float, _: np.random.Generator) -> World:
    """Add a part ``size`` of the mean radiance to all pixels."""
    return world._replace(black=0.25 * size)


def response(world: World, size: float, rng: np.random.Generator) -> World:
    """Raise radiance to the power 1 + or - ``size``."""
    return world._replace(exponent=1 + size * rng.choice([-1, 1]))


def normals(world: World, size: float, rng: np.random.Generator) -> World:
    """Turn normals by ``size`` degrees (rms), by a displacement of degree 2 to 4."""
    bump = np.zeros(25)
    bump[4:] = rng.normal(size=21)
    directions = unit(rng.normal(size=(2000, 3)))
    turned = np.arccos(np.clip(np.sum(_bumpy(1e-3 * bump, directions) * directions, 1), -1, 1))
    return world._replace(bump=1e-3 * bump * np.radians(size) / np.sqrt(np.mean(turned**2)))


def lobe(world: World, size: float, rng: np.random.Generator) -> World:
    """Be of another model: GGX, Phong's lobe, or Fresnel at the half angle."""
    kind = int(size)
    numbers = (TRUE.kd, TRUE.ks, TRUE.sigma, TRUE.mu)
    other = [
        material_named("ggx", {"kd": TRUE.kd, "ks": TRUE.ks, **TRUE.numbers}),
        Phong(TRUE.kd, TRUE.ks, 60.0),
        Microfacet(*numbers, fresnel="half", masking="smith"),
    ][kind]
    return world._replace(material=other)


def clipped(world: World, size: float, _: np.random.Generator) -> World:
    """Clip all values at ``size``."""
    return world._replace(clip=size)


def faces(world: World, size: float, _: np.random.Generator) -> World:
    """Be told a mesh of 20 * 4^``size`` faces for the ball (see ``planted``)."""
    return world


def blur(world: World, size: float, _: np.random.Generator) -> World:
    """Blur the photographs by ``size`` pixels."""
    return world._replace(blur=size)


def defocus(world: World, size: float, _: np.random.Generator) -> World:
    """Focus on the nearest point; at the rim the blur is ``size`` pixels."""
    return world._replace(defocus=size)


def moving(world: World, size: float, rng: np.random.Generator) -> World:
    """Turn the whole light in each photograph by ``size`` degrees about an axis of its own."""
    turns = Rotation.from_rotvec(np.radians(size) * _axes(rng, VIEWS)).as_matrix()
    return world._replace(moves=turns)


def paint(world: World, size: float, _: np.random.Generator) -> World:
    """Let a cap of the ball be rougher by a part ``size``, and of another colour."""
    other = Microfacet(
        np.asarray(TRUE.kd) * (1 + size), TRUE.ks, float(TRUE.sigma) * (1 + size), TRUE.mu
    )
    return world._replace(patch=other)


class Fault(NamedTuple):
    """What is wrong, and three sizes of it."""

    plant: Callable[[World, float, np.random.Generator], World]
    sizes: tuple[float, float, float]


FAULTS = {
    "camera": Fault(camera, (0.05, 0.2, 0.6)),
    "object": Fault(position, (0.003, 0.01, 0.03)),
    "scale": Fault(scale, (0.005, 0.02, 0.06)),
    "exposure": Fault(exposure, (0.01, 0.03, 0.1)),
    "environment": Fault(environment, (1.0, 3.0, 10.0)),
    "lamps": Fault(lamp, (0.3, 1.0, 3.0)),
    "energy": Fault(energy, (0.03, 0.1, 0.3)),
    "nearness": Fault(nearness, (0.05, 0.1, 0.2)),
    "black": Fault(black, (0.02, 0.06, 0.2)),
    "response": Fault(response, (0.02, 0.06, 0.2)),
    "normals": Fault(normals, (0.2, 0.6, 2.0)),
    "lobe": Fault(lobe, (0, 1, 2)),
    "saturation": Fault(clipped, (1.0, 0.7, 0.5)),
    "faces": Fault(faces, (4, 3, 2)),
    "blur": Fault(blur, (0.5, 1.0, 2.0)),
    "sites": Fault(paint, (0.1, 0.3, 1.0)),
    "moved_light": Fault(moving, (0.3, 1.0, 3.0)),
    "defocus": Fault(defocus, (1.0, 2.0, 3.0)),
}


def planted(name: str | None, size: float = 0.0, seed: int = 0) -> Case:
    """Make photographs with a fault, and what the fit is told of them."""
    told = clean(seed)
    rng = np.random.default_rng(3000 + seed)
    true = told if name is None else FAULTS[name].plant(told, size, rng)
    if name == "faces":
        told = told._replace(shape=Mesh.ellipsoid(np.ones(3), int(size)))
    pool = photographs(true, told, seed)
    known = KnownLight(told.environment, DirectionalSources(told.lamp[None], told.irradiance[None]))
    return Case(pool, known, told.shape, told.cameras, true.material)


# A checkerboard of so many rows of latitude, and its second paint beside the first.
CELLS, OTHER_KD, OTHER_KS = 4, 0.5, 2.0


def checkered(points: np.ndarray) -> np.ndarray:
    """Tell where on the ball the second paint is: cells of latitude and longitude in turn."""
    x, y, z = unit(points).T
    row = np.floor(np.arccos(np.clip(z, -1, 1)) / np.pi * CELLS)
    column = np.floor(np.arctan2(y, x) / (2 * np.pi) % 1 * 2 * CELLS)
    return (row + column) % 2 == 1


def marbled(points: np.ndarray) -> np.ndarray:
    """Say which part of the second paint is at each point: veins that are soft."""
    x, y, z = unit(points).T
    return 0.5 + 0.5 * np.sin(6 * x + 2 * np.sin(5 * y) + 4 * z)


def painted(
    name: str | None,
    size: float = 0.0,
    seed: int = 0,
    where: Callable[[np.ndarray], np.ndarray] = checkered,
) -> Case:
    """Make photographs of a ball of two paints of one lobe, with a fault; truth is the first."""
    told = clean(seed)
    rng = np.random.default_rng(3000 + seed)
    true = told if name is None else FAULTS[name].plant(told, size, rng)
    first = true.material
    assert isinstance(first, Microfacet)
    second = first.with_amplitudes(OTHER_KD * first.kd, OTHER_KS * first.ks)
    pool = photographs(true._replace(patch=second, where=where), told, seed)
    known = KnownLight(told.environment, DirectionalSources(told.lamp[None], told.irradiance[None]))
    return Case(pool, known, told.shape, told.cameras, first)
