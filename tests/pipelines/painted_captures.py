"""Captures of painted balls that the tests of textures share: T 6.13 in plain NumPy.

B = kd(x) D + ks(x) S with D and S of ``small_captures``: sums over sources, nothing of the
program's forward model.  Paint is a checkerboard of latitude and longitude whose cells hold whole
texels.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np
import small_captures
from small_captures import SIGMA, Ball, cameras, focal_length, write_json

from jaxrender.geometry import Shape, observe
from jaxrender.io import write_image

SOURCES = (
    ((0.5, 0.6, 0.62), (2.0, 1.8, 1.5)),
    ((0.3, -0.7, 0.2), (1.2, 1.4, 1.8)),
    ((0.9, 0.0, 0.9), (0.8, 0.8, 0.8)),
)
_SOURCES = ", ".join(f"{{direction: {list(d)}, irradiance: {list(e)}}}" for d, e in SOURCES)
LIGHTING = f"lighting: {{directional: [{_SOURCES}]}}\n"
NOISE, CELLS = 0.01, 4
KD = np.array([[0.2, 0.1, 0.05], [0.08, 0.15, 0.25]])
KS = np.array([0.06, 0.12])


class Paint(NamedTuple):
    """Two paints, and where each is; sigma grows by this power from the bottom to the top.

    A paint has one K_s, or one of each channel.  Normals lean up by ``tilt`` where the second paint
    is, and down where the first is.
    """

    kd: np.ndarray = KD
    ks: np.ndarray = KS
    growth: float = 0.0
    tilt: float = 0.0

    def of(self, points):
        """Kd and ks by direction from the origin."""
        which = self.which(points)
        return self.kd[which], self.ks[which]

    def normals_of(self, points, normals):
        """Tilt the normals of a ball."""
        up = np.array([0.0, 0.0, 1.0]) - normals[:, 2:] * normals
        leaning = normals + self.tilt * (2 * self.which(points)[:, None] - 1) * up
        return leaning / np.linalg.norm(leaning, axis=1, keepdims=True)

    def which(self, points):
        """Number the paint by direction from the origin."""
        x, y, z = (points / np.linalg.norm(points, axis=1, keepdims=True)).T
        row = np.floor(np.arccos(np.clip(z, -1, 1)) / np.pi * CELLS)
        column = np.floor((np.arctan2(y, x) / (2 * np.pi)) % 1 * 2 * CELLS)
        return ((row + column) % 2).astype(int)

    def sigma_of(self, points):
        """Sigma by height, that of ``small_captures`` in the middle."""
        height = points[:, 2] / np.linalg.norm(points, axis=1)
        return SIGMA * np.exp(self.growth * height)


CHECKER, DIFFUSE = Paint(), Paint(ks=np.zeros(2))


def write_painted(
    folder: Path,
    paint: Paint = CHECKER,
    views: int = 9,
    shape: Shape | None = None,
    sources: Sequence = SOURCES,
):
    """Write pictures of the ball (or of another shape) and transforms.json."""
    ball = Ball(views=views, size=40)
    shape = ball.shape if shape is None else shape
    (folder / "images").mkdir(parents=True)
    rng = np.random.default_rng(0)
    frames = []
    for number, camera in enumerate(cameras(ball)):
        view = observe(camera, shape)
        kd, ks = paint.of(view.points[view.hit])
        sigma = paint.sigma_of(view.points[view.hit])
        normals = paint.normals_of(view.points[view.hit], view.normals[view.hit])
        diffuse, specular = columns(normals, view.outgoing[view.hit], sources, sigma)
        image = np.zeros((*view.hit.shape, 4))
        exact = kd * diffuse + ks.reshape(len(ks), -1) * specular
        image[view.hit, :3] = exact * (1 + NOISE * rng.normal(size=exact.shape))
        image[..., 3] = view.hit
        write_image(folder / f"images/{number}.exr", image)
        pose = camera.world_from_camera.tolist()
        frames.append({"file_path": f"images/{number}.exr", "transform_matrix": pose})
    intrinsics = {"w": ball.size, "h": ball.size, "fl_x": focal_length(ball.size)}
    write_json(folder / "transforms.json", {**intrinsics, "frames": frames})
    return folder


def soft_light(count: int = 900) -> list:
    """Two wide lights of different colours and a dim surround, as many small sources."""
    height = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    radius = np.sqrt(1 - height**2)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
    middles = np.array([[0.6, 0.5, 0.62], [-0.5, 0.7, -0.5]])
    cosines = directions @ (middles / np.linalg.norm(middles, axis=1, keepdims=True)).T
    radiance = 0.2 + np.exp(8 * (cosines - 1)) @ np.array([[3.0, 2.7, 2.2], [1.2, 1.6, 2.2]])
    return list(zip(directions.tolist(), (radiance * 4 * np.pi / count).tolist()))


def columns(normals, outgoing, sources=SOURCES, sigma=SIGMA):
    """D and S of T 6.13, with the mu of ``small_captures``."""
    found = []
    for kd, ks in (((1.0, 1.0, 1.0), 0.0), ((0.0, 0.0, 0.0), 1.0)):
        with mock.patch.multiple(small_captures, KD=kd, KS=ks, SIGMA=sigma):
            found.append(small_captures.reflected(normals, outgoing, sources))
    return found


def texel_paint(rows: int, paint: Paint = CHECKER):
    """Kd and ks of the texels of a sphere's texture, row by row from the top."""
    polar = ((np.arange(rows) + 0.5) * np.pi / rows)[:, None]
    azimuth = ((np.arange(2 * rows) + 0.5) * np.pi / rows)[None, :]
    points = np.stack(
        np.broadcast_arrays(
            np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)
        ),
        axis=-1,
    )
    return paint.of(points.reshape(-1, 3))


def write_config(folder: Path, text: str, lighting: str = LIGHTING, shape: str = "") -> Path:
    """Write a config beside a capture."""
    geometry = shape or "sphere: {radius: 1}"
    path = folder / "config.yaml"
    path.write_text(
        f"capture: {{transforms: transforms.json, geometry: {{{geometry}}}}}\n{lighting}{text}"
    )
    return path
