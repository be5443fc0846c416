"""A capture before its photographs: what its cameras will see, what lights it, what to suppose.

The photographs that a supposed material would give are computed by the exact integral together with
their derivatives; weighed by the noise to be expected they are all that a forecast needs.
"""

from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet, Parametric
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.elimination import Data, Problem
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.leverage import draw, leverage
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import Columns, ExactModel, LinearisedModel
from jaxrender.inverse.observations import Observations, stratified_subset
from jaxrender.inverse.stated import Unknown
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.inverse.weights import deviations
from jaxrender.lighting import LightNodes
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import AnyArray, Array, Float, Int

# What is supposed of a material that nothing is known of: a glossy plastic, photographed well.
TYPICAL_MATERIAL = Microfacet(np.full(3, 0.2), np.full(3, 0.1), 0.1, 1.5)
TYPICAL_NOISE = NoiseModel(0.01, 0.0)
# Choosing samples by brightness needs no finer light than this.
_COARSE = 0.5

Kind = TypeVar("Kind", bound=Parametric)


class Situation(NamedTuple):
    """What the cameras of each photograph see of the object, and the light it is in.

    Sources that have a place are taken as the object's centre sees them.
    """

    samples: SurfaceSamples
    frame: Int[np.ndarray, "sample"]
    light: KnownLight


class Supposed(NamedTuple):
    """The material and the noise that a forecast is made for."""

    brdf: Parametric = TYPICAL_MATERIAL
    noise: NoiseModel = TYPICAL_NOISE


TYPICAL = Supposed()


class Foreseen(NamedTuple):
    """Photographs that a supposed material would give, to first order in its parameters.

    ``data`` holds their radiance without noise, weighed by the noise.  ``shares`` tell how many
    pixels each sample stands for, relative to their mean, which its weight has in it.
    """

    situation: Situation
    supposed: Supposed
    model: LinearisedModel
    data: Data
    shares: Float[np.ndarray, "sample"] | None = None


class SearchPoint(NamedTuple):
    """A supposed material as a search has it: its variables, and the unknowns eliminated."""

    point: Float[np.ndarray, "unknown"]
    eliminated: Float[np.ndarray, "linear"]


class Thinned(NamedTuple):
    """A part of a situation's samples, and how many samples each of them stands for."""

    situation: Situation
    each: float


def foresee(
    situation: Situation,
    supposed: Supposed = TYPICAL,
    count: int = 2000,
    seed: int = 0,
    angle_per_sigma: float | None = None,
) -> Foreseen:
    """Predict the photographs at ``count`` samples, spread over exit cosines and brightness.

    ``angle_per_sigma`` condenses the light to cells of that many sigma.
    """
    situation = _spread(situation, supposed, count, seed)
    return foreseen_of(situation, supposed, _linearised(situation, supposed, angle_per_sigma))


def foresee_draw(
    situation: Situation,
    supposed: Supposed = TYPICAL,
    count: int = 2000,
    seed: int = 0,
    angle_per_sigma: float | None = None,
) -> Foreseen:
    """Predict the photographs at ``count`` samples, drawn as the refinement of a fit draws them.

    Samples of high leverage are drawn often, and stand for few pixels.
    """
    samples, frame, light = situation
    blank = np.zeros((len(frame), supposed.brdf.amplitudes.shape[1]))
    every = Observations(samples, blank, frame)
    some, index = draw(every, leverage(every, light), count, seed)
    drawn = Situation(some.samples, frame[index], light)
    near = _linearised(drawn, supposed, angle_per_sigma)
    return foreseen_of(drawn, supposed, near, some.shares)


def _linearised(
    situation: Situation, supposed: Supposed, angle_per_sigma: float | None
) -> LinearisedModel:
    """Linearise the integral about the supposed material."""
    brdf = supposed.brdf
    nodes = _nodes(situation, float(brdf.width), angle_per_sigma)
    model = ExactModel(kind_of(brdf), situation.samples, nodes)
    return LinearisedModel.about(model, numbers_of(brdf))


def _nodes(
    situation: Situation, width: float, angle_per_sigma: float | None
) -> tuple[LightNodes | FrameNodes, ...]:
    """List the light's point masses, sources as the object's centre sees them."""
    blank = np.zeros((len(situation.frame), 0))
    seen = Observations(situation.samples, blank, situation.frame)
    return exact_nodes(situation.light.far, seen, width, angle_per_sigma)


def kind_of(brdf: Kind) -> Kind:
    """The kind of a material, without its numbers: one compiled program serves all of a kind."""
    mu = None if brdf.mu is None else 1.5
    return brdf.with_roughness(0.1, mu).with_amplitudes(*np.zeros(brdf.amplitudes.shape))


