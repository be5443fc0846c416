"""T figure 5.1: an object in several materials under light probes, from reflection maps alone.

    python experiments/figure_5_1.py [PROBE.hdr ...] [--convention cross] [--paint FILE.brdf]
        [--mesh FILE --up y] [--window minimal] [--out F.png]

The simplified microfacet of T 5.34, a measured paint where its file is given (Cornell's text
format), a velvet (Lafortune lobes without a vertical part, bright at grazing), and Kajiya and Kay's
fibres, which run uphill everywhere and whose map is about the tangent, q = 0 alone.  Without
arguments a procedural sculpture under a random interior.  +Z is up, the viewer far away; light
that the object takes from itself is left out, as in the thesis.

Prints the orders (F, P), what they miss, the milliseconds that all maps take, those of a frame (the
map for a new viewer and looking it up at every pixel, in float32 on the processor) and the
relative rms against the integral over the probe at some of the pixels.  The thesis: about 30 frames
a second for each picture.

Cut at so few degrees lobes ring, and bright sources are ringed by black specks.  The window that
bends least (``--window none``: as in the thesis) takes most of them off: under Grace Cathedral
pixels of the microfacet below zero fall from 1.0 to .08 %, for 6.9 instead of 5.4 % of rms; Lanczos
leaves none, for 11.4 %.  The lowest values of lobes and pictures are printed.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scenes import probe
from shrm_materials import Material, all_materials, fibre_lobes

from jaxrender.geometry import (
    Mesh,
    Orthographic,
    SurfaceSamples,
    SurfaceView,
    look_at,
    observe,
    sculpture,
)
from jaxrender.harmonics import WINDOWS, LatLongGrid, looked_up, over_poles
from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.io import read_environment, read_mesh
from jaxrender.lighting import Environment, LightNodes
from jaxrender.pipelines.report.display import tone_key, tone_mapped
from jaxrender.reflection import integral_columns, radiance
from jaxrender.reflection.shrm import GlobalShrm, LocalShrm, exit_cosine, global_shrm, local_shrm
from jaxrender.spectra import CentralSpectrum, light_coefficients

# Closer to grazing a weighted map is divided by this cosine: what it misses there would glare.
LEAST_COSINE = 0.15
MAP = LatLongGrid(128, 128)
LIGHT_ROWS, SIZE, COMPARED = 128, 256, 400
# Towards the viewer: azimuth and elevation in degrees, and the angle that the background spans.
VIEW, SPAN = (-70, 12), 70
PUBLISHED_RATE = 30
UP = {"z": np.eye(3), "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])}


class Frames(NamedTuple):
    """What is known behind the pixels that show the object."""

    view: SurfaceView
    centres: jax.Array
    samples: SurfaceSamples


def mesh_from(path: Path | None, up: str) -> Mesh:
    """Read a mesh, turned upright, in a ball of radius 1 about the origin; or a sculpture."""
    mesh = read_mesh(path) if path else sculpture()
    vertices, normals = mesh.vertices @ UP[up].T, mesh.normals @ UP[up].T
    centre = (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    radius = np.linalg.norm(vertices - centre, axis=1).max()
    # Folded triangles of a scan are turned to face as their corners do, or they would be holes.
    faces = mesh.faces.copy()
    corners = mesh.normals[faces].sum(axis=1)
    folded = np.einsum("fi,fi->f", mesh.face_normals(), corners) < 0
    faces[folded] = faces[folded][:, ::-1]
    return Mesh((vertices - centre) / radius, faces, normals)


def light_from(path: Path | None, convention: str) -> Environment:
    return (
        read_environment(path, convention, height=LIGHT_ROWS)
        if path
        else probe("interior", 1, LIGHT_ROWS)
    )


def towards(view: tuple[float, float]) -> np.ndarray:
    azimuth, elevation = np.radians(view)
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def seen(mesh, view: tuple[float, float], about_tangent: bool = False, size: int = SIZE) -> Frames:
    """Normals behind the pixels of a distant viewer, and R or the tangent, which runs uphill."""
    pose = look_at(4 * towards(view), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    seen = observe(Orthographic(size, size, pose, scale=2.04 / size), mesh)
    samples = SurfaceSamples(
        *(jnp.asarray(a[seen.hit], jnp.float32) for a in (seen.normals, seen.outgoing))
    )
    normals = seen.normals[seen.hit]
    uphill = np.array([0.0, 0.0, 1.0]) - normals[:, 2:] * normals
    tangents = uphill / np.maximum(np.linalg.norm(uphill, axis=1, keepdims=True), 1e-9)
    centres = jnp.asarray(tangents, jnp.float32) if about_tangent else samples.reflected
    return Frames(seen, centres, samples)


@eqx.filter_jit
def looked(plain: jax.Array, frames: Frames, divided: bool) -> jax.Array:
    """Look a plain reflection map up at the central directions."""
    found = looked_up(over_poles(plain), frames.centres)
    if divided:
        cosines = exit_cosine(frames.centres, frames.samples.outgoing)
        found = found / jnp.maximum(cosines, LEAST_COSINE)[:, None]
    return jnp.maximum(found, 0)


@eqx.filter_jit
def integrated(material: Material, frames: Frames, nodes: LightNodes) -> jax.Array:
    """The slow truth: every pixel a sum over all texels of the light, no harmonics."""
    if material.brdf is None:
        return _fibres_integrated(frames, nodes)
    exact = radiance(material.brdf, integral_columns(material.brdf, frames.samples, nodes))
    return exact if material.divided else exact * frames.samples.exit_cosines[:, None]


def _fibres_integrated(frames: Frames, nodes: LightNodes) -> jax.Array:
    def one(pixel: tuple) -> jax.Array:
        tangent, outgoing = pixel
        lobes = fibre_lobes(nodes.directions @ tangent, jnp.dot(outgoing, tangent))
        return jnp.sum(lobes * nodes.irradiance, axis=0)

    return jax.lax.map(one, (frames.centres, frames.samples.outgoing))


def some_of(frames: Frames, count: int) -> tuple[np.ndarray, Frames]:
    """Every so many pixels."""
    every = np.linspace(0, len(frames.centres) - 1, count).astype(int)
    samples = SurfaceSamples(*(a[every] for a in frames.samples))
    return every, Frames(frames.view, frames.centres[every], samples)


def mapped(light: Environment, spectrum: CentralSpectrum) -> tuple[LocalShrm, GlobalShrm]:
    coefficients = light_coefficients(light, spectrum.band_limits[0])
    local = local_shrm(coefficients, spectrum, MAP)
    return local, global_shrm(local)


def relative_rms(image: jax.Array, exact: jax.Array) -> float:
    image, exact = np.asarray(image, float), np.asarray(exact, float)
    return float(np.sqrt(np.sum((image - exact) ** 2) / np.sum(exact**2)))


def seconds_of(work: Callable, repeats: int) -> float:
    """The median time of a call, after one that compiles."""
    jax.block_until_ready(work())
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(work())
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def background(light: Environment, view: tuple[float, float], size: int = SIZE) -> np.ndarray:
    """The light behind the object through a wide lens, in a tone curve of its own."""
    x, y = np.meshgrid(*(2 * ((np.arange(size) + 0.5) / size) - 1,) * 2)
    half = np.tan(np.radians(SPAN / 2))
    local = np.stack([x * half, -y * half, -np.ones_like(x)], axis=-1)
    pose = look_at(towards(view), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    directions = jnp.asarray(local @ pose[:3, :3].T, jnp.float32)
    values = np.asarray(looked_up(over_poles(light.radiance), directions))
    return tone_mapped(values, tone_key(values))


def picture(image: jax.Array, frames: Frames, behind: np.ndarray) -> np.ndarray:
    """The object in linear radiance, its 95th percentile just below white, before the light."""
    values = np.asarray(image, float)
    found = behind.copy()
    found[frames.view.hit] = exposed(values[None], exposure_for(values))[0]
    return found


class Drawn(NamedTuple):
    """One picture: seconds for maps and for a frame, and what is wrong with it.

    ``below`` is the part of the pixels below zero in any channel, ``lowest`` the lowest value
    relative to the highest.
    """

    frames: Frames
    image: jax.Array
    prefilter: float
    frame: float
    error: float
    below: float
    lowest: float


def render(material: Material, light: Environment, mesh, nodes: LightNodes) -> Drawn:
    """Draw one picture, time it, and hold it against the integral."""
    frames = seen(mesh, VIEW, material.about_tangent)
    outgoing = jnp.asarray(towards(VIEW), jnp.float32)
    shrm = mapped(light, material.spectrum)[1]
    prefilter = seconds_of(lambda: mapped(light, material.spectrum)[1].maps, 2)

    def frame() -> jax.Array:
        return looked(shrm.dynamic_map(outgoing), frames, material.divided)

    image, spent = frame(), seconds_of(frame, 9)
    every, compared = some_of(frames, COMPARED)
    error = relative_rms(image[every], integrated(material, compared, nodes))
    raw = np.asarray(looked_up(over_poles(shrm.dynamic_map(outgoing)), frames.centres))
    below, lowest = float(np.mean(raw.min(axis=1) < 0)), float(raw.min() / raw.max())
    return Drawn(frames, image, prefilter, spent, error, below, lowest)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("probes", nargs="*", type=Path, default=[None], metavar="PROBE")
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--paint", type=Path)
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--up", choices=tuple(UP), default="z", help="what is up in the mesh")
    parser.add_argument("--window", choices=("none", *WINDOWS), default="minimal")
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_5_1.png"))
    arguments = parser.parse_args()
    mesh = mesh_from(arguments.mesh, arguments.up)
    materials = all_materials(arguments.paint, arguments.window)
    shape = len(arguments.probes), len(materials)
    size = 3 * shape[1], 3.1 * shape[0] + 0.2
    figure, axes = plt.subplots(*shape, squeeze=False, figsize=size, layout="constrained")
    print(f"\n{'light':16s}{'material':11s}{'map, ms':>9s}{'frame, ms':>11s}", end="")
    print(f"{'frames/s':>10s}{'published':>11s}{'rms, %':>8s}{'lowest, %':>11s}{'below 0, %':>12s}")
    for row, path in zip(axes, arguments.probes):
        light = light_from(path, arguments.convention)
        nodes = LightNodes(*(jnp.asarray(a, jnp.float32) for a in light.nodes()))
        behind, title = background(light, VIEW), path.stem if path else "random interior"
        for place, (name, material) in zip(row, materials.items()):
            drawn = render(material, light, mesh, nodes)
            print(f"{title:16s}{name:11s}{1e3 * drawn.prefilter:9.0f}", end="")
            print(f"{1e3 * drawn.frame:11.1f}{1 / drawn.frame:10.0f}{PUBLISHED_RATE:11d}", end="")
            print(f"{100 * drawn.error:8.1f}{100 * drawn.lowest:11.2f}", end="")
            print(f"{100 * drawn.below:12.2f}", flush=True)
            place.imshow(picture(drawn.image, drawn.frames, behind))
            place.set_title(f"{name}, (F, P) = {material.spectrum.band_limits}", fontsize=9)
            place.set_axis_off()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.out, dpi=100)
    print(f"picture: {arguments.out}")


if __name__ == "__main__":
    main()
