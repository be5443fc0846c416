"""What a fit under known light leaves: measured, explained, and absorbed by nuisances if asked for.

Nuisances are freed as ``settings.free`` says (``calibration.automatic``).
"""

import dataclasses

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration import (
    Calibrated,
    Examined,
    State,
    calibrate,
    check_free,
    finish,
    free_what_is_named,
)
from jaxrender.inverse.diagnosis import Diagnosis, Suspect, diagnose
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.misfit import Left, Misfit, measure_misfit, rows_of_three
from jaxrender.inverse.models import ExactModel, LinearisedModel
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Stop
from jaxrender.inverse.prepared_light import DUAL_ERROR
from jaxrender.reflection import FrameNodes

# Pixels that tell the noise, and the cells of the light by which they are predicted if the fit has
# no nodes of its own, in widths of the lobe.
_MOST_NEIGHBOURS, _NEIGHBOURS_CELL = 6000, 0.5


def examine(task: MaterialTask, told: Told, pool: Observations, stop: Stop) -> Examined[Stop]:
    """Examine a fit, and free nuisances as the settings say.

    ``told`` are the samples of ``stop``, ``pool`` all pixels.

    Raises ``ValueError`` for a nuisance that there is none of, or that the photographs or the light
    leave no room for.
    """
    free = task.settings.free
    examined = _examined(task, told, pool, Examined(stop))
    if free == "auto":
        examined = free_what_is_named(
            examined,
            lambda now, names: _examined(task, told, pool, _freed(task, told, now, names)),
        )
    elif free:
        examined = _freed(task, told, examined, check_free(free))
    if examined.calibration is None:
        return examined
    with task.stage("calibration"):
        calibrated = Calibrated(examined.end, examined.calibration)
        ended = finish(task, told, calibrated, _noise_of_pixels(examined))
    finished = dataclasses.replace(examined, end=ended.stop, calibration=ended.found)
    return _examined(task, told, pool, finished)


def _freed(
    task: MaterialTask, told: Told, examined: Examined[Stop], free: tuple[str, ...]
) -> Examined[Stop]:
    """Free some nuisances."""
    stop, before = examined.end, examined.calibration
    so_far = None if before is None else before.corrections
    with task.stage("calibration"):
        calibrated = calibrate(task, told, stop, free, _noise_of_pixels(examined), so_far)
    return Examined(calibrated.stop, calibration=calibrated.found)


def _noise_of_pixels(examined: Examined[Stop]) -> NoiseModel:
    """Take that between neighbours; where these tell none, what the fit ended with."""
    return examined.end.noise if examined.misfit is None else examined.misfit.noise


def _examined(
    task: MaterialTask, told: Told, pool: Observations, examined: Examined[Stop]
) -> Examined[Stop]:
    """Measure what a fit leaves, and say what would explain it."""
    stop, calibration = examined.end, examined.calibration
    corrections = Corrections.none(told) if calibration is None else calibration.corrections
    light = task.light if calibration is None else calibration.light
    with task.stage("misfit"):
        state = State(corrections, light, stop, 0.0)
        misfit = _misfit(task, state, told._replace(observations=pool), examined.freed)
    diagnosis: tuple[Diagnosis, ...] = ()
    if misfit is not None and task.settings.diagnose:
        with task.stage("diagnosis"):
            suspect = Suspect.of(
                stop,
                task.material(stop).in_use,
                light,
                told.shape,
                told.observations if calibration is None else calibration.told.observations,
                pool,
                task.settings.seed,
                examined.freed,
            )
            if task.settings.interreflection:
                suspect = suspect._replace(unknown=("interreflection",))
            diagnosis = diagnose(suspect, misfit)
    return dataclasses.replace(examined, misfit=misfit, diagnosis=diagnosis)


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
        some = corrections.observations(state.softened(task, near_by, freed))
        frame = np.asarray(some.frame)
        if light.near is None and isinstance(stop.model, ExactModel):
            nodes = tuple(
                part._replace(frame_of_sample=frame) if isinstance(part, FrameNodes) else part
                for part in stop.model.nodes
            )
        else:
            nodes = task.nodes(light, some, task.width(stop), _NEIGHBOURS_CELL)
        physical = task.unknowns.unpack(stop.fit.solution.point)
        near = LinearisedModel.about(task.integral(some, nodes), physical.numbers, ())
        data = stop.data._replace(frame=frame)
        columns = task.problem.columns(near, data, physical)
        predicted = columns.times_on_host(np.asarray(stop.fit.linear.amplitudes))
        threes = np.arange(rows.size)
        neighbours = Left(some.take(threes), predicted[threes])
    given = task.settings.noise
    if task.settings.refine:
        return measure_misfit(fitted, neighbours, given)
    # The dual model leaves as much of its own.
    return measure_misfit(fitted, neighbours, given, least=DUAL_ERROR)
