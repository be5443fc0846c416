"""The response of a camera from photographs of one scene at several exposures.

A pixel of log radiance e_i at exposure t_j has a stored value v_ij with

    g(v_ij) = e_i + ln t_j,

g the logarithm of the response (Debevec and Malik, Recovering High Dynamic Range Radiance Maps from
Photographs, SIGGRAPH 1997).  Weighted least squares find g at the values of 8 bits.  The e_i are
eliminated, so that many pixels may take part.  Three things differ from that paper:

- g is smooth as a function of ln(v / (1.1 - v)), in which films and gamma curves bend little;
- noise is in v alone, and weighs each value: the fit repeats that of Gauss and Newton;
- g increases: its steps are found by non-negative least squares where the free ones would not.

Exposures must be known: their squares and the square of the response would fit as well.
Host side, NumPy float64.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse
from scipy.optimize import nnls

from jaxrender.imaging.bracket_samples import Measurements, measurements_of
from jaxrender.imaging.brackets import Bracket, BracketRules, check_brackets
from jaxrender.imaging.masks import saturated
from jaxrender.imaging.response import Curve
from jaxrender.imaging.sensor import SensorNoise
from jaxrender.shapes import checked

# The stored values of 8 bits but 0, of which there is no logarithm.
_KNOTS = 255
_VALUES = np.arange(1, 256) / 255
# Where they lie on the scale on which g is smooth, ln(v / (1.1 - v)).
_ABOVE = 0.1
_PLACES = np.log(_VALUES / (1 + _ABOVE - _VALUES))
_ROUNDS = 4
_LEAST_EXCESS = 1e-2
_MEDIAN_ABSOLUTE = 0.6744897501960817
# An entry is told whose logarithm is known to this, beside the best known one, and that lies no
# further beyond the values of the photographs than this.
_TOLD, _BEYOND = 0.05, 4.5 / 255
# A measurement is expected so many standard deviations below the top, or does not count.
_REACH, _OUTLIER = 1.5, 4.0
# Relative error at the middle of the scale to begin with.
_START = 0.02
# Weight of the squared bend.  Curves of cameras and films have a squared bend below 1.  A smaller
# weight would let in waves whose period is that of the exposures, which no data contradict.
_STIFFNESS = 100.0
# Each step of the logarithm is at least this.
_LEAST_STEP = 1e-7
# No logarithm is known better than to this.
_LEAST_ERROR = 1e-4
# Radiance so low is told as good as 0.
_BLACK_RADIANCE = 3e-3
# Channels are alike where no entries differ by more standard errors.
_ALIKE = 4.0


class RecoveredResponse(NamedTuple):
    """A camera's response, and how well the photographs tell it.

    ``curve`` has the values that are told, radiance 1 at full scale, one column for each channel
    unless all channels are alike.  ``standard_error`` are those of the logarithm of each of its
    radiances, beside the best known one: infinite at value 0, where radiance is all but 0 and is
    called 0.  ``rms`` is what the curve leaves of the logarithms.
    """

    curve: Curve
    standard_error: Float[np.ndarray, "entry channel"]
    rms: float

    @property
    def said(self) -> str:
        """Say which values are told, and how well."""
        first, last = self.curve.values[[0, -1]]
        each = "one curve for each channel" if self.curve.radiance.ndim == 2 else "one curve"
        untold = [
            f"{low:.3g} to {high:.3g}"
            for low, high in ((0.0, first), (last, 1.0))
            if high - low > _BEYOND
        ]
        missing = f"; from {' and from '.join(untold)} it cannot be told" if untold else ""
        errors = self.standard_error[np.isfinite(self.standard_error)]
        return (
            f"the response was recovered: {each}, values {first:.3g} to {last:.3g}, standard error "
            f"{100 * np.median(errors):.2g} % in the median and "
            f"{100 * np.max(errors):.2g} % at worst{missing}"
        )


@checked
def recover_response(
    brackets: Sequence[Bracket],
    noise: SensorNoise | None = None,
    rules: BracketRules | None = None,
    *,
    increasing: bool = True,
) -> RecoveredResponse:
    """Find the response, by the ratios of the stated exposures.

    ``noise``: that of the sensor, which is scaled until it explains what the curve leaves.
    ``increasing`` False leaves the curve free, as Debevec and Malik do.
    Raises ``ValueError`` for fewer than two exposures, for photographs that share no well exposed
    pixels, and where a free curve does not increase.
    """
    check_brackets(brackets)
    exposures = np.array([float(one.exposure) for one in brackets])
    if np.ptp(np.log(exposures)) == 0:
        raise ValueError("one exposure alone tells no response: give photographs of several")
    noise, rules = noise or SensorNoise(), rules or BracketRules()
    values = np.stack([np.asarray(one.values, np.float64) for one in brackets], axis=-1)
    whole = np.stack([~saturated(v, rules.saturation) for v in np.moveaxis(values, -1, 0)], -1)
    channels = []
    for channel in range(values.shape[2]):
        own = values[:, :, channel]
        channels.append(_channel(own, whole & (own > rules.black), exposures, noise, increasing))
    return _joined(channels)


class _Channel(NamedTuple):
    """One channel's logarithms, their errors, which of them are told, and what is left over."""

    logarithms: Float[np.ndarray, "entry"]
    errors: Float[np.ndarray, "entry"]
    told: Bool[np.ndarray, "entry"]
    rms: float


