"""The search behind ``nearest_models``: one candidate, one metric, values at pairs of directions.

A point is the search variables of the model's own numbers (``unknowns``), then the amplitudes.
From each start of the numbers the amplitudes are those of least squares with weights that make
plain differences about those of the metric; the best start goes on by SciPy's ``least_squares``
within the bounds of the amplitudes, its derivatives from JAX.  Absolute errors are minimised as
those of a soft corner, far narrower than the errors are.
"""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from jaxrender.brdf import Parametric
from jaxrender.brdf.tables.measurements import Measurements, Metric, nearly_zero
from jaxrender.geometry import Components
from jaxrender.inverse.elimination import Data, Problem
from jaxrender.inverse.models import Columns, Numbers, Rows
from jaxrender.inverse.search import search
from jaxrender.inverse.unknowns import unknowns_of
from jaxrender.shapes import AnyArray, Array, Bool, Float

_MOST_STEPS = 200
# Of a soft corner: this part of the typical error.
_CORNER = 0.05
# Directions in which the pairs say less than this part of the most are not told by them.
_UNTOLD = 1e-9
# Amplitudes below this part of the largest are zero.
_AT_ZERO = 1e-5
_TWO_SIDED_95 = 1.959964


class Found(NamedTuple):
    """Where a search stopped, and whether it may."""

    point: Float[np.ndarray, "unknown"]
    converged: bool


class Spread(NamedTuple):
    """Standard errors, and ends of intervals of 95 %, in the model's own units."""

    amplitudes: Float[np.ndarray, "lobe channel"]
    numbers: dict[str, float]
    amplitude_intervals: Float[np.ndarray, "lobe channel 2"]
    number_intervals: dict[str, list[float]]


class _Pairs(eqx.Module):
    """The forward model: a BRDF's lobes at pairs of directions."""

    variant: Parametric
    incoming: Float[AnyArray, "sample 3"]
    outgoing: Float[AnyArray, "sample 3"]
    channels: int = eqx.field(static=True)

    def columns(self, numbers: Numbers) -> Columns:
        """Evaluate each lobe in 1/sr."""
        incoming, outgoing = (Components.of(w) for w in (self.incoming, self.outgoing))
        lobes = self.variant.with_numbers(numbers).transfer(incoming, outgoing)
        shape = (len(self.incoming), self.channels)
        values = (jnp.broadcast_to((lobe / incoming.z)[:, None], shape) for lobe in lobes)
        return Columns(*values, shaped=self.variant.shaped())

    def take(self, index: Rows) -> "_Pairs":
        """Keep the pairs of the given indices."""
        pairs = self.incoming[index], self.outgoing[index]
        return _Pairs(self.variant, *pairs, self.channels)


class _Wanted(NamedTuple):
    """Values and weights [sample, channel], cosines [sample, 1], and two numbers."""

    values: Float[Array, "sample channel"]
    weights: Float[Array, "sample channel"]
    cosine: Float[Array, "sample 1"]
    least: Float[Array, ""]
    scale: Float[Array, ""]


