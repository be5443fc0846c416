"""An object with a measured paint under a real probe turns, 30 frames a second on the processor.

    python experiments/turning_bunny.py MESH PROBE --paint FILE.brdf [--turn camera] [--up y]
        [--size 256] [--out F.png] [--film F.gif]

The reflection map is made once: light and paint become coefficients, and these a global SHRM.  Each
frame then
    1. sums it to a plain reflection map for the viewer (T 5.35),
    2. traces one ray a pixel to a face and a place on it (Embree),
    3. looks the map up at R for every pixel, divides by the exit cosine, and encodes it as sRGB,
1 and 3 in two jitted functions in float32, 2 on all processors.  With ``--turn camera`` the viewer
goes round and the light stays with the object; with ``object`` the object turns below the fixed
light and viewer, where the map could be kept: it is summed again all the same.  The viewer is far
away, light that the object takes from itself is left out, and +Z is up.

Prints the seconds before the first frame, the milliseconds of each step and of a whole frame, in
sequence and with the next frames' rays traced meanwhile.  Demanded: 30 frames a second for the
whole; T 5.7.5 had about 30 with a graphics card to trace and look up.  Draws twelve of the frames.
"""

import argparse
import itertools
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from figure_5_1 import LEAST_COSINE, UP, mesh_from, towards
from PIL import Image
from shrm_materials import BAND_LIMIT, chosen, paint_from

from jaxrender.geometry import Mesh, Orthographic, look_at, reflect
from jaxrender.geometry.tracing import EmbreeTracer
from jaxrender.harmonics import LatLongGrid, looked_up, over_poles
from jaxrender.imaging.display import exposure_for
from jaxrender.io import read_environment
from jaxrender.reflection.shrm import GlobalShrm, exit_cosine, global_shrm, local_shrm
from jaxrender.spectra import central_spectrum_of, light_coefficients

ORDER, MAP_ROWS, LIGHT_ROWS = 5, 128, 256
DEMANDED = 30
FRAMES, SHEET = 120, (3, 4)
ELEVATION, FIRST_AZIMUTH = 12, -70
# Pixels that are shaded together; radiance of nothing, as shown, and its code.
PORTION = 4096
BACKGROUND = 0.02
_EMPTY = 39


class Pose(NamedTuple):
    """Of one frame: the viewer's direction, and the turn of the object."""

    camera: Orthographic
    outgoing: np.ndarray
    world_from_object: np.ndarray


class Surface(NamedTuple):
    """The pixels that show the object, the face behind each and the weights of its corners.

    The latter two are filled up to a multiple of ``PORTION``, so that few shapes are ever compiled.
    """

    pixels: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray


class Device(NamedTuple):
    """What stays on the device from frame to frame."""

    corner_normals: jax.Array
    exposure: jax.Array


