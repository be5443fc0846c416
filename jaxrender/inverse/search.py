"""The search for the numbers that are not linear: from many starts, on as few samples as will do.

Among many samples a search begins with part of them, and takes its last steps on condensed columns,
which stand for all.  Every step solves for the amplitudes (:mod:`jaxrender.inverse.elimination`).
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.elimination import (
    Data,
    Few,
    Fit,
    Objective,
    Problem,
    condense,
    condensed_residuals,
    residuals,
)
from jaxrender.inverse.models import LinearisedModel, Model
from jaxrender.inverse.solvers import least_squares, simplex
from jaxrender.programs import stored
from jaxrender.shapes import Array, Float

_OURS = "variable-projection"
METHODS = {_OURS: least_squares, "simplex": simplex}

# From so many samples on, a search begins with one in so many of them.  The others then move the
# answer by a few of its standard errors: a distance at which the model is all but linear.
MANY, THINNING = 4000, 12
# The last steps: at most so many, until none moves a search variable by more than this (what the
# next would do is of the order of its square), and to a cost not above what was promised by more
# than this part.
_LAST_STEPS, _SETTLED, _BROKEN_PROMISE = 4, 0.01, 0.01
# Searches that end closer than this in every variable have found the same minimum.
_SAME_PLACE = 0.05


def search(
    problem: Problem,
    model: Model,
    data: Data,
    starts: Float[np.ndarray, "start unknown"],
    method: str = _OURS,
    few: Few | None = None,
) -> Fit:
    """Search from every start, and compare where they end on all samples.

    Of many samples each search begins with ``few``, or else with one in twelve.  Raises
    ``ValueError`` for a method that is not in ``METHODS``.
    """
    if method not in METHODS:
        raise ValueError(f"method={method!r}: choose one of {', '.join(METHODS)}")
    if method != _OURS or problem.unknowns.free_gains:
        return _best(problem, model, data, starts, method)
    if isinstance(model, LinearisedModel):
        # Nothing is lost by condensing once and for all, and one compiled search serves any number
        # of samples.
        near, near_data = condense(model, data)
        return _evaluate(problem, model, data, _best(problem, near, near_data, starts))
    if data.radiance.shape[0] < MANY:
        return _best(problem, model, data, starts)
    part, thinning = (model, data), THINNING
    if few is not None:
        part, thinning = few.of(model, data), 1
    ends = [_search(problem, *part, s, method, thinning).solution.point for s in starts]
    return _lowest(
        [
            _settle(problem, model, data, end) or _search(problem, model, data, end, method, 1)
            for end in _distinct(ends)
        ]
    )


def _best(
    problem: Problem,
    model: Model,
    data: Data,
    starts: Float[np.ndarray, "start unknown"],
    method: str = _OURS,
) -> Fit:
    """Search from every start among all samples."""
    # One after the other: a batched search compiles for ten seconds to save a few milliseconds.
    return _lowest([_search(problem, model, data, s, method, 1) for s in starts])


def _distinct(ends: list[Float[Array, "unknown"]]) -> list[Float[Array, "unknown"]]:
    """Keep one of all searches that ended in the same place."""
    kept = []
    for end in ends:
        if not any(np.all(np.abs(np.subtract(end, other)) < _SAME_PLACE) for other in kept):
            kept.append(end)
    return kept


def _lowest(found: list[Fit]) -> Fit:
    """Pick the fit of the lowest finite cost."""
    if len(found) == 1:
        return found[0]
    costs = np.array([float(fit.solution.cost) for fit in found])
    return found[int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))]


def _settle(
    problem: Problem, model: Model, data: Data, point: Float[Array, "unknown"]
) -> Fit | None:
    """Take the last steps from where a part of the samples led, each solved on condensed columns.

    One pass over the samples makes up for a whole search among them.  None where that does not
    settle, or ends higher than the columns promised.
    """
    for _ in range(_LAST_STEPS):
        few, few_data = _condense_about(problem, model, data, point)
        fit = _search(problem, few, few_data, point, _OURS, 1)
        moved = np.abs(np.asarray(fit.solution.point) - np.asarray(point))
        point = fit.solution.point
        if not np.all(moved < _SETTLED):
            continue
        settled = _evaluate(problem, model, data, fit)
        promised = (1 + _BROKEN_PROMISE) * float(fit.solution.cost)
        return settled if float(settled.solution.cost) <= promised else None
    return None


@stored(jax.jit, effort="more")
def _condense_about(
    problem: Problem, model: Model, data: Data, point: Float[Array, "unknown"]
) -> tuple[LinearisedModel, Data]:
    physical, free = problem.unknowns.unpack(point), problem.unknowns.free_numbers
    with jax.default_matmul_precision("highest"):
        return condense(LinearisedModel.about(model, physical.numbers, free), data)


@stored(jax.jit, effort="less")
def _evaluate(problem: Problem, model: Model, data: Data, fit: Fit) -> Fit:
    """Say what a model predicts, and the cost, where a fit on condensed columns ended."""
    predicted = problem.predict(model, data, fit.solution.point, fit.linear)
    physical = problem.unknowns.unpack(fit.solution.point)
    cost = problem.cost(data, predicted, physical, fit.linear)
    return Fit(fit.solution._replace(cost=cost), fit.linear, predicted)


# Everything passed is arrays and static fields, so that plain jit will do; a call of it costs a
# tenth of filter_jit's, of which a warm search would else be half.  No argument has a default: one
# that is left out would make another program than one that is stated.
@stored(partial(jax.jit, static_argnames=("method", "thinning")), effort="more")
def _search(
    problem: Problem,
    model: Model,
    data: Data,
    start: Float[Array, "unknown"],
    method: str,
    thinning: int,
) -> Fit:
    if thinning > 1:
        every = slice(None, None, thinning)
        model, data = model.take(every), Data(*(jnp.asarray(a)[every] for a in data))
    scaled, scaled_data = problem.in_own_units(data)
    objective = Objective(scaled, model, scaled_data)
    with jax.default_matmul_precision("highest"):
        # Gains differ between photographs, so then no few samples can stand for all.  A linearised
        # model comes condensed.
        condensable = method == _OURS and not problem.unknowns.free_gains
        condensable = condensable and not isinstance(model, LinearisedModel)
        minimised = condensed_residuals if condensable else residuals
        solution = METHODS[method](minimised, start, objective, has_aux=True)
        linear, predicted = solution.aux
        physical = problem.unknowns.unpack(solution.point)
        cost = problem.cost(data, predicted, physical, linear)
        converged = solution.converged & jnp.isfinite(cost)
        solution = solution._replace(cost=cost, converged=converged, aux=None)
    return Fit(solution, linear, predicted)
