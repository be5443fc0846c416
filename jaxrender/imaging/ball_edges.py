"""The circle of a ball found without a mask, by the edges that it makes in photographs.

An edge of a picture lies across its gradient.  On the outline of a ball the gradient points along
a radius, one way or the other, so that each edge votes for two centres at every radius.  Of the
circles that have most of their circumference in such edges the largest is the outline: reflections
inside the ball make smaller ones.  Positions are as in ``silhouette``.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.optimize import least_squares

from jaxrender.imaging.silhouette import Circle
from jaxrender.shapes import checked

# The search looks at a picture no larger than this; edges are found after a blur of this much.
_SIDE, _BLUR = 240, 1.2
# The part of all pixels that count as edges, and the radii that are tried.
_EDGES, _LEAST_RADIUS = 0.06, 8
# An edge this close to a circle, in pixels, and this nearly across its radius, speaks for it.
_NEAR, _ACROSS = 1.5, 0.94
_SECTORS = 72
# A circle with less of its circumference in edges is none; one with nearly as much is as good.
# Chance makes small circles: they need more, by this over the radius in pixels of the search.
_LEAST_SUPPORT, _AS_GOOD, _BY_CHANCE = 0.5, 0.85, 3.0
_CANDIDATES = 40
_OUTLIER = 0.7


class _Edges(NamedTuple):
    """Points of edges, in pixels from the top left corner, and unit gradients there."""

    points: Float[np.ndarray, "edge 2"]
    gradients: Float[np.ndarray, "edge 2"]


@checked
def circle_of_edges(photographs: Sequence[Float[np.ndarray, "row column"]]) -> Circle:
    """Find the circle of a ball in photographs that one camera took, by their edges.

    Brightness in each counts by its logarithm.  ``support`` is the part of the circumference that
    shows an edge.  Raises ``ValueError`` where no circle has half of its circumference in edges.
    """
    relief = np.mean([_logarithm(np.asarray(one, float)) for one in photographs], axis=0)
    step = max(1, round(max(relief.shape) / _SIDE))
    small = _shrunk(relief, step)
    starts = _best(_edges(small), small.shape)
    if not starts:
        raise ValueError("no edges of a ball are seen")
    edges, seen = _edges(relief), 0.0
    for start in starts:
        circle = _refined(start * step, edges, step)
        seen = max(seen, circle.support)
        if circle.support - _BY_CHANCE * step / circle.radius >= _LEAST_SUPPORT:
            return circle
    raise ValueError(
        f"the best circle has edges along {100 * seen:.0f} % of it: that is no sure ball"
    )


def _refined(start: Float[np.ndarray, "3"], edges: _Edges, step: int) -> Circle:
    """Fit a circle of the search to the edges of the whole picture."""
    for near in (2.0 * step, _NEAR):
        own = edges.points[_along(start, edges, near)]
        if len(own) < _SECTORS // 2:
            break
        start = least_squares(_off, start, args=(own,), loss="cauchy", f_scale=_OUTLIER).x
    row, column, radius = map(float, start)
    speaking = edges.points[_along(start, edges, _NEAR)]
    if not len(speaking):
        return Circle(row, column, radius, radius, 0.0)
    spread = float(np.sqrt(np.mean(_off(start, speaking) ** 2) * 2 / len(speaking)))
    return Circle(row, column, radius, spread, _around(start, speaking))


def _logarithm(values: np.ndarray) -> np.ndarray:
    typical = float(np.median(values)) or float(values.mean()) or 1.0
    return np.log(np.maximum(values, 0) + 0.1 * typical)


def _shrunk(picture: np.ndarray, step: int) -> np.ndarray:
    rows, columns = (size // step for size in picture.shape)
    whole = picture[: rows * step, : columns * step]
    return whole.reshape(rows, step, columns, step).mean(axis=(1, 3))


def _edges(picture: np.ndarray) -> _Edges:
    """Find where the gradient is a maximum across the edge, and among the largest."""
    down, across = (
        ndimage.gaussian_filter1d(
            ndimage.gaussian_filter1d(picture, _BLUR, axis=1 - axis), _BLUR, axis=axis, order=1
        )
        for axis in (0, 1)
    )
    size = np.hypot(down, across)
    unit = np.stack([down, across]) / np.maximum(size, 1e-300)
    places = np.indices(picture.shape, float)
    before, after = (
        ndimage.map_coordinates(size, places + sign * unit, order=1, mode="nearest")
        for sign in (-1, 1)
    )
    ridge = (size >= before) & (size >= after) & (size > 0)
    count = max(1, round(_EDGES * picture.size))
    least = np.sort(size[ridge])[-count:][0] if ridge.any() else np.inf
    ridge &= size >= least
    # Where the parabola through the three has its top.
    bend = before + after - 2 * size
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, 1), 0)
    points = places + 0.5 + np.clip(shift, -0.5, 0.5) * unit
    return _Edges(points[:, ridge].T, unit[:, ridge].T)


def _best(edges: _Edges, shape: tuple[int, int]) -> list[Float[np.ndarray, "3"]]:
    """Vote for circles, and list those with most of their circumference, the largest first."""
    candidates = []
    for radius in range(_LEAST_RADIUS, min(shape) // 2 + 1):
        votes = np.zeros(shape)
        for sign in (-1, 1):
            cell = np.floor(edges.points + sign * radius * edges.gradients).astype(int)
            inside = ((cell >= 0) & (cell < shape)).all(axis=1)
            np.add.at(votes, tuple(cell[inside].T), 1.0)
        # An error of direction spreads the votes of a large circle further.
        votes = ndimage.gaussian_filter(votes, 1 + 0.02 * radius)
        row, column = np.unravel_index(int(np.argmax(votes)), shape)
        candidates.append((float(votes.max()) / radius, row + 0.5, column + 0.5, float(radius)))
    best = sorted(candidates, reverse=True)[:_CANDIDATES]
    circles = [np.array(one[1:]) for one in best]
    refined = []
    for circle in circles:
        own = edges.points[_along(circle, edges, 2.5)]
        if len(own) < _SECTORS // 4:
            continue
        fit = least_squares(_off, circle, args=(own,), loss="cauchy", f_scale=_OUTLIER).x
        support = _around(fit, edges.points[_along(fit, edges, _NEAR)])
        refined.append((support - _BY_CHANCE / fit[2], fit))
    if not refined:
        return []
    most = max(support for support, _ in refined)
    as_good = [fit for support, fit in refined if support >= _AS_GOOD * most]
    return sorted(as_good, key=lambda fit: -fit[2])


def _along(circle: Float[np.ndarray, "3"], edges: _Edges, near: float) -> np.ndarray:
    """Mark the edges near a circle whose gradient is along its radius."""
    offset = edges.points - circle[:2]
    distance = np.hypot(*offset.T)
    radial = np.abs(np.sum(offset * edges.gradients, axis=1)) / np.maximum(distance, 1e-9)
    return (np.abs(distance - circle[2]) < near) & (radial > _ACROSS)


def _around(circle: Float[np.ndarray, "3"], points: Float[np.ndarray, "point 2"]) -> float:
    """The part of the circumference along which points lie."""
    down, across = (points - circle[:2]).T
    sector = np.floor((np.arctan2(down, across) / (2 * np.pi) + 0.5) * _SECTORS) % _SECTORS
    return len(np.unique(sector)) / _SECTORS


def _off(
    circle: Float[np.ndarray, "3"], points: Float[np.ndarray, "point 2"]
) -> Float[np.ndarray, "point"]:
    return np.hypot(*(points - circle[:2]).T) - circle[2]
