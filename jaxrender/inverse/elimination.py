"""Variable projection: kd and ks are solved for inside every step of a search for the rest.

The model B = gain (kd D + ks S(numbers)) is linear in kd and ks.  For given numbers of the lobe
they are the solution of normal equations of a handful of unknowns, within their bounds.  What
remains is a least-squares problem in these numbers alone (and the gains), whose derivative goes
through the inner solution.  The columns D and S may come from any model: the dual model's table,
the exact integral.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.models import LinearisedModel, Model
from jaxrender.inverse.solvers import Solution, least_squares, simplex, solve_in_box
from jaxrender.inverse.unknowns import Physical, Unknown, Unknowns
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float, Int

# XLA's newer emitters of loops do not vectorise rows of three channels: products of columns take up
# to ten times as long by them, and longer to compile.
_COMPILER_OPTIONS = {"xla_cpu_use_fusion_emitters": False}

METHODS = {"variable-projection": least_squares, "simplex": simplex}

# From so many samples on, a search begins with one in so many of them.  The others then move the
# answer by a few of its standard errors: a distance at which the model is all but linear.
MANY, THINNING = 4000, 12
# The last steps: at most so many, until none moves a search variable by more than this (what the
# next would do is of the order of its square), and to a cost not above what was promised by more
# than this part.
_LAST_STEPS, _SETTLED, _BROKEN_PROMISE = 4, 0.01, 0.01
# Searches that end closer than this in every variable have found the same minimum.
_SAME_PLACE = 0.05
# By the method of the house, among all samples.
_AS_IT_IS = ("variable-projection", 1)


class Data(NamedTuple):
    """Measured radiance, its weights (1 / standard deviation), and each sample's photograph."""

    radiance: Float[AnyArray, "sample channel"]
    weights: Float[AnyArray, "sample channel"]
    frame: Int[AnyArray, "sample"]


class Few(NamedTuple):
    """Part of the samples, and how many each of them stands for relative to the others."""

    index: Int[np.ndarray, "few"]
    shares: Float[np.ndarray, "few"]

    def of(self, model: Model, data: Data) -> tuple[Model, Data]:
        """Keep this part of a model's rows and of the data."""
        radiance, weights, frame = (np.asarray(part)[self.index] for part in data)
        weights = weights * np.sqrt(self.shares)[:, None].astype(weights.dtype)
        return model.take(self.index), Data(radiance, weights, frame)


class Linear(NamedTuple):
    """The solved linear part: the eliminated unknowns, and the kd and ks that they make."""

    eliminated: Float[Array, "linear"]
    kd: Float[Array, "channel"]
    ks: Float[Array, "channel"]


class Problem(eqx.Module):
    """A material's unknowns, with the linear ones laid out for elimination.

    (kd, ks) of all channels = ``mix`` @ eliminated + ``offset``.
    """

    unknowns: Unknowns
    mix: Float[AnyArray, "two_channels linear"]
    offset: Float[AnyArray, "two_channels"]
    lower: Float[AnyArray, "linear"]
    upper: Float[AnyArray, "linear"]

    @classmethod
    def of(cls, unknowns: Unknowns, channels: int, dtype=np.float64) -> "Problem":
        """Lay out the linear unknowns of a material with ``channels`` colour channels."""
        columns, bounds = [], []
        offset = np.zeros(2 * channels)
        for which, unknown in enumerate((unknowns.kd, unknowns.ks)):
            rows = which * channels + np.arange(channels)
            if unknown.fixed is not None:
                offset[rows] = _per_channel(unknown, channels)
                continue
            shared = which == 1 and not unknowns.ks_per_channel
            for group in [rows] if shared else rows[:, None]:
                columns.append(np.isin(np.arange(2 * channels), group).astype(float))
                bounds.append((unknown.lower, unknown.upper))
        if unknowns.free_scale and offset.any():
            # What is fixed enters times the unknown scale, which is then one more linear unknown.
            columns.append(offset)
            bounds.append((0.0, np.inf))
            offset = np.zeros_like(offset)
        mix = np.stack(columns, axis=1) if columns else np.zeros((2 * channels, 0))
        lower, upper = np.array(bounds or np.zeros((0, 2))).T
        arrays = (np.asarray(a, dtype) for a in (mix, offset, lower, upper))
        return cls(unknowns, *arrays)

    def columns(
        self, model: Model, data: Data, physical: Physical
    ) -> tuple[Float[Array, "sample channel"], Float[Array, "sample channel"]]:
        """Evaluate the model's columns, times the gain of each sample's photograph."""
        diffuse, specular = model.columns(physical.numbers)
        if self.unknowns.free_gains:
            gain = physical.gains[jnp.asarray(data.frame)][:, None]
            diffuse, specular = diffuse * gain, specular * gain
        return diffuse, specular

    def eliminate(
        self,
        diffuse: Float[Array, "sample channel"],
        specular: Float[Array, "sample channel"],
        data: Data,
    ) -> Linear:
        """Solve for kd and ks within their bounds, given their columns."""
        squares = jnp.asarray(data.weights) ** 2
        target = squares * data.radiance
        dd, ds, ss = (
            jnp.diag(jnp.sum(squares * a * b, axis=0))
            for a, b in ((diffuse, diffuse), (diffuse, specular), (specular, specular))
        )
        normal = jnp.block([[dd, ds], [ds, ss]])
        right = jnp.concatenate([jnp.sum(target * diffuse, 0), jnp.sum(target * specular, 0)])
        mix, offset = jnp.asarray(self.mix), jnp.asarray(self.offset)
        if not mix.shape[1]:
            return self.linear(jnp.zeros(0, right.dtype))
        eliminated = solve_in_box(
            mix.T @ normal @ mix,
            mix.T @ (right - normal @ offset),
            jnp.asarray(self.lower),
            jnp.asarray(self.upper),
        )
        return self.linear(eliminated)

    @partial(jax.jit, inline=True)
    def linear(self, eliminated: Float[Array, "linear"]) -> Linear:
        """Spread the eliminated unknowns over kd and ks of all channels."""
        both = jnp.asarray(self.mix) @ eliminated + jnp.asarray(self.offset)
        channels = both.shape[0] // 2
        return Linear(eliminated, both[:channels], both[channels:])

    def predict(
        self, model: Model, data: Data, point: Float[Array, "unknown"], linear: Linear
    ) -> Float[Array, "sample channel"]:
        """Predict the radiance of every sample."""
        diffuse, specular = self.columns(model, data, self.unknowns.unpack(point))
        return linear.kd[None, :] * diffuse + linear.ks[None, :] * specular


