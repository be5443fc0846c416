"""A BRDF from photographs under known light (T 6.4.2), from the frequency view to the exact one.

1. *Rough*: the light is split at a small roughness, and the dual model fitted from many starts.
2. *Frequency fit*: the light is split again at the roughness found, as finely as the dual model
   needs it, and the samples fitted again; the noise is estimated and the samples reweighted by it.
3. *Refinement*: Levenberg-Marquardt on the exact integral over a draw of the samples, starting from
   there.  The draw grows until two halves of it agree.  How far the refinement moves each parameter
   is the bias of the frequency fit, and is reported.
4. *Examination*: neighbouring pixels tell the noise; what is left above it is misfit, and score
   tests say what would explain it.  Nuisances are freed where that is asked for.
5. *Account*: intervals from the full covariance, widened by the misfit, what is identifiable, where
   sigma comes from, and what would be different under a slightly different model.

On a concave shape the frequency view is T 6.12, with transfer vectors and the visibilities of R and
of the sources, and the exact one asks for every node of the light whether a sample sees it.  Light
that bounces from one part of the object to another is in neither, and joins the exact one where it
is asked for (``settings.interreflection``, T 6.6).

A material whose lobe is not about the reflected direction has no frequency view.  Neither have
environments of single photographs.  There a coarse fit by the integral takes the place of the first
two steps (``coarse_fit``).
"""

from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Bank, Parametric
from jaxrender.geometry import Shape
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.account import account_for, error_bars, judge
from jaxrender.inverse.bank_choice import choose_lobes
from jaxrender.inverse.bounds import checked_at_bound
from jaxrender.inverse.calibration import Calibration, check_free
from jaxrender.inverse.coarse_fit import fit_coarsely
from jaxrender.inverse.conditioning import WidthEvidence
from jaxrender.inverse.diagnosis import Diagnosis
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.examination import examine
from jaxrender.inverse.frequency_fit import fit_by_frequency
from jaxrender.inverse.interreflection import Bounced, WithBounced, fit_with_bounces
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.leverage import draw, leverage
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.material_task import MaterialTask, Stage
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.nuisances import Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.passes import DEFAULTS, FitSettings, Stop, descend, values_of
from jaxrender.inverse.prepared_light import PreparedLight, by_frequency, undivided
from jaxrender.inverse.shadowing import concave
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.lighting import LightNodes
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import Float

# A draw whose halves disagree grows by this factor.
_GROWTH = 3
# Pairs of a sample and a node of the light: a draw has so many without asking, and grows to so
# many; and to no more than so many samples.
_LITTLE_WORK, _MOST_WORK, _MOST_DRAWN = 5e4, 4e8, 100_000


class BRDFFit(NamedTuple):
    """A recovered material with all that is known about how well it is known."""

    brdf: Parametric
    outcome: Outcome
    parameters: Uncertain
    identifiable: dict[str, bool]
    evidence: WidthEvidence | None
    frequency: Stop
    exact: Stop | None
    light: PreparedLight
    reasons: tuple[str, ...]
    bounced: Bounced | None = None
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()
    calibration: Calibration | None = None

    @property
    def noise(self) -> NoiseModel:
        """The noise of single pixels where it is known, else that of the residuals."""
        return self.final.noise if self.misfit is None else self.misfit.noise

    @property
    def final(self) -> Stop:
        """The refined fit where there is one, else the frequency fit (or the coarse one)."""
        return self.frequency if self.exact is None else self.exact

    @property
    def bias(self) -> dict[str, Float[np.ndarray, "..."]]:
        """How far the refinement moved each parameter, relative to its refined value.

        Of a value of zero that is not finite.
        """
        if self.exact is None:
            return {}
        before, after = values_of(self.frequency), values_of(self.exact)
        with np.errstate(divide="ignore", invalid="ignore"):
            return {
                name: np.asarray(before.of(name)) / np.asarray(after.of(name)) - 1
                for name in (*after.amplitudes, *after.numbers)
            }


