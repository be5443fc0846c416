"""Variable projection: amplitudes are solved for inside every step of a search for the rest.

The model B = gain (kd D + ks S(numbers) + ...) is linear in its amplitudes.  For given numbers of
the lobes they are the solution of normal equations of a handful of unknowns, within their bounds.
What remains is a least-squares problem in these numbers alone (and the gains), whose derivative
goes through the inner solution (:mod:`jaxrender.inverse.search`).  The columns D and S may come
from any model: the dual model's table, the exact integral.
"""

import dataclasses
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.models import Columns, LinearisedModel, Model
from jaxrender.inverse.priors import Priors, priors_of
from jaxrender.inverse.solvers import Solution, solve_in_box
from jaxrender.inverse.stated import Unknown
from jaxrender.inverse.unknowns import Physical, Unknowns
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float, Int

# Products of so few columns are sums of their own, in one loop with what made the columns.
_FEW_LOBES = 4


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
    """The solved linear part: the eliminated unknowns, and the amplitudes that they make."""

    eliminated: Float[Array, "linear"]
    amplitudes: Float[Array, "lobe channel"]


class Problem(eqx.Module):
    """A material's unknowns, with the linear ones laid out for elimination.

    The amplitudes of all lobes and channels, lobe by lobe, are ``mix`` @ eliminated + ``offset``.
    """

    unknowns: Unknowns
    mix: Float[AnyArray, "amplitude linear"]
    offset: Float[AnyArray, "amplitude"]
    lower: Float[AnyArray, "linear"]
    upper: Float[AnyArray, "linear"]
    priors: Priors | None = None

    @classmethod
    def of(cls, unknowns: Unknowns, channels: int, dtype=np.float64) -> "Problem":
        """Lay out the linear unknowns of a material with ``channels`` colour channels."""
        layout: list[tuple[np.ndarray, Unknown]] = []
        lobes = len(unknowns.amplitudes)
        size = lobes * channels
        offset = np.zeros(size)
        for at, (name, unknown) in enumerate(zip(unknowns.amplitude_names, unknowns.amplitudes)):
            rows = at * channels + np.arange(channels)
            if unknown.fixed is not None:
                offset[rows] = _per_channel(unknown, channels)
                continue
            for group in rows[:, None] if name in unknowns.coloured else [rows]:
                layout.append((np.isin(np.arange(size), group).astype(float), unknown))
        if unknowns.free_scale and any(unknown.prior is not None for _, unknown in layout):
            (name, *_) = unknowns.with_prior
            raise ValueError(
                f"{name} has a prior, but the light is known up to a factor, so that the "
                "photographs show the amplitude times the factor: leave one of the two out"
            )
        if unknowns.free_scale and offset.any():
            # What is fixed enters times the unknown scale, which is then one more linear unknown.
            layout.append((offset, Unknown()))
            offset = np.zeros_like(offset)
        mix = np.stack([column for column, _ in layout], 1) if layout else np.zeros((size, 0))
        bounds = [(unknown.lower, unknown.upper) for _, unknown in layout]
        lower, upper = np.array(bounds or np.zeros((0, 2))).T
        arrays = (np.asarray(a, dtype) for a in (mix, offset, lower, upper))
        priors = priors_of(unknowns, [unknown for _, unknown in layout], dtype)
        return cls(unknowns, *arrays, priors=priors)

    @property
    def without_priors(self) -> "Problem":
        """The same problem with the data alone."""
        return self if self.priors is None else dataclasses.replace(self, priors=None)

    def damped(
        self, model: LinearisedModel, data: Data, linear: Linear, damping: float
    ) -> "Problem":
        """Hold the free numbers near those of a linearisation, the better the more they move it.

        That is the step of Levenberg and Marquardt in the numbers' own units.
        """
        names = self.unknowns.free_numbers
        if not names:
            return self
        amplitudes = [linear.amplitudes[at] for at in model.at.shaped]
        precisions = []
        for name in names:
            of_lobes = zip(amplitudes, model.slopes[name])
            moved = sum(amount[None, :] * slope for amount, slope in of_lobes)
            precisions.append(
                jnp.sqrt(damping * _sum_of_squares(jnp.asarray(data.weights) * moved))
            )
        none = jnp.zeros(self.mix.shape[1])
        here = Priors(
            names,
            jnp.stack([model.numbers[name] for name in names]),
            jnp.stack(precisions),
            none,
            none,
        )
        before = self.priors or dataclasses.replace(
            here, names=(), means=jnp.zeros(0), precisions=jnp.zeros(0)
        )
        return dataclasses.replace(self, priors=before.held_at(here))

    def columns(self, model: Model, data: Data, physical: Physical) -> Columns:
        """Evaluate the model's columns, times the gain of each sample's photograph."""
        columns = model.columns(physical.numbers)
        if not self.unknowns.free_gains:
            return columns
        gain = physical.gains[jnp.asarray(data.frame)][:, None]
        return columns.map(lambda column: column * gain)

    def eliminate(self, columns: Columns, data: Data) -> Linear:
        """Solve for the amplitudes within their bounds, given their columns."""
        squares = jnp.asarray(data.weights) ** 2
        target = squares * data.radiance
        normal = _gram(columns, squares)
        right = jnp.concatenate([jnp.sum(target * column, 0) for column in columns])
        mix, offset = jnp.asarray(self.mix), jnp.asarray(self.offset)
        if not mix.shape[1]:
            return self.linear(jnp.zeros(0, right.dtype))
        normal, right = mix.T @ normal @ mix, mix.T @ (right - normal @ offset)
        if self.priors is not None:
            known = self.priors.linear_precisions**2
            normal, right = normal + jnp.diag(known), right + known * self.priors.linear_means
        eliminated = solve_in_box(normal, right, jnp.asarray(self.lower), jnp.asarray(self.upper))
        return self.linear(eliminated)

    @partial(jax.jit, inline=True)
    def linear(self, eliminated: Float[Array, "linear"]) -> Linear:
        """Spread the eliminated unknowns over the amplitudes of all channels."""
        every = jnp.asarray(self.mix) @ eliminated + jnp.asarray(self.offset)
        return Linear(eliminated, every.reshape(len(self.unknowns.amplitudes), -1))

    def predict(
        self, model: Model, data: Data, point: Float[Array, "unknown"], linear: Linear
    ) -> Float[Array, "sample channel"]:
        """Predict the radiance of every sample."""
        columns = self.columns(model, data, self.unknowns.unpack(point))
        return columns.times(linear.amplitudes)

    def cost(
        self,
        data: Data,
        predicted: Float[Array, "sample channel"],
        physical: Physical,
        linear: Linear,
    ) -> Float[Array, ""]:
        """Half the sum of squares of what stays unexplained of the data, and of the priors."""
        cost = _sum_of_squares(jnp.asarray(data.weights) * (data.radiance - predicted)) / 2
        if self.priors is None:
            return cost
        return cost + jnp.sum(self.priors.left(physical, linear.eliminated) ** 2) / 2

    def in_own_units(self, data: Data) -> tuple["Problem", Data]:
        """Scale all weights so that the squares of the weighted radiance add up to one."""
        size = jnp.sqrt(_sum_of_squares(jnp.asarray(data.weights) * data.radiance))
        size = jnp.maximum(size, jnp.finfo(size.dtype).tiny)
        scaled = data._replace(weights=data.weights / size)
        if self.priors is None:
            return self, scaled
        return dataclasses.replace(self, priors=self.priors.times(1 / size)), scaled


