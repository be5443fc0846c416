"""Captures whose files mean other axes, units, turns and mirrors than are told."""

import numpy as np

from jaxrender.geometry import Mesh, Pinhole, Placement, Shape, Sphere, look_at
from jaxrender.inverse.conventions import Framing, Silhouettes
from jaxrender.inverse.conventions.silhouettes import covered

# The columns are x, y and z of each program, as right, up and backwards.
WRITTEN = {
    "opengl": np.eye(3),
    "opencv": np.diag([1.0, -1, -1]),
    "pytorch3d": np.diag([-1.0, 1, -1]),
    "llff": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "ros": np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]]),
}


def cameras(count: int = 6, size: int = 64, distance: float = 6.0) -> list[Pinhole]:
    """Cameras around the object, some higher than others."""
    found = []
    for k in range(count):
        azimuth, height = 2 * np.pi * k / count, 0.3 + 0.25 * np.sin(1.7 * k)
        flat = distance * np.cos(height)
        place = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), distance * height])
        pose = look_at(place, np.zeros(3), np.array([0.0, 0, 1]))
        found.append(Pinhole(size, size, pose, fl_x=1.5 * size))
    return found


def as_written(camera: Pinhole, axes: str) -> Pinhole:
    """Write a camera as another program would, and take its pose for ours."""
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ WRITTEN[axes.removesuffix("_inverted")]
    if axes.endswith("_inverted"):
        pose = np.linalg.inv(pose)
        pose[3] = [0, 0, 0, 1]
    return Pinhole(camera.width, camera.height, pose, fl_x=camera.fl_x)


def silhouettes(shape: Shape, axes: str = "opengl", mirrored: bool = False) -> Silhouettes:
    """See a shape, and write cameras and masks in other conventions."""
    masks = [covered(camera, shape) for camera in cameras()]
    masks = [mask[:, ::-1] if mirrored else mask for mask in masks]
    written = tuple(as_written(camera, axes) for camera in cameras())
    return Silhouettes(tuple(f"{k}" for k in range(len(masks))), written, tuple(masks))


def file_of(shape: Mesh | Sphere, framing: Framing) -> Mesh | Sphere:
    """Write a shape so that a framing makes it what it is."""
    back: Placement = framing.own.inverse
    if isinstance(shape, Sphere):
        return Sphere(back.points(shape.center[None])[0], shape.radius * back.scale)
    return back.mesh(shape)
