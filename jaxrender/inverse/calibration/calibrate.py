"""Free nuisances of a capture under known light: on some samples first, and then on all."""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration.account import Calibration, calibration_of
from jaxrender.inverse.calibration.capture import MOST_SAMPLES, Divided, FreeCapture, State
from jaxrender.inverse.calibration.search import Weighing, search
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
        again = finish(task, few, _account(task, few, now, free, settled))
        capture = dataclasses.replace(capture, weighing=_weighing(again.stop, noise))
        now, settled = search(capture, capture.softened(now).fitted(now.corrections, again.stop))
    found = finish(task, few, _account(task, few, now, free, settled))
    return found._replace(found=found.found._replace(absorbed=absorbed))


def finish(task: MaterialTask, told: Told, calibrated: Calibrated) -> Calibrated:
    """Fit the material to all samples, as they are corrected now."""
    found, before = calibrated.found, calibrated.stop
    corrections, light = found.corrections, found.light
    told = State(corrections, light, before, 0.0).softened(task, told, found.free)
    observed = corrections.observations(told)
    nodes = task.nodes(light, observed, task.width(before))
    stop = descend(
        task.problem, task.integral(observed, nodes), observed, before.onward(None), task.settings
    )
    state = State(corrections, light, stop, 0.0)
    return _account(task, told, state, found.free, found.settled)


def _account(
    task: MaterialTask, told: Told, state: State, free: tuple[str, ...], settled: bool
) -> Calibrated:
    observed = state.stop.observations
    index = _some(observed.count, task.settings.seed)
    columns = state.columns(task, told, free, index)
    clusters = Clusters.of(observed.take(index))
    found = calibration_of(told, state.corrections, columns, clusters, settled)
    return Calibrated(state.stop, found)


def _some(count: int, seed: int) -> Int[np.ndarray, "sample"]:
    if count <= MOST_SAMPLES:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, MOST_SAMPLES, replace=False))


def _weighing(stop: Stop, pixels: NoiseModel) -> Weighing:
    return Weighing.of(stop.noise, pixels, np.asarray(stop.fit.predicted))