class Fit(NamedTuple):
    """The best of all starts: where the search ended, the linear part, and the prediction there."""

    solution: Solution
    linear: Linear
    predicted: Float[Array, "sample channel"]


class Objective(NamedTuple):
    """What a search minimises: the residuals of a model of a problem beside the data."""

    problem: Problem
    model: Model
    data: Data


class Explained(NamedTuple):
    """The linear part at a point of a search, and what it predicts."""

    linear: Linear
    predicted: Float[Array, "sample channel"]


def residuals(
    point: Float[Array, "unknown"], objective: Objective
) -> tuple[Float[Array, "residual"], Explained]:
    """Weighted residuals with the linear unknowns eliminated: what the solvers minimise.

    What they are made of comes second.
    """
    problem, model, data = objective
    physical = problem.unknowns.unpack(point)
    columns = problem.columns(model, data, physical)
    linear = problem.eliminate(columns, data)
    predicted = columns.times(linear.amplitudes)
    left = (jnp.asarray(data.weights) * (data.radiance - predicted)).ravel()
    if problem.priors is not None:
        left = jnp.concatenate([left, problem.priors.left(physical, linear.eliminated)])
    return left, Explained(linear, predicted)


def condensed_residuals(
    point: Float[Array, "unknown"], objective: Objective
) -> tuple[Float[Array, "residual"], Explained]:
    """The same residuals in another basis: a few a channel, whatever the number of samples.

    Near a point every residual is a combination of few columns a channel: the lobes, their
    derivatives, and the measured radiance.  With Q R their factorization, R has all their
    inner products and takes the samples' place.  The sum of squares and its Gauss-Newton model at
    the point are those of ``residuals``, its twin, for one pass over the samples.
    """
    problem, model, data = objective
    here = problem.unknowns.unpack(jax.lax.stop_gradient(point))
    near = LinearisedModel.about(model, here.numbers, problem.unknowns.free_numbers)
    left, (linear, _) = residuals(point, Objective(problem, *condense(near, data)))
    return left, Explained(linear, near.at.times(linear.amplitudes))


