"""Cameras and the rays of their pixels.  Host side, NumPy float64.

A pose is ``world_from_camera`` in the NeRF and Blender convention: its rotation's columns are
the camera's x (right), y (up) and z (backwards, the camera looks along -z), its last column the
position.  Pixel (row, column) has its centre at x = column + 1/2, y = row + 1/2 in pixels, x to
the right and y down from the image's top left corner.  A lens (``lenses``) has y down and z ahead.
"""

import abc
import math
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from jaxrender.geometry.lenses import Lens, PerspectiveLens
from jaxrender.shapes import AnyArray, checked

# Poses in files are often written with six digits; a scale or a shear is far beyond this.
POSE_TOLERANCE = 1e-4
# From a pose's axes to those of a lens: y down, z ahead.
_LENS_AXES = np.array([1.0, -1.0, -1.0])


class Rays(NamedTuple):
    """One ray a pixel: origins in world units, unit directions into the scene.

    Directions are NaN where the lens shows nothing.
    """

    origins: Float[np.ndarray, "row column 3"]
    directions: Float[np.ndarray, "row column 3"]


class Camera(eqx.Module):
    """An image of ``height`` x ``width`` pixels and the pose it was taken from."""

    width: eqx.AbstractVar[int]
    height: eqx.AbstractVar[int]
    world_from_camera: eqx.AbstractVar[Float[np.ndarray, "4 4"]]

    @abc.abstractmethod
    def rays(self) -> Rays:
        """Rays through the pixel centres, row 0 at the top."""

    @abc.abstractmethod
    def project(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 2"]:
        """Image positions (x, y) in pixels of world points; NaN for points not in front."""

    @property
    def position(self) -> Float[np.ndarray, "3"]:
        """Where the camera stands, in world units."""
        return self.world_from_camera[:3, 3]


class Pinhole(Camera):
    """A perspective camera: x = fl_x X / -Z + cx, y = -fl_y Y / -Z + cy, lengths in pixels.

    A ``lens`` moves (X, -Y) / -Z, or takes their place in a fisheye.
    """

    width: int
    height: int
    world_from_camera: Float[np.ndarray, "4 4"]
    fl_x: float
    fl_y: float
    cx: float
    cy: float
    lens: Lens | None

    def __init__(
        self,
        width: int,
        height: int,
        world_from_camera: Float[AnyArray, "4 4"],
        *,
        fl_x: float,
        fl_y: float | None = None,
        cx: float | None = None,
        cy: float | None = None,
        lens: Lens | None = None,
    ):
        """``fl_y`` defaults to ``fl_x``, the principal point to the image's centre."""
        self.width, self.height = _checked_size(width, height)
        self.world_from_camera = _checked_pose(world_from_camera)
        self.fl_x = _positive("fl_x", fl_x)
        self.fl_y = self.fl_x if fl_y is None else _positive("fl_y", fl_y)
        self.cx = _finite("cx", width / 2 if cx is None else cx)
        self.cy = _finite("cy", height / 2 if cy is None else cy)
        self.lens = lens

    def rays(self) -> Rays:
        """All rays start at the camera's position."""
        x, y = _pixel_centres(self.width, self.height)
        x, y = (x - self.cx) / self.fl_x, (y - self.cy) / self.fl_y
        if self.lens is None:
            local = np.stack([x, -y, -np.ones_like(x)], axis=-1)
        else:
            local = self.lens.undistort(np.stack([x, y], axis=-1)) * _LENS_AXES
        directions = local @ self.world_from_camera[:3, :3].T
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return Rays(np.broadcast_to(self.position, directions.shape), directions)

    @checked
    def project(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 2"]:
        """Divide by the depth -Z, or do what the lens does; NaN for what it does not show."""
        local = _to_camera(self.world_from_camera, points)
        if self.lens is not None:
            places = self.lens.distort(local * _LENS_AXES)
            return places * [self.fl_x, self.fl_y] + [self.cx, self.cy]
        depth = np.where(local[:, 2] < 0, -local[:, 2], np.nan)
        x = self.fl_x * local[:, 0] / depth + self.cx
        y = self.cy - self.fl_y * local[:, 1] / depth
        return np.stack([x, y], axis=-1)

    @checked
    def pixel_slopes(
        self, directions: Float[np.ndarray, "*batch 3"]
    ) -> Float[np.ndarray, "*batch 2 3"]:
        """Differentiate the image position (x, y) by the direction, in the world's axes."""
        lens = PerspectiveLens(()) if self.lens is None else self.lens
        world_from_lens = self.world_from_camera[:3, :3] * _LENS_AXES
        slopes = lens.jacobian(directions @ world_from_lens) @ world_from_lens.T
        return slopes * np.array([self.fl_x, self.fl_y])[:, None]


class Orthographic(Camera):
    """Parallel rays, ``scale`` world units a pixel: x = X / scale + cx, y = -Y / scale + cy."""

    width: int
    height: int
    world_from_camera: Float[np.ndarray, "4 4"]
    scale: float
    cx: float
    cy: float

    def __init__(
        self,
        width: int,
        height: int,
        world_from_camera: Float[AnyArray, "4 4"],
        *,
        scale: float,
        cx: float | None = None,
        cy: float | None = None,
    ):
        """``cx`` and ``cy``, the pixel position of the optical axis, default to the centre."""
        self.width, self.height = _checked_size(width, height)
        self.world_from_camera = _checked_pose(world_from_camera)
        self.scale = _positive("scale", scale)
        self.cx = _finite("cx", width / 2 if cx is None else cx)
        self.cy = _finite("cy", height / 2 if cy is None else cy)

    def rays(self) -> Rays:
        """Rays start on the camera's plane: what lies behind it is not seen."""
        x, y = _pixel_centres(self.width, self.height)
        local = self.scale * np.stack([x - self.cx, self.cy - y, np.zeros_like(x)], axis=-1)
        rotation = self.world_from_camera[:3, :3]
        backwards = rotation[:, 2] / np.linalg.norm(rotation[:, 2])
        origins = self.position + local @ rotation.T
        return Rays(origins, np.broadcast_to(-backwards, origins.shape))

    @checked
    def project(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 2"]:
        """Drop the depth."""
        local = _to_camera(self.world_from_camera, points)
        seen = np.where(local[:, 2] < 0, 1, np.nan)
        x = local[:, 0] / self.scale + self.cx
        y = self.cy - local[:, 1] / self.scale
        return np.stack([x * seen, y * seen], axis=-1)


@checked
def look_at(
    position: Float[AnyArray, "3"], target: Float[AnyArray, "3"], up: Float[AnyArray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """``world_from_camera`` at a position, looking at a target, with ``up`` up in the image.

    Raises ValueError if the target is the position or lies straight above or below it along ``up``.
    """
    position, target, up = (np.asarray(v, np.float64) for v in (position, target, up))
    backwards = position - target
    right = np.cross(up, backwards)
    scale = np.linalg.norm(up) * np.linalg.norm(backwards)
    if not np.linalg.norm(right) > 1e-9 * scale:
        raise ValueError(
            f"looking from {position} to {target} with up {up} leaves the upright undefined: "
            "give a target other than the position and an up not along the line of sight"
        )
    right /= np.linalg.norm(right)
    backwards /= np.linalg.norm(backwards)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(backwards, right), backwards, position], axis=-1)
    return pose


def _pixel_centres(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij")
    return x, y


def _to_camera(world_from_camera: np.ndarray, points: np.ndarray) -> np.ndarray:
    return (np.asarray(points, np.float64) - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]


def _checked_size(width: int, height: int) -> tuple[int, int]:
    if int(width) != width or int(height) != height or width < 1 or height < 1:
        raise ValueError(f"image size {width} x {height}: width and height must be whole and >= 1")
    return int(width), int(height)


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name} is {value}: it must be positive and finite")
    return float(value)


def _finite(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{name} is {value}: it must be finite")
    return float(value)


def _checked_pose(world_from_camera: Float[AnyArray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    pose = np.array(world_from_camera, np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(
            f"world_from_camera must be a finite 4 x 4 matrix, got {pose.tolist()}: "
            "append the row 0 0 0 1 to a 3 x 4 pose and mend NaN or infinite entries"
        )
    if not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise ValueError(
            f"world_from_camera's last row is {pose[3]}, not 0 0 0 1: is the matrix transposed?"
        )
    rotation = pose[:3, :3]
    # What overflows is no rotation.
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if not deviation <= POSE_TOLERANCE:
        raise ValueError(
            f"world_from_camera's 3 x 3 part deviates from a rotation by {deviation:.2g} (at most "
            f"{POSE_TOLERANCE:g}): take scale and shear out of the pose"
        )
    if np.linalg.det(rotation) < 0:
        raise ValueError(
            "world_from_camera's 3 x 3 part is a reflection (determinant -1): the axes must be x "
            "right, y up, z backwards; negate one column, for instance"
        )
    return pose
