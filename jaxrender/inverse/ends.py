"""How far from its end an unknown may lie that a fit has put there: at a bound of its range.

At an end the search variable no longer moves the number, and an amplitude of 0 is held there, so
that a covariance knows no error of either.  Near by, the data say exp(-(t - m)^2 / 2 s^2) of the
distance t from the end, where m is not above 0 (the data would have it beyond) and t is not below
0.  The distance of an amplitude is in its own units, that of a number in the logarithm above its
origin, in which it is searched.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from jaxrender.inverse.elimination import Data, Fit, Problem
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.parameters import Parameters, weighted_jacobian
from jaxrender.inverse.unknowns import Physical
from jaxrender.shapes import Array, Bool, Float

# The part of what is possible that an interval of 90 % leaves out on one side.
_BEYOND = 0.1


class AtEnd(NamedTuple):
    """An unknown at an end, ``whole`` away from the other one.

    ``moves`` is how a step inwards moves each weighted residual, as the other unknowns cannot, and
    ``left`` are the residuals.  ``unit`` is what a short step of 1 is in the unknown's own units.
    """

    moves: Float[np.ndarray, "value"]
    left: Float[np.ndarray, "value"]
    whole: float
    unit: float = 1.0

    def within(self, variance: Float[np.ndarray, "value"]) -> float:
        """Say how far from the end the unknown lies with a probability of 90 %.

        ``variance`` is that of each residual.
        """
        squares = float(self.moves @ self.moves)
        if squares <= 0:
            return self.whole
        mean = min(float(self.moves @ self.left) / squares, 0.0)
        deviation = np.sqrt(float(self.moves @ (variance * self.moves))) / squares
        low, high = -mean / deviation, (self.whole - mean) / deviation
        # By the survival function: far out in the tail the other has no digits left.
        beyond, outside = scipy.stats.norm.sf(low), scipy.stats.norm.sf(high)
        if beyond <= 0:
            return float(min(-np.log(_BEYOND) * deviation / low, self.whole))
        quantile = scipy.stats.norm.isf(outside + _BEYOND * (beyond - outside))
        return float(np.clip(mean + deviation * quantile, 0, self.whole))


def unknowns_at_ends(
    problem: Problem,
    model: LinearisedModel,
    data: Data,
    fit: Fit,
    held: Bool[np.ndarray, "all"],
    value: Parameters,
) -> Mapping[str, AtEnd]:
    """Look at each number and amplitude that is at an end, by its label in ``value``.

    ``held`` marks the unknowns at a bound.  An amplitude that stands in for others is left out:
    only their sum means anything, and that has no end.
    """
    if not held.any():
        return {}
    point = jnp.asarray(fit.solution.point)
    jacobian = weighted_jacobian(problem, model, data, point, fit.linear.eliminated)
    jacobian = np.asarray(jacobian, float)
    weights = np.asarray(data.weights, float)
    left = (weights * (np.asarray(data.radiance) - np.asarray(fit.predicted))).ravel()
    basis = np.linalg.qr(jacobian[:, ~held])[0]

    def at_end(moves: Float[np.ndarray, "value"], whole: float, unit: float) -> AtEnd:
        return AtEnd(moves - basis @ (basis.T @ moves), left, whole, unit)

    found = {}
    for name, at in zip(problem.unknowns.free_numbers, held):
        if at:
            found[name] = at_end(*_of_number(problem, model, data, fit, name))
    all_light = float(np.linalg.norm(weights * np.asarray(data.radiance, float)))
    for column in map(int, np.flatnonzero(held[len(point) :])):
        labels, moves = _labels(problem, value, column), jacobian[:, len(point) + column]
        size = float(np.linalg.norm(moves))
        if labels and size > 0:
            # By itself it sends no more light than there is.
            lower, upper = float(problem.lower[column]), float(problem.upper[column])
            inwards = 1.0 if float(fit.linear.eliminated[column]) <= lower else -1.0
            whole = min(all_light / size, upper - lower)
            one = at_end(inwards * moves, whole, 1 / float(value.scale))
            found |= dict.fromkeys(labels, one)
    return found


def _of_number(
    problem: Problem, model: LinearisedModel, data: Data, fit: Fit, name: str
) -> tuple[Float[np.ndarray, "value"], float, float]:
    """Say how a step inwards moves the residuals, how long the range is, and what a step is."""
    unknowns = problem.unknowns
    physical = unknowns.unpack(jnp.asarray(fit.solution.point))
    value, origin = physical.numbers[name], unknowns.origins[name]

    def predicted(value: Float[Array, ""]) -> Float[Array, "sample channel"]:
        moved = Physical({**physical.numbers, name: value}, physical.gains)
        return problem.columns(model, data, moved).times(fit.linear.amplitudes)

    slope = jax.jvp(predicted, (value,), (jnp.ones_like(value),))[1]
    lower, upper = unknowns[name].lower, unknowns[name].upper
    above = float(value) - origin
    inwards = 1.0 if float(value) - lower < upper - float(value) else -1.0
    moves = inwards * above * (np.asarray(data.weights, float) * np.asarray(slope, float)).ravel()
    return moves, float(np.log((upper - origin) / (lower - origin))), above


def _labels(problem: Problem, value: Parameters, column: int) -> list[str]:
    """Name the amplitudes of the channels that a linear unknown is, but not what is only summed."""
    unknowns, mix = problem.unknowns, np.asarray(problem.mix)[:, column]
    channels = len(mix) // len(unknowns.amplitudes)
    own = [divmod(int(row), channels) for row in np.flatnonzero(mix)]
    names = unknowns.amplitude_names
    labels = [f"{names[at]}[{k}]" for at, k in own if names[at] not in unknowns.summed]
    known = set(value.labels)
    return [label for label in labels if label in known]