class Fit(NamedTuple):
    """The best of all starts: where the search ended, the linear part, and the prediction there."""

    solution: Solution
    linear: Linear
    predicted: Float[Array, "sample channel"]


def residuals(
    point: Float[Array, "unknown"], args: tuple[Problem, Model, Data]
) -> Float[Array, "residual"]:
    """Weighted residuals with the linear unknowns eliminated: what the solvers minimise."""
    problem, model, data = args
    diffuse, specular = problem.columns(model, data, problem.unknowns.unpack(point))
    linear = problem.eliminate(diffuse, specular, data)
    predicted = linear.kd[None, :] * diffuse + linear.ks[None, :] * specular
    return (jnp.asarray(data.weights) * (data.radiance - predicted)).ravel()


def condensed_residuals(
    point: Float[Array, "unknown"], args: tuple[Problem, Model, Data]
) -> Float[Array, "residual"]:
    """The same residuals in another basis: a few a channel, whatever the number of samples.

    Near a point every residual is a combination of few columns a channel: both lobes, the specular
    one's derivatives, and the measured radiance.  With Q R their factorization, R has all their
    inner products and takes the samples' place.  The sum of squares and its Gauss-Newton model at
    the point are those of ``residuals``, its twin, for one pass over the samples.
    """
    problem, model, data = args
    here = problem.unknowns.unpack(jax.lax.stop_gradient(point))
    near = LinearisedModel.about(model, here.numbers)
    return residuals(point, (problem, *condense(near, data)))


@stored(jax.jit)
def condense(model: LinearisedModel, data: Data) -> tuple[LinearisedModel, Data]:
    """Let a few samples stand for all: their inner products are the sums over all.

    For photographs without gains of their own.
    """
    # Rounding of single precision counts most in the last columns: sigma goes before mu, which the
    # samples tell least of.
    order = sorted(model.slopes, reverse=True)
    parts = (model.diffuse, model.specular, *(model.slopes[n] for n in order), data.radiance)
    # Laid out as LAPACK wants it, every column in one piece.
    weighted = jnp.stack([(jnp.asarray(part) * data.weights).T for part in parts], axis=1)
    triangle = jnp.linalg.qr(jnp.swapaxes(weighted, 1, 2), mode="r")
    diffuse, specular, *slopes, radiance = jnp.moveaxis(triangle, (2, 0), (0, 2))
    weights = jnp.ones_like(radiance)
    frame = jnp.zeros(radiance.shape[0], int)
    few = LinearisedModel(diffuse, specular, dict(zip(order, slopes)), model.numbers)
    return few, Data(radiance, weights, frame)


@stored()
def cost_at(
    problem: Problem, model: Model, data: Data, point: Float[Array, "unknown"]
) -> Float[Array, ""]:
    """Half the sum of squared weighted residuals at a point."""
    return jnp.sum(residuals(point, (problem, model, data)) ** 2) / 2


