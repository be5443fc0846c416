"""Photographs that Mitsuba 3 takes: a blend of conductor and diffuse under a probe.

Direct light only: a rough conductor (Smith masking, no Fresnel) blended with a diffuse one.  Our
conventions are put into Mitsuba's words here, and checked against what Mitsuba makes of them:
``check_directions`` by one bright texel, ``check_material`` by the BRDF at random pairs of
directions.
"""

import tempfile
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.brdf.distributions import DISTRIBUTIONS
from jaxrender.geometry import Components, Mesh, Pinhole, look_at
from jaxrender.io import write_mesh
from jaxrender.lighting import Environment

# The blend: this much conductor, the rest diffuse of this reflectance.
CONDUCTOR, REFLECTANCE, TINT = 0.35, np.array([0.45, 0.3, 0.2]), np.array([0.6, 0.6, 0.6])
ROUGHNESS = 0.2
VIEWS, SIZE, ANGLE, DISTANCE = 4, 128, 22.0, 5.4
# Mitsuba computes in single precision, and Beckmann's masking by a rational function.
_SAME_BRDF = {"ggx": 1e-5, "beckmann": 5e-3}


class Object(NamedTuple):
    """What is photographed: a mesh, its light on a fine image, and the distribution of facets."""

    mesh: Mesh
    light: Environment
    distribution: str


def material(distribution: str) -> Microfacet:
    """The blend in our units: kd = (1 - w) reflectance / pi, ks = w tint."""
    kd, ks = (1 - CONDUCTOR) * REFLECTANCE / np.pi, CONDUCTOR * TINT
    return Microfacet(kd, ks, ROUGHNESS, None, "half", "smith", distribution)


def blend(distribution: str) -> dict:
    """The same material in Mitsuba's terms."""
    facets = {
        "type": "roughconductor",
        "distribution": distribution,
        "alpha": ROUGHNESS,
        "material": "none",
        "specular_reflectance": {"type": "rgb", "value": TINT.tolist()},
    }
    diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": REFLECTANCE.tolist()}}
    return {"type": "blendbsdf", "weight": CONDUCTOR, "diffuse": diffuse, "facets": facets}


def cameras(mesh: Mesh) -> list[Pinhole]:
    """Cameras on a ring about the middle of the mesh, looking at it from a few diagonals."""
    lower, upper = mesh.bounds()
    centre, size = (lower + upper) / 2, mesh.diagonal() / 2
    focal = SIZE / 2 / np.tan(np.radians(ANGLE) / 2)
    found = []
    for azimuth in 2 * np.pi * (np.arange(VIEWS) + 0.25) / VIEWS:
        towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.35])
        position = centre + DISTANCE * size * towards / np.linalg.norm(towards)
        pose = look_at(position, centre, np.array([0.0, 0.0, 1.0]))
        found.append(Pinhole(SIZE, SIZE, pose, fl_x=float(focal)))
    return found


def photographs(mi: ModuleType, what: Object, spp: int) -> list[np.ndarray]:
    """Render every camera's view, direct light only."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "object.ply"
        write_mesh(path, what.mesh)
        shape = {"type": "ply", "filename": str(path), "bsdf": blend(what.distribution)}
        scene = mi.load_dict({"type": "scene", "light": envmap(mi, what.light), "object": shape})
        integrator = mi.load_dict({"type": "direct", "hide_emitters": True})
        images = []
        for number, camera in enumerate(cameras(what.mesh)):
            sensor = mi.load_dict(sensor_of(mi, camera))
            image = mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=number)
            images.append(np.asarray(image, float)[..., :3])
    return images


def envmap(mi: ModuleType, light: Environment) -> dict:
    """Our panorama as Mitsuba's: seen from inside, its azimuths run the other way, up is +Y."""
    # Mitsuba: u = atan2(x, -z) / 2 pi and v = acos(y) / pi in the map's own axes.
    to_world = np.array([[0, 0, -1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)
    image = np.ascontiguousarray(np.asarray(light.radiance, np.float32)[:, ::-1])
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(image),
        "to_world": mi.ScalarTransform4f(to_world),
    }


def sensor_of(mi: ModuleType, camera: Pinhole) -> dict:
    """The same camera in Mitsuba's terms: it looks along +z, with x to the left."""
    flipped = camera.world_from_camera @ np.diag([-1.0, 1.0, -1.0, 1.0])
    return {
        "type": "perspective",
        "fov": ANGLE,
        "fov_axis": "x",
        "near_clip": 1e-3,
        "far_clip": 1e4,
        "to_world": mi.ScalarTransform4f(flipped),
        "film": {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
        },
    }


def check_directions(mi: ModuleType) -> None:
    """Light of one bright texel must come from where we say it does."""
    radiance = np.full((64, 128, 3), 1e-6)
    radiance[14, 40] = 100.0
    light = Environment(radiance)
    expected = light.grid.directions()[14, 40]
    scene = mi.load_dict({"type": "scene", "light": envmap(mi, light)})
    directions = light.grid.directions().reshape(-1, 3)
    surface = mi.SurfaceInteraction3f()
    found = []
    for direction in directions:
        surface.wi = -mi.Vector3f(*direction)
        found.append(scene.environment().eval(surface)[0])
    brightest = directions[int(np.argmax(found))]
    if brightest @ expected < 1 - 1e-6:
        raise SystemExit(f"Mitsuba sees {expected} at {brightest}: its conventions have changed")


def check_material(mi: ModuleType, distribution: str, count: int = 500) -> tuple[float, float]:
    """Our BRDF times cosine must be Mitsuba's but for the masking, of which Smith left two forms.

    Mitsuba multiplies the two directions' maskings, 1 / ((1 + a) (1 + b)), ours is correlated by
    the facets' heights, 1 / (1 + a + b).  Returned are the largest relative differences once ours
    has Mitsuba's form, and as it is.
    """
    ours, bsdf = material(distribution), mi.load_dict(blend(distribution))
    incoming, outgoing = (_upper_directions(count, seed) for seed in (0, 1))
    pair = [Components.of(jnp.asarray(directions)) for directions in (incoming, outgoing)]
    cosine, lobe = ours.transfer(*pair)
    surface, theirs = mi.SurfaceInteraction3f(), np.zeros((count, 3))
    for number, (light, view) in enumerate(zip(incoming, outgoing)):
        surface.wi = mi.Vector3f(*view)
        theirs[number] = np.ravel(bsdf.eval(mi.BSDFContext(), surface, mi.Vector3f(*light)))
    facets = DISTRIBUTIONS[distribution](ROUGHNESS)
    a, b = (np.asarray(facets.smith_lambda(direction)) for direction in pair)
    off = []
    for shading in ((1 + a + b) / ((1 + a) * (1 + b)), 1):
        mixed = np.outer(cosine, ours.kd) + np.outer(lobe * shading, ours.ks)
        off.append(float(np.max(np.abs(mixed / theirs - 1))))
    if off[0] > _SAME_BRDF[distribution]:
        raise SystemExit(f"our {distribution} is not Mitsuba's: {off[0]:.1e} off at worst")
    return off[0], off[1]


def _upper_directions(count: int, seed: int) -> np.ndarray:
    """Draw directions above the horizon, half of them close to one another's mirror."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    side = 1 if seed else -1
    directions[::2] = 0.2 * directions[::2] + np.array([0.7 * side, 0.2, 1.0])
    directions[:, 2] = np.abs(directions[:, 2]) + 0.05
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
