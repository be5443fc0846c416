"""Free nuisances of a capture under known light: on some samples first, and then on all."""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration.account import Calibration, calibration_of
from jaxrender.inverse.calibration.capture import MOST_SAMPLES, Divided, FreeCapture, State
from jaxrender.inverse.calibration.equations import Columns
from jaxrender.inverse.calibration.search import Weighing, last_step, search
from jaxrender.inverse.clusters import Clusters
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.passes import Stop, descend
from jaxrender.shapes import Int


class Calibrated(NamedTuple):
    """A calibration, and the material that goes with it: a fit to corrected samples."""

    stop: Stop
    found: Calibration


def calibrate(
    task: MaterialTask,
    told: Told,
    begin: Stop,
    free: tuple[str, ...],
    noise: NoiseModel,
    corrections: Corrections | None = None,
) -> Calibrated:
    """Free some nuisances, and find them with the material; ``begin`` is a fit without them.

    ``noise`` is that of single pixels.  ``corrections`` are those known so far.  It works on some
    of the samples, under light in coarse cells; ``finish`` takes all of both.

    Raises ``ValueError`` for a nuisance that the photographs or the light leave no room for.
    """
    corrections = corrections or Corrections.none(told)
    index = Divided.of(task, told, begin)
    few = told._replace(observations=told.observations.take(index.some))
    weighing = _weighing(begin, noise)
    capture = FreeCapture(task, few, free, task.width(begin), weighing)
    light = corrections.light(told)
    capture = capture.softened(State(corrections, light, begin, 0.0))
    begun = capture.fitted(corrections, begin)
    now, settled = search(capture, begun)
    others = told._replace(observations=told.observations.take(index.held_out))
    checked = dataclasses.replace(capture, told=others)
    before, after = (checked.softened(state).above_noise(state) for state in (begun, now))
    absorbed = 1 - after / before if before > 0 else 1.0
    if task.settings.noise is None:
        # Less is left now than what the samples were weighed by.
        again = _fitted(task, few, now, free).state.stop
        capture = dataclasses.replace(capture, weighing=_weighing(again, noise))
        now, settled = search(capture, capture.softened(now).fitted(now.corrections, again))
    ended = _fitted(task, few, now, free)
    found = _account(task, ended, _columns(task, ended, free), settled)
    return found._replace(found=found.found._replace(absorbed=absorbed))


def finish(task: MaterialTask, told: Told, calibrated: Calibrated, noise: NoiseModel) -> Calibrated:
    """Fit the material to all samples under all of the light, and correct once more by them.

    What was found on a part of the samples is as uncertain as that part lets it be.  The errors
    that are stated are those of the samples that the last step is taken on.
    """
    found = calibrated.found
    before = State(found.corrections, found.light, calibrated.stop, 0.0)
    ended = _fitted(task, told, before, found.free)
    columns = _columns(task, ended, found.free)
    strength = _weighing(ended.state.stop, noise).strength
    further = last_step(columns, found.corrections, strength)
    if further is not None:
        corrected = State(further, further.light(told), ended.state.stop, 0.0)
        ended = _fitted(task, told, corrected, found.free)
        columns = _columns(task, ended, found.free)
    return _account(task, ended, columns, found.settled)


class _Fitted(NamedTuple):
    """Samples as they were ``told``, and the corrections and the material that fit them."""

    told: Told
    state: State


def _fitted(task: MaterialTask, told: Told, before: State, free: tuple[str, ...]) -> _Fitted:
    """Fit the material to all samples, as they are corrected now."""
    told = before.softened(task, told, free)
    corrections, light, stop = before.corrections, before.light, before.stop
    observed = corrections.observations(told)
    nodes = task.nodes(light, observed, task.width(stop))
    model = task.integral(observed, nodes)
    stop = descend(task.problem, model, observed, stop.onward(None), task.settings)
    return _Fitted(told, State(corrections, light, stop, 0.0))


def _columns(task: MaterialTask, fitted: _Fitted, free: tuple[str, ...]) -> Columns:
    return fitted.state.columns(task, fitted.told, free, _some(task, fitted))


def _account(task: MaterialTask, fitted: _Fitted, columns: Columns, settled: bool) -> Calibrated:
    told, state = fitted
    clusters = Clusters.of(state.stop.observations.take(_some(task, fitted)))
    found = calibration_of(told, state.corrections, columns, clusters, settled)
    return Calibrated(state.stop, found)


def _some(task: MaterialTask, fitted: _Fitted) -> Int[np.ndarray, "sample"]:
    """Pick the samples that are differentiated."""
    count = fitted.state.stop.observations.count
    if count <= MOST_SAMPLES:
        return np.arange(count)
    return np.sort(np.random.default_rng(task.settings.seed).choice(count, MOST_SAMPLES, False))


def _weighing(stop: Stop, pixels: NoiseModel) -> Weighing:
    return Weighing.of(stop.noise, pixels, np.asarray(stop.fit.predicted))
