"""From measurements at scattered pairs of directions to an ``IsotropicTable``, with its error.

A measurement is a point in the half and difference angles; reciprocity and the mirror symmetry of
isotropic surfaces leave only cos 2 p_d of the azimuth, which matters less the nearer either polar
angle is to 0.  The points are interpolated by cubic radial functions with a linear part in

    (2 sqrt(t_h), t_d, sin t_h sin t_d cos 2 p_d),

as the cube root of the value: reflectances span four decades, and zeros are among them.  How much
is smoothed is chosen by cross-validation, and nothing exceeds or undercuts the measurements near
by: a highlight between them is no brighter than they are.  (Found by held-out error on measured
paints among linear, thin-plate and cubic functions; the logarithm and the cube root of the value;
and against trilinear grids with penalised curvature, whose typical error was twice as large.)

Beyond the largest polar angle that was measured, the value is held constant in t_d.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree

from jaxrender.brdf.tables.isotropic import (
    Corner,
    HalfDifference,
    IsotropicTable,
    corners,
    half_difference,
    node_angles,
    raised,
)
from jaxrender.geometry import Components
from jaxrender.shapes import Bool, Float, Int, checked

SMOOTHINGS = (0.0, 1e-5, 1e-4, 1e-3, 1e-2)

# Points nearer than this in the coordinates above (radians) are one, at their mean.
_SAME_POINT = 1e-3
# Errors of the cube root below this are rounding.
_NO_ERROR = 1e-9
# So many measurements bound the value between them: extrapolated cubics know no limit.
_BOUNDING = 32
# Fewer say nothing about three angles.
_FEWEST = 40
# Every point is a neighbour of every other up to here; the cost of that grows with the cube.
_MOST_AT_ONCE = 4000
_NEIGHBOURS = 96

_corners, _half_difference = eqx.filter_jit(corners), eqx.filter_jit(half_difference)


class ScatteredFit(NamedTuple):
    """A table, and what is known of its error, for each channel.

    ``relative_rms`` and ``typical`` are of measurements held out of the fit, in turn: sqrt(sum r^2
    / sum v^2), which the brightest few decide, and median |r| over the median of v where it is not
    zero.  They include the noise, and say nothing of directions nearer to grazing than any
    measured.  ``residual`` is the former at the measurements that the table was made of.  All three
    are of the table as it is interpolated.  ``used`` and ``masked`` count measurements.
    ``smoothing`` is what the interpolation was given: one for all channels that miss the same
    measurements.
    """

    brdf: IsotropicTable
    relative_rms: Float[np.ndarray, "channel"]
    typical: Float[np.ndarray, "channel"]
    residual: Float[np.ndarray, "channel"]
    used: Int[np.ndarray, "channel"]
    masked: Int[np.ndarray, "channel"]
    smoothing: Float[np.ndarray, "channel"]


class _Points(NamedTuple):
    """Cube roots of the values, where there are any, and the least cosine of any direction."""

    angles: HalfDifference
    roots: Float[np.ndarray, "point channel"]
    least_cosine: float


@checked
def fit_isotropic_table(
    incoming: Float[np.ndarray, "measurement 3"],
    outgoing: Float[np.ndarray, "measurement 3"],
    values: Float[np.ndarray, "measurement channel"],
    shape: tuple[int, int, int] = (90, 90, 60),
    folds: int = 5,
) -> ScatteredFit:
    """Fit a table of ``shape`` (theta_h, theta_d, phi_d) to values in 1/sr.

    Directions are local unit vectors away from the surface.  Values that are negative or not finite
    are left out, and counted.  Deterministic: measurements are dealt to the folds by a fixed seed.
    Raises ``ValueError`` for directions below the horizon, fewer than 40 values in a channel, fewer
    than 2 folds, and measurements that do not spread over all three angles.
    """
    incoming, outgoing, values = (np.asarray(a, float) for a in (incoming, outgoing, values))
    _refuse_directions(incoming, "incoming")
    _refuse_directions(outgoing, "outgoing")
    if folds < 2:
        raise ValueError(f"folds={folds}: at least 2, to hold one out while fitting the rest")
    valid = np.isfinite(values) & (values >= 0)
    if np.any(valid.sum(0) < _FEWEST):
        raise ValueError(
            f"a channel has {valid.sum(0).min()} usable values: a table needs at least {_FEWEST}"
        )
    found = _half_difference(Components.of(incoming), Components.of(outgoing))
    angles = HalfDifference(*(np.asarray(angle, float) for angle in found))
    lower = np.minimum(incoming[:, 2], outgoing[:, 2])
    table = np.empty((*shape, values.shape[1]))
    numbers = np.empty((4, values.shape[1]))
    # Channels that miss the same measurements share the work.
    patterns, which = np.unique(valid, axis=1, return_inverse=True)
    for pattern in range(patterns.shape[1]):
        channels, rows = np.flatnonzero(which.ravel() == pattern), patterns[:, pattern]
        subset = HalfDifference(*(angle[rows] for angle in angles))
        points = _merged(subset, np.cbrt(values[np.ix_(rows, channels)]), float(lower[rows].min()))
        table[..., channels], numbers[:, channels] = _fit(points, shape, folds)
    used = valid.sum(0)
    relative_rms, typical, residual, smoothing = numbers
    return ScatteredFit(
        brdf=IsotropicTable(table),
        relative_rms=relative_rms,
        typical=typical,
        residual=residual,
        used=used,
        masked=len(valid) - used,
        smoothing=smoothing,
    )


def _fit(
    points: _Points, shape: tuple[int, int, int], folds: int
) -> tuple[Float[np.ndarray, "_ _ _ channel"], Float[np.ndarray, "4 channel"]]:
    """Make a table, and its relative rms, typical error, residual and smoothing."""
    fold = np.random.default_rng(0).permutation(len(points.roots)) % folds
    stencil = _stencil(shape, points.angles)
    nodes = HalfDifference(*(angle.ravel() for angle in node_angles(shape)))
    held_out = [_cross_validated(points, nodes, stencil, fold, s) for s in SMOOTHINGS]
    errors = [_mean_error(np.cbrt(held), points.roots) for held in held_out]
    # One choice, or highlights would have colours of their own; every channel has the same say.
    best = int(np.argmin(np.sum(np.log(np.maximum(errors, _NO_ERROR)), axis=1)))
    everything = np.ones(len(fold), bool)
    table = _predicted(points, everything, SMOOTHINGS[best], nodes)
    held, values = held_out[best], points.roots**3
    again = np.einsum("pk,pkc->pc", stencil.weight, table[stencil.index])
    numbers = [
        _relative_rms(held, values),
        _typical_error(held, values),
        _relative_rms(again, values),
        np.full(values.shape[1], SMOOTHINGS[best]),
    ]
    return table.reshape(*shape, -1), np.stack(numbers)


def _cross_validated(
    points: _Points,
    nodes: HalfDifference,
    stencil: Corner,
    fold: Int[np.ndarray, "point"],
    smoothing: float,
) -> Float[np.ndarray, "point channel"]:
    """Predict each value by a table of the points in the other folds."""
    found = np.empty_like(points.roots)
    for number in range(fold.max() + 1):
        kept = fold != number
        index, weight = stencil.index[~kept], stencil.weight[~kept]
        asked, place = np.unique(index, return_inverse=True)
        needed = HalfDifference(*(angle[asked] for angle in nodes))
        table = _predicted(points, kept, smoothing, needed)
        found[~kept] = np.einsum("pk,pkc->pc", weight, table[place.reshape(index.shape)])
    return found


def _predicted(
    points: _Points, kept: Bool[np.ndarray, "point"], smoothing: float, nodes: HalfDifference
) -> Float[np.ndarray, "node channel"]:
    """Interpolate values at nodes, within the range of the measurements about each."""
    coordinates, roots = _coordinates(points.angles)[kept], points.roots[kept]
    asked, place = np.unique(
        _coordinates(raised(nodes, points.least_cosine)).round(12), axis=0, return_inverse=True
    )
    neighbours = _NEIGHBOURS if len(roots) > _MOST_AT_ONCE else None
    try:
        fitted = RBFInterpolator(
            coordinates, roots, neighbors=neighbours, smoothing=smoothing, kernel="cubic", degree=1
        )
        found = fitted(asked)
    except np.linalg.LinAlgError:
        raise ValueError(
            "the measurements do not spread over all of theta_h, theta_d and phi_d: measure more "
            "than one plane or one half angle"
        ) from None
    nearest = KDTree(coordinates).query(asked, min(_BOUNDING, len(roots)))[1]
    bounding = roots[nearest]
    return (np.clip(found, bounding.min(axis=1), bounding.max(axis=1)) ** 3)[place.ravel()]


def _coordinates(angles: HalfDifference) -> Float[np.ndarray, "point 3"]:
    theta_h, theta_d, phi_d = angles
    across = np.sin(theta_h) * np.sin(theta_d) * np.cos(2 * np.asarray(phi_d))
    return np.stack([2 * np.sqrt(theta_h), theta_d, across], axis=-1)


def _merged(
    angles: HalfDifference, roots: Float[np.ndarray, "point channel"], least_cosine: float
) -> _Points:
    """Make one point of those that coincide: pairs measured both ways or twice."""
    cells = (_coordinates(angles) / _SAME_POINT).round()
    _, first, place, count = np.unique(
        cells, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    total = np.zeros((len(first), roots.shape[1]))
    np.add.at(total, place.ravel(), roots)
    return _Points(
        HalfDifference(*(np.asarray(angle)[first] for angle in angles)),
        total / count[:, None],
        least_cosine,
    )


def _stencil(shape: tuple[int, int, int], angles: HalfDifference) -> Corner:
    """Gather the corners about each point: index and weight [point, corner]."""
    found = _corners(shape, angles)
    index = np.stack([np.asarray(corner.index) for corner in found], axis=-1)
    return Corner(index, np.stack([np.asarray(corner.weight, float) for corner in found], axis=-1))


def _relative_rms(
    found: Float[np.ndarray, "point channel"], values: Float[np.ndarray, "point channel"]
) -> Float[np.ndarray, "channel"]:
    size = np.sum(values**2, axis=0)
    return np.sqrt(np.sum((found - values) ** 2, axis=0) / np.where(size > 0, size, 1))


def _typical_error(
    found: Float[np.ndarray, "point channel"], values: Float[np.ndarray, "point channel"]
) -> Float[np.ndarray, "channel"]:
    return np.median(np.abs(found - values), axis=0) / _typical_value(values)


def _mean_error(
    found: Float[np.ndarray, "point channel"], roots: Float[np.ndarray, "point channel"]
) -> Float[np.ndarray, "channel"]:
    """Average an error that is relative for bright values, so that no few of them decide."""
    return np.mean(np.abs(found - roots) / (roots + _typical_value(roots)[None, :]), axis=0)


def _typical_value(values: Float[np.ndarray, "point channel"]) -> Float[np.ndarray, "channel"]:
    """Find the median of the values that are not zero, 1 where all are."""
    found = [np.median(v[v > 0]) if np.any(v > 0) else 1.0 for v in values.T]
    return np.array(found, float)


def _refuse_directions(directions: Float[np.ndarray, "measurement 3"], name: str) -> None:
    length = np.linalg.norm(directions, axis=1)
    wrong = ~((np.abs(length - 1) < 1e-3) & (directions[:, 2] > 0))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(
            f"{name}[{row}] is {directions[row]}: give unit vectors above the horizon, away from "
            "the surface, +Z the normal"
        )
