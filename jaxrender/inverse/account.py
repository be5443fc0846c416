"""The account at the end of a fit: error bars, what is identifiable, and why not."""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.conditioning import WidthEvidence, width_evidence
from jaxrender.inverse.known_light import PreparedLight
from jaxrender.inverse.models import DualModel, LinearisedModel
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.passes import FitSettings, Stop, in_deviations
from jaxrender.inverse.reasons import not_identifiable
from jaxrender.inverse.shadowing import shadows_of
from jaxrender.inverse.uncertainty import (
    Uncertain,
    off_prior,
    rests_on_prior,
    uncertain_parameters,
    within_reach,
)
from jaxrender.inverse.weights import variance_factor

# Photographs and a prior that differ by so many standard deviations contradict each other.
_MOST_OFF = 4.0


class Account(NamedTuple):
    """The error bars of a fit, and what that of the width rests on (of a glossy model)."""

    parameters: Uncertain
    evidence: WidthEvidence | None


def account_for(
    stop: Stop,
    variant: Parametric,
    prepared: PreparedLight,
    settings: FitSettings,
    shape: Shape | None = None,
) -> Account:
    """Put error bars on the end of a fit, and say what they rest on; ``shape`` if it is concave."""
    near = _linearised(stop)
    uncertain = error_bars(stop, settings)
    if not (isinstance(variant, Glossy) and variant.has_frequency_view):
        return Account(uncertain, None)
    samples = stop.observations.samples
    light = prepared.dual.for_frames(stop.data.frame)
    darkened = shadows_of(shape, stop.observations, light)
    spectral = DualModel(variant, samples, light, darkened, transfer="gaussian")
    evidence = width_evidence(stop.problem, near, spectral, stop.data, stop.fit)
    return Account(uncertain, evidence)


def error_bars(stop: Stop, settings: FitSettings) -> Uncertain:
    """Put error bars on the end of a fit."""
    return uncertain_parameters(
        stop.problem,
        _linearised(stop),
        stop.data,
        stop.fit,
        settings.noise is not None,
        variance_factor=variance_factor(in_deviations(stop), settings.loss),
        shares=stop.observations.shares,
    )


def _linearised(stop: Stop) -> LinearisedModel:
    if isinstance(stop.model, LinearisedModel):
        return stop.model
    physical = stop.problem.unknowns.unpack(stop.fit.solution.point)
    return LinearisedModel.about(stop.model, physical.numbers)


def judge(
    stop: Stop, account: Account, variant: Parametric
) -> tuple[Outcome, dict[str, bool], tuple[str, ...]]:
    """Decide what is identifiable, how the fit ended, and why, in the model's own words."""
    unknowns = stop.problem.unknowns
    eliminated = np.asarray(stop.fit.linear.eliminated)
    bound = dict(zip(unknowns.names, unknowns.at_bound(stop.fit.solution.point)))
    lower, upper = np.asarray(stop.problem.lower), np.asarray(stop.problem.upper)
    mixed = np.asarray(stop.problem.mix) @ ((eliminated <= lower) | (eliminated >= upper))
    by_lobe = np.split(mixed > 0, len(unknowns.amplitudes))
    bound |= {name: bool(of.any()) for name, of in zip(unknowns.amplitude_names, by_lobe)}
    names = [*unknowns.free_amplitudes, *unknowns.free_numbers]
    identifiable, reasons = {}, []
    for name in names:
        reached = within_reach(account.parameters, name)
        silent = rests_on_prior(account.parameters, name, unknowns[name].prior)
        off = 0.0 if silent else off_prior(account.parameters, name, unknowns[name].prior)
        identifiable[name] = reached and not bound[name] and not silent and off < _MOST_OFF
        if bound[name]:
            reasons.append(f"{name} is at a bound of its range")
        elif silent:
            reasons.append(f"{name} is what its prior says: the photographs add next to nothing")
        elif off >= _MOST_OFF:
            reasons.append(
                f"{name} in the photographs is {off:.0f} standard deviations off its prior: "
                "one of the two is wrong"
            )
        elif not reached:
            reasons.append(_why(name, account, variant))
    if not bool(stop.fit.solution.converged):
        return Outcome.NOT_CONVERGED, identifiable, tuple(reasons)
    if any(bound[name] for name in names):
        return Outcome.AT_BOUND, identifiable, tuple(reasons)
    outcome = Outcome.CONVERGED if all(identifiable.values()) else Outcome.NOT_IDENTIFIABLE
    return outcome, identifiable, tuple(reasons)


def _why(name: str, account: Account, variant: Parametric) -> str:
    """Say why a parameter is not identifiable."""
    sentence = not_identifiable(name, account.parameters)
    if name in variant.amplitude_names:
        return sentence
    if account.evidence is None:
        return f"{sentence}; these views and this light show too little of the lobe's shape"
    # Where the light is silent about any specular lobe, however strong, ks is lost with the others.
    silent = not np.isfinite(account.evidence.spectrum)
    if not silent and not within_reach(account.parameters, "ks"):
        return f"{sentence}; the specular lobe is too weak beside what the model leaves unexplained"
    if name == variant.index.name:
        return f"{sentence}; too few grazing samples show how the lobe grows towards the horizon"
    return (
        f"{sentence}; the light has too little detail for the roughness to blur, and too few "
        f"grazing samples show the horizon ({account.evidence.sentence()})"
    )
