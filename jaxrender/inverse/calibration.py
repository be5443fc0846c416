"""Calibration: nuisances of a capture, found together with the material.

Each round fits the material to samples and light as they are corrected so far, differentiates the
prediction by what is free (the columns by which ``diagnosis`` tests causes), and corrects further:
least squares of material and nuisances at once, the nuisances held by their priors.  A step that
makes matters worse is damped (Levenberg and Marquardt).  At the end the errors of the material hold
those of the nuisances.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.clusters import Clusters, widened
from jaxrender.inverse.diagnosis.causes import CAUSES
from jaxrender.inverse.diagnosis.grounds import Derivatives, Grounds, Suspect
from jaxrender.inverse.elimination import Data
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.material_task import MaterialTask
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.nuisances import NUISANCES, Corrections, Told
from jaxrender.inverse.parameters import slopes_of_parameters
from jaxrender.inverse.passes import Begin, Stop, descend
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import Float, Int

# So many samples are calibrated on; the light is condensed to cells of so many widths of the lobe.
_SAMPLES, _CELLS = 1500, 0.35
# Of light of few sources so many pairs of a sample and a node, and no more samples than that.
_WORK, _MOST_SAMPLES = 1e5, 6000
# Rounds, and tries of each with more and more damping; a round that gains less than this of
# chi-squared is the last.
_ROUNDS, _TRIES, _DAMPING, _LEAST_GAIN = 25, 5, 0.03, 0.5
# Degrees of freedom of the priors: a fault is many deviations off more often than Gauss says.
_FREEDOM = 4.0
# Sources come no nearer than this.
_NEAREST = 0.95
# Two nuisances are alike where both together leave less than their priors say, of something that
# one alone would tell so many times as well (variances).
_ALIKE = 100.0


class Calibrated(NamedTuple):
    """A material and the corrections that go with it.

    ``stop`` is of corrected samples, under the corrected ``light``; ``told`` is what was corrected.
    ``errors`` are the standard errors of what is ``free``.  ``spread`` is what the material's
    covariance has for their sake.  ``sentences`` say what cannot be told apart or is at a bound.
    ``absorbed`` is the part of chi-squared above the noise that they do away with.
    """

    stop: Stop
    told: Told
    corrections: Corrections
    light: KnownLight
    free: tuple[str, ...]
    errors: dict[str, Float[np.ndarray, "number"]]
    spread: Float[np.ndarray, "parameter parameter"]
    settled: bool
    sentences: tuple[str, ...]
    absorbed: float = 0.0


class _State(NamedTuple):
    """Corrections, and the material that fits best with them."""

    corrections: Corrections
    light: KnownLight
    stop: Stop
    cost: float


class _Step(NamedTuple):
    """How far to move each nuisance, and what of chi-squared that would gain."""

    by: dict[str, Float[np.ndarray, "number"]]
    gain: float


class _Weighing(NamedTuple):
    """How samples count: by the noise and what a wrong model leaves above it.

    So a wrong model does not chase the darkest pixels.  Beside the priors they count as if all of
    it were noise of single pixels: by ``strength``, the ratio of the two variances.
    """

    noise: NoiseModel
    strength: float

    @classmethod
    def of(cls, stop: Stop, pixels: NoiseModel) -> "_Weighing":
        """Weigh by the noise that a fit has ended with."""
        predicted = np.asarray(stop.fit.predicted)
        of_fit, own = (
            float(np.mean(standard_deviations(noise, predicted) ** 2))
            for noise in (stop.noise, pixels)
        )
        return cls(stop.noise, max(of_fit / own, 1.0))


class _Capture(NamedTuple):
    """Some samples of a capture, what is free of it, and the width of the lobe."""

    task: MaterialTask
    told: Told
    free: tuple[str, ...]
    width: float

    def fitted(
        self,
        corrections: Corrections,
        before: Stop,
        weighing: _Weighing,
        predicted: Float[np.ndarray, "sample channel"] | None = None,
    ) -> _State:
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
        prior = sum(_Pull.of(corrections, name).cost for name in self.free)
        cost = weighing.strength * float(np.sum(left**2)) + prior
        return _State(corrections, light, stop, cost)

    def above_noise(self, state: _State, weighing: _Weighing, pixels: NoiseModel) -> float:
        """Say what the end of a search leaves of these samples above noise: part of chi-squared."""
        task, problem, end = self.task, self.task.problem, state.stop.fit
        observed = state.corrections.observations(self.told)
        nodes = task.nodes(state.light, observed, self.width, _CELLS)
        physical = problem.unknowns.unpack(end.solution.point)
        near = LinearisedModel.about(task.integral(observed, nodes), physical.numbers)
        data = Data(observed.radiance, np.ones_like(observed.radiance), np.asarray(observed.frame))
        predicted = np.asarray(problem.columns(near, data, physical).times(end.linear.amplitudes))
        squares = (np.asarray(observed.radiance) - predicted) ** 2
        squares -= standard_deviations(pixels, predicted) ** 2
        squares /= standard_deviations(weighing.noise, predicted) ** 2
        return float(np.sum(observed.shares[:, None] * squares))

    def searched(self, now: _State, weighing: _Weighing) -> tuple[_State, bool]:
        """Correct further until nothing is gained; say whether that was so."""
        damping = 0.0
        for _ in range(_ROUNDS):
            equations = _equations(self, now, weighing.strength)
            predicted, further = np.asarray(now.stop.fit.predicted), None
            for _ in range(_TRIES):
                step = equations.step(damping)
                if step.gain < _LEAST_GAIN:
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
            if gained < _LEAST_GAIN:
                return now, True
        return now, False


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
    index = _Divided.of(task, told, begin)
    few = told._replace(observations=told.observations.take(index.some))
    capture = _Capture(task, few, free, task.width(begin))
    weighing = _Weighing.of(begin, noise)
    begun = capture.fitted(corrections, begin, weighing)
    now, settled = capture.searched(begun, weighing)
    others = told._replace(observations=told.observations.take(index.held_out))
    checked = capture._replace(told=others)
    before, after = (checked.above_noise(state, weighing, noise) for state in (begun, now))
    absorbed = 1 - after / before if before > 0 else 1.0
    if task.settings.noise is None:
        # Less is left now than what the samples were weighed by.
        again = finish(task, few, _account(task, few, now, free, settled))
        weighing = _Weighing.of(again.stop, noise)
        begun = capture.fitted(now.corrections, again.stop, weighing)
        now, settled = capture.searched(begun, weighing)
    found = finish(task, few, _account(task, few, now, free, settled))
    return found._replace(absorbed=absorbed)


def finish(task: MaterialTask, told: Told, calibrated: Calibrated) -> Calibrated:
    """Fit the material to all samples, as they are corrected now."""
    corrections, before = calibrated.corrections, calibrated.stop
    observed, light = corrections.observations(told), corrections.light(told)
    nodes = task.nodes(light, observed, task.width(before))
    stop = descend(
        task.problem, task.integral(observed, nodes), observed, before.onward(None), task.settings
    )
    state = _State(corrections, light, stop, 0.0)
    return _account(task, told, state, calibrated.free, calibrated.settled)


class _Divided(NamedTuple):
    """The samples to calibrate on, and as many others, where there are any, to check that by."""

    some: Int[np.ndarray, "sample"]
    held_out: Int[np.ndarray, "sample"]

    @classmethod
    def of(cls, task: MaterialTask, told: Told, begin: Stop) -> "_Divided":
        """Take more samples where the light is a few sources."""
        few = told.observations.take(np.zeros(1, int))
        nodes = task.nodes(told.light, few, task.width(begin), _CELLS)
        each = sum(part.directions.shape[-2] for part in nodes)
        count = int(np.clip(_WORK / each, _SAMPLES, _MOST_SAMPLES))
        order = np.random.default_rng(task.settings.seed).permutation(told.observations.count)
        some, others = np.sort(order[:count]), np.sort(order[count : 2 * count])
        return cls(some, others if len(others) >= _SAMPLES // 2 else some)


def _some(count: int, seed: int) -> Int[np.ndarray, "sample"]:
    if count <= _MOST_SAMPLES:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, _MOST_SAMPLES, replace=False))


class _Pull(NamedTuple):
    """How far a nuisance is from what was told, in standard deviations of its prior, and the pull.

    A fault that is gross is pulled less: by Student's t of few degrees of freedom.
    """

    off: Float[np.ndarray, "number"]

    @classmethod
    def of(cls, corrections: Corrections, *names: str) -> "_Pull":
        """Look at some nuisances, one after the other."""
        numbers = [
            corrections.of(name) / NUISANCES[name].deviations(len(corrections.of(name)))
            for name in names
        ]
        return cls(np.concatenate(numbers))

    @property
    def weights(self) -> Float[np.ndarray, "number"]:
        """The information that a prior has here."""
        return 1 / (1 + self.off**2 / _FREEDOM)

    @property
    def cost(self) -> float:
        """What it adds to chi-squared."""
        return float(np.sum(_FREEDOM * np.log1p(self.off**2 / _FREEDOM)))


class _Columns(NamedTuple):
    """Derivatives of what is left by the material's unknowns and by what is free, weighted.

    Nuisances are in standard deviations of their priors; ``names`` says whose each column is.
    """

    known: Derivatives
    columns: Float[np.ndarray, "value nuisance"]
    names: np.ndarray


def _columns(
    task: MaterialTask,
    told: Told,
    state: _State,
    free: tuple[str, ...],
    index: Int[np.ndarray, "sample"],
) -> _Columns:
    """Differentiate by the material and by all that is free."""
    stop, light = state.stop, state.light
    every = told.observations
    suspect = Suspect(stop, task.material(stop), light, told.shape, every, every)
    grounds, known = Grounds.of(suspect, index), Derivatives.of(stop, index)
    found, names = [], []
    for name in free:
        columns = CAUSES[name].columns(grounds)
        if columns is None:
            raise ValueError(f"{name} cannot be freed: {_NO_ROOM.get(name, 'there is none')}")
        # The last photographs may have no sample among these.
        every = len(state.corrections.of(name))
        columns = np.pad(columns, ((0, 0), (0, 0), (0, every - columns.shape[2])))
        found.append(known.weighted(columns * NUISANCES[name].deviations(every)))
        names += [name] * every
    return _Columns(known, np.hstack(found), np.array(names))


_NO_ROOM = {
    "camera": "nobody says where the cameras stand",
    "scale": "nobody says where the cameras stand, or their rays are parallel",
    "object": "nobody says where the samples lie",
    "environment": "the light has no environment",
    "lamps": "the light has no sources",
    "nearness": "the light has no source that stands alone, or nobody says where the samples lie",
}


class _Equations(NamedTuple):
    """Normal equations of material and nuisances, the nuisances last and called by ``names``."""

    matrix: Float[np.ndarray, "all all"]
    right: Float[np.ndarray, "all"]
    names: np.ndarray

    def step(self, damping: float) -> _Step:
        """Solve them; damping shortens what is told worst."""
        diagonal = np.where(np.arange(len(self.right)) < len(self.right) - len(self.names), 0, 1)
        damped = self.matrix + damping * np.diag(diagonal * np.diag(self.matrix))
        found = np.linalg.lstsq(damped, self.right, rcond=1e-12)[0]
        gain = float(2 * self.right @ found - found @ self.matrix @ found)
        own = found[-len(self.names) :]
        by = {
            str(name): own[self.names == name] * _deviations(name, self.names)
            for name in dict.fromkeys(self.names)
        }
        return _Step(by, gain)


def _equations(capture: _Capture, state: _State, strength: float) -> _Equations:
    """Set up material and nuisances at once, to first order."""
    count, free = state.stop.observations.count, capture.free
    known, columns, names = _columns(capture.task, capture.told, state, free, np.arange(count))
    both = np.hstack([_scaled(known.jacobian), columns])
    pull = _Pull.of(state.corrections, *free)
    prior = np.zeros(both.shape[1])
    prior[-len(names) :] = pull.weights
    right = strength * both.T @ known.left
    right[-len(names) :] -= pull.weights * pull.off
    return _Equations(strength * both.T @ both + np.diag(prior), right, names)


def _deviations(name: str, names: np.ndarray) -> Float[np.ndarray, "number"]:
    """List the priors of one nuisance's columns."""
    return NUISANCES[name].deviations(int(np.sum(names == name)))


