"""The noise of a measured radiance: a part proportional to it, and a floor.

    standard deviation(L)^2 = (relative L)^2 + floor^2

The relative part stands for what is wrong with the model or the calibration, the floor for readout
and quantisation.  ``estimate_noise`` reads both off the residuals of a fit.
"""

import math
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import truncnorm

from jaxrender.shapes import AnyArray, checked

# Residuals beyond this many standard deviations are outliers.  At 3.5 a Gaussian sample loses
# 0.05 % of its values, which _KEPT_VARIANCE makes up for.
_CUT = 3.5
_KEPT_VARIANCE = float(np.asarray(truncnorm.var(-_CUT, _CUT)))
_MIN_SAMPLES = 10
_BINS = 16
_MAX_SWEEPS = 100
_CONVERGED = 1e-6
# Median absolute deviation of a standard Gaussian.
_MEDIAN_ABSOLUTE = 0.6744897501960817
# Least variance of a sample, as part of the mean squared residual: it keeps one dark pixel from
# outweighing all others when the floor is 0.
_LEAST_VARIANCE = 1e-12


class NoiseModel(eqx.Module):
    """Gaussian noise of standard deviation sqrt((relative L)^2 + floor^2)."""

    relative: float
    floor: float

    def __check_init__(self):
        for name, value in (("relative", self.relative), ("floor", self.floor)):
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"noise {name} is {value}: give a finite number, 0 or more")

    @checked
    def standard_deviation(self, radiance: Float[AnyArray, "*batch"]) -> Float[AnyArray, "*batch"]:
        """Of each radiance, in its units; works on NumPy and JAX arrays alike."""
        return ((self.relative * radiance) ** 2 + self.floor**2) ** 0.5

    @checked
    def add(
        self, radiance: Float[np.ndarray, "*batch"], rng: np.random.Generator
    ) -> Float[np.ndarray, "*batch"]:
        """The radiance as one noisy measurement of it; negative results are kept."""
        return radiance + self.standard_deviation(radiance) * rng.standard_normal(radiance.shape)


class _Variances(NamedTuple):
    """relative^2 and floor^2."""

    relative: float
    floor: float


@checked
def estimate_noise(
    residuals: Float[np.ndarray, "*batch"] | Float[Array, "*batch"],
    predictions: Float[np.ndarray, "*batch"] | Float[Array, "*batch"],
    least: float = 0.0,
) -> NoiseModel:
    """Maximum likelihood of both parts under Gaussian residuals, with outliers cut.

    Minimises sum log v + r^2 / v over v = a p^2 + b, a >= 0, b >= 0 by Fisher scoring (weighted
    least squares of r^2 on (p^2, 1)), from median absolute deviations.  Each sweep leaves out
    residuals beyond 3.5 standard deviations and divides by the variance that a Gaussian so cut
    would keep.  The floor is ``least`` or more: what is known of it, such as the rounding of stored
    values, which neighbours may share.  Raises ValueError for fewer than ten or for non-finite
    samples.
    """
    residuals, predictions = (np.ravel(np.asarray(x, np.float64)) for x in (residuals, predictions))
    if len(residuals) < _MIN_SAMPLES:
        raise ValueError(f"{len(residuals)} residuals: a noise model needs {_MIN_SAMPLES} or more")
    if not (np.isfinite(residuals).all() and np.isfinite(predictions).all()):
        raise ValueError("residuals and predictions must be finite: mask invalid pixels first")
    squares = residuals**2
    if not squares.any():
        return NoiseModel(0.0, least)
    # Scaled to comparable sizes, so that the two-column problem below is well conditioned.
    scale = math.sqrt(np.mean(predictions**2)) or 1.0
    intensity = (predictions / scale) ** 2
    variances = _sweep(squares, intensity, _from_bins(np.abs(residuals), intensity))
    floor = max(math.sqrt(variances.floor), least)
    return NoiseModel(math.sqrt(variances.relative) / scale, floor)


def _sweep(squares: np.ndarray, intensity: np.ndarray, start: _Variances) -> _Variances:
    """Fisher scoring with the outliers chosen anew at each step."""
    least = _LEAST_VARIANCE * float(np.mean(squares))
    current = start
    for _ in range(_MAX_SWEEPS):
        variance = np.maximum(current.relative * intensity + current.floor, least)
        kept = squares <= _CUT**2 * variance
        if 2 * kept.sum() < len(kept):  # outliers are a minority, or the model is wrong: take all
            kept[:] = True
        target = squares[kept] / _KEPT_VARIANCE
        previous, current = current, _fit(target, intensity[kept], variance[kept] ** -2)
        change = max(abs(new - old) for new, old in zip(current, previous, strict=True))
        if change <= _CONVERGED * max(current):
            break
    return current


def _from_bins(magnitudes: np.ndarray, intensity: np.ndarray) -> _Variances:
    """A start that outliers cannot spoil, and too large rather than too small.

    The darkest samples' whole variance is taken for the floor, the brightest samples' for the
    relative part, by median absolute deviation.  Too small a part would cut its own evidence away
    as outliers, and never recover.
    """
    order = np.argsort(intensity)
    bins = np.array_split(order, min(_BINS, len(order) // 5))
    dark, bright = _robust_variance(magnitudes[bins[0]]), _robust_variance(magnitudes[bins[-1]])
    brightness = float(np.median(intensity[bins[-1]]))
    return _Variances(bright / brightness if brightness > 0 else 0.0, dark)


def _robust_variance(magnitudes: np.ndarray) -> float:
    """From the median; from the mean square where more than half of the residuals are 0."""
    deviation = np.median(magnitudes) / _MEDIAN_ABSOLUTE
    return float(deviation**2 or np.mean(magnitudes**2))


def _fit(target: np.ndarray, intensity: np.ndarray, weights: np.ndarray) -> _Variances:
    """Least squares of the target on (intensity, 1) with both coefficients non-negative."""
    weights = weights / weights.max()
    total, mean = weights.sum(), np.average(intensity, weights=weights)
    mean_target = np.average(target, weights=weights)
    spread = weights @ (intensity - mean) ** 2
    slope = weights @ ((intensity - mean) * target) / spread if spread > 0 else 0.0
    floor = mean_target - slope * mean
    if slope < 0:
        return _Variances(0.0, float(mean_target))
    if floor < 0:
        squared = spread + total * mean**2
        return _Variances(float(weights @ (intensity * target) / squared), 0.0)
    return _Variances(float(slope), float(floor))
