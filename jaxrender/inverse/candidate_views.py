"""Where a further camera could stand, and what it would see of the object."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxrender.geometry import (
    Camera,
    Orthographic,
    Pinhole,
    Shape,
    SurfaceSamples,
    fibonacci_sphere,
    look_at,
    observe,
)
from jaxrender.shapes import Float

# Directions over the sphere, about 20 degrees apart.
_DIRECTIONS = 96
# The pixels across a candidate's picture.
_PIXELS = 40


class View(NamedTuple):
    """A candidate camera: where it stands as seen from the object, and what it sees."""

    direction: Float[np.ndarray, "3"]
    samples: SurfaceSamples


def candidate_directions() -> Float[np.ndarray, "direction 3"]:
    """Spread directions over the sphere."""
    return fibonacci_sphere(_DIRECTIONS)


def candidate_views(
    cameras: Sequence[Camera],
    shape: Shape,
    min_cosine: float,
    directions: Float[np.ndarray, "view 3"] | None = None,
) -> list[View]:
    """Look at the object from all around, at the present mean distance with the present lens."""
    directions = candidate_directions() if directions is None else directions
    centre = np.asarray(shape.bounds()).mean(axis=0)
    distance = float(np.mean([float(np.linalg.norm(c.position - centre)) for c in cameras]))
    found = []
    for direction in directions:
        seen = observe(_small(cameras[0], centre + distance * direction, centre), shape)
        usable = seen.hit & (seen.exit_cosines >= min_cosine)
        found.append(View(direction, SurfaceSamples(seen.normals[usable], seen.outgoing[usable])))
    return found


def _small(camera: Camera, position: np.ndarray, target: np.ndarray) -> Camera:
    """Make the same camera with few pixels, looking at the object."""
    towards = position - target
    up = np.eye(3)[2 if abs(towards[2]) < 0.9 * np.linalg.norm(towards) else 0]
    pose = look_at(position, target, up)
    shrink = max(camera.width, camera.height) / _PIXELS
    width, height = (max(1, round(size / shrink)) for size in (camera.width, camera.height))
    if isinstance(camera, Orthographic):
        return Orthographic(width, height, pose, scale=camera.scale * shrink)
    assert isinstance(camera, Pinhole)
    lengths = {"fl_x": camera.fl_x / shrink, "fl_y": camera.fl_y / shrink}
    return Pinhole(width, height, pose, **lengths, lens=camera.lens)