@dataclasses.dataclass(frozen=True)
class Objective:
    """A candidate, the values it is to be near to, and in what sense."""

    model: _Pairs
    problem: Problem
    data: Data
    cosine: Float[np.ndarray, "sample 1"]
    metric: Metric
    least: float
    scale: float

    @classmethod
    def of(cls, variant: Parametric, measured: Measurements, metric: Metric) -> "Objective":
        """Lay out the unknowns of a candidate whose amplitudes have all channels of their own."""
        channels, valid = measured.values.shape[1], measured.valid
        unknowns = unknowns_of(variant, ks_per_channel=True, expected=False)
        values = np.where(valid, measured.values, 0)
        data = Data(values, valid.astype(float), np.zeros(len(values), int))
        model = _Pairs(variant, measured.incoming, measured.outgoing, channels)
        cosine, least = measured.incoming[:, 2:], nearly_zero(values)
        wanted = np.asarray(metric.of(values, cosine, least))
        scale = float(np.sqrt(np.sum(valid * wanted**2)))
        return cls(model, Problem.of(unknowns, channels), data, cosine, metric, least, scale)

    @property
    def variant(self) -> Parametric:
        """The candidate."""
        return self.model.variant

    @property
    def searched(self) -> int:
        """How many search variables come before the amplitudes."""
        return len(self.problem.unknowns.names)

    def weighted(self, kept: Bool[np.ndarray, "sample"]) -> "Objective":
        """Give the other pairs no weight; no program is compiled anew for it."""
        weights = np.asarray(self.data.weights) * kept[:, None]
        return dataclasses.replace(self, data=self.data._replace(weights=weights))

    def predicted(self, point: Float[np.ndarray, "unknown"]) -> Float[np.ndarray, "sample channel"]:
        """Evaluate the candidate in 1/sr."""
        return np.asarray(_predicted(self.model, self.problem, jnp.asarray(point)))

    def residuals(self, point: Float[np.ndarray, "unknown"]) -> Float[np.ndarray, "residual"]:
        """Take differences as the metric counts them, of all values together of order 1."""
        return np.asarray(
            _residuals(self.model, self.problem, self._wanted(), jnp.asarray(point), self.metric)
        )

    def slopes(self, point: Float[np.ndarray, "unknown"]) -> Float[np.ndarray, "residual unknown"]:
        """Differentiate them."""
        return np.asarray(
            _slopes(self.model, self.problem, self._wanted(), jnp.asarray(point), self.metric)
        )

    def physical(
        self, point: Float[np.ndarray, "unknown"]
    ) -> tuple[dict[str, float], Float[np.ndarray, "lobe channel"]]:
        """Turn a point into numbers and amplitudes."""
        held = self.problem.unknowns.unpack(jnp.asarray(point[: self.searched])).numbers
        names = [one.name for one in self.problem.unknowns.searched]
        return {name: float(held[name]) for name in names}, self.amplitudes(point)

    def amplitudes(self, point: Float[np.ndarray, "unknown"]) -> Float[np.ndarray, "lobe channel"]:
        """Lay out the amplitudes of a point."""
        held = np.asarray(self.problem.mix) @ point[self.searched :]
        return (held + np.asarray(self.problem.offset)).reshape(-1, self.model.channels)

    def _wanted(self) -> "_Wanted":
        weights, least, scale = self.data.weights, np.asarray(self.least), np.asarray(self.scale)
        parts = (self.data.radiance, weights, self.cosine, least, scale)
        return _Wanted(*(jnp.asarray(part) for part in parts))


def started(objective: Objective, count: int) -> Found:
    """Search in plain squares, weighted so that they are about those of the metric.

    For the plain metric itself the weights are one, and this is the answer.
    """
    data, values = objective.data, np.asarray(objective.data.radiance)
    slope = jax.grad(lambda v: jnp.sum(objective.metric.of(v, objective.cosine, objective.least)))(
        jnp.asarray(values + 0.01 * values.mean())
    )
    weights = np.asarray(data.weights) * np.asarray(slope)
    problem, unknowns = objective.problem, objective.problem.unknowns
    fit = search(problem, objective.model, data._replace(weights=weights), unknowns.starts(count))
    point = np.asarray(fit.solution.point, float)
    eliminated = np.asarray(fit.linear.eliminated, float)
    return Found(np.concatenate([point, eliminated]), bool(fit.solution.converged))


def minimised(objective: Objective, start: Found) -> Found:
    """Go from a start to the nearest minimum of the metric."""
    if objective.metric.name == "plain":
        return _by_elimination(objective, start)
    point = start.point
    lower, upper = _bounds(objective)
    point = np.clip(point, lower, upper)
    options = {"bounds": (lower, upper), "x_scale": "jac", "max_nfev": _MOST_STEPS}
    loss = {}
    if objective.metric.power == 1:
        missed = np.abs(objective.residuals(point))
        counted = missed[missed > 0]
        corner = _CORNER * float(np.median(counted)) if counted.size else 1.0
        loss = {"loss": "soft_l1", "f_scale": corner}
    derivatives: Any = objective.slopes
    found = least_squares(
        objective.residuals, _inside(point, lower, upper), derivatives, **options, **loss
    )
    # A search within bounds comes near to them and never there.
    ended = np.asarray(found.x, float)
    amounts = np.arange(len(ended)) >= objective.searched
    reach = _AT_ZERO * float(np.max(ended[amounts], initial=0))
    return Found(np.where(amounts & (ended <= lower + reach), lower, ended), bool(found.status > 0))


def spread_of(objective: Objective, point: Float[np.ndarray, "unknown"]) -> Spread:
    """Estimate standard errors from the residuals themselves (the sandwich of White, 1980).

    Amplitudes at zero are taken as known to be that, and so are search variables at a bound.
    """
    residuals, slopes = objective.residuals(point), objective.slopes(point)
    lower, _ = _bounds(objective)
    moving = np.ones(len(point), bool)
    moving[objective.searched :] = point[objective.searched :] > lower[objective.searched :]
    at_bound = np.asarray(
        objective.problem.unknowns.at_bound(jnp.asarray(point[: objective.searched]))
    )
    moving[: objective.searched] = ~at_bound
    covariance = np.zeros((len(point), len(point)))
    if moving.any():
        kept = slopes[:, moving]
        norm = np.sqrt(np.sum(kept**2, axis=0))
        norm = np.where(norm > 0, norm, 1)
        left, sizes, right = np.linalg.svd(kept / norm, full_matrices=False)
        told = sizes > _UNTOLD * max(sizes.max(), 1e-300)
        freedom = len(residuals) / max(len(residuals) - int(moving.sum()), 1)
        inner = (left[:, told] * residuals[:, None] ** 2).T @ left[:, told] * freedom
        outer = right[told].T / sizes[told]
        block = outer @ inner @ outer.T / np.outer(norm, norm)
        lost = np.any(np.abs(right[~told]) > 1e-3, axis=0)
        block[lost, lost] = np.inf
        covariance[np.ix_(moving, moving)] = block
    deviations = np.sqrt(np.diag(covariance))
    return _in_own_units(objective, point, deviations)


