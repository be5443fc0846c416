"""Centre and radius of a ball, by the silhouettes of its photographs (T 6.4.1).

The outline of a ball is an ellipse in a perspective photograph, and its rays are tangents.  So the
distance of the centre from each of them is the radius, whatever the camera.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from jaxrender.geometry import Camera, Sphere
from jaxrender.shapes import Bool, Float

_FEWEST = 12
# Tangents are off by less than this part of the radius, or they are of no ball.
_ROUND = 0.05


class FoundSphere(NamedTuple):
    """A ball, the standard errors of its centre and radius (world units), and what is left.

    ``misfit`` is the root mean square by which tangents miss the ball, relative to its radius.
    """

    sphere: Sphere
    centre_error: float
    radius_error: float
    misfit: float


class _Tangents(NamedTuple):
    origins: Float[np.ndarray, "ray 3"]
    directions: Float[np.ndarray, "ray 3"]


def sphere_of_silhouettes(
    cameras: list[Camera] | tuple[Camera, ...],
    masks: list[Bool[np.ndarray, "_ _"]] | tuple[Bool[np.ndarray, "_ _"], ...],
    radius: float | None = None,
) -> FoundSphere:
    """Find a ball by least squares of the distances from the tangents at its outlines.

    A photograph alone says how large a ball would be at each distance: then ``radius`` is needed,
    and the camera must be a perspective one.  Where a radius is given, it is kept.
    Raises ``ValueError`` for too few points of an outline, and for what is no ball.
    """
    parts = [_tangents(camera, mask) for camera, mask in zip(cameras, masks, strict=True)]
    rays = _Tangents(*(np.concatenate(each) for each in zip(*parts)))
    if len(rays.origins) < _FEWEST:
        raise ValueError(f"the masks' outlines have {len(rays.origins)} points: give larger ones")
    if radius is None and sum(len(part.origins) > 0 for part in parts) < 2:
        raise ValueError(
            "one photograph does not say how far the ball is: give more photographs, or its radius"
        )
    start = _start(parts, radius)
    free = 3 if radius is not None else 4

    def residuals(numbers: Float[np.ndarray, "number"]) -> Float[np.ndarray, "ray"]:
        held = radius if radius is not None else numbers[3]
        return _distances(rays, numbers[:3]) - held

    solved = least_squares(residuals, start[:free], loss="soft_l1", f_scale=0.02 * start[3])
    normal = solved.jac.T @ solved.jac
    if np.linalg.cond(normal) > 1e10:
        raise ValueError("the photographs do not say where the ball is: give some from other sides")
    found = float(radius if radius is not None else solved.x[3])
    left = residuals(solved.x)
    misfit = float(np.sqrt(np.mean(left**2)))
    if not (found > 0 and misfit < _ROUND * found):
        raise ValueError(
            f"the outlines miss a ball by {100 * misfit / abs(found):.0f} % of its radius: are "
            "they masks of one ball, and the cameras right?"
        )
    errors = np.sqrt(np.diag(np.linalg.inv(normal)) * misfit**2)
    centre = Sphere(solved.x[:3], found)
    radius_error = 0.0 if radius is not None else float(errors[3])
    return FoundSphere(centre, float(np.linalg.norm(errors[:3])), radius_error, misfit / found)


def _tangents(camera: Camera, mask: Bool[np.ndarray, "row column"]) -> _Tangents:
    """List the rays half way between pixels of which one shows the ball.

    A ball that the picture's border cuts has no outline there.
    """
    rays, origins, directions = camera.rays(), [], []
    for axis in (0, 1):
        inside = np.moveaxis(mask, axis, 0)
        line, place = np.nonzero(inside[1:] != inside[:-1])
        for image, found in ((rays.origins, origins), (rays.directions, directions)):
            along = np.moveaxis(image, axis, 0)
            found.append((along[line, place] + along[line + 1, place]) / 2)
    towards = np.concatenate(directions)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return _Tangents(np.concatenate(origins), towards)


def _distances(rays: _Tangents, point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "ray"]:
    """How far the rays pass from a point."""
    to = point - rays.origins
    along = np.einsum("ri,ri->r", to, rays.directions)
    return np.linalg.norm(to - along[:, None] * rays.directions, axis=1)


def _start(parts: list[_Tangents], radius: float | None) -> Float[np.ndarray, "4"]:
    """Find the point where the middles of the outlines meet, or the place on one of them."""
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    for part in parts:
        if len(part.origins):
            axis = part.directions.mean(axis=0)
            axis /= np.linalg.norm(axis)
            across = np.eye(3) - np.outer(axis, axis)
            matrix, right = matrix + across, right + across @ part.origins.mean(axis=0)
    first = next(part for part in parts if len(part.origins))
    axis = first.directions.mean(axis=0)
    length = float(np.linalg.norm(axis))
    axis /= length
    if np.linalg.cond(matrix) < 1e6:
        centre = np.linalg.solve(matrix, right)
    else:
        # The cosine of the half angle is about the length of the mean of the unit tangents.
        sine = np.sqrt(max(1 - length**2, 1e-12))
        centre = first.origins.mean(axis=0) + axis * (radius or 1.0) / sine
    every = _Tangents(*(np.concatenate(each) for each in zip(*parts)))
    return np.array([*centre, float(np.mean(_distances(every, centre)))])