class _Equations(NamedTuple):
    """One row for each measurement: rows @ g - e = right, with its weight, and its pixel."""

    rows: sparse.csr_array
    right: Float[np.ndarray, "measurement"]
    weights: Float[np.ndarray, "measurement"]
    pixel: np.ndarray


def _channel(
    values: Float[np.ndarray, "row column photograph"],
    usable: Bool[np.ndarray, "row column photograph"],
    exposures: Float[np.ndarray, "photograph"],
    noise: SensorNoise,
    increasing: bool,
) -> _Channel:
    measured = measurements_of(values, usable, exposures)
    penalty = _STIFFNESS * _curvature()
    # Debevec and Malik's weights to begin with: the middle of the scale is trusted most.
    hat = np.minimum(measured.value, 1 - measured.value) + 1 / 255
    at = np.maximum(measured.value, _VALUES[0])
    equations = _Equations(_rows(at), measured.exposure, hat / _START**2, measured.pixel)
    for turn in range(_ROUNDS):
        normal, right, mean = _normal_equations(equations)
        found = _solved(normal + penalty, right, increasing)
        left = equations.rows @ found - equations.right
        pixels = mean(left)
        left = left - pixels
        if turn + 1 < _ROUNDS:
            equations = _linearised(measured, found, measured.exposure + pixels, noise)
    covariance = _covariance(equations, measured.cell, normal, penalty, left)
    middle = int(np.argmax(np.diag(normal)))
    apart = covariance[middle, middle] + np.diag(covariance) - 2 * covariance[middle]
    errors = np.sqrt(np.maximum(apart, 0))
    seen = (equations.rows.T @ equations.weights) > 0
    rms = float(np.sqrt(np.average(left**2, weights=equations.weights)))
    return _Channel(found, errors, _told(errors, _VALUES[seen], middle), rms)


def _rows(values: Float[np.ndarray, "measurement"]) -> sparse.csr_array:
    """Interpolate g at stored values, on the scale on which it is smooth."""
    places = np.log(values / (1 + _ABOVE - values))
    place = np.interp(places, _PLACES, np.arange(_KNOTS))
    below = np.minimum(place.astype(int), _KNOTS - 2)
    part, at = place - below, np.arange(len(values))
    ends = np.concatenate([below, below + 1])
    entries = (np.concatenate([1 - part, part]), (np.concatenate([at, at]), ends))
    return sparse.csr_array(entries, shape=(len(values), _KNOTS))


