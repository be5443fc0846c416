"""What a fit leaves: measured, explained, and absorbed by nuisances where that is asked for.

Nuisances are freed as ``settings.free`` says: some by name, or (``auto``) whatever the diagnosis
names, one after the other, until it names none or none that can be freed.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.calibration import Calibrated, calibrate, finish, softened
from jaxrender.inverse.calibration.equations import State
from jaxrender.inverse.diagnosis import CLIPPED, Diagnosis, Suspect, diagnose
from jaxrender.inverse.known_light import DUAL_ERROR
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.misfit import Left, Misfit, measure_misfit, rows_of_three
from jaxrender.inverse.models import ExactModel, LinearisedModel
from jaxrender.inverse.nuisances import NUISANCES, Corrections, Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Stop
from jaxrender.reflection import FrameNodes

# Pixels that tell the noise, and the cells of the light by which they are predicted if the fit has
# no nodes of its own, in widths of the lobe.
_MOST_NEIGHBOURS, _NEIGHBOURS_CELL = 6000, 0.5
# So many times at most something is freed that the diagnosis names.
_MOST_FREED = 3
# Causes whose odds are within e^5 of the best one's may be the right one.
_AS_WELL = 10.0
# What is freed is to do this part of what the diagnosis foretold.
_AS_FORETOLD = 0.5


class Examined(NamedTuple):
    """Where a fit has ended, what it leaves, what would explain it, and what was freed for it."""

    stop: Stop
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()
    calibrated: Calibrated | None = None
    unsettled: bool = False
    refused: tuple[str, ...] = ()

    @property
    def freed(self) -> tuple[str, ...]:
        """What has been freed so far."""
        return () if self.calibrated is None else self.calibrated.free

    @property
    def named(self) -> tuple[str, ...]:
        """The nuisance that explains the rest best, and those that do so as well.

        None is tried where values are clipped: that no nuisance is to take up.
        """
        if any(one.cause == CLIPPED for one in self.diagnosis):
            return ()
        left = [
            one
            for one in self.diagnosis
            if one.cause in NUISANCES and one.cause not in self.refused
        ]
        least = left[0].bic - _AS_WELL if left else 0.0
        return tuple(one.cause for one in left if one.bic >= least)

    def and_then(self, further: "Examined") -> "Examined":
        """Go on with what was freed, if that did what the diagnosis foretold; else refuse it.

        What is wrong in truth does more than its first order says; what looks alike does less.
        Where something else explains more, it is to do more than that would.
        """
        best = self.diagnosis[0]
        demanded = (_AS_FORETOLD if best.cause in self.named else 1) * best.explains
        assert further.calibrated is not None
        if further.calibrated.absorbed >= demanded:
            return further._replace(refused=self.refused)
        return self._replace(refused=(*self.refused, *self.named))


def examine(task: MaterialTask, told: Told, pool: Observations, stop: Stop) -> Examined:
    """Examine a fit, and free nuisances as the settings say.

    ``told`` are the samples of ``stop``, ``pool`` all pixels.

    Raises ``ValueError`` for a nuisance that there is none of, or that the photographs or the light
    leave no room for.
    """
    free = task.settings.free
    examined = _examined(task, told, pool, Examined(stop))
    if free != "auto":
        free = check_free(free)
        return _finished(task, told, pool, _freed(task, told, examined, free)) if free else examined
    for _ in range(_MOST_FREED):
        if not examined.named:
            break
        free = (*examined.freed, *examined.named)
        further = _examined(task, told, pool, _freed(task, told, examined, free))
        examined = examined.and_then(further)
    unsettled = examined.calibrated is not None and bool(examined.named)
    examined = _finished(task, told, pool, examined)
    return examined._replace(unsettled=unsettled)


def check_free(free: tuple[str, ...] | str) -> tuple[str, ...]:
    """Refuse what is no nuisance; each counts once."""
    if free == "auto":
        return ()
    for name in (free,) if isinstance(free, str) else free:
        if name not in NUISANCES:
            raise ValueError(f"{name!r} cannot be freed; choose of {', '.join(NUISANCES)}, or auto")
    if isinstance(free, str):
        raise ValueError(f"free={free!r}: give a tuple of names, or auto")
    return tuple(dict.fromkeys(free))


def _freed(task: MaterialTask, told: Told, examined: Examined, free: tuple[str, ...]) -> Examined:
    """Free some nuisances."""
    noise = examined.stop.noise if examined.misfit is None else examined.misfit.noise
    so_far = None if examined.calibrated is None else examined.calibrated.corrections
    with task.stage("calibration"):
        calibrated = calibrate(task, told, examined.stop, free, noise, so_far)
    return Examined(calibrated.stop, calibrated=calibrated)


def _finished(task: MaterialTask, told: Told, pool: Observations, examined: Examined) -> Examined:
    """Fit what was freed to all samples, and examine that."""
    if examined.calibrated is None:
        return examined
    with task.stage("calibration"):
        calibrated = finish(task, told, examined.calibrated)
    return _examined(task, told, pool, Examined(calibrated.stop, calibrated=calibrated))


def _examined(task: MaterialTask, told: Told, pool: Observations, examined: Examined) -> Examined:
    """Measure what a fit leaves, and say what would explain it."""
    stop, calibrated = examined.stop, examined.calibrated
    corrections = Corrections.none(told) if calibrated is None else calibrated.corrections
    light = told.light if calibrated is None else calibrated.light
    with task.stage("misfit"):
        state = State(corrections, light, stop, 0.0)
        misfit = _misfit(task, state, told._replace(observations=pool), examined.freed)
    diagnosis: tuple[Diagnosis, ...] = ()
    if misfit is not None and task.settings.diagnose:
        with task.stage("diagnosis"):
            suspect = Suspect.of(
                stop,
                task.material(stop),
                light,
                told.shape,
                told.observations if calibrated is None else calibrated.told.observations,
                pool,
                task.settings.seed,
                examined.freed,
            )
            if task.settings.interreflection:
                suspect = suspect._replace(unknown=("interreflection",))
            diagnosis = diagnose(suspect, misfit)
    return examined._replace(misfit=misfit, diagnosis=diagnosis)


def _misfit(task: MaterialTask, state: State, told: Told, freed: tuple[str, ...]) -> Misfit | None:
    """Measure the noise between neighbouring pixels, and what the fit leaves above it.

    ``told`` holds all pixels, as they were told.
    """
    stop, corrections, light = state.stop, state.corrections, state.light
    fitted = Left(stop.observations, np.asarray(stop.fit.predicted))
    # As many as the fit's own samples: the program that predicts them is there already.
    count = min(stop.observations.count, _MOST_NEIGHBOURS)
    pool = told.observations
    rows = rows_of_three(pool, count // 3, task.settings.seed)
    neighbours = None
    if len(rows):
        some = pool.take(np.resize(rows.ravel(), count))
        near_by = told._replace(observations=some, softening=None)
        some = corrections.observations(softened(task, near_by, state, freed))
        frame = np.asarray(some.frame)
        if light.near is None and isinstance(stop.model, ExactModel):
            nodes = tuple(
                part._replace(frame_of_sample=frame) if isinstance(part, FrameNodes) else part
                for part in stop.model.nodes
            )
        else:
            nodes = task.nodes(light, some, task.width(stop), _NEIGHBOURS_CELL)
        physical = task.unknowns.unpack(stop.fit.solution.point)
        near = LinearisedModel.about(task.integral(some, nodes), physical.numbers)
        data = stop.data._replace(frame=frame)
        predicted = task.problem.columns(near, data, physical).times(stop.fit.linear.amplitudes)
        threes = np.arange(rows.size)
        neighbours = Left(some.take(threes), np.asarray(predicted)[threes])
    given = task.settings.noise
    if task.settings.refine:
        return measure_misfit(fitted, neighbours, given)
    # The dual model leaves as much of its own.
    return measure_misfit(fitted, neighbours, given, least=DUAL_ERROR)
