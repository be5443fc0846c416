"""The error bars that a fit of the material under known light will have (T 2.4.2, 6.4.2).

They are those of ``inverse.uncertainty`` at the end of a fit, which are the Cramer-Rao bounds.  The
photographs that the supposed material would give take the place of measured ones.  For the
covariance of least squares depends on what is measured only through where the fit ends.
"""

from typing import NamedTuple

import jax
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.inverse.brdf import BRDFFit
from jaxrender.inverse.conditioning import WidthEvidence, width_evidence
from jaxrender.inverse.curves import curves_of, reach_at_the_peak
from jaxrender.inverse.elimination import Fit, Problem
from jaxrender.inverse.forecast.causes import causes_of
from jaxrender.inverse.forecast.information import frame_grams, reading_of
from jaxrender.inverse.forecast.situation import (
    Foreseen,
    Situation,
    Supposed,
    foreseen_of,
    kind_of,
    problem_of,
    unknowns_at,
)
from jaxrender.inverse.forecast.spectrum import highest_identifiable_degree
from jaxrender.inverse.intervals import (
    IDENTIFIABLE_WITHIN,
    Uncertain,
    relative_error,
    within_reach,
)
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.models import DualModel, LinearisedModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.prepared_light import by_frequency, prepare_light
from jaxrender.inverse.solvers import Solution
from jaxrender.inverse.uncertainty import uncertain_parameters
from jaxrender.inverse.unknowns import Unknowns, unknowns_of
from jaxrender.shapes import Float


class MaterialForecast(NamedTuple):
    """The forecast of a fit of the material.

    The operator takes relative changes of the parameters named ``unknowns`` to the photographs in
    units of their noise.  ``singular_values`` are its own, descending; ``weakest`` is the change
    that shows least.  Up to ``highest_degree`` the light shows through the lobe above the noise.
    """

    parameters: Uncertain
    identifiable: dict[str, bool]
    evidence: WidthEvidence | None
    unknowns: tuple[str, ...]
    singular_values: Float[np.ndarray, "unknown"]
    weakest: Float[np.ndarray, "unknown"]
    samples: int
    sentences: tuple[str, ...]
    highest_degree: int = 0

    def relative_error(self, name: str) -> float:
        """The standard error as a part of the value above its origin, in the worst channel."""
        return relative_error(self.parameters, name)


def forecast_material(
    foreseen: Foreseen,
    unknowns: Unknowns | None = None,
    split: str | float = "auto",
    explain: bool = True,
) -> MaterialForecast:
    """Predict the error bars of a fit, what will be identifiable, and why not.

    All is free where no ``unknowns`` are given.  Parameters that are fixed are taken to be fixed at
    what is supposed of them.  ``split`` is that of the fit.  ``explain`` looks for remedies where a
    parameter is not identifiable.
    Raises ``ValueError`` for a supposed material outside the bounds of the search.
    """
    brdf = foreseen.supposed.brdf
    problem = problem_of(unknowns or unknowns_of(brdf), brdf)
    evidence = _evidence(problem, foreseen, _fit_at(problem, foreseen), split)
    return _forecast(problem, foreseen, evidence, explain)


def forecast_of_fit(fit: BRDFFit, light: KnownLight) -> MaterialForecast:
    """Predict the error bars that a fit of the material that was found should have.

    That is what could have been said beforehand, had the material been known: an error bar that was
    achieved is larger where the model leaves more unexplained than noise.  Made of the columns and
    derivatives that the fit ended with, so that it costs next to nothing.
    """
    final = fit.final
    near = final.model
    physical = final.problem.unknowns.unpack(final.fit.solution.point)
    if not isinstance(near, LinearisedModel):
        near = LinearisedModel.about(final.model, physical.numbers)
    # What the photographs show, before any gauge.
    amplitudes = np.asarray(final.fit.linear.amplitudes)
    supposed = Supposed(fit.brdf.with_amplitudes(*amplitudes), fit.noise)
    observed = final.observations
    situation = Situation(observed.samples, np.asarray(observed.frame), light)
    foreseen = foreseen_of(situation, supposed, near, observed.shares)
    problem = problem_of(final.problem.unknowns, supposed.brdf)
    return _forecast(problem, foreseen, fit.evidence, explain=True)


