"""Error bars: the full covariance at the end of a fit, the eliminated linear part included.

The covariance is that of least squares, s^2 (J' W J)^-1 over search and linear unknowns together,
carried over to the parameters in their own units.  s^2 is the mean squared weighted residual where
the noise was estimated; where it was given, intervals are widened when the data scatter more than
they should, and never narrowed.  A robust loss widens them by what it costs.  The numbers of a lobe
lie above their origins, so their intervals are symmetric in the logarithm of the distance.

Samples of a draw that stand for c pixels each count c times in the sum of squares, but are measured
only once.  Their covariance is (J' C W J)^-1 (J' C^2 W J) (J' C W J)^-1 in place of (J' W J)^-1.

That covariance is right if the model is.  Where the samples come with their ``clusters``, it is
widened by what they leave unexplained together, and the model's own stays beside it.
"""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from jaxrender.inverse.clusters import Clusters, widened
from jaxrender.inverse.elimination import Data, Fit, Problem
from jaxrender.inverse.ends import numbers_at_ends
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.parameters import Parameters, slopes_of_parameters, to_parameters
from jaxrender.inverse.unknowns import Prior
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Half the width of a 90 % interval of the normal distribution, in standard errors.
_NORMAL_90 = 1.6448536269514722
# An interval that reaches beyond this factor above its origin has no end there.
_ENDLESS = 1e4
# Two halves of the samples agree when their difference is among this part of what noise makes.
_HALVES_AGREE = 0.999
# A parameter is not identifiable when its interval reaches further than this to either side.
IDENTIFIABLE_WITHIN = 0.25
# An error that the data leave above this part of the prior's is the prior's.
_ALL_BUT = 0.9


class Uncertain(NamedTuple):
    """Values, 90 % intervals (lower and upper) and standard errors of the same parameters.

    What is fixed has a standard error of zero and an interval of its value alone.  ``covariance``
    is that of all of ``Parameters`` one after the other.
    ``disagreement`` is how far two halves of the samples are apart: the chi-squared of the
    difference between what each of them says, over what 99.9 % of halves stay below.  ``origins``
    are what the lobe's numbers lie above, and ``ends`` what closed ones lie between.  ``if_exact``
    is the same as it would be if the model were exact, where this one knows of misfit.
    """

    value: Parameters
    lower: Parameters
    upper: Parameters
    standard_error: Parameters
    covariance: Float[np.ndarray, "number number"] | None = None
    disagreement: float = 0.0
    origins: Mapping[str, float] = MappingProxyType({})
    ends: Mapping[str, tuple[float, float]] = MappingProxyType({})
    if_exact: "Uncertain | None" = None

    def with_covariance(self, covariance: Float[np.ndarray, "number number"]) -> "Uncertain":
        """Put intervals of another covariance about the same values; these stay as ``if_exact``."""
        error = _spread_over(self.value, covariance)
        found = intervals(self.value, error, self.origins, covariance, self.ends)
        return found._replace(disagreement=self.disagreement, if_exact=self.if_exact or self)

    def summed(self, sums: Mapping[str, tuple[str, ...]]) -> "Uncertain":
        """Add up amplitudes, each sum by its name; those that are in none stay by themselves."""
        if not sums:
            return self
        return self._added({own: name for name, parts in sums.items() for own in parts})

    def only(self, names: Iterable[str]) -> "Uncertain":
        """Keep the amplitudes of these names."""
        left_out = {*self.value.amplitudes} - {*names}
        return self._added(dict.fromkeys(left_out)) if left_out else self

    def _added(self, of: Mapping[str, str | None]) -> "Uncertain":
        """Add amplitudes to those whose names are given; None leaves one out."""
        assert self.covariance is not None
        amplitudes: dict = {}
        for own, amount in self.value.amplitudes.items():
            name = of.get(own, own)
            if name is not None:
                amplitudes[name] = amplitudes.get(name, np.zeros(np.shape(amount))) + amount
        value = self.value._replace(amplitudes=amplitudes)
        rows = {label: row for row, label in enumerate(value.labels)}
        adding = np.zeros((len(rows), len(self.value.labels)))
        for column, label in enumerate(self.value.labels):
            own, bracket, channel = label.partition("[")
            name = of.get(own, own)
            if name is not None:
                adding[rows[f"{name}{bracket}{channel}"], column] = 1
        covariance = adding @ self.covariance @ adding.T
        error = _spread_over(value, covariance)
        found = intervals(value, error, self.origins, covariance, self.ends)
        exact = None if self.if_exact is None else self.if_exact._added(of)
        return found._replace(disagreement=self.disagreement, if_exact=exact)

    def spread_by(self, shifts: Float[np.ndarray, "number cause"]) -> "Uncertain":
        """Let these intervals reach as far as causes shift the values, a column each.

        So do those if the model were exact.
        """
        if self.covariance is None:
            return self
        more = shifts @ shifts.T
        wider, exact = self.with_covariance(self.covariance + more), self.if_exact
        if exact is not None and exact.covariance is not None:
            exact = exact.with_covariance(exact.covariance + more)._replace(if_exact=None)
        return wider._replace(if_exact=exact)


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
        problem, model, drawn, *end, held, noise_given, factor
    )
    value = jax.tree.map(lambda leaf: np.asarray(leaf, float), value)
    most = scipy.stats.chi2.ppf(_HALVES_AGREE, max(int(np.sum(~held)), 1))
    covariance = np.asarray(covariance)
    of_values = float(variance) * np.repeat(np.asarray(shares, float), data.radiance.shape[1])
    near = numbers_at_ends(problem, model, data, fit, held)
    reach = {name: one.within(of_values) for name, one in near.items()}
    exact, unknowns = _reaching(covariance, value, reach), problem.unknowns
    found = intervals(value, _spread_over(value, exact), unknowns.origins, exact, unknowns.ends)
    found = found._replace(disagreement=float(apart) / float(most))
    if clusters is None:
        return found
    wider = widened(covariance, clusters.covariance(np.asarray(influence)))
    told = np.diag(covariance) > 0
    more = np.median(np.diag(wider)[told] / np.diag(covariance)[told]) if told.any() else 1.0
    reach = {name: one.within(more * of_values) for name, one in near.items()}
    return found.with_covariance(_reaching(wider, value, reach))


