"""Which further photograph would shrink the error bars most: another view, or another source.

Fisher information adds up: that of the present photographs, and that of one more.  The one more is
taken from a new direction, or from a present camera with a further source beside the present light.
Every candidate counts with as many samples as a photograph has now, so that all cost the same.
They are ranked by the predicted relative standard error of one parameter, or of the worst.
Candidates within a per cent of each other are ranked by the determinant of the information
(D-optimality).
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.candidate_views import View, candidate_directions
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.forecast.information import (
    Errors,
    Reading,
    columns_of,
    frame_grams,
    grams_by_frame,
    reading_of,
)
from jaxrender.inverse.forecast.situation import (
    Foreseen,
    Situation,
    foresee,
    kind_of,
    numbers_of,
    weights_of,
)
from jaxrender.inverse.forecast.spectrum import mean_irradiance
from jaxrender.inverse.models import ExactModel, LinearisedModel
from jaxrender.lighting import LightNodes
from jaxrender.shapes import Array, Float

# Logarithms of errors closer than this are a tie.
_TIE = 0.01
# Candidates are ranked first with this few samples each, under light of cells this wide (in sigma).
# This many times the wanted number are ranked again, with all samples under the light as it is.
_FEW, _COARSE, _AGAIN = 48, 0.5, 2
_SOURCES_AT_ONCE = 16


class Suggestion(NamedTuple):
    """One more photograph: the direction of its camera or source, and the errors with it.

    With a further source it is taken by the camera of the present photograph ``frame``, which is
    None for a view.  ``errors`` are relative standard errors by name: of mu - 1 for mu, of the
    worst channel for kd and ks.
    """

    direction: Float[np.ndarray, "3"]
    frame: int | None
    errors: dict[str, float]
    criterion: float


def present_errors(foreseen: Foreseen, problem: Problem) -> dict[str, float]:
    """Compute the relative standard errors that the present photographs allow."""
    reading = reading_of(problem, foreseen)
    errors = reading.errors(reading.information(frame_grams(foreseen)))
    return {name: float(value) for name, value in errors.relative.items()}


def suggest_views(
    foreseen: Foreseen,
    problem: Problem,
    views: Sequence[View],
    aim: str = "worst",
    count: int = 5,
) -> tuple[Suggestion, ...]:
    """Rank candidate cameras, best first, and return the ``count`` best.

    New photographs are in the light that the first of the present ones is in.  Raises
    ``ValueError`` for an aim that is not free, and where nothing is to be seen.
    """
    reading = _reading(problem, foreseen, aim)
    views = [view for view in views if len(view.samples.normals) >= 8]
    if not views:
        raise ValueError("no candidate camera sees the object: give other directions")
    own = frame_grams(foreseen)
    wanted = round(len(foreseen.situation.frame) / len(np.unique(foreseen.situation.frame)))

    def errors(chosen: Sequence[View], samples: int, cell: float | None) -> Errors:
        grams = _view_grams(foreseen, chosen, samples, wanted, cell)
        return reading.errors(reading.information(_beside(own, grams)))

    first = _ranked(errors(views, min(_FEW, wanted), _COARSE), aim)[: _AGAIN * count]
    best = [views[index] for index in first]
    found = errors(best, wanted, None)
    return tuple(
        _suggestion(best[index].direction, None, found, int(index), aim)
        for index in _ranked(found, aim)[:count]
    )


def suggest_sources(
    foreseen: Foreseen,
    problem: Problem,
    directions: Float[np.ndarray, "source 3"] | None = None,
    aim: str = "worst",
    count: int = 5,
) -> tuple[Suggestion, ...]:
    """Rank sources by one more photograph with each, from the present camera that gains most.

    A source sends the irradiance that the present light sends to a plane on average, in grey.
    Raises ``ValueError`` for an aim that is not free.
    """
    reading = _reading(problem, foreseen, aim)
    directions = candidate_directions() if directions is None else directions
    own = frame_grams(foreseen)
    grams = np.concatenate(
        [
            _source_grams(foreseen, directions[start : start + _SOURCES_AT_ONCE])
            for start in range(0, len(directions), _SOURCES_AT_ONCE)
        ]
    )
    found = reading.errors(reading.information(_beside(own, grams[:, :, None])))
    # The best photograph of each source; photographs without samples gain nothing.
    frames = np.argmin(found.criterion(aim), axis=1)
    each = np.arange(len(directions))
    best = Errors(
        {name: values[each, frames] for name, values in found.relative.items()},
        found.log_determinant[each, frames],
    )
    return tuple(
        _suggestion(directions[source], int(frames[source]), best, int(source), aim)
        for source in _ranked(best, aim)[:count]
    )


def _reading(problem: Problem, foreseen: Foreseen, aim: str) -> Reading:
    reading = reading_of(problem, foreseen)
    if aim != "worst" and aim not in reading.names:
        free = ", ".join(dict.fromkeys(("worst", *reading.names)))
        raise ValueError(f"aim={aim!r} is not a free parameter; choose one of {free}")
    if not reading.names:
        raise ValueError("nothing is free: there are no error bars to shrink")
    return reading


def _ranked(errors: Errors, aim: str) -> Float[np.ndarray, "candidate"] | np.ndarray:
    level = np.floor(np.log(np.maximum(errors.criterion(aim), 1e-300)) / _TIE)
    return np.lexsort((-errors.log_determinant, level))


def _suggestion(
    direction: np.ndarray, frame: int | None, errors: Errors, index: int, aim: str
) -> Suggestion:
    own = {name: float(values[index]) for name, values in errors.relative.items()}
    return Suggestion(np.asarray(direction, float), frame, own, float(errors.criterion(aim)[index]))


def _beside(own: np.ndarray, grams: np.ndarray) -> np.ndarray:
    """Put the present photographs before those of each candidate."""
    shape = (*grams.shape[:-4], *own.shape)
    return np.concatenate([np.broadcast_to(own, shape), grams], axis=-4)


def _view_grams(
    foreseen: Foreseen, views: Sequence[View], few: int, wanted: int, cell: float | None
) -> Float[np.ndarray, "view 1 channel column column"]:
    """Foresee the photographs of all candidates in one go: ``few`` samples stand for ``wanted``."""
    thinned = [_thinned(view.samples, few) for view in views]
    joined = SurfaceSamples(*(np.concatenate(arrays) for arrays in zip(*thinned)))
    number = np.repeat(np.arange(len(views)), few)
    light = foreseen.situation.light.of_frame(0)
    together = Situation(joined, number, light)
    grams = frame_grams(foresee(together, foreseen.supposed, len(number), angle_per_sigma=cell))
    return grams[:, None] * (wanted / few)


def _thinned(samples: SurfaceSamples, count: int) -> SurfaceSamples:
    """Draw samples evenly, with repetition where there are fewer."""
    index = np.linspace(0, len(samples.normals) - 1, count).round().astype(int)
    return SurfaceSamples(*(np.asarray(a)[index] for a in samples))


def _source_grams(
    foreseen: Foreseen, directions: Float[np.ndarray, "source 3"]
) -> Float[np.ndarray, "source frame channel column column"]:
    """Foresee every present photograph, taken again with each source lit as well."""
    brdf = foreseen.supposed.brdf
    samples, frame, light = foreseen.situation
    channels = foreseen.model.at.diffuse.shape[1]
    grey = np.full(channels, float(mean_irradiance(light.of_frame(0)).mean()))
    missing = -len(directions) % _SOURCES_AT_ONCE
    padded = np.concatenate([directions, np.tile(directions[:1], (missing, 1))])
    samples = SurfaceSamples(*(jnp.asarray(np.asarray(a, float)) for a in samples))
    sources = LightNodes(jnp.asarray(padded), jnp.asarray(np.tile(grey, (len(padded), 1))))
    source = np.asarray(_source_columns(kind_of(brdf), numbers_of(brdf), samples, sources))
    columns = columns_of(foreseen)[None] + source[: len(directions)]
    amplitudes = np.asarray(brdf.amplitudes).T
    radiance = np.sum(amplitudes * columns[..., : amplitudes.shape[1]], axis=-1)
    weights = np.stack([weights_of(foreseen.supposed.noise, each) for each in radiance])
    return grams_by_frame(columns * weights[..., None], np.asarray(frame))


@eqx.filter_jit
def _source_columns(
    variant: Parametric,
    numbers: dict[str, Float[Array, ""]],
    samples: SurfaceSamples,
    sources: LightNodes,
) -> Float[Array, "source sample channel column"]:
    """Evaluate the columns under each source alone."""

    def one(source: LightNodes) -> Float[Array, "sample channel column"]:
        nodes = (jax.tree.map(lambda part: part[None], source),)
        near = LinearisedModel.about(ExactModel(variant, samples, nodes), numbers)
        return jnp.stack(near.gathered(variant.numbers), axis=-1)

    return jax.lax.map(one, sources)