def _linearised(
    measured: Measurements,
    found: Float[np.ndarray, "entry"],
    expected: Float[np.ndarray, "measurement"],
    noise: SensorNoise,
) -> _Equations:
    """Make the equations of a step of Gauss and Newton, from the curve and the radiances found.

    Noise is in the stored value v alone, beside the value w that curve and radiance foretell:

        g(w) - e = ln t - g'(w) (v - w),

    to first order.  Rows at v itself would bend the curve where noise is more than it is straight.
    """
    values = (1 + _ABOVE) / (1 + np.exp(-np.interp(expected, found, _PLACES)))
    radiance, slope = np.exp(found), np.gradient(found, _VALUES)
    photons = (noise.photon * radiance + noise.read**2) / radiance**2
    variance = photons + (slope * noise.step) ** 2 / 12
    slopes, variances = (np.interp(values, _VALUES, one) for one in (slope, variance))
    # Beyond these the scale cuts off noise, or nothing is foretold.
    inside = (expected > found[0]) & (expected + _REACH * np.sqrt(variances) < found[-2])
    left = slopes * (measured.value - values)
    weights = np.where(inside, 1 / variances, 0)
    # How many times the noise's variance there is, whatever the outliers do.
    share = weights / np.maximum(np.bincount(measured.pixel, weights)[measured.pixel], 1e-300)
    scaled = np.abs(left) * np.sqrt(weights / np.maximum(1 - share, 0.05))
    excess = float(np.median(scaled[inside & (share < 0.95)]) / _MEDIAN_ABSOLUTE) ** 2
    weights = weights / max(excess, _LEAST_EXCESS)
    # Outliers, such as what moved, count less: as little as at four standard deviations.
    scaled = np.abs(left) * np.sqrt(weights)
    weights = weights * np.minimum(1, _OUTLIER / np.maximum(scaled, 1e-300)) ** 2
    return _Equations(_rows(values), measured.exposure - left, weights, measured.pixel)


def _normal_equations(equations: _Equations):
    """Eliminate the pixels' radiances; the third result is the weighted mean of each pixel."""
    rows, right, weights, pixel = equations
    count = int(pixel[-1]) + 1
    total = np.maximum(np.bincount(pixel, weights, count), 1e-300)

    def mean(residuals: np.ndarray) -> np.ndarray:
        return (np.bincount(pixel, weights * residuals, count) / total)[pixel]

    weighted = rows.multiply(weights[:, None]).tocsr()
    ones = (np.ones(len(weights)), (pixel, np.arange(len(weights))))
    sums = (sparse.csr_array(ones, shape=(count, len(weights))) @ weighted).tocsr()
    scaled = sums.multiply(1 / total[:, None]).tocsr()
    normal = np.asarray((rows.T @ weighted - sums.T @ scaled).todense())
    push = rows.T @ (weights * (right - mean(right)))
    return (normal + normal.T) / 2, np.asarray(push), mean


def _curvature() -> Float[np.ndarray, "entry entry"]:
    """Make the integral of the squared second derivative by ln(v / (1.1 - v))."""
    steps = np.diff(_PLACES)
    slopes = np.diff(np.eye(_KNOTS), axis=0) / steps[:, None]
    between = (steps[1:] + steps[:-1]) / 2
    second = np.diff(slopes, axis=0) / between[:, None]
    return second.T @ (between[:, None] * second)


