"""Error bars: the full covariance at the end of a fit, the eliminated linear part included.

The covariance is that of least squares, s^2 (J' W J)^-1 over search and linear unknowns together,
carried over to the parameters in their own units.  s^2 is the mean squared weighted residual where
the noise was estimated; where it was given, intervals are widened when the data scatter more than
they should, and never narrowed.  A robust loss widens them by what it costs.  sigma and mu - 1 are
positive, so their intervals are symmetric in the logarithm.

Samples of a draw that stand for c pixels each count c times in the sum of squares, but are measured
only once.  Their covariance is (J' C W J)^-1 (J' C^2 W J) (J' C W J)^-1 in place of (J' W J)^-1.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from jaxrender.brdf import Parametric
from jaxrender.inverse.elimination import Data, Fit, Linear, Problem
from jaxrender.inverse.models import LinearisedModel
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Half the width of a 90 % interval of the normal distribution, in standard errors.
_NORMAL_90 = 1.6448536269514722
# Two halves of the samples agree when their difference is among this part of what noise makes.
_HALVES_AGREE = 0.999
# A parameter is not identifiable when its interval reaches further than this to either side.
IDENTIFIABLE_WITHIN = 0.25


class Parameters(NamedTuple):
    """A material in its own units: kd and ks per channel, sigma, mu (NaN: metal), gains, scale."""

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    sigma: Float[AnyArray, ""]
    mu: Float[AnyArray, ""]
    gains: Float[AnyArray, "frame"]
    scale: Float[AnyArray, ""]


class Uncertain(NamedTuple):
    """Values, 90 % intervals (lower and upper) and standard errors of the same parameters.

    What is fixed has a standard error of zero and an interval of its value alone.  ``covariance``
    is that of all numbers of ``Parameters`` one after the other (a metal's mu counts, as fixed).
    ``disagreement`` is how far two halves of the samples are apart: the chi-squared of the
    difference between what each of them says, over what 99.9 % of halves stay below.
    """

    value: Parameters
    lower: Parameters
    upper: Parameters
    standard_error: Parameters
    covariance: Float[np.ndarray, "number number"] | None = None
    disagreement: float = 0.0


def uncertain_parameters(
    problem: Problem,
    model: LinearisedModel,
    data: Data,
    fit: Fit,
    noise_given: bool,
    *,
    variance_factor: float = 1.0,
    shares: Float[np.ndarray, "sample"] | None = None,
) -> Uncertain:
    """Compute the parameters at the end of a fit, with their intervals.

    ``variance_factor`` is that of a robust loss (:mod:`jaxrender.inverse.weights`).  ``shares``
    tell how many pixels each sample stands for, relative to their mean, which its weight has in it.
    """
    shares = np.ones(data.radiance.shape[0]) if shares is None else shares
    held = _held(problem, fit)
    # Neighbouring pixels are alike, so that every other one would be no draw of its own.
    half = np.random.default_rng(0).permutation(len(shares)) % 2 == 0
    settings = (held, noise_given, np.asarray(variance_factor))
    value, covariance, apart = _propagate(
        problem, model, (data, shares, half), (fit.solution.point, fit.linear.eliminated), settings
    )
    structure = jax.tree.structure(value)
    sizes = [leaf.size for leaf in jax.tree.leaves(value)]
    errors = np.sqrt(np.maximum(np.diag(np.asarray(covariance)), 0))
    parts = np.split(errors, np.cumsum(sizes)[:-1])
    shaped = [part.reshape(leaf.shape) for part, leaf in zip(parts, jax.tree.leaves(value))]
    error = Parameters(*jax.tree.unflatten(structure, shaped))
    value = Parameters(*(np.asarray(leaf, float) for leaf in value))
    most = scipy.stats.chi2.ppf(_HALVES_AGREE, max(int(np.sum(~held)), 1))
    found = intervals(value, error, np.asarray(covariance))
    return found._replace(disagreement=float(apart) / float(most))


def intervals(
    value: Parameters,
    error: Parameters,
    covariance: Float[np.ndarray, "number number"] | None = None,
) -> Uncertain:
    """Put 90 % intervals about values of known standard error."""
    low, high = _bound(value, error, -1), _bound(value, error, 1)
    return Uncertain(value, low, high, error, covariance)


def in_own_units(uncertain: Uncertain, brdf: Parametric) -> Uncertain:
    """Say the width sigma as the model's own number, such as an exponent, in its place; mu too.

    Powers keep an interval symmetric in the logarithm; a negative one swaps its ends.
    """
    shape, index = brdf.shape, brdf.index
    value, low, high = (shape.of_width(part.sigma) for part in uncertain[:3])
    error = abs(shape.power) * value * uncertain.standard_error.sigma / uncertain.value.sigma
    low, high = (low, high) if shape.power > 0 else (high, low)
    numbers = (value, low, high, error)
    own = [part._replace(sigma=number) for part, number in zip(uncertain[:4], numbers)]
    value, low, high = (part._replace(mu=index.of_index(part.mu)) for part in own[:3])
    return Uncertain(value, low, high, own[3])


def within_reach(uncertain: Uncertain, name: str, least_index: float = 1.0) -> bool:
    """Say whether a parameter's interval lies within 25 % of its value (for mu: of mu - 1).

    ``least_index`` is what stands for an index of 1 where mu is in a model's own units.
    """
    origin = least_index if name == "mu" else 0.0
    value, low, high = (
        np.asarray(getattr(part, name)) - origin
        for part in (uncertain.value, uncertain.lower, uncertain.upper)
    )
    reach = IDENTIFIABLE_WITHIN * np.abs(value)
    return bool(np.all(high - value <= reach) and np.all(value - low <= reach))


@eqx.filter_jit
def to_parameters(
    problem: Problem, point: Float[Array, "unknown"], eliminated: Float[Array, "linear"]
) -> Parameters:
    """Put a search point and its linear part into a material's own units, gauge applied.

    With an unknown scale between light and photographs, kd and ks are those of a material whose
    mean kd + ks is one, unless a fixed kd or ks says what the scale is.
    """
    physical = problem.unknowns.unpack(point)
    linear: Linear = problem.linear(eliminated)
    kd, ks = linear.kd, linear.ks
    scale = jnp.ones((), kd.dtype)
    if problem.unknowns.free_scale:
        fixed = not (problem.unknowns.kd.free and problem.unknowns.ks.free)
        scale = eliminated[-1] if fixed else jnp.mean(kd + ks)
        kd, ks = kd / scale, ks / scale
    mu = jnp.full((), jnp.nan, kd.dtype) if physical.mu is None else physical.mu
    return Parameters(kd, ks, physical.sigma, mu, physical.gains, scale)


@eqx.filter_jit
def _propagate(
    problem: Problem,
    model: LinearisedModel,
    measured: tuple[Data, Float[AnyArray, "sample"], Bool[AnyArray, "sample"]],
    unknowns: tuple,
    settings: tuple,
) -> tuple[Parameters, Float[Array, "parameter parameter"], Float[Array, ""]]:
    (data, shares, half), (held, noise_given, factor) = measured, settings
    vector, split = jnp.concatenate(unknowns), unknowns[0].shape[0]

    def residual(vector: Float[Array, "all"]) -> Float[Array, "residual"]:
        predicted = problem.predict(model, data, vector[:split], problem.linear(vector[split:]))
        return (jnp.asarray(data.weights) * (data.radiance - predicted)).ravel()

    def parameters(vector: Float[Array, "all"]) -> Float[Array, "parameter"]:
        found = to_parameters(problem, vector[:split], vector[split:])
        found = found._replace(mu=jnp.nan_to_num(found.mu))
        return jnp.concatenate([jnp.ravel(leaf) for leaf in found])

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
        spread = jnp.where(held[None, :], 0, jax.jacfwd(parameters)(vector))
        return (
            to_parameters(problem, vector[:split], vector[split:]),
            spread @ covariance @ spread.T,
            apart @ _inverse(first + second) @ apart,
        )


def _prior(problem: Problem, vector: Float[Array, "all"]) -> Float[Array, "all"]:
    """Say what the bounds of sigma and mu alone tell about their search variables.

    Spread evenly between its bounds (in the logarithm) a parameter's logit has the variance
    pi^2 / 3.  It matters only where the data say nothing: the error of such a parameter stays that
    of its range, and does not leak into the others through a linearisation far beyond its reach.
    """
    bounded = np.array([not name.startswith("gain") for name in problem.unknowns.names], bool)
    prior = np.zeros(vector.shape[0])
    prior[: len(bounded)] = bounded * 3 / np.pi**2
    return jnp.asarray(prior, vector.dtype)


def _inverse(matrix: Float[Array, "all all"]) -> Float[Array, "all all"]:
    """Invert a symmetric matrix scaled to unit diagonal; what has no information stays huge."""
    diagonal = jnp.diag(matrix)
    scale = jnp.where(diagonal > 0, 1 / jnp.sqrt(jnp.where(diagonal > 0, diagonal, 1)), 0)
    values, vectors = jnp.linalg.eigh(matrix * scale[:, None] * scale[None, :])
    floor = jnp.finfo(matrix.dtype).eps * matrix.shape[0]
    inverse = (vectors / jnp.maximum(values, floor)[None, :]) @ vectors.T
    return inverse * scale[:, None] * scale[None, :]


def _held(problem: Problem, fit: Fit) -> np.ndarray:
    """Mark the unknowns that ended at a bound: they have no error bar of their own."""
    eliminated = np.asarray(fit.linear.eliminated)
    lower, upper = np.asarray(problem.lower), np.asarray(problem.upper)
    at_box = (eliminated <= lower) | (eliminated >= upper)
    return np.concatenate([problem.unknowns.at_bound(fit.solution.point), at_box])


def _bound(value: Parameters, error: Parameters, sign: int) -> Parameters:
    """Move each value by the 90 % half width, sigma and mu - 1 by a factor."""
    moved = {}
    for name in Parameters._fields:
        centre, spread = getattr(value, name), _NORMAL_90 * getattr(error, name)
        if name in ("sigma", "mu"):
            origin = 1.0 if name == "mu" else 0.0
            moved[name] = origin + (centre - origin) * np.exp(sign * spread / (centre - origin))
        else:
            moved[name] = centre + sign * spread
    return Parameters(**moved)