def search(
    problem: Problem,
    model: Model,
    data: Data,
    starts: Float[np.ndarray, "start unknown"],
    method: str = "variable-projection",
    few: Few | None = None,
) -> Fit:
    """Search from every start, and compare where they end on all samples.

    Of many samples each search begins with ``few``, or else with one in twelve.  Raises
    ``ValueError`` for a method that is not in ``METHODS``.
    """
    if method not in METHODS:
        raise ValueError(f"method={method!r}: choose one of {', '.join(METHODS)}")
    if method != "variable-projection" or problem.unknowns.free_gains:
        return _best(problem, model, data, starts, method)
    if isinstance(model, LinearisedModel):
        # Nothing is lost by condensing once and for all, and one compiled search serves any number
        # of samples.
        near, near_data = condense(model, data)
        return _evaluate(problem, model, data, _best(problem, near, near_data, starts))
    if data.radiance.shape[0] < MANY:
        return _best(problem, model, data, starts)
    part, how = (model, data), (method, THINNING)
    if few is not None:
        part, how = few.of(model, data), _AS_IT_IS
    ends = [_search(problem, *part, start, how=how).solution.point for start in starts]
    return _lowest(
        [
            _settle(problem, model, data, end) or _search(problem, model, data, end, how=_AS_IT_IS)
            for end in _distinct(ends)
        ]
    )


def _best(
    problem: Problem,
    model: Model,
    data: Data,
    starts: Float[np.ndarray, "start unknown"],
    method: str = "variable-projection",
) -> Fit:
    """Search from every start among all samples."""
    # One after the other: a batched search compiles for ten seconds to save a few milliseconds.
    return _lowest([_search(problem, model, data, s, how=(method, 1)) for s in starts])


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
        fit = _search(problem, few, few_data, point, how=_AS_IT_IS)
        moved = np.abs(np.asarray(fit.solution.point) - np.asarray(point))
        point = fit.solution.point
        if not np.all(moved < _SETTLED):
            continue
        settled = _evaluate(problem, model, data, fit)
        promised = (1 + _BROKEN_PROMISE) * float(fit.solution.cost)
        return settled if float(settled.solution.cost) <= promised else None
    return None


@stored(partial(jax.jit, compiler_options=_COMPILER_OPTIONS))
def _condense_about(
    problem: Problem, model: Model, data: Data, point: Float[Array, "unknown"]
) -> tuple[LinearisedModel, Data]:
    physical = problem.unknowns.unpack(point)
    with jax.default_matmul_precision("highest"):
        return condense(LinearisedModel.about(model, physical.numbers), data)


@stored(partial(jax.jit, compiler_options=_COMPILER_OPTIONS))
def _evaluate(problem: Problem, model: Model, data: Data, fit: Fit) -> Fit:
    """Say what a model predicts, and the cost, where a fit on condensed columns ended."""
    predicted = problem.predict(model, data, fit.solution.point, fit.linear)
    left = jnp.asarray(data.weights) * (data.radiance - predicted)
    cost = _sum_of_squares(left) / 2
    return Fit(fit.solution._replace(cost=cost), fit.linear, predicted)


# Everything passed is arrays and static fields, so that plain jit will do; a call of it costs a
# tenth of filter_jit's, of which a warm search would else be half.
@stored(partial(jax.jit, static_argnames="how", compiler_options=_COMPILER_OPTIONS))
def _search(
    problem: Problem,
    model: Model,
    data: Data,
    start: Float[Array, "unknown"],
    how: tuple[str, int],
) -> Fit:
    method, thinning = how
    if thinning > 1:
        every = slice(None, None, thinning)
        model, data = model.take(every), Data(*(jnp.asarray(a)[every] for a in data))
    args = (problem, model, _in_its_own_units(data))
    with jax.default_matmul_precision("highest"):
        # Gains differ between photographs, so then no few samples can stand for all.  A linearised
        # model comes condensed.
        condensable = method == "variable-projection" and not problem.unknowns.free_gains
        condensable = condensable and not isinstance(model, LinearisedModel)
        solution = METHODS[method](condensed_residuals if condensable else residuals, start, args)
        physical = problem.unknowns.unpack(solution.point)
        diffuse, specular = problem.columns(model, data, physical)
        linear = problem.eliminate(diffuse, specular, data)
        predicted = linear.kd[None, :] * diffuse + linear.ks[None, :] * specular
        left = jnp.asarray(data.weights) * (data.radiance - predicted)
        cost = _sum_of_squares(left) / 2
        converged = solution.converged & jnp.isfinite(cost)
        solution = solution._replace(cost=cost, converged=converged)
    return Fit(solution, linear, predicted)


def _in_its_own_units(data: Data) -> Data:
    """Scale the weights so that the squares of the weighted radiance add up to one."""
    size = jnp.sqrt(_sum_of_squares(jnp.asarray(data.weights) * data.radiance))
    return data._replace(weights=data.weights / jnp.maximum(size, jnp.finfo(size.dtype).tiny))


def _sum_of_squares(x: Float[Array, "sample channel"]) -> Float[Array, ""]:
    """Add up, over the channels by a product of matrices: XLA's sums go number by number."""
    return jnp.sum(jnp.square(x) @ jnp.ones(x.shape[1], x.dtype))


def _per_channel(unknown: Unknown, channels: int) -> Float[np.ndarray, "channel"]:
    values = np.asarray(unknown.fixed, float)
    if values.shape[0] not in (1, channels):
        raise ValueError(f"fixed at {values.tolist()}: give one value or {channels}, one a channel")
    return np.broadcast_to(values, (channels,))
