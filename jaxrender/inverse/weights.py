"""Noise and robust losses as weights: what a fit leaves says how the next one weighs its samples.

A loss rho is minimised by iteratively reweighted least squares with weights psi(r) / r.  The
factors here are their square roots, which multiply the residuals.
"""

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.shapes import Float

# Noise is never taken to be less than this part of the mean radiance: exact data have none.
_LEAST_NOISE = 1e-6
# The noise has settled when its standard deviation changes by less than this part.
_NOISE_SETTLED = 0.02

# At these constants each loss keeps 95 % of the efficiency of least squares on Gaussian noise.
_HUBER = 1.345
_CAUCHY = 2.385


def deviations(
    noise: NoiseModel, predicted: Float[np.ndarray, "*any channel"], scale: float
) -> Float[np.ndarray, "*any channel"]:
    """Compute the standard deviations of the noise; ``scale`` is the mean radiance.

    They are those at the predicted radiance: the measured radiance would favour dark noise.
    """
    deviation = np.asarray(noise.standard_deviation(np.maximum(predicted, 0)))
    return np.hypot(deviation, _LEAST_NOISE * scale)


def standard_deviations(
    noise: NoiseModel, predicted: Float[np.ndarray, "*any channel"]
) -> Float[np.ndarray, "*any channel"]:
    """Compute the same of predictions by themselves, whose root mean square is the scale."""
    return deviations(noise, predicted, float(np.sqrt(np.mean(predicted**2))))


def with_misfit(noise: NoiseModel, predicted: Float[np.ndarray, "*any channel"]) -> NoiseModel:
    """Give a noise that is mostly what a model misses a floor in the dark.

    A model that is only near the truth misses a part of the radiance, and of what is typical where
    it is darker than that.  Weighed by what it misses of most pixels alone, which are dark, a
    highlight would count as little as each of them.
    """
    typical = float(np.sqrt(np.mean(predicted**2)))
    return NoiseModel(noise.relative, max(noise.floor, noise.relative * typical))


def noise_settled(
    before: NoiseModel, after: NoiseModel, predicted: Float[np.ndarray, "sample channel"]
) -> bool:
    """Say whether two rounds of a fit have found the same noise, to two per cent."""
    level = np.sqrt(np.mean(predicted**2, keepdims=True))
    one, other = (float(noise.standard_deviation(level).item()) for noise in (before, after))
    return bool(abs(np.log(max(one, 1e-300) / max(other, 1e-300))) < _NOISE_SETTLED)


def _squares(residuals: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    return np.ones_like(residuals)


def _huber(residuals: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    return np.sqrt(np.minimum(1, _HUBER / np.maximum(np.abs(residuals), _HUBER)))


def _cauchy(residuals: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    return 1 / np.sqrt(1 + (residuals / _CAUCHY) ** 2)


LOSSES = {"squares": _squares, "huber": _huber, "cauchy": _cauchy}


def robust_weights(
    residuals: Float[np.ndarray, "*batch"], loss: str
) -> Float[np.ndarray, "*batch"]:
    """Compute the factors for residuals in standard deviations; ``ValueError`` for other losses."""
    if loss not in LOSSES:
        raise ValueError(f"loss={loss!r}: choose one of {', '.join(LOSSES)}")
    return LOSSES[loss](residuals)


# Where nearly all residuals are outliers the noise is misjudged, and the slope says nothing.
_LEAST_SLOPE = 0.05
# Derivatives of psi(r) = r times the squared factor.
_SLOPES = {
    "squares": np.ones_like,
    "huber": lambda r: (np.abs(r) <= _HUBER).astype(float),
    "cauchy": lambda r: (1 - (r / _CAUCHY) ** 2) / (1 + (r / _CAUCHY) ** 2) ** 2,
}


def variance_factor(residuals: Float[np.ndarray, "*batch"], loss: str) -> float:
    """Compute the variance of a robust estimate over that of weighted least squares.

    The estimate's covariance is that of unweighted least squares times E[psi^2] / E[psi']^2 (Huber
    1964).  The weighted sums give E[psi r] / E[psi / r] in its place.  For Gaussian noise under
    Huber's loss their standard error is a tenth too small.  Residuals in standard deviations.
    """
    squared = robust_weights(residuals, loss) ** 2
    psi = squared * residuals
    slope = float(np.mean(_SLOPES[loss](residuals)))
    stated = float(np.mean(psi * residuals)) / float(np.mean(squared))
    if stated == 0:  # exact data: nothing to correct
        return 1.0
    return float(np.mean(psi**2)) / max(slope, _LEAST_SLOPE) ** 2 / stated