def _in_own_units(objective: Objective, point: np.ndarray, deviations: np.ndarray) -> Spread:
    searched, unknowns = objective.searched, objective.problem.unknowns
    amounts = objective.amplitudes(point)
    mix = np.abs(np.asarray(objective.problem.mix))
    free = deviations[searched:]
    of_amounts = np.array([np.max(free[row > 0], initial=0) for row in mix]).reshape(amounts.shape)
    ends = amounts[..., None] + _TWO_SIDED_95 * of_amounts[..., None] * np.array([-1, 1])
    numbers, intervals = {}, {}
    middle = {
        n: float(v) for n, v in unknowns.unpack(jnp.asarray(point[:searched])).numbers.items()
    }
    jacobian = jax.jacfwd(lambda at: unknowns.unpack(at).numbers)(jnp.asarray(point[:searched]))
    for one in unknowns.searched:
        place = unknowns.names.index(one.name) if one.name in unknowns.names else None
        if place is None:
            numbers[one.name], intervals[one.name] = 0.0, [middle[one.name]] * 2
            continue
        slope = float(np.asarray(jacobian[one.name])[place])
        numbers[one.name] = abs(slope) * float(deviations[place]) if slope else np.inf
        between = []
        for side in (-1, 1):
            moved = np.array(point[:searched])
            reach = _TWO_SIDED_95 * deviations[place]
            moved[place] += side * (reach if np.isfinite(reach) else 1e6)
            between.append(float(unknowns.unpack(jnp.asarray(moved)).numbers[one.name]))
        intervals[one.name] = sorted(between)
    return Spread(of_amounts, numbers, np.maximum(ends, 0), intervals)


def _by_elimination(objective: Objective, start: Found) -> Found:
    """Search from one start by variable projection."""
    begin = start.point[None, : objective.searched]
    fit = search(objective.problem, objective.model, objective.data, begin)
    eliminated = np.asarray(fit.linear.eliminated, float)
    point = np.concatenate([np.asarray(fit.solution.point, float), eliminated])
    return Found(point, bool(fit.solution.converged))


def _bounds(objective: Objective) -> tuple[np.ndarray, np.ndarray]:
    numbers = np.full(objective.searched, np.inf)
    lower = np.concatenate([-numbers, np.asarray(objective.problem.lower, float)])
    return lower, np.concatenate([numbers, np.asarray(objective.problem.upper, float)])


def _inside(point: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Step off the bounds, where SciPy's search cannot begin."""
    amounts = point[np.isfinite(lower)]
    nudge = 1e-3 * max(float(np.max(np.abs(amounts), initial=0)), 1e-6)
    return np.where(point <= lower, lower + nudge, np.where(point >= upper, upper - nudge, point))


@eqx.filter_jit
def _predicted(model: _Pairs, problem: Problem, point: Array) -> Float[Array, "sample channel"]:
    searched = len(problem.unknowns.names)
    physical = problem.unknowns.unpack(point[:searched])
    amplitudes = jnp.asarray(problem.mix) @ point[searched:] + jnp.asarray(problem.offset)
    return model.columns(physical.numbers).times(amplitudes.reshape(-1, model.channels))


@eqx.filter_jit
def _residuals(
    model: _Pairs, problem: Problem, wanted: _Wanted, point: Array, metric: Metric
) -> Float[Array, "residual"]:
    found = jnp.maximum(_predicted(model, problem, point), 0)
    apart = metric.of(found, wanted.cosine, wanted.least)
    apart = apart - metric.of(wanted.values, wanted.cosine, wanted.least)
    return (wanted.weights * apart / wanted.scale).ravel()


@eqx.filter_jit
def _slopes(
    model: _Pairs, problem: Problem, wanted: _Wanted, point: Array, metric: Metric
) -> Float[Array, "residual unknown"]:
    return jax.jacfwd(lambda at: _residuals(model, problem, wanted, at, metric))(point)
