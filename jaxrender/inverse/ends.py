"""How far from its end a number may lie that a fit has put there: a share of 0, or of 1.

At an end the search variable no longer moves the number, so that a covariance of search variables
knows no error of it.  Near by, the data say exp(-(t - m)^2 / 2 s^2) of its distance t from the end,
where m is not above 0 (the data would have it beyond) and t is not below 0.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from jaxrender.inverse.elimination import Data, Fit, Problem
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.parameters import weighted_jacobian
from jaxrender.inverse.unknowns import Physical
from jaxrender.shapes import Array, Bool, Float

# The part of what is possible that an interval of 90 % leaves out on one side.
_BEYOND = 0.1


class AtEnd(NamedTuple):
    """A number at an end, ``whole`` away from the other one.

    ``moves`` is how a step inwards moves each weighted residual, as the other unknowns cannot, and
    ``left`` are the residuals.
    """

    moves: Float[np.ndarray, "value"]
    left: Float[np.ndarray, "value"]
    whole: float

    def within(self, variance: Float[np.ndarray, "value"]) -> float:
        """Say how far from the end the number lies with a probability of 90 %.

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


def numbers_at_ends(
    problem: Problem,
    model: LinearisedModel,
    data: Data,
    fit: Fit,
    held: Bool[np.ndarray, "all"],
) -> Mapping[str, AtEnd]:
    """Look at each closed number that is at an end; ``held`` marks the unknowns at a bound."""
    unknowns, point = problem.unknowns, jnp.asarray(fit.solution.point)
    closed = {one.name for one in unknowns.searched if one.closed}
    at_end = [name for name, at in zip(unknowns.names, held) if at and name in closed]
    if not at_end:
        return {}
    physical = unknowns.unpack(point)
    jacobian = weighted_jacobian(problem, model, data, point, fit.linear.eliminated)
    jacobian = np.asarray(jacobian, float)[:, ~held]
    weights = np.asarray(data.weights, float)
    left = (weights * (np.asarray(data.radiance) - np.asarray(fit.predicted))).ravel()
    found = {}
    for name in at_end:

        def predicted(value: Float[Array, ""], name: str = name) -> Float[Array, "sample channel"]:
            moved = Physical({**physical.numbers, name: value}, physical.gains)
            return problem.columns(model, data, moved).times(fit.linear.amplitudes)

        value = physical.numbers[name]
        slope = jax.jvp(predicted, (value,), (jnp.ones_like(value),))[1]
        moves = (weights * np.asarray(slope, float)).ravel()
        moves = moves - jacobian @ np.linalg.lstsq(jacobian, moves, rcond=None)[0]
        lower, upper = unknowns[name].lower, unknowns[name].upper
        inwards = 1.0 if float(value) - lower < upper - float(value) else -1.0
        found[name] = AtEnd(inwards * moves, left, upper - lower)
    return found
