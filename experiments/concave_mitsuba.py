"""A concave object photographed by Mitsuba 3, its material recovered under known light.

    python experiments/concave_mitsuba.py [--mesh FILE] [--probe FILE] [--distribution ggx]

Direct light only: a rough conductor (Smith masking, no Fresnel) blended with a diffuse one, under
an image of 256 rows; the fit is given 128 of them, the mesh and the cameras.  Without ``--mesh``
the object is the project's sculpture, without ``--probe`` (a vertical cross) the light is drawn by
``scenes.py``.  What is fitted is T 6.2 with masking: its Gaussian is close to Beckmann's, whose
roughness alpha is then sigma, and is not GGX's.  Demanded, of the same model as was rendered:
roughness within 10 %, albedo within 3 %.  The fit without shadows is printed beside it.
"""

import argparse
import tempfile
import time
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import jax
import numpy as np
import scenes

from jaxrender.brdf import Microfacet
from jaxrender.geometry import (
    Mesh,
    Pinhole,
    SurfacePlaces,
    SurfaceSamples,
    SurfaceView,
    look_at,
    observe,
)
from jaxrender.geometry.sculpture import sculpture
from jaxrender.imaging import erode
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    MicrofacetUnknowns,
    Observations,
    fit_brdf,
)
from jaxrender.inverse.observations import random_subset
from jaxrender.inverse.passes import values_of
from jaxrender.inverse.shadowing import hidden_fraction
from jaxrender.io import read_environment, read_mesh, write_mesh
from jaxrender.lighting import DirectionalSources, Environment

# The blend: this much conductor, the rest diffuse of this reflectance.
GLOSS, REFLECTANCE, TINT = 0.35, np.array([0.45, 0.3, 0.2]), np.array([0.6, 0.6, 0.6])
ROUGHNESS = 0.2
VIEWS, SIZE, ANGLE, DISTANCE = 4, 128, 22.0, 5.4
SAMPLES, LOWEST_COSINE = 8000, 0.15


class Object(NamedTuple):
    """What is photographed: a mesh, its light on a fine image, and the distribution of facets."""

    mesh: Mesh
    light: Environment
    distribution: str


def material() -> Microfacet:
    """The blend in our units: kd = (1 - w) reflectance / pi, ks = w tint."""
    kd, ks = (1 - GLOSS) * REFLECTANCE / np.pi, GLOSS * TINT
    return Microfacet(kd, ks, ROUGHNESS, None, "exit", "smith")


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


def photographs(mi: ModuleType, what: Object, spp: int) -> list[np.ndarray]:
    """Render every camera's view, direct light only."""
    facets = {
        "type": "roughconductor",
        "distribution": what.distribution,
        "alpha": ROUGHNESS,
        "material": "none",
        "specular_reflectance": {"type": "rgb", "value": TINT.tolist()},
    }
    matt = {"type": "diffuse", "reflectance": {"type": "rgb", "value": REFLECTANCE.tolist()}}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "object.ply"
        write_mesh(path, what.mesh)
        blend = {"type": "blendbsdf", "weight": GLOSS, "matt": matt, "facets": facets}
        scene = mi.load_dict(
            {
                "type": "scene",
                "light": envmap(mi, what.light),
                "object": {"type": "ply", "filename": str(path), "bsdf": blend},
            }
        )
        integrator = mi.load_dict({"type": "direct", "hide_emitters": True})
        images = []
        for number, camera in enumerate(cameras(what.mesh)):
            sensor = mi.load_dict(sensor_of(mi, camera))
            image = mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=number)
            images.append(np.asarray(image, float)[..., :3])
    return images


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


