"""Light that is nowhere negative, from coefficients that were measured.

A sum of few degrees dips below zero where the light is dark.  Cutting that off adds radiance, a
tenth or a fifth of the mean, and every diffuse body lit by it comes out too bright.  Instead

    minimise |x - x_0|^2 / mean^2 + sum_lm ((x_lm - c_lm) / e_lm)^2  over x >= 0

where x_0 is the sum and e_lm are the standard errors of its coefficients c_lm.  The minimum is the
positive part of another sum of the same degrees: its coefficients are those of the dual problem,
which is smooth, convex, and small enough for Newton's method.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import LatLongGrid, band_limit_of, real_basis, synthesise
from jaxrender.lighting.environment import Environment
from jaxrender.shapes import Float, checked

# Rows of the grid on which radiance is kept positive, for each degree of the light.
_ROWS_PER_DEGREE, _FEWEST_ROWS = 5, 16
# The error of every coefficient in parts of the mean light where none is stated.
_ALIKE = 0.01
_MOST_STEPS, _SHORTEST = 40, 1e-6
# The misfit of a coefficient, in parts of the mean light, at which the search ends.
_TOLERANCE = 1e-7
# A step is taken if it brings this part of what its slope promises.
_SUFFICIENT = 1e-4


@checked
def positive_part_of(
    coefficients: Float[np.ndarray, "coefficient channel"],
    errors: Float[np.ndarray, "coefficient channel"] | None = None,
) -> Float[np.ndarray, "coefficient channel"]:
    """Find a sum of harmonics whose positive part has these coefficients within these errors.

    The light itself is ``max(synthesise(grid, result), 0)``.  A channel without light stays so.
    Without errors all coefficients count alike, as known to a hundredth of the mean light.
    """
    if errors is None:
        errors = np.tile(_ALIKE * np.abs(coefficients[0]), (len(coefficients), 1))
    limit = band_limit_of(len(coefficients))
    rows = max(_FEWEST_ROWS, _ROWS_PER_DEGREE * limit)
    grid = LatLongGrid(rows, 2 * rows)
    basis = np.asarray(real_basis(grid.directions().reshape(-1, 3), limit))
    weights = grid.weights().reshape(-1)
    found = np.zeros_like(coefficients)
    # Channels are alike: what one needed is where the next one begins.
    added = np.zeros(len(coefficients))
    for channel, (wanted, error) in enumerate(zip(coefficients.T, errors.T)):
        level = abs(float(wanted[0]))
        if level > 0:
            relative = wanted / level, (error / level) ** 2
            added = _of_one_channel(basis, weights, *relative, added)
            found[:, channel] = wanted + level * added
    return found


@checked
def positive_environment(
    coefficients: Float[np.ndarray, "coefficient channel"],
    errors: Float[np.ndarray, "coefficient channel"] | None,
    rows: int,
) -> Environment:
    """Draw the light that has these coefficients and is nowhere negative."""
    grid = LatLongGrid(rows, 2 * rows)
    series = positive_part_of(coefficients, errors)
    return Environment(np.maximum(np.asarray(synthesise(grid, jnp.asarray(series))), 0))


def _of_one_channel(
    basis: Float[np.ndarray, "texel coefficient"],
    weights: Float[np.ndarray, "texel"],
    wanted: Float[np.ndarray, "coefficient"],
    variance: Float[np.ndarray, "coefficient"],
    added: Float[np.ndarray, "coefficient"],
) -> Float[np.ndarray, "coefficient"]:
    """Maximise the dual from a start: its variables are what is added to the coefficients."""
    # Of a curvature half the digits are enough, and take half the time.
    rough = basis.astype(np.float32)

    def dual(added: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        light = np.maximum(basis @ (wanted + added), 0)
        slope = basis.T @ (weights * light) - wanted + variance * added
        value = weights @ light**2 / 2 - added @ wanted + variance @ added**2 / 2
        return float(value), slope, light > 0

    value, slope, lit = dual(added)
    for _ in range(_MOST_STEPS):
        seen = rough[lit] * np.sqrt(weights[lit, None]).astype(np.float32)
        curvature = (seen.T @ seen).astype(float) + np.diag(variance)
        # Where all is dark, coefficients without an error have no curvature.
        curvature[np.diag_indices_from(curvature)] += np.finfo(float).eps
        step, length = np.linalg.solve(curvature, -slope), 1.0
        while length > _SHORTEST:
            trial = dual(added + length * step)
            if trial[0] <= value + _SUFFICIENT * length * (slope @ step):
                break
            length /= 2
        added, (value, slope, lit) = added + length * step, trial
        if np.abs(slope).max() < _TOLERANCE or length <= _SHORTEST:
            break
    return added
