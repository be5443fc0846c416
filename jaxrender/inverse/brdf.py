"""A BRDF from photographs under known light (T 6.4.2), from the frequency view to the exact one.

1. *Rough*: the light is split at a small roughness, and the dual model fitted from many starts.
2. *Frequency fit*: the light is split again at the roughness found, as finely as the dual model
   needs it, and the samples fitted again; the noise is estimated and the samples reweighted by it.
3. *Refinement*: Levenberg-Marquardt on the exact integral over a stratified subset, starting from
   there.  How far it moves each parameter is the bias of the frequency fit, and is reported.
4. *Account*: intervals from the full covariance, what is identifiable, where sigma comes from, and
   what would be different under a slightly different model.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.conditioning import GRAZING_COSINE, SigmaEvidence, sigma_standard_error
from jaxrender.inverse.elimination import Data, Fit, Problem, cost_at, search
from jaxrender.inverse.known_light import KnownLight, PreparedLight, exact_nodes, prepare_light
from jaxrender.inverse.models import ExactModel, LinearisedModel, Model, TabulatedModel
from jaxrender.inverse.observations import Observations, stratified_subset
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.uncertainty import (
    Parameters,
    Uncertain,
    to_parameters,
    uncertain_parameters,
    within_reach,
)
from jaxrender.inverse.unknowns import MicrofacetUnknowns
from jaxrender.inverse.weights import robust_weights
from jaxrender.reflection import roughness_table
from jaxrender.shapes import Float

# The roughness that the light is split at in the rough first pass.
_ROUGH_SIGMA = 0.06
# The table of the second pass reaches this factor beyond the roughness found by the first.
_TABLE_REACH = 1.8
# The light is split anew when the fit ends this far (in log sigma) from where it was split.
_SPLIT_AGAIN = 0.25
_SPLITS = 3
# Noise is never taken to be less than this part of the mean radiance: exact data have none.
_LEAST_NOISE = 1e-6
# The refinement gives up after so many steps.
_REFINEMENTS = 20
# The noise has settled when its standard deviation changes by less than this.
_NOISE_SETTLED = 0.02
# Reweighting rounds: the noise settles in two, a robust loss in a few more.
_ROUNDS = {"squares": 3, "huber": 7, "cauchy": 7}

Stage = Callable[[str], AbstractContextManager]


class FitSettings(NamedTuple):
    """How a fit is done; the defaults are those of the command line."""

    split: str | float = "auto"
    band_limit: int | None = None
    transfer: str = "exit-cosine"
    refine: bool = True
    refine_samples: int = 2000
    method: str = "variable-projection"
    loss: str = "squares"
    noise: NoiseModel | None = None
    starts: int = 8
    seed: int = 0


class Stop(NamedTuple):
    """Where one pass ended: the fit, the observations, weights and model it ended with."""

    fit: Fit
    problem: Problem
    model: Model
    data: Data
    observations: Observations
    noise: NoiseModel

    @property
    def relative_rms(self) -> float:
        """sqrt(sum r^2 / sum B^2), unweighted."""
        residual = np.asarray(self.data.radiance) - np.asarray(self.fit.predicted)
        return float(np.sqrt(np.sum(residual**2) / np.sum(np.asarray(self.data.radiance) ** 2)))


class Begin(NamedTuple):
    """Where a pass begins: the noise and the prediction known so far, and the starting points."""

    noise: NoiseModel | None
    predicted: Float[np.ndarray, "sample channel"] | None
    starts: Float[np.ndarray, "start unknown"]


class Account(NamedTuple):
    """The error bars of a fit, and what the one of sigma rests on."""

    parameters: Uncertain
    evidence: SigmaEvidence


class BRDFFit(NamedTuple):
    """A recovered material with all that is known about how well it is known."""

    brdf: Microfacet
    outcome: Outcome
    parameters: Uncertain
    identifiable: dict[str, bool]
    evidence: SigmaEvidence
    frequency: Stop
    exact: Stop | None
    light: PreparedLight
    reasons: tuple[str, ...]

    @property
    def final(self) -> Stop:
        """The refined fit where there is one, else the frequency fit."""
        return self.frequency if self.exact is None else self.exact

    @property
    def bias(self) -> dict[str, Float[np.ndarray, "..."]]:
        """How far the refinement moved each parameter, relative to its refined value."""
        if self.exact is None:
            return {}
        before, after = values_of(self.frequency), values_of(self.exact)
        return {
            name: np.asarray(getattr(before, name) / getattr(after, name) - 1)
            for name in ("kd", "ks", "sigma", "mu")
        }


def fit_brdf(
    observations: Observations,
    light: KnownLight,
    unknowns: MicrofacetUnknowns,
    variant: Microfacet,
    settings: FitSettings = FitSettings(),
    stage: Stage = lambda name: nullcontext(),
) -> BRDFFit:
    """Recover kd, ks, sigma and mu of T 6.2 from samples of the reflected light.

    ``variant`` tells the Fresnel angle, the masking and, by ``mu=None``, a metal; its numbers do
    not matter.  ``stage`` is entered with the name of each step.  Raises ``ValueError`` for fewer
    samples than unknowns.
    """
    problem = Problem.of(unknowns, observations.radiance.shape[1])
    _check_enough(observations, problem)
    with stage("rough"):
        found = _rough_fit(observations, light, problem, variant, settings)
    for _ in range(_SPLITS):
        at = _sigma(found)
        with stage("split"):
            brdf = variant.with_roughness(at, None).as_metal()
            prepared = prepare_light(light, observations, brdf, settings.split, settings.band_limit)
        with stage("table"):
            table = roughness_table(
                variant,
                observations.samples,
                prepared.dual,
                _table_range(unknowns, at),
                transfer=settings.transfer,
            )
        with stage("solve"):
            begin = Begin(settings.noise, None, np.asarray(found.fit.solution.point)[None])
            found = _fit_in_rounds(problem, TabulatedModel(table), observations, begin, settings)
        if abs(np.log(_sigma(found) / at)) < _SPLIT_AGAIN:
            break
    exact = None
    if settings.refine:
        with stage("refine"):
            exact = _refine(found, light, variant, settings)
    final = found if exact is None else exact
    with stage("account"):
        account = _account(final, variant, prepared, settings)
        outcome, identifiable, reasons = _judge(final, account)
    return BRDFFit(
        _material(final, variant),
        outcome,
        account.parameters,
        identifiable,
        account.evidence,
        found,
        exact,
        prepared,
        reasons,
    )


def _rough_fit(
    observations: Observations,
    light: KnownLight,
    problem: Problem,
    variant: Microfacet,
    settings: FitSettings,
) -> Stop:
    """Find the neighbourhood of the answer from many starts."""
    unknowns = problem.unknowns
    if unknowns.sigma.free:
        sigma = max(unknowns.sigma.lower, min(_ROUGH_SIGMA, unknowns.sigma.upper))
        reach = (unknowns.sigma.lower, unknowns.sigma.upper)
    else:
        sigma = unknowns.sigma.fixed[0]
        reach = (sigma, sigma * 1.01)
    split = "rough" if settings.split == "auto" else settings.split
    brdf = variant.with_roughness(sigma, None)
    prepared = prepare_light(light, observations, brdf, split, settings.band_limit)
    table = roughness_table(
        variant, observations.samples, prepared.dual, reach, transfer=settings.transfer
    )
    begin = Begin(settings.noise, None, unknowns.starts(settings.starts))
    return _fit_in_rounds(problem, TabulatedModel(table), observations, begin, settings)


def _refine(frequency: Stop, light: KnownLight, variant: Microfacet, settings: FitSettings) -> Stop:
    """Continue on the exact integral over a stratified subset."""
    some, predicted = stratified_subset(
        frequency.observations, frequency.fit.predicted, settings.refine_samples, settings.seed
    )
    nodes = exact_nodes(light, np.asarray(some.frame), _sigma(frequency))
    model = ExactModel(variant, some.samples, nodes)
    return descend(frequency, model, some, predicted, settings)


def descend(
    frequency: Stop,
    model: Model,
    observations: Observations,
    predicted: Float[np.ndarray, "sample channel"],
    settings: FitSettings,
    tolerance: float = 1e-5,
) -> Stop:
    """Minimise over an expensive model: Levenberg-Marquardt on its linearisation, again and again.

    The model and its derivatives are evaluated once a step; everything else, the noise and the
    weights included, is solved to the end on the linearised columns.  A step that makes the true
    residual larger is halved until it does not.  Ends when no search variable moves by more than
    ``tolerance``.
    """
    problem, noise = frequency.problem, settings.noise or frequency.noise
    point, before = np.asarray(frequency.fit.solution.point), None
    for _ in range(_REFINEMENTS):
        physical = problem.unknowns.unpack(jnp.asarray(point))
        near = LinearisedModel.about(model, physical.sigma, physical.mu)
        if before is not None and _cost(problem, near, before.stop.data, point) > before.cost:
            point = (point + before.point) / 2
            continue
        begin = Begin(noise, predicted, point[None])
        stop = _fit_in_rounds(problem, near, observations, begin, settings)
        before = _Step(point, stop, _cost(problem, near, stop.data, point))
        noise, predicted = stop.noise, np.asarray(stop.fit.predicted)
        point = np.asarray(stop.fit.solution.point)
        if np.all(np.abs(point - before.point) < tolerance):
            return stop
    return _not_converged(before.stop)


class _Step(NamedTuple):
    """One linearisation: where, what it led to, and the true cost there."""

    point: Float[np.ndarray, "unknown"]
    stop: Stop
    cost: float


def _cost(problem: Problem, model: Model, data: Data, point: Float[np.ndarray, "unknown"]) -> float:
    """Weigh up a model exactly at a point, with a rounding's tolerance."""
    return float(cost_at(problem, model, data, jnp.asarray(point))) * (1 + 1e-9)