@stored(jax.jit, effort="least")
def condense(model: LinearisedModel, data: Data) -> tuple[LinearisedModel, Data]:
    """Let a few samples stand for all: their inner products are the sums over all.

    For photographs without gains of their own.
    """
    # Rounding of single precision counts most in the last columns: sigma goes before mu, which the
    # samples tell least of.
    order = sorted(model.slopes, reverse=True)
    parts = (*model.gathered(order), data.radiance)
    # Laid out as LAPACK wants it, every column in one piece.
    weighted = jnp.stack([(jnp.asarray(part) * data.weights).T for part in parts], axis=1)
    triangle = jnp.linalg.qr(jnp.swapaxes(weighted, 1, 2), mode="r")
    *rows, radiance = jnp.moveaxis(triangle, (2, 0), (0, 2))
    weights = jnp.ones_like(radiance)
    frame = jnp.zeros(radiance.shape[0], int)
    lobes, shaped = len(model.at), len(model.at.shaped)
    slopes = {
        name: tuple(rows[lobes + at * shaped : lobes + (at + 1) * shaped])
        for at, name in enumerate(order)
    }
    few = LinearisedModel(Columns(*rows[:lobes], shaped=model.at.shaped), slopes, model.numbers)
    return few, Data(radiance, weights, frame)


@stored(effort="least")
def cost_at(
    problem: Problem, model: Model, data: Data, point: Float[Array, "unknown"]
) -> Float[Array, ""]:
    """Half the sum of squared weighted residuals at a point."""
    left, _ = residuals(point, Objective(problem, model, data))
    return jnp.sum(left**2) / 2


def _gram(
    columns: Columns, squares: Float[Array, "sample channel"]
) -> Float[Array, "amplitude amplitude"]:
    """Multiply weighted columns with one another; channels have nothing to do with each other."""
    every = range(len(columns))
    if len(columns) > _FEW_LOBES:
        # One product of matrices a channel: a program of thousands of sums takes long to compile.
        stacked = jnp.stack(list(columns))
        by_channel = jnp.einsum("asc,sc,bsc->abc", stacked, squares, stacked, precision="highest")
        apart = jnp.eye(squares.shape[1], dtype=squares.dtype)
        size = len(columns) * squares.shape[1]
        return jnp.einsum("abc,cd->acbd", by_channel, apart).reshape(size, size)
    blocks = {
        (a, b): jnp.diag(jnp.sum(squares * one * other, axis=0))
        for b, other in enumerate(columns)
        for a, one in enumerate(columns)
        if a <= b
    }
    return jnp.block([[blocks[min(a, b), max(a, b)] for b in every] for a in every])


def _sum_of_squares(x: Float[Array, "sample channel"]) -> Float[Array, ""]:
    """Add up, over the channels by a product of matrices: XLA's sums go number by number."""
    return jnp.sum(jnp.square(x) @ jnp.ones(x.shape[1], x.dtype))


def _per_channel(unknown: Unknown, channels: int) -> Float[np.ndarray, "channel"]:
    values = np.asarray(unknown.fixed, float)
    if values.shape[0] not in (1, channels):
        raise ValueError(f"fixed at {values.tolist()}: give one value or {channels}, one a channel")
    return np.broadcast_to(values, (channels,))
