"""Error bars: the full covariance at the end of a fit, the eliminated linear part included.

The covariance is that of least squares, s^2 (J' W J)^-1 over search and linear unknowns together,
carried over to the parameters in their own units.  s^2 is the mean squared weighted residual where
the noise was estimated; where it was given, intervals are widened when the data scatter more than
they should, and never narrowed.  A robust loss widens them by what it costs.

Samples of a draw that stand for c pixels each count c times in the sum of squares, but are measured
only once.  Their covariance is (J' C W J)^-1 (J' C^2 W J) (J' C W J)^-1 in place of (J' W J)^-1.

That covariance is right if the model is.  Where the samples come with their ``clusters``, it is
widened by what they leave unexplained together, and the model's own stays beside it.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from jaxrender.inverse.clusters import Clusters, widened
from jaxrender.inverse.elimination import Data, Fit, Problem
from jaxrender.inverse.ends import AtEnd, unknowns_at_ends
from jaxrender.inverse.intervals import NORMAL_90, Uncertain, intervals, standard_errors
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.parameters import Parameters, slopes_of_parameters, to_parameters
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Two halves of the samples agree when their difference is among this part of what noise makes.
_HALVES_AGREE = 0.999


def uncertain_parameters(
    problem: Problem,
    model: LinearisedModel,
    data: Data,
    fit: Fit,
    noise_given: bool,
    *,
    variance_factor: float = 1.0,
    shares: Float[np.ndarray, "sample"] | None = None,
    clusters: Clusters | None = None,
) -> Uncertain:
    """Compute the parameters at the end of a fit, with their intervals.

    ``variance_factor`` is that of a robust loss (:mod:`jaxrender.inverse.weights`).  ``shares``
    tell how many pixels each sample stands for, relative to their mean, which its weight has in it.
    ``clusters`` are of samples that may err together.
    """
    shares = np.ones(data.radiance.shape[0]) if shares is None else shares
    held = held_at_bounds(problem, fit)
    # Neighbouring pixels are alike, so that every other one would be no draw of its own.
    half = np.random.default_rng(0).permutation(len(shares)) % 2 == 0
    end = fit.solution.point, fit.linear.eliminated
    drawn = Drawn(data, shares, half)
    factor = np.asarray(variance_factor)
    value, covariance, apart, influence, variance = _propagate(
        problem, model, drawn, *end, held, np.asarray(noise_given), factor
    )
    value = jax.tree.map(lambda leaf: np.asarray(leaf, float), value)
    most = scipy.stats.chi2.ppf(_HALVES_AGREE, max(int(np.sum(~held)), 1))
    covariance = np.asarray(covariance)
    of_values = float(variance) * np.repeat(np.asarray(shares, float), data.radiance.shape[1])
    near = unknowns_at_ends(problem, model, data, fit, held, value)
    exact, unknowns = _reaching(covariance, value, near, of_values), problem.unknowns
    at_ends = {name: unknowns.range_of(name) for name in near if name in value.numbers}
    ends = {**unknowns.ends, **at_ends}
    found = intervals(value, standard_errors(value, exact), unknowns.origins, exact, ends)
    found = found._replace(disagreement=float(apart) / float(most))
    if clusters is None:
        return found
    wider = widened(covariance, clusters.covariance(np.asarray(influence)))
    told = np.diag(covariance) > 0
    more = np.median(np.diag(wider)[told] / np.diag(covariance)[told]) if told.any() else 1.0
    return found.with_covariance(_reaching(wider, value, near, more * of_values))


def _reaching(
    covariance: Float[np.ndarray, "number number"],
    value: Parameters,
    near: Mapping[str, AtEnd],
    variance: Float[np.ndarray, "value"],
) -> Float[np.ndarray, "number number"]:
    """Give unknowns that are at an end the error by which their interval reaches into the range."""
    changed, labels = covariance.copy(), value.labels
    for name, one in near.items():
        place = labels.index(name)
        changed[place, place] = (one.unit * one.within(variance) / NORMAL_90) ** 2
    return changed


class Drawn(NamedTuple):
    """Data with the share of each sample, and which of them are in the first of two halves."""

    data: Data
    shares: Float[AnyArray, "sample"]
    half: Bool[AnyArray, "sample"]


class Propagated(NamedTuple):
    """Parameters, their covariance, and the chi-squared between the two halves of a draw.

    ``influence`` is how far what the model leaves of each sample moves each parameter, and
    ``variance`` that of a weighted residual.
    """

    value: Parameters
    covariance: Float[Array, "parameter parameter"]
    apart: Float[Array, ""]
    influence: Float[Array, "sample parameter"]
    variance: Float[AnyArray, ""]


@stored(effort="least")
def _propagate(
    problem: Problem,
    model: LinearisedModel,
    drawn: Drawn,
    point: Float[Array, "unknown"],
    eliminated: Float[Array, "linear"],
    held: Bool[AnyArray, "all"],
    noise_given: Bool[AnyArray, ""],
    factor: Float[AnyArray, ""],
) -> Propagated:
    data, shares, half = drawn
    half = jnp.asarray(half)
    vector, split = jnp.concatenate([point, eliminated]), point.shape[0]

    def residual(vector: Float[Array, "all"]) -> Float[Array, "residual"]:
        predicted = problem.predict(model, data, vector[:split], problem.linear(vector[split:]))
        return (jnp.asarray(data.weights) * (data.radiance - predicted)).ravel()

    with jax.default_matmul_precision("highest"):
        jacobian = jnp.where(held[None, :], 0, jax.jacfwd(residual)(vector))
        left = residual(vector)
        freedom = left.size - jnp.sum((~held).astype(left.dtype))
        variance = jnp.sum(left**2) / freedom
        variance = factor * jnp.where(noise_given, jnp.maximum(variance, 1), variance)
        prior = jnp.diag(prior_information(problem, vector))
        channels = left.size // shares.shape[0]
        own = jnp.repeat(jnp.asarray(shares), channels)
        bread = _inverse(jacobian.T @ jacobian / variance + prior)
        meat = jacobian.T @ (own[:, None].astype(left.dtype) * jacobian) / variance + prior
        scores = (left[:, None] * jacobian / variance).reshape(-1, channels, len(vector))
        scores = jnp.sum(scores, axis=1)

        def answer(chosen: Array) -> tuple[Float[Array, "all all"], Float[Array, "all"]]:
            """Say how far from here some samples put the unknowns, and how well they tell that.

            That is by how their scores scatter.  Where the model is wrong, they scatter more in
            some places than in others, and than noise does.
            """
            rows = jnp.where(jnp.repeat(chosen, channels)[:, None], jacobian, 0)
            total = jnp.sum(jnp.where(chosen[:, None], scores, 0), axis=0)
            mean = (total / jnp.sum(chosen).astype(total.dtype))[None]
            about = jnp.where(chosen[:, None], scores - mean, 0)
            bread = _inverse(rows.T @ rows / variance + prior)
            return bread @ (about.T @ about + prior) @ bread, bread @ total

        (first, one), (second, other) = answer(half), answer(~half)
        apart = jnp.where(held, 0, one - other)
        spread = jnp.where(held[None, :], 0, slopes_of_parameters(problem, point, eliminated))
        return Propagated(
            to_parameters(problem, vector[:split], vector[split:]),
            spread @ bread @ meat @ bread @ spread.T,
            apart @ _inverse(first + second) @ apart,
            scores @ (spread @ bread).T,
            variance,
        )


def prior_information(problem: Problem, vector: Float[Array, "all"]) -> Float[Array, "all"]:
    """Say what is known of search variables and eliminated unknowns beforehand: 1 / variance.

    That is what their own priors say, and what the bounds of the numbers say.  The bounds matter
    only where the data say nothing: the error of such a parameter stays that of its range, and does
    not leak into the others through a linearisation far beyond its reach.
    """
    unknowns, priors = problem.unknowns, problem.priors
    searched = len(unknowns.names)
    of_range = unknowns.range_information(vector[:searched])
    prior = jnp.concatenate([of_range, jnp.zeros_like(vector[searched:])])
    if priors is None:
        return prior
    return prior + priors.information(unknowns, vector)


def _inverse(matrix: Float[Array, "all all"]) -> Float[Array, "all all"]:
    """Invert a symmetric matrix scaled to unit diagonal; what has no information stays huge."""
    diagonal = jnp.diag(matrix)
    scale = jnp.where(diagonal > 0, 1 / jnp.sqrt(jnp.where(diagonal > 0, diagonal, 1)), 0)
    values, vectors = jnp.linalg.eigh(matrix * scale[:, None] * scale[None, :])
    floor = jnp.finfo(matrix.dtype).eps * matrix.shape[0]
    inverse = (vectors / jnp.maximum(values, floor)[None, :]) @ vectors.T
    return inverse * scale[:, None] * scale[None, :]


def held_at_bounds(problem: Problem, fit: Fit) -> Bool[np.ndarray, "all"]:
    """Mark the unknowns that ended at a bound: they have no error bar of their own."""
    eliminated = np.asarray(fit.linear.eliminated)
    lower, upper = np.asarray(problem.lower), np.asarray(problem.upper)
    at_box = (eliminated <= lower) | (eliminated >= upper)
    return np.concatenate([problem.unknowns.at_bound(fit.solution.point), at_box])