def poses(turn: str, count: int, size: int) -> list[Pose]:
    """Stand at equal steps of the azimuth, or turn the object by as much."""
    found = []
    for angle in np.arange(count) * 360 / count:
        azimuth = FIRST_AZIMUTH + (angle if turn == "camera" else 0)
        outgoing = towards((azimuth, ELEVATION))
        pose = look_at(4 * outgoing, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        camera = Orthographic(size, size, pose, scale=2.04 / size)
        turned = 0.0 if turn == "camera" else np.radians(angle)
        cosine, sine = np.cos(turned), np.sin(turned)
        about = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
        found.append(Pose(camera, outgoing, about))
    return found


def traced(tracer: EmbreeTracer, vertices: np.ndarray, pose: Pose) -> Surface:
    """Find the face behind every pixel, the rays turned to where the object stands still.

    Only the rectangle of pixels that the object's vertices span is asked for.
    """
    places = pose.camera.project(vertices @ pose.world_from_object.T)
    size = pose.camera.width
    low = np.clip(np.floor(places.min(axis=0)), 0, size - 1).astype(int)
    high = np.clip(np.ceil(places.max(axis=0)), low + 1, size).astype(int)
    columns, rows = (np.arange(*ends) for ends in zip(low, high))
    pose_of_rays = pose.world_from_object.T @ pose.camera.world_from_camera[:3]
    right, up, backwards, position = pose_of_rays.T
    across = pose.camera.scale * (columns + 0.5 - pose.camera.cx)
    upwards = pose.camera.scale * (pose.camera.cy - rows - 0.5)
    origins = position + across[None, :, None] * right + upwards[:, None, None] * up
    origins = origins.reshape(-1, 3)
    found = tracer.first_faces(origins, np.broadcast_to(-backwards, origins.shape))
    hit = np.flatnonzero(found.face >= 0)
    pixels = ((rows * size)[:, None] + columns[None, :]).reshape(-1)[hit]
    count = -(-len(hit) // PORTION) * PORTION
    face, barycentric = np.zeros(count, np.int32), np.zeros((count, 3), np.float32)
    face[: len(hit)], barycentric[: len(hit)] = found.face[hit], found.barycentric[hit]
    return Surface(pixels, face, barycentric)


@jax.jit
def shaded(
    plain: jax.Array,
    device: Device,
    places: tuple[jax.Array, jax.Array],
    view: tuple[jax.Array, jax.Array],
) -> jax.Array:
    """Look the map up at the R of every place, a face and weights of its corners; sRGB."""
    outgoing, world_from_object = view
    face, barycentric = places
    corners = device.corner_normals[face]
    normals = jnp.einsum("xk,xki->xi", barycentric, corners) @ world_from_object.T
    normals = normals / jnp.maximum(jnp.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    away = jnp.broadcast_to(outgoing, normals.shape)
    centres = reflect(away, normals)
    cosines = jnp.maximum(exit_cosine(centres, away), LEAST_COSINE)[:, None]
    radiance = looked_up(over_poles(plain), centres) / cosines
    # What sees the back of a face, at a hole, shows nothing.
    front = jnp.sum(normals * away, axis=1) > 0
    return encoded(jnp.where(front[:, None], radiance * device.exposure, BACKGROUND))


def encoded(linear: jax.Array) -> jax.Array:
    """Encode as sRGB."""
    clipped = jnp.clip(linear, 0, 1)
    curve = 1.055 * jnp.power(jnp.maximum(clipped, 0.0031308), 1 / 2.4) - 0.055
    return jnp.round(255 * jnp.where(clipped <= 0.0031308, 12.92 * clipped, curve)).astype("uint8")


class Renderer(NamedTuple):
    """The mesh, prepared for rays, and the light and paint, prepared for viewers."""

    vertices: np.ndarray
    tracer: EmbreeTracer
    shrm: GlobalShrm
    device: Device

    def trace(self, pose: Pose) -> Surface:
        """Step 2 of a frame, which knows nothing of light."""
        return traced(self.tracer, self.vertices, pose)

    def plain_map(self, pose: Pose) -> jax.Array:
        """Step 1."""
        return self.shrm.dynamic_map(pose.outgoing.astype(np.float32))

    def shade(self, plain: jax.Array, pose: Pose, surface: Surface) -> np.ndarray:
        """Step 3: the picture."""
        view = pose.outgoing.astype(np.float32), pose.world_from_object.astype(np.float32)
        codes = shaded(plain, self.device, surface[1:], view)
        size = pose.camera.width
        picture = np.full((size * size, 3), _EMPTY, np.uint8)
        picture[surface.pixels] = np.asarray(codes)[: len(surface.pixels)]
        return picture.reshape(size, size, 3)

    def frames(self, views: list[Pose], ahead: int) -> Iterator[np.ndarray]:
        """Draw frame after frame, the rays of the next ones being traced meanwhile."""
        if not ahead:
            for pose in views:
                yield self.shade(self.plain_map(pose), pose, self.trace(pose))
            return
        with ThreadPoolExecutor(ahead) as pool:
            coming = [pool.submit(self.trace, pose) for pose in views[:ahead]]
            for pose, following in itertools.zip_longest(views, views[ahead:]):
                if following is not None:
                    coming.append(pool.submit(self.trace, following))
                yield self.shade(self.plain_map(pose), pose, coming.pop(0).result())


def prepared(mesh: Mesh, arguments: argparse.Namespace) -> Renderer:
    """Make the reflection map and say what each part of it takes."""
    start = time.perf_counter()
    brdf = paint_from(arguments.paint)
    print(f"{'paint: a table from its measurements':44s}{time.perf_counter() - start:8.2f} s")
    start = time.perf_counter()
    whole = central_spectrum_of(brdf, (BAND_LIMIT, ORDER), weighted=True)
    spectrum = chosen("paint", jax.block_until_ready(whole))
    print(f"{'its coefficients about R':44s}{time.perf_counter() - start:8.2f} s")
    light = read_environment(arguments.probe, arguments.convention, height=LIGHT_ROWS)
    for kind in ("with compilation", "again"):
        start = time.perf_counter()
        coefficients = light_coefficients(light, spectrum.band_limits[0])
        grid = LatLongGrid(MAP_ROWS, MAP_ROWS)
        shrm = global_shrm(local_shrm(coefficients, spectrum, grid))
        jax.block_until_ready(shrm.maps)
        print(f"{f'light and paint to maps, {kind}':44s}{time.perf_counter() - start:8.2f} s")
    maps = shrm.maps.shape
    print(f"maps {' x '.join(str(n) for n in maps)}, {shrm.maps.nbytes / 2**20:.1f} MiB")
    corner_normals = jnp.asarray(mesh.normals[mesh.faces], jnp.float32)
    tracer = EmbreeTracer(mesh.vertices, mesh.faces)
    return Renderer(mesh.vertices, tracer, shrm, Device(corner_normals, jnp.float32(1)))


def with_exposure(renderer: Renderer, first: Pose) -> Renderer:
    """Expose for the first frame, and keep to it."""
    surface = renderer.trace(first)
    face = surface.face[: len(surface.pixels)]
    normals = np.asarray(renderer.device.corner_normals)[face].mean(axis=1) @ (
        first.world_from_object.T
    )
    normals = jnp.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True), jnp.float32)
    away = jnp.broadcast_to(jnp.asarray(first.outgoing, jnp.float32), normals.shape)
    radiance = np.asarray(renderer.shrm.at(reflect(away, normals), away))
    device = renderer.device._replace(exposure=jnp.float32(exposure_for(radiance)))
    return renderer._replace(device=device)


def report_steps(renderer: Renderer, views: list[Pose]):
    """Time each step alone, the median over the frames."""
    times = []
    for pose in views[: FRAMES // 2]:
        marks = [time.perf_counter()]
        surface = renderer.trace(pose)
        marks.append(time.perf_counter())
        plain = jax.block_until_ready(renderer.plain_map(pose))
        marks.append(time.perf_counter())
        renderer.shade(plain, pose, surface)
        marks.append(time.perf_counter())
        times.append(np.diff(marks))
    trace, plain, shade = 1e3 * np.median(times, axis=0)
    print(f"{'rays to faces':44s}{trace:8.1f} ms")
    print(f"{'the map for this viewer (T 5.35)':44s}{plain:8.1f} ms")
    print(f"{'looking it up, exit cosine, sRGB':44s}{shade:8.1f} ms")
    rate("light and paint alone (map and looking up)", (plain + shade) / 1e3)


def rate(what: str, seconds: float):
    verdict = "met" if 1 / seconds >= DEMANDED else "NOT met"
    print(
        f"{what:44s}{1e3 * seconds:8.1f} ms, {1 / seconds:5.0f} frames a second; "
        f"demanded {DEMANDED}: {verdict}"
    )


def sheet(film: list[np.ndarray]) -> Image.Image:
    """Lay frames out in reading order."""
    rows, columns = SHEET
    chosen_frames = film[:: len(film) // (rows * columns)][: rows * columns]
    pictures = np.stack(chosen_frames).reshape(rows, columns, *film[0].shape)
    return Image.fromarray(np.concatenate(np.concatenate(pictures, axis=1), axis=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path)
    parser.add_argument("probe", type=Path)
    parser.add_argument("--paint", type=Path, required=True)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--turn", choices=("camera", "object"), default="camera")
    parser.add_argument("--up", choices=tuple(UP), default="y", help="what is up in the mesh")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--out", type=Path, default=Path("experiments/out/turning_bunny.png"))
    parser.add_argument("--film", type=Path, help="an animated GIF or PNG")
    arguments = parser.parse_args()
    mesh = mesh_from(arguments.mesh, arguments.up)
    renderer = prepared(mesh, arguments)
    views = poses(arguments.turn, FRAMES, arguments.size)
    renderer = with_exposure(renderer, views[0])
    # Every shape is compiled once before anything is timed.
    list(renderer.frames(views, 0))
    report_steps(renderer, views)
    for ahead, name in ((0, "a whole frame"), (1, "traced one frame ahead"), (2, "two ahead")):
        start = time.perf_counter()
        film = list(renderer.frames(views, ahead))
        rate(name, (time.perf_counter() - start) / FRAMES)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    sheet(film).save(arguments.out)
    print(f"picture: {arguments.out}")
    if arguments.film:
        pictures = [Image.fromarray(frame) for frame in film]
        milliseconds = 1000 // DEMANDED
        pictures[0].save(
            arguments.film, save_all=True, append_images=pictures[1:], duration=milliseconds, loop=0
        )
        print(f"film: {arguments.film}")


if __name__ == "__main__":
    main()