def numbers_of(brdf: Parametric) -> dict[str, Float[Array, ""]]:
    """The numbers of a material's lobe, as arrays: they may differ without another compilation."""
    return {name: jnp.asarray(float(value)) for name, value in brdf.numbers.items()}


def foreseen_of(
    situation: Situation,
    supposed: Supposed,
    near: LinearisedModel,
    shares: Float[np.ndarray, "sample"] | None = None,
) -> Foreseen:
    """Weigh what a model predicts by the noise to be expected, and by the samples' shares."""
    radiance = near.at.times_on_host(_amplitudes(supposed.brdf))
    weights = weights_of(supposed.noise, radiance)
    if shares is not None:
        weights = weights * np.sqrt(shares)[:, None]
    return Foreseen(situation, supposed, near, Data(radiance, weights, situation.frame), shares)


def weights_of(
    noise: NoiseModel, radiance: Float[np.ndarray, "*any channel"]
) -> Float[np.ndarray, "*any channel"]:
    """Compute 1 / standard deviation of the noise, as a fit weighs its samples."""
    scale = float(np.sqrt(np.mean(radiance**2)))
    return 1 / np.maximum(deviations(noise, radiance, scale), np.finfo(float).tiny)


def unknowns_at(problem: Problem, brdf: Parametric) -> SearchPoint:
    """Find the search point and the eliminated unknowns of a supposed material.

    Raises ``ValueError`` where it lies outside the bounds of the search.
    """
    unknowns = problem.unknowns
    for name in unknowns.free_numbers:
        unknown, value = unknowns[name], getattr(brdf, name)
        if value is None or not unknown.lower <= float(value) <= unknown.upper:
            raise ValueError(
                f"the supposed {name} is {value}, but it is looked for between {unknown.lower:g} "
                f"and {unknown.upper:g}: suppose a value in between, or widen its bounds"
            )
    point = unknowns.pack({name: float(value) for name, value in brdf.numbers.items()})
    every = np.ravel(np.asarray(brdf.amplitudes, float))
    mix = np.asarray(problem.mix)
    eliminated = np.linalg.lstsq(mix, every - np.asarray(problem.offset), rcond=None)[0]
    return SearchPoint(point, eliminated)


def problem_of(unknowns: Unknowns, brdf: Parametric) -> Problem:
    """Lay out the unknowns of a supposed material, fixed ones at what is supposed of them."""

    def held(unknown: Unknown, value: Any) -> Unknown:
        return (
            unknown
            if unknown.free
            else Unknown(fixed=tuple(np.ravel(np.asarray(value, float)).tolist()))
        )

    searched = [
        (one, held(unknown, getattr(brdf, one.name)))
        for one, unknown in zip(unknowns.searched, unknowns.numbers)
        if getattr(brdf, one.name) is not None
    ]
    known = replace(
        unknowns,
        amplitudes=tuple(map(held, unknowns.amplitudes, np.asarray(brdf.amplitudes))),
        numbers=tuple(unknown for _, unknown in searched),
        searched=tuple(one for one, _ in searched),
    )
    return Problem.of(known, brdf.amplitudes.shape[1])


def thinned(situation: Situation, most: int) -> Thinned:
    """Keep at most ``most`` samples, evenly spread."""
    count = len(situation.frame)
    if count <= most:
        return Thinned(situation, 1.0)
    index = np.linspace(0, count - 1, most).round().astype(int)
    samples = SurfaceSamples(*(np.asarray(a)[index] for a in situation.samples))
    some = Situation(samples, situation.frame[index], situation.light)
    return Thinned(some, count / most)


def radiance_of(situation: Situation, supposed: Supposed) -> Float[np.ndarray, "sample channel"]:
    """Predict radiance alone, well enough to weigh and to choose samples by."""
    brdf = supposed.brdf
    nodes = _nodes(situation, float(brdf.width), _COARSE)
    model = ExactModel(kind_of(brdf), situation.samples, nodes)
    columns = _columns(model, numbers_of(brdf))
    return columns.times_on_host(_amplitudes(brdf))


def _amplitudes(brdf: Parametric) -> list[Float[AnyArray, "channel"]]:
    return [getattr(brdf, name) for name in brdf.amplitude_names]


@eqx.filter_jit
def _columns(model: ExactModel, numbers: dict[str, Float[Array, ""]]) -> Columns:
    return model.columns(numbers)


def _spread(situation: Situation, supposed: Supposed, count: int, seed: int) -> Situation:
    samples, frame, light = situation
    if len(frame) <= count:
        return situation
    radiance = radiance_of(situation, supposed)
    some, _ = stratified_subset(Observations(samples, radiance, frame), radiance, count, seed)
    return Situation(some.samples, np.asarray(some.frame), light)