def _not_converged(stop: Stop) -> Stop:
    solution = stop.fit.solution._replace(converged=jnp.zeros((), bool))
    return stop._replace(fit=stop.fit._replace(solution=solution))


def _fit_in_rounds(
    problem: Problem,
    model: Model,
    observations: Observations,
    begin: Begin,
    settings: FitSettings,
) -> Stop:
    """Fit, estimate the noise from what is left, weigh by it (and by the loss), fit again."""
    radiance = np.asarray(observations.radiance)
    scale = float(np.sqrt(np.mean(radiance**2)))
    noise, predicted, starts = begin
    weights = np.full_like(radiance, 1 / scale)
    for turn in range(_ROUNDS[settings.loss]):
        if noise is not None and predicted is not None:
            weights = _weights(noise, predicted, scale)
            weights *= robust_weights((radiance - predicted) * weights, settings.loss)
        data = Data(radiance, weights, np.asarray(observations.frame))
        fit = search(problem, model, data, starts, settings.method)
        predicted = np.asarray(fit.predicted)
        starts = np.asarray(fit.solution.point)[None]
        before, noise = noise, settings.noise or estimate_noise(radiance - predicted, predicted)
        if turn > 0 and settings.loss == "squares" and _close(before, noise, predicted):
            break
    return Stop(fit, problem, model, data, observations, noise)


