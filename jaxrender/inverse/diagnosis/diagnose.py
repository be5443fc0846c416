"""Rank the causes of what a fit leaves by the Bayesian information criterion."""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.diagnosis.axes import other_axes
from jaxrender.inverse.diagnosis.causes import CAUSES, typical_amounts
from jaxrender.inverse.diagnosis.grounds import Derivatives, Grounds, Suspect
from jaxrender.inverse.diagnosis.scores import Leftover, Score
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.parameters import slopes_of_parameters
from jaxrender.inverse.saturation import clipped_values
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import Float, Int

# So many samples are tested.
_SAMPLES = 700
# A cause is named where the criterion prefers it by so much (odds of e^5 to one), and where it
# changes the photographs by more than the integrals' own errors.
_NAMED, _LEAST_EFFECT = 10.0, 1e-3
CLIPPED = "saturation"
# Where more than this part of the radiance is misfit, other axes of the environment are tried.
_GROSS = 0.15


class Diagnosis(NamedTuple):
    """One cause of a misfit: its name, in words, and the part of the misfit that it explains.

    ``bic`` is by how much the Bayesian information criterion prefers it to the model as it is.
    ``shift`` is how far each parameter would move, were the cause known.
    """

    cause: str
    sentence: str
    explains: float
    bic: float
    shift: Float[np.ndarray, "parameter"]


def diagnose(suspect: Suspect, misfit: Misfit) -> tuple[Diagnosis, ...]:
    """Name what would explain the rest, the best first; nothing where nothing is wrong.

    What takes a while is tested only where there is more than noise, or where a cause is named that
    takes none: black levels, exposures, paints and the like show whatever is not the same
    everywhere.
    """
    stop, index = suspect.stop, _some(suspect)
    grounds, known = Grounds.of(suspect, index), Derivatives.of(stop, index)
    weights, jacobian = known.weights, known.jacobian
    freed = [CAUSES[name].columns(grounds) for name in suspect.freed]
    jacobian = np.hstack([jacobian, *(known.weighted(c) for c in freed if c is not None)])
    leftover = Leftover(known.left, jacobian)
    signal = float(np.sum((weights * grounds.predicted) ** 2))
    noise = float(np.sum((weights * standard_deviations(misfit.noise, grounds.predicted)) ** 2))
    excess = max(float(leftover.left @ leftover.left) - noise, 1e-300)
    end = stop.fit.solution.point, stop.fit.linear.eliminated
    slopes = np.asarray(slopes_of_parameters(stop.problem, *end))

    def tested(of_light: bool) -> list[_Tested]:
        """Test the causes of one kind that the photographs leave room for."""
        found = []
        for cause in CAUSES.values():
            if cause.of_light != of_light or cause.name in suspect.freed:
                continue
            columns = cause.columns(grounds)
            if columns is not None:
                typical = typical_amounts(cause.name, grounds, columns.shape[2])
                score = leftover.score(known.weighted(columns), typical)
                found.append(_Tested(cause.name, cause.sentence, score))
        return found

    def named(scores: list[_Tested]) -> list[Diagnosis]:
        found = []
        for name, sentence, score in scores:
            effect = np.sqrt(score.explained / signal) if signal > 0 else 0.0
            if score.gain > _NAMED and effect > _LEAST_EFFECT:
                explains = float(np.clip((score.explained - score.columns) / excess, 0, 1))
                shift = slopes @ score.shift[: slopes.shape[1]]
                found.append(Diagnosis(name, sentence, explains, score.gain, shift))
        return found

    found = named(tested(of_light=False))
    clipped = clipped_values(suspect.told.take(index), suspect.pool)
    if clipped.any():
        score = leftover.without(clipped.ravel(), int(clipped.any(axis=0).sum()))
        found += named([_Tested(CLIPPED, "bright values are clipped", score)])
    if found or misfit.found:
        found += named(tested(of_light=True))
    if misfit.rms > _GROSS and not suspect.freed:
        axes = other_axes(grounds)
        if axes is not None:
            gain = known.left.size * 2 * np.log(axes.as_told / max(axes.left, 1e-300))
            explains = 1 - (axes.left / axes.as_told) ** 2
            none = np.zeros(slopes.shape[0])
            found.append(Diagnosis("convention", axes.sentence(), explains, gain, none))
    # Values that pile up at the top are clipped, whatever else they look like.
    return tuple(sorted(found, key=lambda one: (one.cause != CLIPPED, -one.bic)))


def _some(suspect: Suspect) -> Int[np.ndarray, "sample"]:
    """Choose the samples that are tested."""
    count = suspect.stop.observations.count
    if count <= _SAMPLES:
        return np.arange(count)
    rng = np.random.default_rng(suspect.seed)
    return np.sort(rng.choice(count, _SAMPLES, replace=False))


class _Tested(NamedTuple):
    """A cause and its score."""

    name: str
    sentence: str
    score: Score