def fit_brdf(
    observations: Observations,
    light: KnownLight,
    unknowns: Unknowns,
    variant: Parametric,
    settings: FitSettings = DEFAULTS,
    stage: Stage = lambda name: nullcontext(),
    *,
    shape: Shape | None = None,
    pool: Observations | None = None,
) -> BRDFFit:
    """Recover kd, ks and the numbers of any parametric model from reflected light.

    ``variant`` tells the model: of a microfacet the distribution, the Fresnel angle, the masking
    and, by ``mu=None``, a metal; its numbers do not matter.  ``stage`` is entered with the name of
    each step.  ``shape`` is asked for shadows where it is concave, and then the observations must
    have places.  ``pool`` are all pixels that the observations were drawn from: neighbours among
    them tell the noise, and on a convex shape the refinement draws from it.

    Raises ``ValueError`` for fewer samples than unknowns, for bounced light of a bank or of
    sources that have a place, and for nuisances that there are none of or no room for.
    """
    check_free(settings.free)
    if settings.interreflection and light.near is not None:
        raise ValueError(
            "bounced light is not followed from sources that have a place; leave "
            "solve.interreflection out"
        )
    problem = Problem.of(unknowns, observations.radiance.shape[1])
    check_free_numbers(problem)
    check_enough(observations, problem)
    task = MaterialTask(problem, variant, observations, light, settings, concave(shape), stage)
    if by_frequency(variant, light):
        quick, prepared = fit_by_frequency(task)
        choice = Choice(quick.observations, np.asarray(quick.fit.predicted))
    else:
        if settings.interreflection and isinstance(variant, Bank):
            raise ValueError(
                "a bank is not refined, and learns nothing of bounced light: leave "
                "solve.interreflection out, or choose another model"
            )
        with stage("solve"):
            if isinstance(variant, Bank):
                # By the integral already, so that there is nothing to refine.
                task, quick = choose_lobes(task)
                choice = None
            else:
                quick, drawn, predicted = fit_coarsely(task)
                choice = Choice(drawn, predicted)
        with stage("split"):
            prepared = undivided(light, observations, settings.band_limit)
    exact, bounced = None, None
    if settings.refine and choice is not None:
        # Shadows are traced for the samples alone: a pool would cost as many times more rays.
        drawn_from = choice if pool is None or task.shape is not None else Choice(pool)
        exact, bounced = _refine(task, quick, drawn_from)
    stop = quick if exact is None else exact
    told = Told(stop.observations, light, shape)
    examined = examine(task, told, observations if pool is None else pool, stop)
    final, calibration = examined.end, examined.calibration
    with stage("account"):
        account = account_for(final, variant, prepared, settings, task.shape)
        account = account.with_misfit(examined.misfit, examined.diagnosis)
        if calibration is not None:
            account = account.with_calibration(calibration)
        if settings.free == "auto" and examined.unsettled:
            account = account.with_note(examined.unsettled_sentence)
        outcome, identifiable, reasons = judge(final, account, variant)
    material = task.material(final).in_use
    return BRDFFit(
        material,
        outcome,
        account.parameters.only(material.amplitude_names),
        identifiable,
        account.evidence,
        quick,
        exact if calibration is None else final,
        prepared,
        reasons,
        bounced,
        examined.misfit,
        examined.diagnosis,
        calibration,
    )


class Choice(NamedTuple):
    """Samples for a refinement to choose from, and what a quicker fit predicts of them, if known.

    Of a pool of all pixels nothing is predicted.
    """

    observations: Observations
    predicted: Float[np.ndarray, "sample channel"] | None = None


class _Refined(NamedTuple):
    """Where a refinement ended, and the light that bounces, if that was asked for."""

    stop: Stop
    bounced: Bounced | None = None


def _refine(task: MaterialTask, quick: Stop, choice: Choice) -> _Refined:
    """Continue on the exact integral over a draw of the samples, and with bounces if asked.

    ``quick`` is where a quicker fit ended.  The draw grows until two halves of it agree within
    their errors, until it holds all samples, or until it becomes too much work.
    """
    light, shape, settings, stage = task.light, task.shape, task.settings, task.stage
    (pool, expected), before = choice, quick
    weight = leverage(pool, light, task.widths)
    count = settings.refine_samples
    if expected is None:
        # Where the light is a few sources, many samples cost as little as few under an environment.
        nodes = exact_nodes(light, None, task.width(quick))
        count = max(count, int(_LITTLE_WORK / _nodes_a_sample(nodes)))
    while True:
        with stage("refine"):
            some, index = draw(pool, weight, count, settings.seed)
            nodes = task.nodes(light, some, task.width(before))
        with stage("refine" if shape is None else "shadows"):
            model = task.integral(some, nodes)
        with stage("refine"):
            begin = before.onward(None if expected is None else expected[index])
            stop = descend(task.problem, model, some, begin, settings)
            stop = checked_at_bound(stop, model, settings)
            work = some.count * _nodes_a_sample(nodes)
            largest = min(pool.count, _MOST_DRAWN)
            grown = some.count >= largest or _GROWTH * work > _MOST_WORK
            if grown or error_bars(stop, settings).disagreement <= 1:
                break
        count, before = min(_GROWTH * count, largest), stop
    if shape is None or not settings.interreflection:
        return _Refined(stop)

    def refit(before: Stop, bounced: ExactModel) -> Stop:
        at = np.asarray(before.fit.predicted)
        brighter = WithBounced(model, bounced)
        return descend(before.problem, brighter, some, before.onward(at), settings)

    with stage("interreflection"):
        return _Refined(*fit_with_bounces(stop, task.material, shape, light, refit))


def _nodes_a_sample(nodes: tuple[LightNodes | FrameNodes, ...]) -> int:
    return sum(part.directions.shape[-2] for part in nodes)


def check_free_numbers(problem: Problem) -> None:
    """Raise ``ValueError`` where nothing is unknown."""
    if _count_free(problem) == 0:
        raise ValueError("all numbers are fixed, and nothing is left to find: free one of them")


def check_enough(observations: Observations, problem: Problem) -> None:
    """Raise ``ValueError`` for fewer measurements than the unknowns need."""
    measured, unknown = observations.radiance.size, _count_free(problem)
    if measured < max(10, 2 * unknown):
        raise ValueError(
            f"{observations.count} samples cannot determine {unknown} unknowns: "
            "use more photographs, a lower samples.min_cosine, or a smaller capture.erode"
        )


def _count_free(problem: Problem) -> int:
    return len(problem.unknowns.names) + problem.mix.shape[1]
