"""Rank the causes of what a fit leaves by the Bayesian information criterion."""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.diagnosis.axes import other_axes
from jaxrender.inverse.diagnosis.causes import CAUSES, typical_amounts
from jaxrender.inverse.diagnosis.derivatives import Derivatives
from jaxrender.inverse.diagnosis.grounds import Grounds, Suspect
from jaxrender.inverse.diagnosis.scores import Leftover, Score
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.misfit import Misfit
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
# First order errs by this part of a strong cause: a general one is to gain so much more.
_FIRST_ORDER = 0.05
# Causes that explain this part of what the best does may be the right one as well.
_AS_GOOD = 0.5


class Diagnosis(NamedTuple):
    """One cause of a misfit: its name, in words, and the part of the misfit that it explains.

    ``bic`` is by how much the Bayesian information criterion prefers it to the model as it is.
    ``shift`` is how far each parameter would move, were the cause known: those of the material, and
    then those of a light that is unknown too.
    """

    cause: str
    sentence: str
    explains: float
    bic: float
    shift: Float[np.ndarray, "parameter"]

    @property
    def reason(self) -> str:
        """Say it in words, with how much it would explain."""
        part = f"{100 * self.explains:.0f} % of what the model leaves above the noise"
        return f"{self.sentence}: that would explain {part} ({self.cause})"


def likeliest(diagnosis: tuple[Diagnosis, ...]) -> list[Float[np.ndarray, "parameter"]]:
    """Say how far parameters would move by the best explanation, and by those about as good.

    What is wrong in the same way everywhere no clusters of samples show.
    """
    most = max((one.explains for one in diagnosis), default=0.0)
    return [one.shift for one in diagnosis if one.explains >= _AS_GOOD * most]


def reaching(parameters: Uncertain, diagnosis: tuple[Diagnosis, ...]) -> Uncertain:
    """Let error bars reach as far as the parameters would move by the best explanations."""
    shifts = likeliest(diagnosis)
    if not shifts or parameters.covariance is None:
        return parameters
    own = [shift[: len(parameters.covariance)] for shift in shifts]
    moved = sum(np.outer(shift, shift) for shift in own)
    return parameters.with_covariance(parameters.covariance + moved)


def diagnose(suspect: Suspect, misfit: Misfit) -> tuple[Diagnosis, ...]:
    """Name what would explain the rest, the best first; nothing where nothing is wrong.

    What takes a while is tested only where there is more than noise, or where a cause is named that
    takes none: black levels, exposures, paints and the like show whatever is not the same
    everywhere.
    """
    index = _some(suspect)
    grounds = Grounds.of(suspect, index)
    # The integrals' own errors are noise as well: dark samples may have no other.
    typical = float(np.sqrt(np.mean(grounds.predicted**2)))
    known = suspect.derivatives(index).no_surer_than(_LEAST_EFFECT * typical)
    freed = [CAUSES[name].columns(grounds) for name in suspect.freed]

    def leftover_of(known: Derivatives) -> Leftover:
        made = (known.weighted(columns) for columns in freed if columns is not None)
        return Leftover(known.left, np.hstack([known.jacobian, *made]))

    leftover = leftover_of(known)
    signal = float(np.sum((known.weights * grounds.predicted) ** 2))
    noise = known.expected(standard_deviations(misfit.noise, grounds.predicted))
    excess = max(float(leftover.left @ leftover.left) - noise, 1e-300)

    def tested(of_light: bool) -> list[_Tested]:
        """Test the causes of one kind that the photographs leave room for."""
        found = []
        for cause in CAUSES.values():
            if cause.of_light != of_light or cause.name in (*suspect.freed, *suspect.unknown):
                continue
            # What is not taken for granted is not in its general cases either.
            if cause.general in suspect.unknown:
                continue
            columns = cause.columns(grounds)
            if columns is not None:
                amounts = typical_amounts(cause.name, grounds, columns.shape[2])
                score = leftover.score(known.weighted(columns), amounts)
                found.append(_Tested(cause.name, cause.sentence, score))
        return found

    def named(scores: list[_Tested]) -> list[Diagnosis]:
        found = []
        for name, sentence, score in scores:
            effect = np.sqrt(score.explained / signal) if signal > 0 else 0.0
            if score.gain > _NAMED and effect > _LEAST_EFFECT:
                explains = float(np.clip((score.explained - score.columns) / excess, 0, 1))
                shift = known.moved(score.shift, score.change)
                found.append(Diagnosis(name, sentence, explains, score.gain, shift))
        return found

    found = named(tested(of_light=False))
    clipped = clipped_values(suspect.told.take(index), suspect.pool)
    if clipped.any():
        others = leftover_of(known.without(clipped))
        score = leftover.compared(others, int(clipped.any(axis=0).sum()))
        found += named([_Tested(CLIPPED, "bright values are clipped", score)])
    if found or misfit.found:
        found = _simplest(found + named(tested(of_light=True)))
    told = not {"environment", "convention"} & set(suspect.unknown)
    if misfit.rms > _GROSS and not suspect.freed and told:
        axes = other_axes(grounds)
        if axes is not None:
            gain = known.left.size * 2 * np.log(axes.as_told / max(axes.left, 1e-300))
            explains = 1 - (axes.left / axes.as_told) ** 2
            none = np.zeros(len(known.parameters))
            found.append(Diagnosis("convention", axes.sentence(), explains, gain, none))
    # Values that pile up at the top are clipped, whatever else they look like.
    return tuple(sorted(found, key=lambda one: (one.cause != CLIPPED, -one.bic)))


def _simplest(found: list[Diagnosis]) -> list[Diagnosis]:
    """Leave out general cases of a cause that does as well."""
    gains = {one.cause: one.bic for one in found}

    def needed(one: Diagnosis) -> bool:
        simple = CAUSES[one.cause].general if one.cause in CAUSES else None
        return simple is None or gains.get(simple, 0.0) < (1 - _FIRST_ORDER) * one.bic

    return [one for one in found if needed(one)]


def _some(suspect: Suspect) -> Int[np.ndarray, "sample"]:
    """Choose the samples that are tested."""
    count = suspect.observations.count
    if count <= _SAMPLES:
        return np.arange(count)
    rng = np.random.default_rng(suspect.seed)
    return np.sort(rng.choice(count, _SAMPLES, replace=False))


class _Tested(NamedTuple):
    """A cause and its score."""

    name: str
    sentence: str
    score: Score
