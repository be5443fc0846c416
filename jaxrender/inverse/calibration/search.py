"""The search for corrections: step by step, until nothing is gained.

It knows nothing of the fit that goes with them: under known light or unknown, that is asked to fit
corrected samples, and to differentiate what it leaves.
"""

import abc
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration.equations import Columns, Step, equations_of
from jaxrender.inverse.nuisances import NUISANCES, Corrections
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.weights import robust_weights, standard_deviations
from jaxrender.shapes import Float

# Rounds, and tries of each with more and more damping.
_ROUNDS, _TRIES, _DAMPING = 25, 5, 0.03
# What a blur does is taken so often from the fit, until its prediction moves by less than this part
# of the noise (rms).
_SOFTENED, _STILL = 30, 0.01
# A round that gains less of chi-squared is the last: than this, and than this part of what is left.
_LEAST_GAIN, _SMALL_GAIN = 0.5, 1e-3
# Sources come no nearer than this.
NEAREST = 0.95


class Weighing(NamedTuple):
    """How samples count: by the noise and what a wrong model leaves above it.

    So a wrong model does not chase the darkest pixels.  Beside the priors they count as if all of
    it were noise of single pixels, ``pixels``: by ``strength``, the ratio of the two variances.
    """

    noise: NoiseModel
    pixels: NoiseModel
    strength: float

    @classmethod
    def of(
        cls, noise: NoiseModel, pixels: NoiseModel, predicted: Float[np.ndarray, "sample channel"]
    ) -> "Weighing":
        """Weigh by the noise that a fit has ended with."""
        of_fit, own = (
            float(np.mean(standard_deviations(one, predicted) ** 2)) for one in (noise, pixels)
        )
        return cls(noise, pixels, max(of_fit / own, 1.0))

    def above_noise(
        self, observed: Observations, predicted: Float[np.ndarray, "sample channel"]
    ) -> float:
        """Say what a fit leaves of samples above noise: a part of chi-squared."""
        deviations = standard_deviations(self.noise, predicted)
        left = (np.asarray(observed.radiance) - predicted) / deviations
        # Edges of highlights, where hardly anything is predicted, do not decide alone.
        robust = robust_weights(left, "huber") ** 2
        own = standard_deviations(self.pixels, predicted) / deviations
        return float(np.sum(observed.shares[:, None] * robust * (left**2 - own**2)))


class Corrected(abc.ABC):
    """Corrections, and the fit that goes with them.

    ``cost`` is chi-squared of the samples and of the priors.
    """

    corrections: Corrections
    cost: float

    @property
    @abc.abstractmethod
    def predicted(self) -> Float[np.ndarray, "sample channel"]:
        """What the samples should be."""

    @property
    @abc.abstractmethod
    def weights(self) -> Float[np.ndarray, "sample channel"]:
        """What their residuals are multiplied by."""


State = TypeVar("State", bound=Corrected)


class Capture(abc.ABC, Generic[State]):
    """A capture of which something is ``free``, how its samples count, and the fit to it."""

    free: tuple[str, ...]
    weighing: Weighing

    @abc.abstractmethod
    def corrected(self, corrections: Corrections, before: State) -> State:
        """Fit to samples as they are corrected, from where it stood before."""

    @abc.abstractmethod
    def columns(self, state: State) -> Columns:
        """Differentiate what is left by the fit's own unknowns and by what is free."""

    @abc.abstractmethod
    def softened(self, state: State) -> "Capture[State]":
        """Take what a blur does from a state."""


def search(capture: Capture[State], now: State) -> tuple[State, bool]:
    """Correct further until nothing is gained; say whether that was so.

    What a blur does is taken from the fit found so far, until that stays as it is.
    """
    if "blur" not in capture.free:
        return _searched(capture, now)
    for _ in range(_SOFTENED):
        here, before = capture.softened(now), now.predicted
        now, settled = _searched(here, here.corrected(now.corrections, now))
        moved = now.weights * (now.predicted - before)
        if np.sqrt(np.mean(moved**2)) < _STILL:
            return now, settled
    return now, False


def _searched(capture: Capture[State], now: State) -> tuple[State, bool]:
    damping, strength = 0.0, capture.weighing.strength
    for _ in range(_ROUNDS):
        columns = capture.columns(now)
        equations = equations_of(columns, now.corrections, capture.free, strength)
        further = None
        # Where much is left that is no noise, small gains are the price of coarse derivatives.
        least = max(_LEAST_GAIN, _SMALL_GAIN * (now.cost - columns.known.weights.size))
        for _ in range(_TRIES):
            step = equations.step(damping)
            if step.gain < least:
                return now, True
            further = capture.corrected(_moved(now.corrections, step), now)
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


def last_step(columns: Columns, corrections: Corrections, strength: float) -> Corrections | None:
    """Correct once more, where columns are of more samples; None where nothing is gained."""
    free = tuple(dict.fromkeys(columns.names.tolist()))
    step = equations_of(columns, corrections, free, strength).step(0.0)
    return _moved(corrections, step) if step.gain >= _LEAST_GAIN else None


def _moved(corrections: Corrections, step: Step) -> Corrections:
    """Take a step, no further than bounds allow."""
    for name, by in step.by.items():
        before = corrections.of(name)
        highest = NEAREST if name == "nearness" else np.inf
        after = np.clip(before + by, NUISANCES[name].lowest, highest)
        # Rotations follow upon each other, so they are not clipped but turned.
        corrections = corrections.moved(name, after - before)
    return corrections
