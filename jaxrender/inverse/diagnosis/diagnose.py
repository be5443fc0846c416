"""Rank the causes of what a fit leaves by the Bayesian information criterion."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.diagnosis.causes import CAUSES
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.diagnosis.saturation import clipped_values
from jaxrender.inverse.diagnosis.scores import Leftover, Score
from jaxrender.inverse.elimination import Data, Problem
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import Stop, values_of
from jaxrender.inverse.uncertainty import slopes_of_parameters
from jaxrender.inverse.weights import standard_deviations
from jaxrender.programs import stored
from jaxrender.shapes import Array, Float

# So many samples are tested.
_SAMPLES = 700
# A cause is named where the criterion prefers it by so much (odds of e^5 to one), and where it
# changes the photographs by more than the integrals' own errors.
_NAMED, _LEAST_EFFECT = 10.0, 1e-3
_CLIPPED = "saturation"


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


class Suspect(NamedTuple):
    """A fit under known light that may be wrong: where it ended, and what it was made from.

    ``pool`` are all pixels, ``seed`` that of the samples that are tested.
    """

    stop: Stop
    material: Parametric
    light: KnownLight
    shape: Shape | None
    pool: Observations
    seed: int = 0


def diagnose(suspect: Suspect, misfit: Misfit) -> tuple[Diagnosis, ...]:
    """Name what would explain the rest, the best first; nothing where nothing is wrong.

    What takes a while is tested only where there is more than noise, or where a cause is named that
    takes none: black levels, exposures, paints and the like show whatever is not the same
    everywhere.
    """
    stop = suspect.stop
    end = stop.fit.solution.point, stop.fit.linear.eliminated
    grounds, data, near = _grounds(suspect)
    weights = np.asarray(data.weights)
    leftover = Leftover(
        (weights * (np.asarray(data.radiance) - grounds.predicted)).ravel(),
        np.asarray(_jacobian(stop.problem, near, data, *end)),
    )
    signal = float(np.sum((weights * grounds.predicted) ** 2))
    noise = float(np.sum((weights * standard_deviations(misfit.noise, grounds.predicted)) ** 2))
    excess = max(float(leftover.left @ leftover.left) - noise, 1e-300)
    slopes = np.asarray(slopes_of_parameters(stop.problem, *end))

    def named(tested: list[_Tested]) -> list[Diagnosis]:
        found = []
        for name, sentence, score in tested:
            effect = np.sqrt(score.explained / signal) if signal > 0 else 0.0
            if score.gain > _NAMED and effect > _LEAST_EFFECT:
                explains = float(np.clip((score.explained - score.columns) / excess, 0, 1))
                shift = slopes @ score.shift
                found.append(Diagnosis(name, sentence, explains, score.gain, shift))
        return found

    found = named(_tested(grounds, leftover, weights, of_light=False))
    clipped = clipped_values(grounds.observations, suspect.pool)
    if clipped.any():
        score = leftover.without(clipped.ravel(), int(clipped.any(axis=0).sum()))
        found += named([_Tested(_CLIPPED, "bright values are clipped", score)])
    if found or misfit.found:
        found += named(_tested(grounds, leftover, weights, of_light=True))
    # Values that pile up at the top are clipped, whatever else they look like.
    return tuple(sorted(found, key=lambda one: (one.cause != _CLIPPED, -one.bic)))


def _grounds(suspect: Suspect) -> tuple[Grounds, Data, LinearisedModel]:
    """Choose samples, and differentiate the prediction there."""
    stop = suspect.stop
    physical = stop.problem.unknowns.unpack(stop.fit.solution.point)
    near = LinearisedModel.about(stop.model, physical.numbers)
    count = stop.observations.count
    index = np.arange(count)
    if count > _SAMPLES:
        index = np.sort(np.random.default_rng(suspect.seed).choice(count, _SAMPLES, replace=False))
    data = Data(*(np.asarray(part)[index] for part in stop.data))
    value = values_of(stop)
    gains = np.asarray(value.gains)
    gain = gains[data.frame] if len(gains) > 1 else np.ones(len(index))
    grounds = Grounds(
        stop.observations.take(index),
        np.asarray(stop.fit.predicted)[index],
        (float(value.scale) * gain)[:, None],
        suspect.material,
        suspect.light,
        suspect.shape,
    )
    return grounds, data, near.take(index)


class _Tested(NamedTuple):
    """A cause and its score."""

    name: str
    sentence: str
    score: Score


def _tested(
    grounds: Grounds,
    leftover: Leftover,
    weights: Float[np.ndarray, "sample channel"],
    of_light: bool,
) -> list[_Tested]:
    """Test the causes of one kind that the photographs leave room for."""
    found = []
    for cause in CAUSES:
        columns = cause.columns(grounds) if cause.of_light == of_light else None
        if columns is not None:
            weighted = (weights[:, :, None] * columns).reshape(weights.size, -1)
            found.append(_Tested(cause.name, cause.sentence, leftover.score(weighted)))
    return found


@stored(older_emitters=True)
def _jacobian(
    problem: Problem,
    model: LinearisedModel,
    data: Data,
    point: Float[Array, "unknown"],
    eliminated: Float[Array, "linear"],
) -> Float[Array, "value all"]:
    """Differentiate the weighted prediction by search variables and eliminated unknowns."""
    split = point.shape[0]

    def weighted(vector: Float[Array, "all"]) -> Float[Array, "value"]:
        predicted = problem.predict(model, data, vector[:split], problem.linear(vector[split:]))
        return (jnp.asarray(data.weights) * predicted).ravel()

    return jax.jacfwd(weighted)(jnp.concatenate([point, eliminated]))