def _moved(corrections: Corrections, step: _Step) -> Corrections:
    """Take a step, no further than bounds allow."""
    for name, by in step.by.items():
        before = corrections.of(name)
        highest = _NEAREST if name == "nearness" else np.inf
        after = np.clip(before + by, NUISANCES[name].lowest, highest)
        # Rotations follow upon each other, so they are not clipped but turned.
        corrections = corrections.moved(name, after - before)
    return corrections


def _scaled(jacobian: Float[np.ndarray, "value all"]) -> Float[np.ndarray, "value all"]:
    """Let every column have length one, if it has any."""
    size = np.linalg.norm(jacobian, axis=0)
    return jacobian / np.where(size > 0, size, 1)


def _account(
    task: MaterialTask, told: Told, state: _State, free: tuple[str, ...], settled: bool
) -> Calibrated:
    """Say how well the nuisances are known, and what of that goes into the material's errors."""
    stop = state.stop
    index = _some(stop.observations.count, task.settings.seed)
    known, columns, names = _columns(task, told, state, free, index)
    jacobian = known.jacobian
    # How the material answers to each nuisance, and what of the nuisance the material cannot make.
    answer = np.linalg.lstsq(_scaled(jacobian), columns, rcond=1e-9)[0]
    own = columns - _scaled(jacobian) @ answer
    pull = _Pull.of(state.corrections, *free)
    covariance = np.linalg.inv(own.T @ own + np.diag(pull.weights))
    left = known.left - own @ (covariance @ (own.T @ known.left))
    channels = known.weights.shape[1]
    scores = np.sum((left[:, None] * own).reshape(-1, channels, len(names)), axis=1)
    clusters = Clusters.of(stop.observations.take(index))
    covariance = widened(covariance, clusters.covariance(scores @ covariance))
    size = np.linalg.norm(jacobian, axis=0)
    answer = answer / np.where(size > 0, size, 1)[:, None]
    end = stop.fit.solution.point, stop.fit.linear.eliminated
    moves = np.asarray(slopes_of_parameters(stop.problem, *end)) @ answer
    errors = np.sqrt(np.diag(covariance))
    by_name = {name: errors[names == name] * _deviations(name, names) for name in free}
    sentences = [*_alike(columns, own, names), *_at_bound(state.corrections, free)]
    if not settled:
        sentences.append(f"the calibration of {' and '.join(free)} did not settle")
    return Calibrated(
        stop,
        told,
        state.corrections,
        state.light,
        free,
        by_name,
        moves @ covariance @ moves.T,
        settled,
        tuple(sentences),
    )