def _reaching(
    covariance: Float[np.ndarray, "number number"], value: Parameters, reach: Mapping[str, float]
) -> Float[np.ndarray, "number number"]:
    """Give numbers that are at an end the error by which their interval reaches so far."""
    changed, labels = covariance.copy(), value.labels
    for name, far in reach.items():
        place = labels.index(name)
        changed[place, place] = (far / _NORMAL_90) ** 2
    return changed


def _spread_over(value: Parameters, covariance: Float[np.ndarray, "number number"]) -> Parameters:
    """Lay standard errors out as the parameters are."""
    leaves, structure = jax.tree.flatten(value)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0))
    parts = np.split(errors, np.cumsum([leaf.size for leaf in leaves])[:-1])
    shaped = [part.reshape(leaf.shape) for part, leaf in zip(parts, leaves)]
    return jax.tree.unflatten(structure, shaped)


def intervals(
    value: Parameters,
    error: Parameters,
    origins: Mapping[str, float],
    covariance: Float[np.ndarray, "number number"] | None = None,
    ends: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> Uncertain:
    """Put 90 % intervals about values of known standard error, within the ends of closed ones."""
    low, high = (_bound(value, error, origins, sign) for sign in (-1, 1))
    low, high = (
        bound._replace(numbers={**bound.numbers, **_clipped(bound.numbers, ends)})
        for bound in (low, high)
    )
    return Uncertain(value, low, high, error, covariance, origins=origins, ends=ends)


def _clipped(
    numbers: Mapping[str, Float[AnyArray, "..."]], ends: Mapping[str, tuple[float, float]]
) -> dict[str, Float[AnyArray, "..."]]:
    """Keep numbers between their ends."""
    return {name: np.asarray(np.clip(numbers[name], *both)) for name, both in ends.items()}


def within_reach(uncertain: Uncertain, name: str, beside: Iterable[str] = ()) -> bool:
    """Say whether a parameter's interval lies within 25 % of its value above its origin.

    ``beside`` are amplitudes that count with its own: a base that is all but black is known well
    where it is known to be dark beside the lobe.
    """
    origin = uncertain.origins.get(name, 0.0)
    value, low, high = (
        np.asarray(part.of(name)) - origin
        for part in (uncertain.value, uncertain.lower, uncertain.upper)
    )
    whole = np.abs(value) + sum(float(np.mean(uncertain.value.of(other))) for other in beside)
    reach = IDENTIFIABLE_WITHIN * whole
    return bool(np.all(high - value <= reach) and np.all(value - low <= reach))


def rests_on_prior(uncertain: Uncertain, name: str, prior: Prior | None) -> bool:
    """Say whether the data leave the error of a parameter all but that of its prior."""
    if prior is None:
        return False
    error = np.asarray(uncertain.standard_error.of(name))
    return bool(np.any(error > _ALL_BUT * prior.standard_deviation))


def off_prior(uncertain: Uncertain, name: str, prior: Prior | None) -> float:
    """Say how many standard deviations the data alone put a parameter off its prior.

    The value v and its error e hold both: the data alone differ from the prior's mean m by
    (v - m) / sqrt(p^2 - e^2) standard deviations of the difference, p being the prior's.
    """
    if prior is None:
        return 0.0
    value, error = (
        np.asarray(part.of(name)) for part in (uncertain.value, uncertain.standard_error)
    )
    variance = np.maximum(prior.standard_deviation**2 - error**2, np.finfo(float).tiny)
    return float(np.max(np.abs(value - prior.mean) / np.sqrt(variance)))


def relative_error(uncertain: Uncertain, name: str) -> float:
    """A standard error as a part of the value above its origin, in the worst channel."""
    value = np.asarray(uncertain.value.of(name)) - uncertain.origins.get(name, 0.0)
    error = np.asarray(uncertain.standard_error.of(name))
    return float(np.max(error / np.where(value != 0, np.abs(value), np.nan)))


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
    noise_given: bool,
    factor: Float[AnyArray, ""],
) -> Propagated:
    data, shares, half = drawn
    vector, split = jnp.concatenate([point, eliminated]), point.shape[0]

    def residual(vector: Float[Array, "all"]) -> Float[Array, "residual"]:
        predicted = problem.predict(model, data, vector[:split], problem.linear(vector[split:]))
        return (jnp.asarray(data.weights) * (data.radiance - predicted)).ravel()

    with jax.default_matmul_precision("highest"):
        jacobian = jnp.where(held[None, :], 0, jax.jacfwd(residual)(vector))
        left = residual(vector)
        freedom = left.size - jnp.sum((~held).astype(left.dtype))
        variance = jnp.sum(left**2) / freedom
        variance = factor * (jnp.maximum(variance, 1) if noise_given else variance)
        prior = jnp.diag(_prior(problem, vector))
        channels = left.size // shares.shape[0]
        own, in_half = (jnp.repeat(jnp.asarray(part), channels) for part in (shares, half))

        def answer(chosen: Array) -> tuple[Float[Array, "all all"], Float[Array, "all"]]:
            """Say how well some samples tell the unknowns, and how far from here they put them."""
            some = jnp.where(chosen[:, None], jacobian, 0)
            bread = _inverse(some.T @ some / variance + prior)
            meat = some.T @ (own[:, None].astype(left.dtype) * some) / variance + prior
            return bread @ meat @ bread, bread @ (some.T @ left) / variance

        covariance, _ = answer(jnp.ones_like(in_half))
        (first, one), (second, other) = answer(in_half), answer(~in_half)
        apart = jnp.where(held, 0, one - other)
        spread = jnp.where(held[None, :], 0, slopes_of_parameters(problem, point, eliminated))
        scores = (left[:, None] * jacobian / variance).reshape(-1, channels, len(vector))
        moves = spread @ _inverse(jacobian.T @ jacobian / variance + prior)
        return Propagated(
            to_parameters(problem, vector[:split], vector[split:]),
            spread @ covariance @ spread.T,
            apart @ _inverse(first + second) @ apart,
            jnp.sum(scores, axis=1) @ moves.T,
            variance,
        )


