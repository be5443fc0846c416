"""T figure 4.1: diffuse objects shaded by nine coefficients of the light, in real time.

    python experiments/figure_4_1.py [--probe FILE.hdr] [--convention cross] [--mesh FILE --up y]
        [--azimuth 0] [--out F.png]

From left to right, on a table: a mirror sphere; the object, the project's sculpture where the
thesis has the Stanford armadillo; a sphere; a pool-ball.  Object, middle sphere and table are white
and diffuse, shaded at every pixel by the polynomial of T 4.16.  The pool-ball multiplies the same
irradiance by a texture of albedo and adds a reflection map of Phong's lobe, dimmed as its coat
reflects.  Nothing casts a shadow, as in the thesis.  The thesis's light is Grace Cathedral; without
a probe a random interior.  Tones: a curve for background and mirror, a linear scale for the rest.

Prints the time to shade a frame and, for some of its normals, how far nine coefficients are from
the sum over all texels: parts of the light's total intensity, published to be 1 % on average.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from figure_5_1 import mesh_from, seconds_of
from scenes import probe

from jaxrender.geometry import Mesh, Pinhole, Sphere, SurfaceSamples, look_at, observe
from jaxrender.harmonics import LatLongGrid, analyse, looked_up, over_poles
from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.io import read_environment
from jaxrender.lighting import Environment
from jaxrender.pipelines.report.display import tone_key, tone_mapped
from jaxrender.reflection import irradiance_matrix, quadratic_irradiance, reflection_maps
from jaxrender.spectra import phong_transfer

LIGHT_ROWS = 256
WIDTH, HEIGHT, SPAN = 960, 400, 52
# Azimuth 0 looks along +y; distance and height of the viewer, in radii of the spheres.
DISTANCE, EYE = 10.0, 2.4
PLACES = {"mirror": -3.3, "object": -1.1, "sphere": 1.1, "pool-ball": 3.3}
TABLE = np.array([5.6, 2.2, 0.12])
EXPONENT, COAT = 300.0, 0.06
COAT_BAND_LIMIT, COMPARED = 60, 200
PUBLISHED_MEAN = 0.01


class Scene(NamedTuple):
    """What the pixels show: for each, which thing (-1: the light), and its geometry."""

    thing: np.ndarray
    directions: np.ndarray
    samples: SurfaceSamples


def things(mesh: Mesh, turn: np.ndarray) -> dict[str, Sphere | Mesh]:
    """Spheres of radius 1 and the object side by side, across the line of sight."""
    across = {name: turn @ [x, 0, 0] for name, x in PLACES.items()}
    slab = Mesh.ellipsoid(TABLE, 5)
    bottom = mesh.bounds()[0, 2]
    stand = across["object"] + [0, 0, -1 - bottom]
    return {
        "mirror": Sphere(across["mirror"], 1.0),
        "object": Mesh(mesh.vertices + stand, mesh.faces, mesh.normals),
        "sphere": Sphere(across["sphere"], 1.0),
        "pool-ball": Sphere(across["pool-ball"], 1.0),
        "table": Mesh(slab.vertices @ turn.T - [0, 0, 1 + TABLE[2]], slab.faces),
    }


def seen(shapes: dict, turn: np.ndarray) -> Scene:
    """Trace every shape and keep the nearest."""
    eye = turn @ [0, -DISTANCE, EYE]
    pose = look_at(eye, np.zeros(3), np.array([0.0, 0, 1]))
    length = WIDTH / 2 / np.tan(np.radians(SPAN / 2))
    camera = Pinhole(WIDTH, HEIGHT, pose, fl_x=length, cy=HEIGHT * 0.42)
    nearest = np.full((HEIGHT, WIDTH), np.inf)
    thing, normals = np.full(nearest.shape, -1), np.zeros((*nearest.shape, 3))
    for number, shape in enumerate(shapes.values()):
        view = observe(camera, shape)
        distance = np.linalg.norm(view.points - eye, axis=-1)
        front = view.hit & (distance < nearest)
        nearest[front], thing[front] = distance[front], number
        normals[front] = view.normals[front]
    directions, hit = camera.rays().directions, thing >= 0
    samples = SurfaceSamples(
        *(jnp.asarray(a, jnp.float32) for a in (normals[hit], -directions[hit]))
    )
    return Scene(thing, directions, samples)


def pool_texture(turn: np.ndarray) -> np.ndarray:
    """Albedo by direction: a striped ball, with a disc on the side of the viewer."""
    directions = LatLongGrid(256, 512).directions()
    ball = np.where(np.abs(directions[..., 2:]) < 0.55, [0.75, 0.42, 0.03], [0.85, 0.83, 0.78])
    disc = directions @ (turn @ [0, -0.96, 0.28])
    ball[disc > np.cos(0.42)] = [0.85, 0.83, 0.78]
    ball[(disc < np.cos(0.13)) & (disc > np.cos(0.22))] = 0.03
    return ball


@eqx.filter_jit
def shaded(matrix: jax.Array, normals: jax.Array) -> jax.Array:
    """White diffuse surfaces: E(N) / pi."""
    return jnp.maximum(quadratic_irradiance(matrix, normals), 0) / np.pi


def radiance_of(scene: Scene, light: Environment, texture: np.ndarray, names: list[str]) -> tuple:
    """What leaves every object pixel, by the methods that the caption names."""
    matrix = irradiance_matrix(analyse(light.grid, light.radiance, 2))
    matrix = jnp.asarray(matrix, jnp.float32)
    found = np.array(shaded(matrix, scene.samples.normals), float)
    own = scene.thing[scene.thing >= 0]
    reflected = np.asarray(scene.samples.reflected)
    mirror, ball = (own == names.index(name) for name in ("mirror", "pool-ball"))
    plain = over_poles(jnp.asarray(light.radiance, jnp.float32))
    found[mirror] = looked_up(plain, reflected[mirror])
    transfer = phong_transfer(EXPONENT, COAT_BAND_LIMIT)
    glossy = reflection_maps(light.radiance, transfer[None], light.grid)[0]
    albedo = looked_up(over_poles(jnp.asarray(texture)), np.asarray(scene.samples.normals)[ball])
    specular = np.maximum(looked_up(over_poles(glossy), reflected[ball]), 0)
    found[ball] = np.asarray(albedo) * found[ball] + COAT * np.asarray(specular)
    return matrix, found, mirror


def picture(scene: Scene, found: np.ndarray, mirror: np.ndarray, light: Environment) -> np.ndarray:
    """Background and mirror through a tone curve, all else on a linear scale."""
    plain = over_poles(jnp.asarray(light.radiance, jnp.float32))
    hit = scene.thing >= 0
    linear = np.array(looked_up(plain, jnp.asarray(scene.directions, jnp.float32)), float)
    key = tone_key(linear)
    linear[hit] = found
    curved = np.array(tone_mapped(linear, key))
    curved_alone = hit.copy()
    curved_alone[hit] = ~mirror
    curved[curved_alone] = exposed(linear, exposure_for(linear[curved_alone]))[curved_alone]
    return curved


def report(scene: Scene, light: Environment, matrix: jax.Array) -> None:
    """Print what a frame takes, and how far nine coefficients are from the whole light."""
    normals = scene.samples.normals
    spent = seconds_of(lambda: shaded(matrix, normals), 9)
    print(f"{len(normals)} pixels of objects shaded in {1e3 * spent:.2f} ms: {1 / spent:.0f} Hz")
    some = np.asarray(normals, float)[np.linspace(0, len(normals) - 1, COMPARED).astype(int)]
    nodes = light.nodes()
    directions, energy = np.asarray(nodes.directions), np.asarray(nodes.irradiance)
    exact = np.maximum(some @ directions.T, 0) @ energy
    by_nine = np.pi * np.asarray(shaded(matrix, jnp.asarray(some, jnp.float32)), float)
    off = np.abs(by_nine - exact) / energy.sum(axis=0)
    verdict = "met" if off.mean() < PUBLISHED_MEAN else "NOT met"
    print(f"error, of the light's total: mean {100 * off.mean():.2f} %, largest", end=" ")
    print(f"{100 * off.max():.2f} % (published: 1 % on average: {verdict})")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probe", type=Path)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--up", choices=("z", "y"), default="z", help="what is up in the mesh")
    parser.add_argument("--azimuth", type=float, default=0.0, help="degrees that the viewer turns")
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_4_1.png"))
    arguments = parser.parse_args()
    if arguments.probe:
        light = read_environment(arguments.probe, arguments.convention, height=LIGHT_ROWS)
    else:
        light = probe("interior", 1, LIGHT_ROWS)
    cosine, sine = np.cos(np.radians(arguments.azimuth)), np.sin(np.radians(arguments.azimuth))
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    shapes = things(mesh_from(arguments.mesh, arguments.up), turn)
    scene = seen(shapes, turn)
    matrix, found, mirror = radiance_of(scene, light, pool_texture(turn), list(shapes))
    report(scene, light, matrix)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    plt.imsave(arguments.out, picture(scene, found, mirror, light))
    print(f"picture: {arguments.out}")


if __name__ == "__main__":
    main()
