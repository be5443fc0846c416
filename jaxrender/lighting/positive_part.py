"""Light that is nowhere negative, from coefficients that were measured.

A sum of few degrees dips below zero where the light is dark.  Cutting that off adds radiance, a
tenth or a fifth of the mean, and every diffuse body lit by it comes out too bright.  Instead

    minimise |x - x_0|^2 / mean^2 + sum_lm ((x_lm - c_lm) / e_lm)^2  over x >= 0

where x_0 is the sum and e_lm are the standard errors of its coefficients c_lm.  The minimum is the
positive part of another sum of the same degrees: its coefficients are those of the dual problem,
which is smooth, convex, and small enough for Newton's method.

Where sources were found beside slow light, the coefficients of both together are known best.  If a
source is too bright, slow light is negative around it.  So a source is one more texel of x, as
large as the patch in which nobody could tell it from slow light.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import LatLongGrid, band_limit_of, real_basis, synthesise
from jaxrender.lighting.directional import DirectionalSources
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
    return coefficients + _added(coefficients, coefficients, errors, _texels(coefficients))


@checked
def positive_light(
    coefficients: Float[np.ndarray, "coefficient channel"],
    sources: DirectionalSources,
    errors: Float[np.ndarray, "coefficient channel"],
    rows: int,
    solid_angle: float,
) -> tuple[Environment, DirectionalSources]:
    """Make slow light, and sources beside it, nowhere negative: an image, and the same sources.

    ``errors`` are those of the coefficients of both together, and ``solid_angle`` is that of the
    patch in which a source is not told from slow light (sr).
    """
    directions = np.asarray(sources.directions, float)
    energies = np.asarray(sources.irradiance, float)
    towards = np.asarray(real_basis(directions, band_limit_of(len(coefficients))))
    # The coefficients are known so well that those of another grid would be out by many errors.
    texels, count = _texels(coefficients, rows), len(directions)
    nodes = _Nodes(
        np.concatenate([texels.basis, towards]),
        np.concatenate([texels.weights, np.full(count, solid_angle)]),
        np.concatenate([texels.basis @ coefficients, energies / solid_angle]),
    )
    added = _added(coefficients, coefficients + towards.T @ energies, errors, nodes)
    image = synthesise(LatLongGrid(rows, 2 * rows), jnp.asarray(coefficients + added))
    kept = np.maximum(energies + solid_angle * towards @ added, 0)
    return Environment(np.maximum(np.asarray(image), 0)), DirectionalSources(directions, kept)


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


class _Nodes(NamedTuple):
    """Where radiance is kept positive: harmonics, solid angles, and the radiance to begin with."""

    basis: Float[np.ndarray, "node coefficient"]
    weights: Float[np.ndarray, "node"]
    radiance: Float[np.ndarray, "node channel"]


def _texels(coefficients: Float[np.ndarray, "coefficient channel"], rows: int = 0) -> _Nodes:
    """Lay out the texels of a grid, of as many rows as the light needs if nothing is said."""
    limit = band_limit_of(len(coefficients))
    rows = rows or max(_FEWEST_ROWS, _ROWS_PER_DEGREE * limit)
    grid = LatLongGrid(rows, 2 * rows)
    basis = np.asarray(real_basis(grid.directions().reshape(-1, 3), limit))
    return _Nodes(basis, grid.weights().reshape(-1), basis @ coefficients)


def _added(
    coefficients: Float[np.ndarray, "coefficient channel"],
    wanted: Float[np.ndarray, "coefficient channel"],
    errors: Float[np.ndarray, "coefficient channel"],
    nodes: _Nodes,
) -> Float[np.ndarray, "coefficient channel"]:
    """Find what to add to the coefficients so that the positive part has those wanted."""
    found = np.zeros_like(coefficients)
    # Channels are alike: what one needed is where the next one begins.
    relative = found[:, 0]
    for channel in range(coefficients.shape[1]):
        level = abs(float(wanted[0, channel]))
        if level > 0:
            relative = _of_one_channel(
                nodes._replace(radiance=nodes.radiance[:, channel] / level),
                wanted[:, channel] / level,
                (errors[:, channel] / level) ** 2,
                relative,
            )
            found[:, channel] = level * relative
    return found


def _of_one_channel(
    nodes: _Nodes,
    wanted: Float[np.ndarray, "coefficient"],
    variance: Float[np.ndarray, "coefficient"],
    added: Float[np.ndarray, "coefficient"],
) -> Float[np.ndarray, "coefficient"]:
    """Maximise the dual from a start: its variables are what is added to the coefficients."""
    basis, weights, start = nodes
    # Of a curvature half the digits are enough, and take half the time.
    rough = basis.astype(np.float32)

    def dual(added: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        light = np.maximum(start + basis @ added, 0)
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