def _weights(
    noise: NoiseModel, predicted: Float[np.ndarray, "sample channel"], scale: float
) -> Float[np.ndarray, "sample channel"]:
    """Weigh by the predicted, not the measured radiance: the latter would favour dark noise."""
    deviation = np.asarray(noise.standard_deviation(np.maximum(predicted, 0)))
    return 1 / np.hypot(deviation, _LEAST_NOISE * scale)


def _close(
    before: NoiseModel | None, after: NoiseModel, predicted: Float[np.ndarray, "sample channel"]
) -> bool:
    if before is None:
        return False
    level = np.sqrt(np.mean(predicted**2))
    ratio = before.standard_deviation(level) / max(after.standard_deviation(level), 1e-300)
    return bool(abs(np.log(max(ratio, 1e-300))) < _NOISE_SETTLED)


def _account(
    stop: Stop, variant: Microfacet, prepared: PreparedLight, settings: FitSettings
) -> Account:
    """Put error bars on the end of a fit, and say what they rest on."""
    unknowns, fit = stop.problem.unknowns, stop.fit
    physical = unknowns.unpack(fit.solution.point)
    near = stop.model
    if not isinstance(near, LinearisedModel):
        near = LinearisedModel.about(stop.model, physical.sigma, physical.mu)
    uncertain = uncertain_parameters(stop.problem, near, stop.data, fit, settings.noise is not None)
    at = (fit.solution.point, fit.linear.eliminated)
    steep = np.asarray(stop.observations.samples.exit_cosines) >= GRAZING_COSINE
    without_grazing = stop.data._replace(weights=stop.data.weights * steep[:, None])
    sigma = float(physical.sigma)
    spectral = TabulatedModel(
        roughness_table(
            variant,
            stop.observations.samples,
            prepared.dual,
            (sigma, 1.01 * sigma),
            transfer="gaussian",
        )
    )
    spectrum = LinearisedModel.about(spectral, physical.sigma, physical.mu)
    evidence = SigmaEvidence(
        sigma_standard_error(stop.problem, near, stop.data, at),
        sigma_standard_error(stop.problem, near, without_grazing, at),
        sigma_standard_error(stop.problem, spectrum, stop.data, at),
    )
    return Account(uncertain, evidence)


