"""The whole recovery: photographs of an object of known shape in, light and material out."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.blas import one_blas_thread
from jaxrender.inverse.diagnosis import Diagnosis, likeliest, reaching
from jaxrender.inverse.factorization.account import Account, account_of, widened_light
from jaxrender.inverse.factorization.band_limits import followed_farther, task_of
from jaxrender.inverse.factorization.prediction import predict
from jaxrender.inverse.factorization.recovered_scene import RecoveredScene
from jaxrender.inverse.factorization.rounds import light_the_scene, settle, taken_up
from jaxrender.inverse.factorization.sight import Sight
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
from jaxrender.inverse.factorization.suspicion import Found, explanations
from jaxrender.inverse.misfit import Left, Misfit, measure_misfit, rows_of_three
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.reasons import (
    MOVED,
    missing_under_unknown_light,
    not_identifiable,
    out_of_reach_by_misfit,
)
from jaxrender.inverse.saturation import saturation_sentence
from jaxrender.inverse.shadowing import concave, places_of
from jaxrender.inverse.uncertainty import Uncertain, within_reach
from jaxrender.shapes import Float

# The search for sources, and the fits along with it, use about this many samples; the last steps
# use all.
_ROUND_SAMPLES = 2000
# A logarithm this close to its bound is at it.
_AT_BOUND = 0.01
# Above this relative residual, several times the noise of usual photographs, the reasons say that
# the light is only sketched, unless something else would explain it.
_SKETCHED = 0.05
# So many rows of three neighbouring pixels tell the noise.  The light is a sum of few degrees and
# sources: less of the radiance than this it may leave without being wrong.
_ROWS, _LEAST_MISFIT = 1000, 0.01
# Where more of chi-squared than this is no noise, slow light is tried to more degrees.
_WORTH_FOLLOWING = 0.1


class Factorization(NamedTuple):
    """A recovered material and light, with all that is known about how well they are known."""

    brdf: Parametric
    scene: RecoveredScene
    parameters: Uncertain
    outcome: Outcome
    identifiable: dict[str, bool]
    reasons: tuple[str, ...]
    rounds: tuple[Round, ...]
    predicted: Float[np.ndarray, "sample channel"]
    noise: NoiseModel
    gauge: str
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()

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
    whether things lie elsewhere is asked where the ``shape`` is known.

    Raises ``ValueError`` for too few samples, and for a model of more numbers than a width and an
    index.
    """
    _check_numbers(variant)
    hiding = concave(shape)
    task = task_of(observations, variant, settings, known, hiding)
    observations = task.observations
    step = max(1, observations.count // _ROUND_SAMPLES)
    few = task
    if step > 1:
        thinned = observations.take(np.arange(0, observations.count, step))
        sight = None if hiding is None else Sight(hiding, places_of(thinned))
        few = Task(thinned, task.response.thinned(step), sight, known, settings)
    with stage("light"), one_blas_thread():
        state = light_the_scene(few, watch)
        if step > 1:
            state = taken_up(task, state)
    with stage("refine"), one_blas_thread():
        state = settle(task, state, watch)
    told = _Told(gauge, pool, shape, stage)
    end = _account(task, state, told)
    if end.misfit is not None and end.misfit.share >= _WORTH_FOLLOWING:
        with stage("refine"), one_blas_thread():
            farther = followed_farther(task, state, hiding)
            if farther is not None:
                farther = farther[0], settle(*farther, watch)
        if farther is not None:
            again = _account(*farther, told)
            end = again if again.relative_rms < end.relative_rms else end
    return _judged(end, told)


class _Told(NamedTuple):
    """What else is told: the gauge, all pixels, the shape, and how stages are announced."""

    gauge: str
    pool: Observations | None
    shape: Shape | None
    stage: Callable[[str], AbstractContextManager]


class _End(NamedTuple):
    """Where a search ended, material and light in a gauge, and what they leave beside noise."""

    task: Task
    state: State
    account: Account
    brdf: Parametric
    misfit: Misfit | None

    @property
    def predicted(self) -> Float[np.ndarray, "sample channel"]:
        """What the samples should be."""
        assert self.state.joint is not None
        return np.asarray(self.state.joint.solved.predicted)

    @property
    def relative_rms(self) -> float:
        """What is left, relative to the photographs."""
        return self.state.rounds[-1].relative_rms


def _account(task: Task, state: State, told: _Told) -> _End:
    """Put material and light into the gauge, and measure what they leave."""
    with told.stage("account"):
        account = account_of(task, state, told.gauge)
    value = account.parameters.value
    lobe = task.response.variant.with_numbers(
        {name: float(number) for name, number in value.numbers.items()}
    )
    brdf = lobe.with_amplitudes(*value.in_order(lobe.amplitude_names))
    end = _End(task, state, account, brdf, None)
    if told.pool is None:
        return end
    with told.stage("misfit"):
        return end._replace(misfit=_misfit(end, told.pool, told.shape))


def _judged(end: _End, told: _Told) -> Factorization:
    """Say what would explain the rest, what is identifiable, and how it ended."""
    task, state, misfit, scene = end.task, end.state, end.misfit, end.account.scene
    diagnosis: tuple[Diagnosis, ...] = ()
    clipped = None
    if told.pool is not None:
        clipped = saturation_sentence(told.pool)
        if misfit is not None and task.settings.diagnose:
            with told.stage("diagnosis"):
                found = Found(end.brdf, scene, told.gauge, misfit)
                diagnosis = explanations(task, state, found, told.pool, told.shape)
    parameters = end.account.parameters
    if diagnosis and parameters.covariance is not None:
        shifts = [shift[len(parameters.covariance) :] for shift in likeliest(diagnosis)]
        scene = widened_light(task, state, end.account, told.gauge, shifts)
        parameters = reaching(parameters, diagnosis)
    wrong = _Wrong(misfit, clipped, diagnosis)
    outcome, identifiable, reasons = _judge(task, state, parameters, wrong)
    assert state.joint is not None
    noise = in_deviations(task, state, state.joint.solved).noise if misfit is None else misfit.noise
    return Factorization(
        end.brdf,
        scene,
        parameters,
        outcome,
        identifiable,
        reasons,
        state.rounds,
        end.predicted,
        noise,
        told.gauge,
        misfit,
        diagnosis,
    )


class _Wrong(NamedTuple):
    """What is wrong: more than noise, clipped values (in words), and what would explain it."""

    misfit: Misfit | None
    clipped: str | None
    diagnosis: tuple[Diagnosis, ...]

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
        return (*found, *(best.reason for best in self.diagnosis[:1]))


def _misfit(end: _End, pool: Observations, shape: Shape | None) -> Misfit | None:
    """Measure the noise between neighbouring pixels, and what is left above it."""
    rows = rows_of_three(pool, _ROWS, 0)
    neighbours = None
    if len(rows):
        some = pool.take(rows.ravel())
        neighbours = Left(some, predict(end.brdf, end.account.scene, some, shape))
    fitted = Left(end.task.observations, end.predicted)
    return measure_misfit(fitted, neighbours, None, least=_LEAST_MISFIT)


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