def _solved(matrix: np.ndarray, right: np.ndarray, increasing: bool) -> np.ndarray:
    """Solve with 0 at full scale; where steps would fall, with all of them at least 0."""
    found = np.append(np.linalg.solve(matrix[:-1, :-1], right[:-1]), 0.0)
    if (np.diff(found) > _LEAST_STEP).all():
        return found
    if not increasing:
        entry = int(np.argmax(np.diff(found) <= _LEAST_STEP))
        raise ValueError(
            f"the free response does not increase at value {_VALUES[entry]:.3g}: ask for an "
            "increasing one, or give more exposures"
        )
    # g(v) is minus the sum of the steps from v up.
    steps = -np.triu(np.ones((_KNOTS - 1, _KNOTS - 1)))
    own = steps.T @ matrix[:-1, :-1] @ steps
    push = steps.T @ right[:-1] - own @ np.full(_KNOTS - 1, _LEAST_STEP)
    factor = np.linalg.cholesky(own + 1e-12 * np.trace(own) / len(own) * np.eye(len(own)))
    rise, _ = nnls(factor.T, np.linalg.solve(factor, push), maxiter=30 * _KNOTS)
    return np.append(steps @ (rise + _LEAST_STEP), 0.0)


def _covariance(
    equations: _Equations,
    cell: np.ndarray,
    normal: np.ndarray,
    penalty: np.ndarray,
    left: np.ndarray,
) -> Float[np.ndarray, "entry entry"]:
    """Sum the scores over the cells of the picture, and the prior's part with them."""
    scores = equations.rows.multiply((equations.weights * left)[:, None]).tocsr()
    ones = (np.ones(len(left)), (cell, np.arange(len(left))))
    cells = sparse.csr_array(ones, shape=(int(cell.max()) + 1, len(left)))
    sums = np.asarray((cells @ scores).todense())[:, :-1]
    inverse = np.linalg.inv((normal + penalty)[:-1, :-1])
    inner = np.maximum(len(sums) / max(len(sums) - 1, 1), 1) * (sums.T @ sums)
    covariance = np.zeros_like(normal)
    covariance[:-1, :-1] = inverse @ (inner + penalty[:-1, :-1]) @ inverse
    return covariance


def _told(errors: np.ndarray, seen: np.ndarray, middle: int) -> Bool[np.ndarray, "entry"]:
    """Mark the entries around the best known one that are known, without a gap."""
    known = errors < _TOLD
    known &= (seen.min() - _BEYOND <= _VALUES) & (seen.max() + _BEYOND >= _VALUES)
    gaps = np.flatnonzero(~known)
    below, above = gaps[gaps < middle], gaps[gaps > middle]
    told = np.zeros(_KNOTS, bool)
    told[(below.max() + 1 if len(below) else 0) : (above.min() if len(above) else _KNOTS)] = True
    return told & known


def _joined(channels: list[_Channel]) -> RecoveredResponse:
    """Put the channels together: as one curve where they are alike."""
    told = np.logical_and.reduce([one.told for one in channels])
    if told.sum() < 2:
        raise ValueError(
            "the photographs tell no part of the response: take more exposures, one or two stops "
            "apart, of a scene with all brightnesses"
        )
    values = _VALUES[told]
    logarithms = np.stack([one.logarithms[told] for one in channels], axis=-1)
    errors = np.stack([one.errors[told] for one in channels], axis=-1)
    rms = float(np.sqrt(np.mean([one.rms**2 for one in channels])))
    precision = 1 / np.maximum(errors, _LEAST_ERROR) ** 2
    shapes = logarithms - logarithms[int(np.argmin(errors.sum(axis=-1)))]
    mean = np.average(shapes, axis=-1, weights=precision)
    if (np.abs(shapes - mean[:, None]) * np.sqrt(precision) <= _ALIKE).all():
        radiance = np.exp(mean + np.mean(logarithms - shapes))
        errors = 1 / np.sqrt(precision.sum(axis=-1, keepdims=True))
    else:
        radiance = np.exp(logarithms)
    if radiance[0].max() <= _BLACK_RADIANCE:
        # What is below is 0 to a part of full scale that no picture shows.
        values, radiance = np.append(0, values), np.append(0 * radiance[:1], radiance, axis=0)
        errors = np.append(np.full_like(errors[:1], np.inf), errors, axis=0)
    return RecoveredResponse(Curve(values, radiance), errors, rms)
