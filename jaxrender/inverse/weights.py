"""Robust losses as weights: least squares again, with outliers counted less each round.

A loss rho is minimised by iteratively reweighted least squares with weights psi(r) / r; the factors
here are their square roots, which multiply the residuals.
"""

import numpy as np

from jaxrender.shapes import Float

# At these constants each loss keeps 95 % of the efficiency of least squares on Gaussian noise.
_HUBER = 1.345
_CAUCHY = 2.385


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
