"""Photographs of a ball with one thing wrong: what the fit is told is not how they were taken.

The fit is told the clean camera, object, light and exposures (``ball_worlds.py``).  ``planted``
makes one case, ``painted`` one of a ball of two paints; ``FAULTS`` lists what can be wrong, each by
its size in its own unit, from detectable to gross.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from ball_worlds import SIZE, TRUE, VIEWS, World, bumpy, clean, photographs
from scenes import unit
from scipy.spatial.transform import Rotation

from jaxrender.brdf import Glossy, Microfacet, Parametric, Phong, material_named
from jaxrender.geometry import Camera, Mesh, Pinhole, Shape, Sphere
from jaxrender.inverse import KnownLight, Observations
from jaxrender.lighting import DirectionalSources


class Case(NamedTuple):
    """What a fit is given, and the truth."""

    pool: Observations
    light: KnownLight
    shape: Shape
    cameras: list[Camera]
    truth: Parametric


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
    turned = np.arccos(np.clip(np.sum(bumpy(1e-3 * bump, directions) * directions, 1), -1, 1))
    return world._replace(bump=1e-3 * bump * np.radians(size) / np.sqrt(np.mean(turned**2)))


def lobe(world: World, size: float, rng: np.random.Generator) -> World:
    """Be of another model: GGX, Phong's lobe, or Fresnel at the half angle."""
    kind, true = int(size), world.material
    assert isinstance(true, Microfacet)
    numbers = (true.kd, true.ks, true.sigma, true.mu)
    other = [
        material_named("ggx", {"kd": true.kd, "ks": true.ks, **true.numbers}),
        Phong(true.kd, true.ks, 60.0),
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
    told: World | None = None,
) -> Case:
    """Make photographs of a ball of two paints of one lobe, with a fault; truth is the first.

    ``told`` is what the fit is told; the ball of ``ball_worlds`` where it is None.
    """
    told = told or clean(seed)
    rng = np.random.default_rng(3000 + seed)
    true = told if name is None else FAULTS[name].plant(told, size, rng)
    first = true.material
    assert isinstance(first, Glossy)
    second = first.with_amplitudes(OTHER_KD * np.asarray(first.kd), OTHER_KS * np.asarray(first.ks))
    pool = photographs(true._replace(patch=second, where=where), told, seed)
    known = KnownLight(told.environment, DirectionalSources(told.lamp[None], told.irradiance[None]))
    return Case(pool, known, told.shape, told.cameras, first)
