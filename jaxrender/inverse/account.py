"""The account at the end of a fit: error bars, what is identifiable, and why not."""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.calibration import Calibration
from jaxrender.inverse.clusters import Clusters
from jaxrender.inverse.conditioning import WidthEvidence, width_evidence
from jaxrender.inverse.curves import curves_of, reach_at_the_peak
from jaxrender.inverse.diagnosis import Diagnosis, reaching
from jaxrender.inverse.intervals import (
    IDENTIFIABLE_WITHIN,
    Uncertain,
    off_prior,
    rests_on_prior,
    within_reach,
)
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.models import DualModel, LinearisedModel
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.passes import FitSettings, Stop, in_deviations
from jaxrender.inverse.prepared_light import PreparedLight
from jaxrender.inverse.reasons import (
    MOVED,
    made_up_for,
    not_identifiable,
    out_of_reach_by_misfit,
)
from jaxrender.inverse.shadowing import shadows_of
from jaxrender.inverse.stated import Unknown
from jaxrender.inverse.uncertainty import uncertain_parameters
from jaxrender.inverse.weights import variance_factor

# Photographs and a prior that differ by so many standard deviations contradict each other.
_MOST_OFF = 4.0


class Account(NamedTuple):
    """The error bars of a fit, what that of the width rests on (of a glossy model), and misfit."""

    parameters: Uncertain
    evidence: WidthEvidence | None
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()
    notes: tuple[str, ...] = ()

    def with_misfit(self, misfit: Misfit | None, diagnosis: tuple[Diagnosis, ...]) -> "Account":
        """Let the error bars reach as far as the parameters would move by the best explanations."""
        parameters = reaching(self.parameters, diagnosis)
        return self._replace(parameters=parameters, misfit=misfit, diagnosis=diagnosis)

    def with_calibration(self, calibration: Calibration) -> "Account":
        """Let the error bars hold those of the nuisances that were freed."""
        wider = self.parameters.spread_by(calibration.shifts)
        return self._replace(parameters=wider, notes=calibration.sentences)

    def with_note(self, note: str) -> "Account":
        """Say one thing more."""
        return self._replace(notes=(*self.notes, note))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Say how much the photographs hold beyond the model, and what would explain it."""
        found = []
        if self.misfit is not None and self.misfit.found:
            found.append(self.misfit.sentence())
        return (*found, *(best.reason for best in self.diagnosis[:1]))


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
    if not (prepared.for_dual and isinstance(variant, Glossy)):
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
        variance_factor=variance_factor(
            in_deviations(stop)[stop.observations.pixels > 0], settings.loss
        ),
        shares=stop.observations.shares,
        clusters=Clusters.of(stop.observations),
    )


def _linearised(stop: Stop) -> LinearisedModel:
    if isinstance(stop.model, LinearisedModel):
        return stop.model
    unknowns = stop.problem.unknowns
    numbers = unknowns.unpack(stop.fit.solution.point).numbers
    return LinearisedModel.about(stop.model, numbers, unknowns.free_numbers)


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
    free = [*unknowns.free_amplitudes, *unknowns.free_numbers]
    shaped = [variant.amplitude_names[at] for at in variant.shaped()]
    known = {name: unknowns[name] for name in free}
    if variant.sums:
        # Amplitudes that stand in for one another are judged by their sum, which has no bound.
        sums = [name for name, own in variant.sums.items() if set(own) & set(free)]
        parts = {part for own in variant.sums.values() for part in own}
        free = [*sums, *(name for name in free if name not in parts)]
        shaped = [name for name in sums if name not in variant.bases]
        known |= dict.fromkeys(sums, Unknown())
        bound |= dict.fromkeys(sums, False)
        account = account._replace(parameters=account.parameters.summed(variant.sums))
    identifiable, reasons = {}, [*account.reasons, *account.notes]
    curves = curves_of(variant, account.parameters)
    # Numbers that describe a curve together mean little one by one.
    of_curve = {one.name for one in variant.searched} if curves else set()
    wide = reach_at_the_peak(curves)
    # A prior is held against what the photographs say, be the model right or wrong.
    exact = account.parameters.if_exact or account.parameters
    for name in free:
        base = name in variant.bases
        reached = within_reach(account.parameters, name, shaped if base else ())
        lobes = sum(float(np.mean(account.parameters.value.of(lobe))) for lobe in shaped)
        if base and lobes > 0 and not _is_stated(name, known[name], variant):
            # A metal has no base: 0 is its value, and no bound that anybody would widen.
            bound[name] = False
        if name in variant.closed and not _is_stated(name, known[name], variant):
            bound[name] = False
        silent = rests_on_prior(exact, name, known[name].prior)
        if name in of_curve and not _is_stated(name, known[name], variant):
            identifiable[name] = wide <= IDENTIFIABLE_WITHIN
            continue
        off = 0.0 if silent else off_prior(exact, name, known[name].prior)
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
            reasons.append(_why(name, account, variant, free))
    if wide > IDENTIFIABLE_WITHIN:
        reasons.append(
            "the distribution of facets is not identifiable: above half its peak its 90 % band "
            f"reaches {100 * np.expm1(wide):.0f} % to either side"
        )
    if not bool(stop.fit.solution.converged):
        return Outcome.NOT_CONVERGED, identifiable, tuple(reasons)
    # A bound that somebody stated may be what is wrong.
    if any(bound[name] and _is_stated(name, known[name], variant) for name in free):
        return Outcome.AT_BOUND, identifiable, tuple(reasons)
    if account.reasons:
        return Outcome.MISFIT, identifiable, tuple(reasons)
    judged = [name for name in free if name not in of_curve]
    if any(bound[name] for name in judged):
        return Outcome.AT_BOUND, identifiable, tuple(reasons)
    told = all(identifiable[name] for name in judged) and wide <= IDENTIFIABLE_WITHIN
    outcome = Outcome.CONVERGED if told else Outcome.NOT_IDENTIFIABLE
    return outcome, identifiable, tuple(reasons)


def _is_stated(name: str, unknown: Unknown, variant: Parametric) -> bool:
    """Whether the bounds of a number are not those that its model has anyway."""
    usual = {one.name: (one.lowest, one.highest) for one in variant.searched}
    anything = Unknown()
    low, high = usual.get(name, (anything.lower, anything.upper))
    return unknown.lower > low or unknown.upper < high


def _why(name: str, account: Account, variant: Parametric, free: list[str]) -> str:
    """Say why a parameter is not identifiable; ``free`` are all that may make up for it."""
    sentence = not_identifiable(name, account.parameters)
    other = made_up_for(name, free, account.parameters)
    sentence = f"{sentence}; {other}" if other else sentence
    if account.diagnosis and out_of_reach_by_misfit(name, account.parameters):
        return f"{sentence}; {MOVED}"
    if name in variant.amplitude_names or name in variant.sums:
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
