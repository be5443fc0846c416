"""What the figures of L chapter 7 share: textured shapes under one source, filtered or not.

Images are linear radiance for a source of irradiance pi; ``render`` takes the mean of several rays
a pixel.  A shader turns what a pixel sees (``Seen``) into the BRDF there.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf.textures.mip import level_of
from jaxrender.brdf.textures.pyramid import BRDFPyramid
from jaxrender.geometry import Mesh, Pinhole, look_at, observe
from jaxrender.geometry.footprints import pixel_steps, size_in_texels, texture_steps
from jaxrender.geometry.hits import Shape
from jaxrender.geometry.texels import view_coordinates
from jaxrender.shapes import AnyArray

OUT = Path(__file__).parent / "out"
UP = np.array([0.0, 0.0, 1.0])


class Seen(NamedTuple):
    """Texture coordinates, footprint in finest texels, and local directions of the pixels hit."""

    places: np.ndarray
    size: np.ndarray
    incoming: np.ndarray
    outgoing: np.ndarray


Shader = Callable[[Seen], AnyArray]


def plane(repeats: float) -> Mesh:
    """The square [-1, 1]^2 of the plane z = 0, a texture repeated so often along each side."""
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(corners, faces, None, ((corners[:, :2] + 1) / 2 * repeats)[faces])


def vase(repeats: tuple[float, float], steps: tuple[int, int] = (240, 160)) -> Mesh:
    """A vase about the axis z, the texture repeated around and along it."""
    turn, along = (np.arange(n + 1) / n for n in steps)
    z = 2 * along - 1
    radius = 0.52 + 0.26 * np.sin(3.2 * z - 1.2) + 0.08 * np.sin(7 * z)
    slope = 0.26 * 3.2 * np.cos(3.2 * z - 1.2) + 0.08 * 7 * np.cos(7 * z)
    angle, (i, j) = 2 * np.pi * turn, np.meshgrid(*(np.arange(n + 1) for n in steps), indexing="ij")
    cosine, sine = np.cos(angle)[i], np.sin(angle)[i]
    points = np.stack([radius[j] * cosine, radius[j] * sine, z[j]], axis=-1)
    normals = np.stack([cosine, sine, -slope[j]], axis=-1)
    texture = np.stack([repeats[0] * turn[i], repeats[1] * along[j]], axis=-1)
    corner = (np.arange(steps[0])[:, None] * (steps[1] + 1) + np.arange(steps[1])).ravel()
    right, above = corner + steps[1] + 1, corner + 1
    faces = np.concatenate(
        [np.stack([corner, right, right + 1], -1), np.stack([corner, right + 1, above], -1)]
    )
    flat = texture.reshape(-1, 2)
    return Mesh(points.reshape(-1, 3), faces, normals.reshape(-1, 3), flat[faces])


def camera(position: tuple[float, float, float], size: tuple[int, int], focal: float) -> Pinhole:
    """A camera of (rows, columns) that looks at the origin; focal length in image widths."""
    pose = look_at(np.array(position), np.zeros(3), UP)
    return Pinhole(size[1], size[0], pose, fl_x=focal * size[1])


def render(
    eye: Pinhole, shape: Shape, source: np.ndarray, texels: tuple[int, int], shader: Shader,
    per_side: int = 1,
) -> np.ndarray:  # fmt: skip
    """Shade a shape, with ``per_side`` squared rays a pixel."""
    finer = Pinhole(
        eye.width * per_side, eye.height * per_side, eye.world_from_camera,
        fl_x=eye.fl_x * per_side,
    )  # fmt: skip
    view = observe(finer, shape)
    on, normals = view.hit, view.normals[view.hit]
    tangents = np.cross(UP, normals)
    flat = np.linalg.norm(tangents, axis=1) < 1e-9
    tangents[flat] = [1, 0, 0]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    frames = np.stack([tangents, np.cross(normals, tangents), normals], axis=1)
    source = source / np.linalg.norm(source)
    steps = texture_steps(shape, view, pixel_steps(finer, view))[on]
    incoming = frames @ source
    outgoing = np.einsum("sij,sj->si", frames, view.outgoing[on])
    seen = Seen(view_coordinates(shape, view), size_in_texels(steps, texels), incoming, outgoing)
    rho = np.asarray(shader(seen))
    image = np.zeros((*on.shape, rho.shape[1]))
    image[on] = np.pi * rho * np.maximum(incoming[:, 2:], 0)
    blocks = image.reshape(eye.height, per_side, eye.width, per_side, -1)
    return blocks.mean(axis=(1, 3))


def unfiltered(pyramid: BRDFPyramid) -> Shader:
    """The one texel behind the pixel's centre."""
    return lambda s: pyramid.evaluate(
        s.places, np.zeros(len(s.places)), s.incoming, s.outgoing, "nearest"
    )


def filtered(pyramid: BRDFPyramid, chosen: str = "trilinear") -> Shader:
    """The pyramid, at the footprint's level."""
    return lambda s: pyramid.evaluate(
        s.places, np.asarray(level_of(s.size)), s.incoming, s.outgoing, chosen
    )


def compare(
    pictures: dict[str, Callable[[], np.ndarray]], reference: np.ndarray
) -> dict[str, np.ndarray]:
    """Make pictures, warm, and print their rms errors, relative to the reference, and seconds."""
    found = {}
    print(f"{'picture':36s} {'rms error':>10s} {'bias':>9s} {'seconds':>8s}")
    for name, make in pictures.items():
        make()
        start = time.perf_counter()
        found[name] = make()
        seconds = time.perf_counter() - start
        scale = np.sqrt(np.mean(reference**2))
        error = np.sqrt(np.mean((found[name] - reference) ** 2)) / scale
        bias = np.mean(found[name] - reference) / np.mean(reference)
        print(f"{name:36s} {error:10.4f} {bias:9.4f} {seconds:8.2f}")
    return found | {"reference": reference}


def draw(pictures: dict[str, np.ndarray], path: Path, exposure: float = 1.0, rows: int = 1) -> None:
    """Write pictures beside each other."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    columns = -(-len(pictures) // rows)
    height, width = next(iter(pictures.values())).shape[:2]
    size = (4.5 * columns, rows * (4.5 * height / width + 0.35))
    figure, axes = plt.subplots(rows, columns, figsize=size, squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for axis, (name, image) in zip(axes.flat, pictures.items(), strict=False):
        shown = np.clip(exposure * image, 0, 1) ** (1 / 2.2)
        axis.imshow(np.broadcast_to(shown, (*image.shape[:2], 3)), interpolation="nearest")
        axis.set_title(name, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
