"""Known light made ready for the dual model: split into slow light and sources (T 6.4.2)."""

import math
from typing import NamedTuple, TypeGuard

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import own_sources
from jaxrender.inverse.observations import Observations
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    LightSplit,
    candidates,
    split_to_energy,
    take,
)
from jaxrender.reflection import (
    DualGoal,
    DualLight,
    SourcesNeeded,
    dual_light,
    sources_needed,
)

# exp(-(sigma l)^2) is below 4e-5 at this multiple of 1 / sigma: no higher degree passes the lobe.
_BAND_LIMIT_TIMES_SIGMA = 3.2
_HIGHEST_BAND_LIMIT = 128
# The dual model's specular column is to be this accurate (relative rms) ...
DUAL_ERROR = 0.007
# ... at no more than this many sources; the rough first pass makes do with fewer.
_MOST_SOURCES = 1024
_ROUGH_SOURCES = 64
_SAMPLES_FOR_SPLIT = 128
# Light that is not split is told to this degree; what it would be split for does not matter.
_SHOWN_BAND_LIMIT, _ANY_WIDTH = 20, 0.5


class PreparedLight(NamedTuple):
    """Light split at one roughness, and how well the dual model does with it.

    ``for_dual`` says whether it was prepared for the dual model, or only to be looked at.
    """

    dual: DualLight
    split: LightSplit | None
    needed: SourcesNeeded | None
    for_dual: bool = True


def by_frequency(variant: Parametric, light: KnownLight) -> TypeGuard[Glossy]:
    """Tell whether the dual model knows a material in a light.

    Its slow light is that of all photographs, and its lobe is about the reflected direction.
    """
    about_mirror = isinstance(variant, Glossy) and variant.has_frequency_view
    return about_mirror and light.environments is None


def prepare_light(
    light: KnownLight,
    observations: Observations,
    brdf: Glossy,
    split: str | float,
    band_limit: int | None,
    *,
    transfer: str = "exit-cosine",
) -> PreparedLight:
    """Split the light at the roughness of ``brdf``, as finely as the dual model needs it.

    ``split`` is ``"auto"``, ``"rough"`` (a first pass: the strongest sources, unchecked), ``"off"``
    or the fraction of the energy to leave in the slow part.  ``transfer`` is how the dual model is
    going to filter that.
    """
    frames = own_sources(light, observations)
    shared = _shared_sources(light)
    if light.environment is None:
        return PreparedLight(dual_light(None, shared, 0, frames), None, None)
    sigma = float(brdf.sigma)
    degrees = band_limit_for(light.environment, sigma) if band_limit is None else band_limit
    degrees = min(degrees, light.environment.grid.band_limit)
    if split == "auto":
        goal = DualGoal(DUAL_ERROR, _MOST_SOURCES, degrees, transfer)
        divided, needed = _divide_as_needed(light.environment, observations.samples, brdf, goal)
    else:
        divided, needed = _divide(light.environment, float(brdf.sigma), split), None
    return PreparedLight(dual_light(divided, shared, degrees, frames), divided, needed)


def undivided(
    light: KnownLight, observations: Observations, band_limit: int | None
) -> PreparedLight:
    """Analyse light as it is, for a fit that the dual model takes no part in.

    Of environments of single photographs the first is taken.
    """
    frames = own_sources(light, observations)
    image = next((one for one in light.environments or (light.environment,) if one), None)
    shared = _shared_sources(light)
    if image is None:
        dual = dual_light(None, shared, 0, frames)
        return PreparedLight(dual, None, None, for_dual=False)
    highest = image.grid.band_limit
    degrees = min(_SHOWN_BAND_LIMIT if band_limit is None else band_limit, highest)
    whole = take(image, candidates(image, _ANY_WIDTH), 0, _ANY_WIDTH)
    dual = dual_light(whole, shared, degrees, frames)
    return PreparedLight(dual, None, None, for_dual=False)


def _shared_sources(light: KnownLight) -> DirectionalSources:
    """List the sources that all samples see in the same directions: none, if they have a place."""
    if light.near is None:
        return light.directional
    return DirectionalSources.none(light.directional.irradiance.shape[1])


def band_limit_for(environment: Environment, sigma: float) -> int:
    """Choose the degree up to which a lobe of roughness ``sigma`` passes the light at all."""
    # Rounded up to a few values, so that few programs are ever compiled.
    wanted = 16 * math.ceil(_BAND_LIMIT_TIMES_SIGMA / sigma / 16)
    return min(wanted, environment.grid.band_limit, _HIGHEST_BAND_LIMIT)


def _divide(environment: Environment, sigma: float, split: str | float) -> LightSplit:
    if isinstance(split, float):
        return split_to_energy(environment, sigma, split)
    sources = {"off": 0, "rough": _ROUGH_SOURCES}
    if split not in sources:
        raise ValueError(f"split={split!r}: choose auto, off, or the energy left in the slow part")
    return take(environment, candidates(environment, sigma), sources[split], sigma)


def _divide_as_needed(
    environment: Environment,
    samples: SurfaceSamples,
    brdf: Glossy,
    goal: DualGoal,
) -> tuple[LightSplit, SourcesNeeded]:
    """Split so that the dual model is as accurate as it is to be."""
    sigma = float(brdf.sigma)
    found = candidates(environment, sigma)
    step = max(1, samples.normals.shape[0] // _SAMPLES_FOR_SPLIT)
    some = SurfaceSamples(samples.normals[::step], samples.outgoing[::step])
    needed = sources_needed(environment, found.sources, brdf.as_metal(), some, goal)
    return take(environment, found, needed.count, sigma), needed
