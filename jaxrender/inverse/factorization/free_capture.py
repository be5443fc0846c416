"""A capture under unknown light of which something is free, and the material and light that fit.

The light is found with the material, so that nothing of it is free beside that.
"""

import dataclasses

import numpy as np

from jaxrender.inverse.calibration import Columns, Pull, Weighing, softened
from jaxrender.inverse.calibration.search import Capture, Corrected
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.factorization.band_limits import with_samples
from jaxrender.inverse.factorization.correction import corrected
from jaxrender.inverse.factorization.state import State, Task, descend
from jaxrender.inverse.factorization.suspicion import (
    Found,
    Photographs,
    derivatives_of,
    suspect_of,
)
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import concave
from jaxrender.shapes import Float, Int

# Steps of the fit that goes with corrections, and the relative gain of cost that ends it.
_STEPS, _TOLERANCE = 6, 1e-6
# What the dual model lacks is computed anew where the lobe has moved so far (logarithms).
_FAR = 0.02


@dataclasses.dataclass(frozen=True)
class Lit(Corrected):
    """Corrections, and the material and the light that fit best with them."""

    corrections: Corrections
    task: Task
    state: State
    cost: float

    @property
    def predicted(self) -> Float[np.ndarray, "sample channel"]:
        """What the samples should be."""
        assert self.state.joint is not None
        return np.asarray(self.state.joint.solved.predicted)

    @property
    def weights(self) -> Float[np.ndarray, "sample channel"]:
        """What their residuals are multiplied by."""
        return self.state.weights * np.sqrt(self.task.observations.shares)[:, None]

    def columns(
        self, told: Told, free: tuple[str, ...], index: Int[np.ndarray, "kept"], gauge: str
    ) -> Columns:
        """Differentiate some samples by material and light, and by all that is free."""
        found = Found.per_channel(self.task, self.state)
        photographs = Photographs(told.observations, told.observations, told.shape)
        grounds = Grounds.of(suspect_of(self.task, self.state, found, photographs), index)
        known = derivatives_of(self.task, self.state, gauge, index)
        return Columns.of(grounds, known, self.corrections, free)

    def softened(self, told: Told, free: tuple[str, ...]) -> Told:
        """Say what a blur does to samples, as these are predicted; nothing where none is free."""
        if "blur" not in free:
            return told
        observed = told.observations
        found = Found.per_channel(self.task, self.state)
        grounds = Grounds(
            observed,
            np.zeros(np.shape(observed.radiance)),
            np.ones((observed.count, 1)),
            found.brdf,
            found.light,
            told.shape,
        )
        return softened(told, self.corrections, grounds)

    def task_of(self, told: Told, band_limit: int) -> Task:
        """Make the task of samples as they are corrected, with light of so many degrees."""
        task, hiding = self.task, concave(told.shape)
        # Transfer vectors are those of the places that were told.
        observed = self.corrections.observations(told)._replace(transfer=None)
        variant, settings = task.response.variant, task.settings
        return with_samples(observed, variant, settings, task.known, hiding, band_limit)

    def take(self, index: Int[np.ndarray, "kept"]) -> "Lit":
        """Keep the samples of the given indices."""
        lacking = self.state.lacking
        if lacking is not None:
            lacking = lacking._replace(columns=lacking.columns[index])
        state = self.state._replace(weights=self.state.weights[index], lacking=lacking)
        return dataclasses.replace(self, task=self.task.take(index), state=state)


@dataclasses.dataclass(frozen=True)
class FreeScene(Capture[Lit]):
    """Some samples of a capture, what is free of it, and how the samples count.

    ``weights`` are those of the values that were told, and ``level`` is what is expected of the
    light: both stay, so that costs can be compared.
    """

    told: Told
    free: tuple[str, ...]
    weighing: Weighing
    weights: Float[np.ndarray, "sample channel"]
    level: Float[np.ndarray, "channel"]

    def corrected(self, corrections: Corrections, before: Lit) -> Lit:
        """Fit material and light to samples as they are corrected.

        The light has the brightness that all photographs share, so their gains have the mean 1.
        """
        exposure = corrections.exposure - np.mean(corrections.exposure)
        corrections = corrections._replace(exposure=exposure)
        now = dataclasses.replace(before, corrections=corrections)
        task = self._task(now)
        # Values that are stretched have more noise.
        weights = self.weights / corrections.slopes(self.told)
        state = before.state._replace(weights=weights, level=self.level)
        if task.settings.refine:
            state = corrected(task, state, _FAR)
        state = descend(task, state, _STEPS, _TOLERANCE)._replace(level=self.level)
        assert state.joint is not None
        cost = 2 * self.weighing.strength * float(state.joint.solved.cost)
        pull = Pull.of(corrections, *self.free)
        return Lit(corrections, task, state, cost + pull.cost)

    def columns(self, state: Lit) -> Columns:
        """Differentiate by material and light, and by all that is free."""
        every = np.arange(state.task.observations.count)
        return state.columns(self.told, self.free, every, "per-channel")

    def softened(self, state: Lit) -> "FreeScene":
        """Take what a blur does from a state."""
        return dataclasses.replace(self, told=state.softened(self.told, self.free))

    def _task(self, now: Lit) -> Task:
        """Make the task of samples as they are corrected; that of before where none moves."""
        observed = now.corrections.observations(self.told)
        before = now.task.observations
        if _alike(observed, before):
            return now.task._replace(observations=observed._replace(transfer=before.transfer))
        return now.task_of(self.told, now.task.band_limit)


def _alike(one: Observations, other: Observations) -> bool:
    """Tell whether samples see the same."""
    return all(np.array_equal(a, b) for a, b in zip(one.samples, other.samples))