def _judge(stop: Stop, account: Account) -> tuple[Outcome, dict[str, bool], tuple[str, ...]]:
    """Decide what is identifiable, how the fit ended, and why, in words."""
    unknowns = stop.problem.unknowns
    eliminated = np.asarray(stop.fit.linear.eliminated)
    bound = dict(zip(unknowns.names, unknowns.at_bound(stop.fit.solution.point)))
    lower, upper = np.asarray(stop.problem.lower), np.asarray(stop.problem.upper)
    mixed = np.asarray(stop.problem.mix) @ ((eliminated <= lower) | (eliminated >= upper))
    bound["kd"], bound["ks"] = (bool(half.any()) for half in np.split(mixed > 0, 2))
    free = {"kd": unknowns.kd, "ks": unknowns.ks, "sigma": unknowns.sigma, "mu": unknowns.mu}
    names = [name for name, unknown in free.items() if unknown is not None and unknown.free]
    identifiable, reasons = {}, []
    for name in names:
        reached = within_reach(account.parameters, name)
        identifiable[name] = reached and not bound[name]
        if bound[name]:
            reasons.append(f"{name} is at a bound of its range")
        elif not reached:
            reasons.append(_why(name, account))
    if not bool(stop.fit.solution.converged):
        return Outcome.NOT_CONVERGED, identifiable, tuple(reasons)
    if any(bound[name] for name in names):
        return Outcome.AT_BOUND, identifiable, tuple(reasons)
    outcome = Outcome.CONVERGED if all(identifiable.values()) else Outcome.NOT_IDENTIFIABLE
    return outcome, identifiable, tuple(reasons)


def _why(name: str, account: Account) -> str:
    """Say why a parameter is not identifiable."""
    low, high = (
        np.asarray(getattr(b, name)) for b in (account.parameters.lower, account.parameters.upper)
    )
    interval = ", ".join(f"{a:.3g} to {b:.3g}" for a, b in zip(low.ravel(), high.ravel()))
    sentence = f"{name} is not identifiable: its 90 % interval is {interval}"
    if name != "sigma":
        return sentence
    return (
        f"{sentence}; the light has too little detail for the roughness to blur, and too few "
        f"grazing samples show the horizon ({account.evidence.sentence()})"
    )


def values_of(stop: Stop) -> Parameters:
    """Put the end of a pass into the material's own units."""
    return to_parameters(stop.problem, stop.fit.solution.point, stop.fit.linear.eliminated)


def _sigma(stop: Stop) -> float:
    return float(stop.problem.unknowns.unpack(stop.fit.solution.point).sigma)


def _material(stop: Stop, variant: Microfacet) -> Microfacet:
    found = values_of(stop)
    mu = None if variant.mu is None else float(found.mu)
    return Microfacet(
        np.asarray(found.kd),
        np.asarray(found.ks),
        float(found.sigma),
        mu,
        variant.fresnel,
        variant.masking,
    )


def _table_range(unknowns: MicrofacetUnknowns, sigma: float) -> tuple[float, float]:
    if not unknowns.sigma.free:
        return sigma, 1.01 * sigma
    low = max(unknowns.sigma.lower, sigma / _TABLE_REACH)
    return low, min(unknowns.sigma.upper, sigma * _TABLE_REACH)


def _check_enough(observations: Observations, problem: Problem) -> None:
    measured = observations.radiance.size
    unknown = len(problem.unknowns.names) + problem.mix.shape[1]
    if measured < max(10, 2 * unknown):
        raise ValueError(
            f"{observations.count} samples cannot determine {unknown} unknowns: "
            "use more photographs, a lower samples.min_cosine, or a smaller capture.erode"
        )
