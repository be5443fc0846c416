"""A capture of which something is free: the material that fits, and the search for corrections."""

from typing import NamedTuple

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration.equations import Pull, State, Step, equations_of
from jaxrender.inverse.calibration.softened import softened
from jaxrender.inverse.elimination import Data
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.nuisances import NUISANCES, Corrections, Told
from jaxrender.inverse.passes import Begin, Stop, descend
from jaxrender.inverse.weights import robust_weights, standard_deviations
from jaxrender.shapes import Float, Int

# So many samples are calibrated on; the light is condensed to cells of so many widths of the lobe.
_SAMPLES, _CELLS = 1500, 0.35
# Of light of few sources so many pairs of a sample and a node, and no more samples than that.
_WORK, MOST_SAMPLES = 1e5, 6000
# Rounds, and tries of each with more and more damping.
_ROUNDS, _TRIES, _DAMPING = 25, 5, 0.03
# What a blur does is taken so often from the material, until its prediction moves by less than this
# part of the noise (rms).
_SOFTENED, _STILL = 30, 0.01
# A round that gains less of chi-squared is the last: than this, and than this part of what is left.
_LEAST_GAIN, _SMALL_GAIN = 0.5, 1e-3
# Sources come no nearer than this.
NEAREST = 0.95


class Weighing(NamedTuple):
    """How samples count: by the noise and what a wrong model leaves above it.

    So a wrong model does not chase the darkest pixels.  Beside the priors they count as if all of
    it were noise of single pixels: by ``strength``, the ratio of the two variances.
    """

    noise: NoiseModel
    strength: float

    @classmethod
    def of(cls, stop: Stop, pixels: NoiseModel) -> "Weighing":
        """Weigh by the noise that a fit has ended with."""
        predicted = np.asarray(stop.fit.predicted)
        of_fit, own = (
            float(np.mean(standard_deviations(noise, predicted) ** 2))
            for noise in (stop.noise, pixels)
        )
        return cls(stop.noise, max(of_fit / own, 1.0))


class FreeCapture(NamedTuple):
    """Some samples of a capture, what is free of it, and the width of the lobe."""

    task: MaterialTask
    told: Told
    free: tuple[str, ...]
    width: float

    def fitted(
        self,
        corrections: Corrections,
        before: Stop,
        weighing: Weighing,
        predicted: Float[np.ndarray, "sample channel"] | None = None,
    ) -> State:
        """Fit the material to corrected samples, under corrected light."""
        task, told = self.task, self.told
        observed, light = corrections.observations(told), corrections.light(told)
        model = task.integral(observed, task.nodes(light, observed, self.width, _CELLS))
        start = Begin(weighing.noise, predicted, np.asarray(before.fit.solution.point)[None])
        settings = task.settings._replace(noise=weighing.noise)
        stop = descend(task.problem, model, observed, start, settings)
        left = np.asarray(stop.data.weights) * (
            np.asarray(stop.data.radiance) - np.asarray(stop.fit.predicted)
        )
        prior = sum(Pull.of(corrections, name).cost for name in self.free)
        cost = weighing.strength * float(np.sum(left**2)) + prior
        return State(corrections, light, stop, cost)

    def softened(self, state: State) -> "FreeCapture":
        """Take what a blur does from a state."""
        return self._replace(told=softened(self.task, self.told, state, self.free))

    def above_noise(self, state: State, weighing: Weighing, pixels: NoiseModel) -> float:
        """Say what the end of a search leaves of these samples above noise: part of chi-squared."""
        task, problem, end = self.task, self.task.problem, state.stop.fit
        observed = state.corrections.observations(self.told)
        nodes = task.nodes(state.light, observed, self.width, _CELLS)
        physical = problem.unknowns.unpack(end.solution.point)
        near = LinearisedModel.about(task.integral(observed, nodes), physical.numbers)
        data = Data(observed.radiance, np.ones_like(observed.radiance), np.asarray(observed.frame))
        predicted = np.asarray(problem.columns(near, data, physical).times(end.linear.amplitudes))
        deviations = standard_deviations(weighing.noise, predicted)
        left = (np.asarray(observed.radiance) - predicted) / deviations
        # Edges of highlights, where hardly anything is predicted, do not decide alone.
        robust = robust_weights(left, "huber") ** 2
        squares = robust * (left**2 - (standard_deviations(pixels, predicted) / deviations) ** 2)
        return float(np.sum(observed.shares[:, None] * squares))

    def searched(self, now: State, weighing: Weighing) -> tuple[State, bool]:
        """Correct further until nothing is gained; say whether that was so.

        What a blur does is taken from the material found so far, until that stays as it is.
        """
        if "blur" not in self.free:
            return self._searched(now, weighing)
        for _ in range(_SOFTENED):
            here, before = self.softened(now), np.asarray(now.stop.fit.predicted)
            begun = here.fitted(now.corrections, now.stop, weighing, before)
            now, settled = here._searched(begun, weighing)
            moved = np.asarray(now.stop.data.weights) * (
                np.asarray(now.stop.fit.predicted) - before
            )
            if np.sqrt(np.mean(moved**2)) < _STILL:
                return now, settled
        return now, False

    def _searched(self, now: State, weighing: Weighing) -> tuple[State, bool]:
        damping = 0.0
        for _ in range(_ROUNDS):
            equations = equations_of(self.task, self.told, now, self.free, weighing.strength)
            predicted, further = np.asarray(now.stop.fit.predicted), None
            # Where much is left that is no noise, small gains are the price of coarse derivatives.
            least = max(_LEAST_GAIN, _SMALL_GAIN * (now.cost - predicted.size))
            for _ in range(_TRIES):
                step = equations.step(damping)
                if step.gain < least:
                    return now, True
                tried = _moved(now.corrections, step)
                further = self.fitted(tried, now.stop, weighing, predicted)
                if further.cost < now.cost:
                    break
                further, damping = None, max(10 * damping, _DAMPING)
            if further is None:
                return now, True
            gained, now = now.cost - further.cost, further
            damping = damping / 10 if damping > _DAMPING else 0.0
            if gained < least:
                return now, True
        return now, False


class Divided(NamedTuple):
    """The samples to calibrate on, and as many others, where there are any, to check that by."""

    some: Int[np.ndarray, "sample"]
    held_out: Int[np.ndarray, "sample"]

    @classmethod
    def of(cls, task: MaterialTask, told: Told, begin: Stop) -> "Divided":
        """Take more samples where the light is a few sources."""
        few = told.observations.take(np.zeros(1, int))
        nodes = task.nodes(told.light, few, task.width(begin), _CELLS)
        each = sum(part.directions.shape[-2] for part in nodes)
        count = int(np.clip(_WORK / each, _SAMPLES, MOST_SAMPLES))
        order = np.random.default_rng(task.settings.seed).permutation(told.observations.count)
        some, others = np.sort(order[:count]), np.sort(order[count : 2 * count])
        return cls(some, others if len(others) >= _SAMPLES // 2 else some)


def _moved(corrections: Corrections, step: Step) -> Corrections:
    """Take a step, no further than bounds allow."""
    for name, by in step.by.items():
        before = corrections.of(name)
        highest = NEAREST if name == "nearness" else np.inf
        after = np.clip(before + by, NUISANCES[name].lowest, highest)
        # Rotations follow upon each other, so they are not clipped but turned.
        corrections = corrections.moved(name, after - before)
    return corrections
