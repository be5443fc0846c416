"""The whole recovery: photographs of an object of known shape in, light and material out."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration import Calibration, Examined, check_free
from jaxrender.inverse.diagnosis import Diagnosis, likeliest, reaching
from jaxrender.inverse.factorization.account import widened_light
from jaxrender.inverse.factorization.band_limits import task_of
from jaxrender.inverse.factorization.calibrate import check_free_of_light
from jaxrender.inverse.factorization.examination import Asked, End, examine
from jaxrender.inverse.factorization.recovered_scene import RecoveredScene
from jaxrender.inverse.factorization.rounds import find_both
from jaxrender.inverse.factorization.state import (
    DEFAULTS,
    NOTHING_KNOWN,
    FactorSettings,
    Known,
    Round,
    State,
    Task,
    free_unknowns,
    in_deviations,
)
from jaxrender.inverse.intervals import Uncertain, within_reach
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.nuisances import Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.reasons import (
    MOVED,
    missing_under_unknown_light,
    not_identifiable,
    out_of_reach_by_misfit,
)
from jaxrender.inverse.saturation import saturation_sentence
from jaxrender.inverse.shadowing import concave
from jaxrender.shapes import Float

# A logarithm this close to its bound is at it.
_AT_BOUND = 0.01
# Above this relative residual, several times the noise of usual photographs, the reasons say that
# the light is only sketched, unless something else would explain it.
_SKETCHED = 0.05


class Factorization(NamedTuple):
    """A recovered material and light, with all that is known about how well they are known.

    ``observations`` are the samples as they were fitted, and ``predicted`` what they should be.
    """

    brdf: Parametric
    scene: RecoveredScene
    parameters: Uncertain
    outcome: Outcome
    identifiable: dict[str, bool]
    reasons: tuple[str, ...]
    rounds: tuple[Round, ...]
    observations: Observations
    predicted: Float[np.ndarray, "sample channel"]
    noise: NoiseModel
    gauge: str
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()
    calibration: Calibration | None = None

    @property
    def relative_rms(self) -> float:
        """sqrt(sum r^2 / sum B^2) at the end."""
        return self.rounds[-1].relative_rms


def factorize(
    observations: Observations,
    variant: Parametric,
    settings: FactorSettings = DEFAULTS,
    known: Known = NOTHING_KNOWN,
    *,
    gauge: str = "per-channel",
    shape: Shape | None = None,
    pool: Observations | None = None,
    stage: Callable[[str], AbstractContextManager] = lambda name: nullcontext(),
    watch: Callable[[Round], None] = lambda round_: None,
) -> Factorization:
    """Recover light, kd, ks, sigma and mu from samples of the reflected light alone (T 6.4.4).

    Only the kind of ``variant`` counts: any parametric model; of a microfacet whether it is a
    metal, Fresnel angle, masking, distribution.  For a Lambertian body give a ``known`` share of 0,
    for one with a single lobe a share of 1; ``scene.determined`` then says which degrees of the
    light it determines.  Reflectances and light are in the gauge asked for (``account.GAUGES``).
    For a concave object give the ``shape`` and the observations' places: its shadows are then
    modelled, its interreflections are not.  ``pool`` are all pixels, whose neighbours tell the
    noise, and whose highest values tell whether they are clipped.  What is left above the noise is
    then diagnosed, and the error bars of material and light reach as far as it may have moved them;
    whether things lie elsewhere is asked where the ``shape`` is known.  Nuisances that the settings
    free are found along with material and light.

    Raises ``ValueError`` for too few samples, for a model of more numbers than a width and an
    index, and for nuisances that there are none of, that are the light's own, or that the
    photographs leave no room for.
    """
    _check_numbers(variant)
    check_free_of_light(check_free(settings.free))
    task = task_of(observations, variant, settings, known, concave(shape))
    state = find_both(task, watch, stage)
    told = Told(task.observations, None, shape)
    return _judged(examine(task, state, Asked(gauge, told, pool, stage, watch)), pool)


def _judged(examined: Examined[End], pool: Observations | None) -> Factorization:
    """Say what is identifiable, and how it ended."""
    end, calibration, diagnosis = examined.end, examined.calibration, examined.diagnosis
    task, state, parameters = end.task, end.state, end.account.parameters
    shifts = [] if calibration is None else [calibration.shifts]
    if diagnosis:
        shifts.append(np.stack(likeliest(diagnosis), axis=1))
    scene = end.account.scene
    if shifts:
        assert parameters.covariance is not None
        own, of_light = np.split(np.hstack(shifts), [len(parameters.covariance)])
        scene = widened_light(task, state, scene, end.gauge, of_light)
        if calibration is not None:
            parameters = parameters.spread_by(own[:, : calibration.shifts.shape[1]])
        parameters = reaching(parameters, diagnosis)
    clipped = None if pool is None else saturation_sentence(pool)
    notes = () if calibration is None else calibration.sentences
    if task.settings.free == "auto" and examined.unsettled:
        notes = (*notes, examined.unsettled_sentence)
    wrong = _Wrong(examined.misfit, clipped, diagnosis, notes)
    outcome, identifiable, reasons = _judge(task, state, parameters, wrong)
    misfit = examined.misfit
    return Factorization(
        end.brdf,
        scene,
        parameters,
        outcome,
        identifiable,
        reasons,
        state.rounds,
        task.observations,
        end.predicted,
        in_deviations(task, state).noise if misfit is None else misfit.noise,
        end.gauge,
        misfit,
        diagnosis,
        calibration,
    )


class _Wrong(NamedTuple):
    """What is wrong: more than noise, clipped values (in words), and what would explain it.

    ``notes`` say what is not known of nuisances that were freed.
    """

    misfit: Misfit | None
    clipped: str | None
    diagnosis: tuple[Diagnosis, ...]
    notes: tuple[str, ...]

    @property
    def found(self) -> bool:
        """Whether anything is."""
        more = self.misfit is not None and self.misfit.found
        return self.clipped is not None or more or bool(self.diagnosis)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Say it in words."""
        found = [] if self.clipped is None else [self.clipped]
        if self.misfit is not None and self.misfit.found:
            part = "" if self.diagnosis else "; the intervals contain it only in part"
            found.append(self.misfit.sentence() + part)
        return (*found, *(best.reason for best in self.diagnosis[:1]), *self.notes)


