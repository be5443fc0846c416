"""A diffuse bowl under sky and sun: our path tracer and Mitsuba's along the same rays.

    python experiments/path_tracer_mitsuba.py [--rays 40] [--spp 2000]

Both follow up to eight reflections, at albedos .9, .5 and .2.  Printed is each channel's mean over
the rays, the scatter of the differences in units of their standard error (1 expected), and the
worst one.  Demanded: a scatter of at most 1.3 and means within four standard errors.
"""

import argparse
import tempfile
from pathlib import Path

import jax
import numpy as np

from jaxrender.brdf import Lambertian
from jaxrender.geometry import Mesh
from jaxrender.io import write_mesh
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection.tracing.emitters import DirectionalEmitter, EnvironmentEmitter
from jaxrender.reflection.tracing.path_tracer import PathSettings, path_radiance
from jaxrender.reflection.tracing.scattering import Scene

ALBEDO = np.array([0.9, 0.5, 0.2])
SKY, SUN = np.array([0.3, 0.2, 0.4]), np.array([2.0, 2.0, 1.0])
TOWARDS_SUN = np.array([0.5, 0.1, 0.85])
BOUNCES = 8


def bowl() -> Mesh:
    """The inside of a ball below .4."""
    ball = Mesh.icosphere(2)
    low = ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0.4
    return Mesh(ball.vertices, ball.faces[low][:, ::-1])


def rays_into(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays from above to places within the bowl."""
    rng = np.random.default_rng(1)
    places = rng.normal(size=(count, 3))
    places *= 0.8 * rng.random((count, 1)) ** 0.5 / np.linalg.norm(places, axis=1, keepdims=True)
    directions = np.tile(np.array([0.1, 0.0, -1.0]) / np.hypot(0.1, 1), (count, 1))
    return places * [1, 1, 0] - 4 * directions, directions


def theirs(origins: np.ndarray, directions: np.ndarray, spp: int) -> tuple[np.ndarray, np.ndarray]:
    """Mitsuba's mean radiance and its standard error."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")

    def rgb(values: np.ndarray) -> dict:
        return {"type": "rgb", "value": values.tolist()}

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bowl.ply"
        write_mesh(path, bowl())
        sun = {
            "type": "directional",
            "direction": (-TOWARDS_SUN).tolist(),
            "irradiance": rgb(SUN),
        }
        diffuse = {"type": "diffuse", "reflectance": rgb(ALBEDO)}
        scene = mi.load_dict({
            "type": "scene",
            "sky": {"type": "constant", "radiance": rgb(SKY)},
            "sun": sun,
            # We reflect by the faces' own normals.
            "bowl": {"type": "ply", "filename": str(path), "face_normals": True, "bsdf": diffuse},
        })  # fmt: skip
    integrator = mi.load_dict({"type": "path", "max_depth": BOUNCES + 1, "rr_depth": 99})
    sampler = mi.load_dict({"type": "independent", "sample_count": 1})
    sampler.seed(1, 1)
    means, errors = [], []
    for origin, direction in zip(origins, directions):
        ray = mi.RayDifferential3f(mi.Point3f(*origin), mi.Vector3f(*direction))
        values = [np.ravel(integrator.sample(scene, sampler, ray)[0]) for _ in range(spp)]
        means.append(np.mean(values, axis=0))
        errors.append(np.std(values, axis=0, ddof=1) / np.sqrt(spp))
    return np.array(means), np.array(errors)


def main() -> None:
    """Compare along the rays."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=40)
    parser.add_argument("--spp", type=int, default=2000)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rays = rays_into(asked.rays)
    lights = [
        EnvironmentEmitter.uniform(SKY),
        DirectionalEmitter(DirectionalSources(TOWARDS_SUN[None], SUN[None])),
    ]
    scene = Scene.of(bowl(), [Lambertian(ALBEDO / np.pi)])
    ours = path_radiance(scene, lights, *rays, PathSettings(asked.spp, BOUNCES))
    found, error = theirs(*rays, asked.spp)
    pulls = (ours.radiance - found) / np.hypot(ours.standard_error, error)
    print(f"{'albedo':>8s} {'ours':>10s} {'Mitsuba':>10s} {'scatter':>8s} {'worst':>8s}")
    for channel, albedo in enumerate(ALBEDO):
        own = pulls[:, channel]
        print(
            f"{albedo:8.1f} {ours.radiance[:, channel].mean():10.5f} "
            f"{found[:, channel].mean():10.5f} {np.sqrt(np.mean(own**2)):8.2f} "
            f"{np.abs(own).max():8.2f}"
        )
    mean = np.abs(pulls.mean(axis=0)).max() * np.sqrt(len(pulls))
    if np.sqrt(np.mean(pulls**2)) > 1.3 or mean > 4:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
