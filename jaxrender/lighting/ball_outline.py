"""Where a ball lies in space, from its outline in a photograph (T 6.4.1).

The rays that touch a ball form a cone about the direction of its centre.  A unit vector u along one
of them has u.a = cos b, a the axis and sin b the ball's radius over the distance of its centre; all
of them lie in one plane, which robust least squares find.  The outline itself is an ellipse, whose
middle is not that of the ball.  Host side, NumPy float64.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.optimize import least_squares

from jaxrender.geometry.cameras import Camera, Orthographic
from jaxrender.imaging.silhouette import Circle, circle_of, outline_of
from jaxrender.lighting.ball_views import Ball
from jaxrender.shapes import checked

# Points of the outline this close to its circle belong to the ball, as a part of the radius: an
# ellipse seen 30 degrees off the axis is 15 % longer than wide.
_NEAR, _OUTLIER = 0.2, 0.7
_POINTS = 90
# The distance, in radii, at which a ball stands before a camera that cannot tell.
_BEFORE = 4.0


@checked
def ball_of_mask(
    mask: Bool[np.ndarray, "row column"] | Float[np.ndarray, "row column"],
    camera: Camera,
    radius: float = 1.0,
) -> Ball:
    """Find the ball that a mask, or its coverage, outlines; ``radius`` is in world units.

    Raises ``ValueError`` for a mask that outlines no ball, or is not of the camera's size.
    """
    if mask.shape != (camera.height, camera.width):
        raise ValueError(
            f"a mask of {mask.shape[1]} x {mask.shape[0]} pixels and a camera of {camera.width} x "
            f"{camera.height}: they must be the same"
        )
    circle = circle_of(mask)
    points = outline_of(mask)
    off = np.hypot(points[:, 0] - circle.row, points[:, 1] - circle.column) - circle.radius
    return _ball(points[np.abs(off) < _NEAR * circle.radius], circle, camera, radius)


@checked
def ball_of_circle(circle: Circle, camera: Camera, radius: float = 1.0) -> Ball:
    """Place the ball whose outline is a circle in the picture; ``radius`` is in world units.

    Only a ball in the middle of a picture, or far away, has such an outline.
    """
    around = (np.arange(_POINTS) + 0.5) * 2 * np.pi / _POINTS
    down, across = circle.radius * np.sin(around), circle.radius * np.cos(around)
    points = np.stack([circle.row + down, circle.column + across], axis=-1)
    return _ball(points, circle, camera, radius)


def _ball(
    points: Float[np.ndarray, "point 2"], circle: Circle, camera: Camera, radius: float
) -> Ball:
    if not radius > 0:
        raise ValueError(f"radius={radius}: the ball's must be above 0")
    if isinstance(camera, Orthographic):
        pose, own = camera.world_from_camera, circle.radius * camera.scale
        place = [circle.column - camera.cx, camera.cy - circle.row]
        local = np.array([*(camera.scale * np.array(place)), -_BEFORE * own, 1.0])
        return Ball((pose @ local)[:3], own)
    rays = _directions(camera, points)
    start = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
    # An angle of one pixel, in which distances from the cone count.
    pixel = np.arccos(_cosine(start)) / circle.radius

    def off(v: np.ndarray) -> np.ndarray:
        axis = v / np.linalg.norm(v)
        return (np.arccos(np.clip(rays @ axis, -1, 1)) - np.arccos(_cosine(v))) / pixel

    found = least_squares(off, start, loss="cauchy", f_scale=_OUTLIER).x
    opening = np.arccos(_cosine(found))
    axis = found / np.linalg.norm(found)
    return Ball(camera.position + radius / np.sin(opening) * axis, radius)


def _cosine(v: Float[np.ndarray, "3"]) -> float:
    """The cosine of half the cone's opening, of the vector v with u.v = 1 on the cone."""
    return float(min(1 / np.linalg.norm(v), 1.0 - 1e-15))


def _directions(camera: Camera, points: Float[np.ndarray, "point 2"]) -> np.ndarray:
    """Interpolate the rays of a camera, whatever its model, at points (row, column)."""
    rays = camera.rays().directions
    found = np.stack(
        [
            ndimage.map_coordinates(rays[..., k], points.T - 0.5, order=1, mode="nearest")
            for k in range(3)
        ],
        axis=-1,
    )
    return found / np.linalg.norm(found, axis=-1, keepdims=True)