def _check_numbers(variant: Parametric) -> None:
    found = (variant.shape.name, variant.index.name)
    others = [one.name for one in variant.searched if one.name not in found]
    if len(variant.shaped()) > 1:
        raise ValueError(
            f"{type(variant).__name__} has several lobes that its numbers shape, which are found "
            "under known light alone: give the light, or a model of one"
        )
    if others:
        raise ValueError(
            f"{type(variant).__name__} has {', '.join(others)} beside a width and an index, which "
            "is found under known light alone: give the light, or a model without it"
        )


def _judge(
    task: Task, state: State, parameters: Uncertain, wrong: _Wrong
) -> tuple[Outcome, dict[str, bool], tuple[str, ...]]:
    """Decide what is identifiable and how it ended, in the model's own words."""
    assert state.joint is not None
    variant, guess = task.response.variant, state.guess
    free = free_unknowns(task, state)
    channels = task.radiance.shape[1]
    shares = bool(free[:channels].any())
    searched = dict.fromkeys(variant.amplitude_names, shares)
    searched |= {variant.shape.name: bool(free[channels])}
    searched |= {variant.index.name: bool(free[channels + 1])}
    bound = {
        variant.shape.name: _at_bound(float(guess.sigma), task.bounds.sigma, 0.0),
        variant.index.name: _at_bound(float(guess.mu), task.bounds.mu, 1.0),
    }
    identifiable, reasons = {}, [*wrong.reasons]
    for name in (name for name, is_free in searched.items() if is_free):
        reached = within_reach(parameters, name)
        identifiable[name] = reached and not bound.get(name, False)
        if bound.get(name, False):
            reasons.append(f"{name} is at a bound of its range")
        elif not reached:
            why = missing_under_unknown_light(variant, name)
            if wrong.diagnosis and out_of_reach_by_misfit(name, parameters):
                why = MOVED
            reasons.append(f"{not_identifiable(name, parameters)}; {why}")
    residual = state.rounds[-1].relative_rms
    if residual > _SKETCHED and not wrong.diagnosis:
        reasons.append(
            f"the light found leaves {100 * residual:.1f} % of the photographs unexplained: allow "
            "more sources, or a higher band limit; error bars do not know of it"
        )
    if not np.all(np.isfinite(np.asarray(state.joint.solved.light))):
        return Outcome.NOT_CONVERGED, identifiable, tuple(reasons)
    if any(bound[name] and searched[name] for name in bound):
        return Outcome.AT_BOUND, identifiable, tuple(reasons)
    if not state.settled:
        reasons.append("light and material still moved when the search ended")
        return Outcome.NOT_CONVERGED, identifiable, tuple(reasons)
    if wrong.found:
        return Outcome.MISFIT, identifiable, tuple(reasons)
    good = all(identifiable.values())
    return (Outcome.CONVERGED if good else Outcome.NOT_IDENTIFIABLE), identifiable, tuple(reasons)


def _at_bound(logarithm: float, bounds: tuple[float, float], origin: float) -> bool:
    low, high = (abs(logarithm - np.log(bound - origin)) for bound in bounds)
    return bool(min(low, high) < _AT_BOUND)
