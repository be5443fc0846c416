"""Circles from silhouettes: where a photographed ball lies, to a fraction of a pixel (T 6.4.1).

Positions are in pixels from the image's top left corner, so that pixel (row, column) has its centre
at (row + 1/2, column + 1/2).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from jaxrender.shapes import checked

# A point of the outline this close to a circle, in pixels, speaks for it.
_NEAR = 1.5
_TRIALS = 500
# The residual, in pixels, from which on a point counts less and less.
_OUTLIER = 0.7
_FEWEST_POINTS = 12
# A circle that fewer of the outline's points speak for, or less of whose circumference, is none.
_LEAST_SUPPORT = 0.3
_SECTORS = 36


class Circle(NamedTuple):
    """A circle in an image: its centre and radius in pixels, and how well the outline follows it.

    ``standard_error`` is that of the centre and radius; ``support`` the fraction of the outline's
    points that lie on the circle.
    """

    row: float
    column: float
    radius: float
    standard_error: float
    support: float


@checked
def circle_of(mask: Bool[np.ndarray, "row column"] | Float[np.ndarray, "row column"]) -> Circle:
    """Find the circle that outlines a ball, by a mask or by its coverage from 0 to 1.

    The outline is where coverage crosses 1/2 between neighbouring pixels.  Trials of three points
    find the circle that most of it lies on, so that a stand, a hole or a cropped side do no harm;
    a robust geometric least-squares fit then refines it.
    Raises ``ValueError`` for a mask without an outline, or whose outline is no circle.
    """
    points = outline_of(mask)
    if len(points) < _FEWEST_POINTS:
        raise ValueError(
            f"the mask's outline has {len(points)} points: give one that holds a ball, at least "
            "partly inside the image"
        )
    start = _consensus(points)
    near = points[np.abs(_residuals(start, points)) < 2 * _NEAR]
    fit = least_squares(_residuals, start, args=(near,), loss="cauchy", f_scale=_OUTLIER)
    left = np.abs(_residuals(fit.x, points))
    inliers = points[left < _NEAR]
    support, around = len(inliers) / len(points), _circumference(fit.x, inliers)
    if min(support, around) < _LEAST_SUPPORT:
        raise ValueError(
            f"{100 * support:.0f} % of the mask's outline lie on one circle, and cover "
            f"{100 * around:.0f} % of it: is it the mask of a ball?"
        )
    spread = np.sqrt(np.mean(_residuals(fit.x, inliers) ** 2))
    row, column, radius = (float(value) for value in fit.x)
    return Circle(row, column, radius, float(spread / np.sqrt(len(inliers) / 2)), support)


@checked
def outline_of(
    mask: Bool[np.ndarray, "row column"] | Float[np.ndarray, "row column"],
) -> Float[np.ndarray, "point 2"]:
    """List where coverage crosses 1/2 between the centres of neighbours, along rows and columns."""
    coverage, points = np.asarray(mask, np.float64), []
    for axis in (0, 1):
        along = np.moveaxis(coverage, axis, 1)
        before, after = along[:, :-1], along[:, 1:]
        line, place = np.nonzero((before > 0.5) != (after > 0.5))
        one, other = before[line, place], after[line, place]
        crossing = place + 0.5 + (0.5 - one) / (other - one)
        both = np.stack([line + 0.5, crossing], axis=-1)
        points.append(both if axis == 1 else both[:, ::-1])
    return np.concatenate(points)


def _consensus(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "3"]:
    """Find the circle through three of the points that most points lie near."""
    rng = np.random.default_rng(0)
    triples = points[rng.integers(len(points), size=(_TRIALS, 3))]
    # |p|^2 = 2 c.p + (r^2 - |c|^2), three linear equations for each triple.
    origin = points.mean(axis=0)
    triples = triples - origin
    matrices = np.concatenate([2 * triples, np.ones((_TRIALS, 3, 1))], axis=-1)
    solvable = np.abs(np.linalg.det(matrices)) > 1
    solved = np.linalg.solve(
        matrices[solvable], np.sum(triples[solvable] ** 2, axis=-1)[..., None]
    ).squeeze(-1)
    radii = np.sqrt(solved[:, 2] + np.sum(solved[:, :2] ** 2, axis=1))
    circles = np.column_stack([solved[:, :2] + origin, radii])
    if not len(circles):
        raise ValueError("the mask's outline is a straight line: is it the mask of a ball?")
    votes = [np.sum(np.abs(_residuals(circle, points)) < _NEAR) for circle in circles]
    return circles[int(np.argmax(votes))]


def _circumference(circle: Float[np.ndarray, "3"], points: Float[np.ndarray, "point 2"]) -> float:
    """Compute the fraction of the circle's circumference that the points lie along."""
    down, across = (points - circle[:2]).T
    sector = np.floor((np.arctan2(down, across) / (2 * np.pi) + 0.5) * _SECTORS)
    return len(np.unique(sector % _SECTORS)) / _SECTORS


def _residuals(
    circle: Float[np.ndarray, "3"], points: Float[np.ndarray, "point 2"]
) -> Float[np.ndarray, "point"]:
    return np.hypot(*(points - circle[:2]).T) - circle[2]