def _forecast(
    problem: Problem, foreseen: Foreseen, evidence: WidthEvidence | None, explain: bool
) -> MaterialForecast:
    fit = _fit_at(problem, foreseen)
    parameters = uncertain_parameters(
        problem, foreseen.model, foreseen.data, fit, True, shares=foreseen.shares
    )
    free = [*problem.unknowns.free_amplitudes, *problem.unknowns.free_numbers]
    identifiable = {name: within_reach(parameters, name) for name in free}
    curves = curves_of(foreseen.supposed.brdf, parameters)
    if curves:
        # Numbers that describe a curve together mean little one by one.
        told = reach_at_the_peak(curves) <= IDENTIFIABLE_WITHIN
        identifiable |= dict.fromkeys(problem.unknowns.free_numbers, told)
    lost = [name for name in free if not identifiable[name]]
    sentences = causes_of(foreseen, problem, lost) if explain else ()
    if explain:
        sentences += _closing(problem, free, lost, evidence)
    names, values, weakest = _spectrum(problem, foreseen)
    count = len(foreseen.situation.frame)
    degree = highest_identifiable_degree(foreseen)
    return MaterialForecast(
        parameters, identifiable, evidence, names, values, weakest, count, sentences, degree
    )


def _fit_at(problem: Problem, foreseen: Foreseen) -> Fit:
    """The end of a fit that has found the supposed material."""
    point, eliminated = unknowns_at(problem, foreseen.supposed.brdf)
    done = Solution(*map(jax.device_put, (point, 0.0, True, 0)))
    return Fit(done, problem.linear(eliminated), jax.device_put(foreseen.data.radiance))


def _evidence(
    problem: Problem, foreseen: Foreseen, fit: Fit, split: str | float
) -> WidthEvidence | None:
    """Say what sigma will rest on: all samples, those seen head-on, the light's spectrum."""
    brdf, (samples, frame, light) = foreseen.supposed.brdf, foreseen.situation
    if not by_frequency(brdf, light):
        return None
    assert isinstance(brdf, Glossy)
    observations = Observations(samples, foreseen.data.radiance, frame)
    lobe = brdf.with_roughness(float(brdf.sigma), None).as_metal()
    dual = prepare_light(light.far, observations, lobe, split, None).dual.for_frames(frame)
    spectral = DualModel(kind_of(brdf), samples, dual, transfer="gaussian")
    return width_evidence(problem, foreseen.model, spectral, foreseen.data, fit)


def _spectrum(
    problem: Problem, foreseen: Foreseen
) -> tuple[tuple[str, ...], Float[np.ndarray, "unknown"], Float[np.ndarray, "unknown"]]:
    """Decompose the operator from relative changes of the parameters to weighted photographs."""
    reading = reading_of(problem, foreseen)
    information = reading.information(frame_grams(foreseen))
    information = information * reading.unit[:, None] * reading.unit[None, :]
    if not len(reading.unknowns):
        return (), np.zeros(0), np.zeros(0)
    values, vectors = np.linalg.eigh(information)
    singular = np.sqrt(np.maximum(values[::-1], 0))
    weakest = vectors[:, 0] * np.sign(vectors[np.argmax(np.abs(vectors[:, 0])), 0])
    return reading.unknowns, singular, weakest


def _closing(
    problem: Problem, free: list[str], lost: list[str], evidence: WidthEvidence | None
) -> tuple[str, ...]:
    sentences = []
    if free and not lost:
        sentences.append("every free parameter will be identifiable")
    if evidence is not None and evidence.name in free:
        sentences.append(evidence.sentence())
    if problem.unknowns.free_scale:
        sentences.append(
            "gauge: the scale between light and photographs is unknown, so only the ratios of kd "
            "and ks are identifiable"
        )
    return tuple(sentences)