def _alike(
    columns: Float[np.ndarray, "value nuisance"],
    own: Float[np.ndarray, "value nuisance"],
    names: np.ndarray,
) -> list[str]:
    """Name what cannot be told apart: pairs of nuisances, and a nuisance and the material."""
    found = []
    free = list(dict.fromkeys(names))
    for at, name in enumerate(free):
        mine = own[:, names == name]
        if _lost(columns[:, names == name], mine):
            found.append(
                f"{name} and the material cannot be told apart by these photographs alone: the "
                f"prior of {name} decides"
            )
        for other in free[at + 1 :]:
            theirs = own[:, names == other]
            basis = np.linalg.svd(theirs, full_matrices=False)[0]
            if _lost(mine, mine - basis @ (basis.T @ mine)):
                found.append(
                    f"{name} and {other} cannot be told apart by these photographs: their priors "
                    "divide what both could be; free one of them, or know one better"
                )
    return found


def _lost(
    alone: Float[np.ndarray, "value nuisance"], together: Float[np.ndarray, "value nuisance"]
) -> bool:
    """Whether something is told well alone, and less than by its prior beside something else."""
    values, vectors = np.linalg.eigh(together.T @ together)
    told = np.sum((alone @ vectors) ** 2, axis=0)
    return bool(np.any((values < 1) & (told > _ALIKE)))


def _at_bound(corrections: Corrections, free: tuple[str, ...]) -> list[str]:
    """Say which sources are as far as they can be, or as near."""
    if "nearness" not in free:
        return []
    found = []
    for number, near in enumerate(corrections.nearness):
        if near <= 0:
            found.append(f"nearness of source {number + 1} is at its bound 0: it is infinitely far")
        elif near >= _NEAREST:
            found.append(f"nearness of source {number + 1} is at its bound {_NEAREST}")
    return found