def _prior(problem: Problem, vector: Float[Array, "all"]) -> Float[Array, "all"]:
    """Say what is known of the search variables and amplitudes beforehand.

    That is what their own priors say, and what the bounds of the numbers say.  Spread evenly
    between its bounds (in the logarithm) a parameter's logit has the variance pi^2 / 3.  It matters
    only where the data say nothing: the error of such a parameter stays that of its range, and does
    not leak into the others through a linearisation far beyond its reach.
    """
    bounded, priors = problem.unknowns.bounded, problem.priors
    prior = np.zeros(vector.shape[0])
    prior[: len(bounded)] = bounded * 3 / np.pi**2
    prior = jnp.asarray(prior, vector.dtype)
    if priors is None:
        return prior

    return prior + priors.information(problem.unknowns, vector)


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


def _bound(
    value: Parameters, error: Parameters, origins: Mapping[str, float], sign: int
) -> Parameters:
    """Move each value by the 90 % half width, the lobe's numbers by a factor above their origin.

    What the photographs do not bound is infinite, or at the origin.  No amplitude is below zero.
    """
    moved = {}
    for name, centre in value.numbers.items():
        above = centre - origins[name]
        spread = _NORMAL_90 * error.numbers[name] / above
        endless = np.inf if sign > 0 else 0.0
        factor = np.exp(sign * np.minimum(spread, np.log(_ENDLESS)))
        factor = np.where(spread < np.log(_ENDLESS), factor, endless)
        moved[name] = np.asarray(origins[name] + above * factor)
    amplitudes = {
        name: np.maximum(centre + sign * _NORMAL_90 * error.amplitudes[name], np.minimum(centre, 0))
        for name, centre in value.amplitudes.items()
    }
    gains, scale = (
        getattr(value, name) + sign * _NORMAL_90 * getattr(error, name)
        for name in ("gains", "scale")
    )
    return Parameters(amplitudes, moved, gains, scale)
