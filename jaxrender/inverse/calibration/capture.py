"""A capture under known light of which something is free, and the material that fits."""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxrender.inverse.calibration.equations import Columns, Pull
from jaxrender.inverse.calibration.search import Capture, Corrected, Weighing
from jaxrender.inverse.calibration.softened import softened
from jaxrender.inverse.diagnosis.grounds import Grounds, Suspect, gain_of
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.inverse.elimination import Data
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.passes import Begin, Stop, descend
from jaxrender.shapes import Float, Int

# So many samples are calibrated on; the light is condensed to cells of so many widths of the lobe.
_SAMPLES, _CELLS = 1500, 0.35
# Of light of few sources so many pairs of a sample and a node, and no more samples than that.
_WORK, MOST_SAMPLES = 1e5, 6000


@dataclasses.dataclass(frozen=True)
class State(Corrected):
    """Corrections, and the material that fits best with them."""

    corrections: Corrections
    light: KnownLight
    stop: Stop
    cost: float

    @property
    def predicted(self) -> Float[np.ndarray, "sample channel"]:
        """What the samples should be."""
        return np.asarray(self.stop.fit.predicted)

    @property
    def weights(self) -> Float[np.ndarray, "sample channel"]:
        """What their residuals are multiplied by."""
        return np.asarray(self.stop.data.weights)

    def columns(
        self, task: MaterialTask, told: Told, free: tuple[str, ...], index: Int[np.ndarray, "kept"]
    ) -> Columns:
        """Differentiate some samples by the material and by all that is free."""
        every = told.observations
        material = task.material(self.stop)
        suspect = Suspect.of(self.stop, material, self.light, told.shape, every, every)
        grounds, known = Grounds.of(suspect, index), suspect.derivatives(index)
        return Columns.of(grounds, known, self.corrections, free)

    def softened(self, task: MaterialTask, told: Told, free: tuple[str, ...]) -> Told:
        """Say what a blur does to samples, as these are predicted; nothing where none is free."""
        if "blur" not in free:
            return told
        observed = told.observations
        grounds = Grounds(
            observed,
            np.zeros(np.shape(observed.radiance)),
            gain_of(self.stop, np.asarray(observed.frame))[:, None],
            task.material(self.stop),
            LightParts.known(self.light),
            told.shape,
        )
        return softened(told, self.corrections, grounds)


@dataclasses.dataclass(frozen=True)
class FreeCapture(Capture[State]):
    """Some samples of a capture, what is free of it, the width of the lobe, and how they count."""

    task: MaterialTask
    told: Told
    free: tuple[str, ...]
    width: float
    weighing: Weighing

    def corrected(self, corrections: Corrections, before: State) -> State:
        """Fit the material to samples as they are corrected."""
        return self.fitted(corrections, before.stop, before.predicted)

    def fitted(
        self,
        corrections: Corrections,
        before: Stop,
        predicted: Float[np.ndarray, "sample channel"] | None = None,
    ) -> State:
        """Fit the material to corrected samples, under corrected light."""
        task, told, noise = self.task, self.told, self.weighing.noise
        observed, light = corrections.observations(told), corrections.light(told)
        model = task.integral(observed, task.nodes(light, observed, self.width, _CELLS))
        start = Begin(noise, predicted, np.asarray(before.fit.solution.point)[None])
        settings = task.settings._replace(noise=noise)
        stop = descend(task.problem, model, observed, start, settings)
        left = np.asarray(stop.data.weights) * (
            np.asarray(stop.data.radiance) - np.asarray(stop.fit.predicted)
        )
        cost = self.weighing.strength * float(np.sum(left**2))
        return State(corrections, light, stop, cost + Pull.of(corrections, *self.free).cost)

    def columns(self, state: State) -> Columns:
        """Differentiate by the material and by all that is free."""
        every = np.arange(state.stop.observations.count)
        return state.columns(self.task, self.told, self.free, every)

    def softened(self, state: State) -> "FreeCapture":
        """Take what a blur does from a state."""
        told = state.softened(self.task, self.told, self.free)
        return dataclasses.replace(self, told=told)

    def above_noise(self, state: State) -> float:
        """Say what the end of a search leaves of these samples above noise: part of chi-squared."""
        task, problem, end = self.task, self.task.problem, state.stop.fit
        observed = state.corrections.observations(self.told)
        nodes = task.nodes(state.light, observed, self.width, _CELLS)
        physical = problem.unknowns.unpack(end.solution.point)
        near = LinearisedModel.about(task.integral(observed, nodes), physical.numbers)
        data = Data(observed.radiance, np.ones_like(observed.radiance), np.asarray(observed.frame))
        predicted = np.asarray(problem.columns(near, data, physical).times(end.linear.amplitudes))
        return self.weighing.above_noise(observed, predicted)


class Divided(NamedTuple):
    """The samples to calibrate on, and as many others, where there are any, to check that by."""

    some: Int[np.ndarray, "sample"]
    held_out: Int[np.ndarray, "sample"]

    @classmethod
    def of(cls, task: MaterialTask, told: Told, begin: Stop) -> "Divided":
        """Take more samples where the light is a few sources."""
        few = told.observations.take(np.zeros(1, int))
        nodes = task.nodes(task.light, few, task.width(begin), _CELLS)
        each = sum(part.directions.shape[-2] for part in nodes)
        count = int(np.clip(_WORK / each, _SAMPLES, MOST_SAMPLES))
        order = np.random.default_rng(task.settings.seed).permutation(told.observations.count)
        some, others = np.sort(order[:count]), np.sort(order[count : 2 * count])
        return cls(some, others if len(others) >= _SAMPLES // 2 else some)
