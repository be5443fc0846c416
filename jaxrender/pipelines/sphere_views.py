"""A sphere seen by several distant viewers, shaded by a spherical harmonic reflection map."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from jaxrender.geometry import reflect
from jaxrender.pipelines.report.display import tone_key, tone_mapped
from jaxrender.reflection.shrm import Shrm
from jaxrender.shapes import Bool, Float

# Viewers along the axes, and what to call them.
_VIEWERS = {f"seen from {sign}{'xyz'[axis]}": (sign, axis) for axis in range(3) for sign in "+-"}
_PIXELS = 192
_COLUMNS = 3
_PAPER = 255


class SpherePixels(NamedTuple):
    """The pixels that show a sphere, and the normals of those, row by row."""

    hit: Bool[np.ndarray, "row column"]
    normals: Float[np.ndarray, "point 3"]


def sphere_pixels(
    towards: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"], size: int
) -> SpherePixels:
    """Look at a unit sphere along parallel rays."""
    right = np.cross(up, towards)
    right = right / np.linalg.norm(right)
    above = np.cross(towards, right)
    place = (np.arange(size) + 0.5) * 2 / size - 1
    x, y = np.meshgrid(place, -place)
    hit = x**2 + y**2 < 1
    x, y = x[hit], y[hit]
    z = np.sqrt(1 - x**2 - y**2)
    normals = np.stack([x, y, z], axis=-1) @ np.stack([right, above, towards])
    return SpherePixels(hit, normals)


def sphere_radiance(
    shrm: Shrm,
    normals: Float[np.ndarray, "point 3"],
    towards: Float[np.ndarray, "3"],
    about_normal: bool,
) -> Float[np.ndarray, "point channel"]:
    """Evaluate a map on a sphere for one distant viewer (T 5.35), in the map's own precision."""
    outgoing = np.broadcast_to(towards, normals.shape)
    centres = normals if about_normal else np.asarray(reflect(outgoing, normals))
    dtype = shrm.maps.dtype
    return np.asarray(shrm.at(centres.astype(dtype), outgoing.astype(dtype)))


def write_sphere_views(
    path: Path, shrm: Shrm, title: str, *, about_normal: bool, up: Float[np.ndarray, "3"]
) -> None:
    """Draw the sphere for six viewers, all at one exposure, as a PNG."""
    hits, values = [], []
    for sign, axis in _VIEWERS.values():
        towards = np.eye(3)[axis] * (1 if sign == "+" else -1)
        # Directly above or below, up is undefined: another axis takes its place.
        steep = abs(towards @ up) > 0.9
        hit, normals = sphere_pixels(towards, np.roll(up, 1) if steep else up, _PIXELS)
        hits.append(hit)
        values.append(np.maximum(sphere_radiance(shrm, normals, towards, about_normal), 0))
    key = tone_key(np.concatenate(values)[None])
    rows = -(-len(_VIEWERS) // _COLUMNS)
    figure = Figure(figsize=(9.0, 3.2 * rows + 0.5), layout="constrained")
    figure.suptitle(title, fontsize=9)
    for place, (name, hit, radiance) in enumerate(zip(_VIEWERS, hits, values)):
        picture = np.full((*hit.shape, 3), _PAPER, np.uint8)
        picture[hit] = tone_mapped(radiance[None], key)[0]
        axes = figure.add_subplot(rows, _COLUMNS, place + 1)
        axes.imshow(picture)
        axes.set_title(name, fontsize=10)
        axes.set_axis_off()
    figure.savefig(path, dpi=110)