def observations(what: Object, images: list[np.ndarray]) -> Observations:
    """Trace the pixels and gather those that are usable."""
    parts = []
    for number, (camera, image) in enumerate(zip(cameras(what.mesh), images)):
        view = observe(camera, what.mesh)
        covered = image.sum(axis=-1) > 0
        print(
            f"  view {number}: {view.hit.sum()} pixels, {(view.hit != covered).sum()} not Mitsuba's"
        )
        usable = erode(view.hit, 2) & (view.exit_cosines > LOWEST_COSINE) & _smooth(view)
        arrays = (view.normals, view.outgoing, image, view.points, view.geometric_normals)
        parts.append([a[usable] for a in arrays] + [np.full(usable.sum(), number)])
    normals, outgoing, radiance, points, geometric, frame = (
        np.concatenate(arrays) for arrays in zip(*parts)
    )
    every = Observations(
        SurfaceSamples(normals, outgoing), radiance, frame, SurfacePlaces(points, geometric)
    )
    return random_subset(every, SAMPLES, 0)


def _smooth(view: SurfaceView) -> np.ndarray:
    """Leave out pixels across which one part of the object ends before another."""
    jump = np.zeros(view.hit.shape)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(view.points, axis=axis), axis=-1)
        pad = [(0, 0), (0, 0)]
        for side in ((1, 0), (0, 1)):
            pad[axis] = side
            jump = np.maximum(jump, np.pad(step, pad))
    usual = np.median(jump[view.hit])
    return erode(view.hit & (jump < 6 * usual), 1)


def errors(found) -> str:
    """Compare with the truth, per cent: kd is diffuse albedo, with ks the albedo of all."""
    truth = material()
    albedo = np.pi * np.asarray(found.kd) + np.asarray(found.ks)
    true_albedo = np.pi * np.asarray(truth.kd) + np.asarray(truth.ks)
    pairs = (
        ("kd", found.kd, truth.kd),
        ("ks", found.ks, truth.ks),
        ("albedo", albedo, true_albedo),
        ("roughness", found.sigma, ROUGHNESS),
    )
    return "  ".join(f"{name} {np.max(np.abs(np.asarray(a) / b - 1)):6.1%}" for name, a, b in pairs)


def report(what: Object, seen: Observations) -> None:
    """Fit with and without shadows and print the errors."""
    light = KnownLight(scenes.coarser(what.light), DirectionalSources.none())
    unknowns = MicrofacetUnknowns(mu=None, ks_per_channel=True)
    for name, shape in (("shadows", what.mesh), ("no shadows", None)):
        start = time.perf_counter()
        fit = fit_brdf(seen, light, unknowns, material(), FitSettings(starts=4), shape=shape)
        taken = time.perf_counter() - start
        if fit.frequency.observations.transfer is not None:
            hidden = hidden_fraction(fit.frequency.observations.transfer)
            print(f"  hidden on average: {hidden:.1%} of the hemisphere")
        print(f"  {name:10s} frequency  {errors(values_of(fit.frequency))}")
        print(f"  {name:10s} refined    {errors(values_of(fit.final))}")
        print(
            f"  {'':10s} residual {fit.final.relative_rms:.2%}, {fit.outcome.value}, {taken:.0f} s"
        )


def main() -> None:
    """Render, fit and print."""
    parser = argparse.ArgumentParser(description="Mitsuba photographs, jaxrender fits")
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--probe", type=Path)
    parser.add_argument("--distribution", choices=("beckmann", "ggx"), default="beckmann")
    parser.add_argument("--spp", type=int, default=512)
    given = parser.parse_args()
    try:
        import mitsuba as mi
    except ImportError:
        print("skipped: Mitsuba 3 is not installed (extra 'peers')")
        return
    mi.set_variant("scalar_rgb")
    jax.config.update("jax_enable_x64", True)
    mesh = sculpture(5) if given.mesh is None else read_mesh(given.mesh)
    rows = scenes.FINE_ROWS
    light = scenes.probe("interior", 3)
    if given.probe is not None:
        light = read_environment(given.probe, "cross", height=rows)
    what = Object(mesh, light, given.distribution)
    check_directions(mi)
    names = (given.mesh or "sculpture", given.probe or "synthetic light", given.distribution)
    print("{} under {}, {}".format(*names))
    report(what, observations(what, photographs(mi, what, given.spp)))


if __name__ == "__main__":
    main()
