"""Free nuisances of a capture under unknown light: on some samples first, and then on all."""

import dataclasses
from collections.abc import Callable

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration import Calibration, Weighing, calibration_of, search
from jaxrender.inverse.clusters import Clusters
from jaxrender.inverse.factorization.band_limits import SAMPLES_PER_COEFFICIENT
from jaxrender.inverse.factorization.free_capture import FreeScene, Lit
from jaxrender.inverse.factorization.rounds import find_both, settle, some_samples, taken_up
from jaxrender.inverse.factorization.state import Round, Task, in_deviations
from jaxrender.inverse.nuisances import Told
from jaxrender.shapes import Int

# Nuisances of a light that is told.
OF_LIGHT = ("environment", "lamps", "nearness")
# What all photographs share of these, an unknown light makes as well.
_RELATIVE = ("exposure",)
# So many samples at least are calibrated on.
_SAMPLES = 2000


@dataclasses.dataclass(frozen=True)
class Calibrated:
    """Corrections found with material and light; ``settled`` says whether they still moved.

    ``told`` are all samples, with what a blur does to them if that is free.
    """

    lit: Lit
    told: Told
    free: tuple[str, ...]
    settled: bool

    def account(self, gauge: str) -> Calibration:
        """Say how well the nuisances are known, and what of that goes into the fit's own errors."""
        observed, index = self.lit.task.observations, _some(self.lit.task)
        return calibration_of(
            self.told,
            self.lit.corrections,
            self.lit.columns(self.told, self.free, index, gauge),
            Clusters.of(observed.take(index)),
            self.settled,
            found="material and light",
            relative=_RELATIVE,
        )


def check_free_of_light(free: tuple[str, ...]) -> None:
    """Refuse nuisances of a light that is told."""
    for name in free:
        if name in OF_LIGHT:
            raise ValueError(f"{name} cannot be freed: the light is not told, but found")


def calibrate(
    told: Told,
    begin: Lit,
    free: tuple[str, ...],
    pixels: NoiseModel,
    watch: Callable[[Round], None],
    *,
    anew: bool,
) -> Calibrated:
    """Free some nuisances, and find them with material and light, from where a fit has ended.

    ``told`` are all samples that ``begin`` is of.  ``pixels`` is the noise of single pixels.
    ``anew`` lets material and light be found from the start once more: what was wrong may have led
    the fit astray, and made sources that are not there.

    Raises ``ValueError`` for a nuisance that the photographs leave no room for.
    """
    index = _some(begin.task)
    some = begin.take(index)
    few = told._replace(observations=told.observations.take(index), softening=None)
    few = some.softened(few, free)
    weights = some.state.weights * some.corrections.slopes(few)
    capture = FreeScene(few, free, weighing_of(begin, pixels), weights, some.state.level)
    found, settled = search(capture, capture.corrected(some.corrections, some))
    told, at = found.softened(told, free), found.state
    task = found.task_of(told, found.task.band_limit)
    if anew:
        state = find_both(task, watch)
    else:
        before = begin.state._replace(
            guess=at.guess, active=at.active, level=at.level, joint=at.joint
        )
        state = settle(task, taken_up(task, before), watch)
    return Calibrated(dataclasses.replace(found, task=task, state=state), told, free, settled)


def absorbed(before: Lit, after: Lit, pixels: NoiseModel) -> float:
    """Say which part of chi-squared above the noise of single pixels corrections do away with."""
    weighing = weighing_of(before, pixels)
    left = [weighing.above_noise(one.task.observations, one.predicted) for one in (before, after)]
    return 1 - left[1] / left[0] if left[0] > 0 else 1.0


def weighing_of(lit: Lit, pixels: NoiseModel) -> Weighing:
    """Weigh samples by the noise that a fit has ended with."""
    return Weighing.of(in_deviations(lit.task, lit.state).noise, pixels, lit.predicted)


def _some(task: Task) -> Int[np.ndarray, "kept"]:
    """Choose the samples to calibrate on: more where the light is fine."""
    return some_samples(task, max(_SAMPLES, SAMPLES_PER_COEFFICIENT * task.response.slow_count))
