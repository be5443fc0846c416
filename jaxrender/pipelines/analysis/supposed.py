"""What a forecast supposes of material and noise, and where each number is from."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import SIMPLE_PARAMETRIC, Glossy, Microfacet, Parametric
from jaxrender.errors import InputError
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.forecast import TYPICAL_MATERIAL, TYPICAL_NOISE, Supposed
from jaxrender.pipelines.config import RecipeConfig, RunConfig
from jaxrender.pipelines.config.brdf import chosen_numbers_of, distribution_of, numbers_of
from jaxrender.pipelines.scene import fault_of, simple_material

_NAMES = ("kd", "ks", "sigma", "mu", "roughness", "roughness_y", "exponent")

# What is typical of grooves (radians), and of the rougher direction of brushed metal.
_TYPICAL = {"sigma": 0.35, "roughness_y": 0.25}


class Supposition(NamedTuple):
    """Material and noise, and in words where they are from."""

    supposed: Supposed
    source: str


def supposition_of(
    config: RunConfig, recipe: RecipeConfig | None, given: Sequence[str], noise: float | None
) -> Supposition:
    """Take each number from the command line, the config, the recipe, or what is typical.

    ``given`` are ``name=value`` or, of kd and ks, ``name=red,green,blue``.  Raises ``InputError``
    for what is no such pair, and for values that no material has.
    """
    told = dict(_pair(text) for text in given)
    own = _own_numbers(config)
    for name in told:
        if name not in own:
            raise InputError(f"--suppose {name}: {config.brdf.model} has {', '.join(own)}")
    values, sources = {}, {}
    for name in own:
        values[name], sources[name] = _one(name, config, recipe, told)
    if config.brdf.model == "lambertian":
        values |= {"ks": np.zeros(3), "mu": None}
        sources = {"kd": sources["kd"]}
    with fault_of("--suppose" if told else "brdf"):
        brdf = _material(config, values)
    if sources.get("ks") == "typical":
        # An albedo, whatever the model's ks means.
        brdf = brdf.with_amplitudes(brdf.kd, np.asarray(brdf.ks) / float(brdf.energy))
    model, of_noise = _noise(config, recipe, noise)
    words: dict[str, list[str]] = {}
    for name, source in {**sources, "noise": of_noise}.items():
        words.setdefault(source, []).append(name)
    source = "; ".join(f"{', '.join(names)} {source}" for source, names in words.items())
    return Supposition(Supposed(brdf, model), source)


def _own_numbers(config: RunConfig) -> tuple[str, ...]:
    """List what makes up a material of the config's model; one without gloss has a lobe of none."""
    model = config.brdf.model
    return ("kd", *numbers_of("microfacet" if model == "lambertian" else model))


def _material(config: RunConfig, values: dict) -> Parametric:
    kd, ks = (
        np.broadcast_to(np.asarray(values.get(name, 0), float), (3,)).copy()
        for name in ("kd", "ks")
    )
    if config.brdf.model in SIMPLE_PARAMETRIC:
        chosen = {name: getattr(config.brdf, name) for name in chosen_numbers_of(config.brdf.model)}
        return simple_material(config.brdf.model, {**values, **chosen, "kd": kd, "ks": ks})
    choices = config.brdf.fresnel, config.brdf.masking, distribution_of(config.brdf.model)
    sigma = float(np.mean(np.asarray(values["sigma"], float)))
    return Microfacet(kd, ks, sigma, values["mu"], *choices)


def _one(name: str, config: RunConfig, recipe: RecipeConfig | None, told: dict):
    if name in told:
        return told[name], "as told"
    parameter = getattr(config.brdf, name)
    if parameter == "none":
        return None, "from the config"
    value = parameter.fixed if parameter.fixed is not None else parameter.start
    if value is not None:
        value = np.asarray(value, float)
        return value if name in ("kd", "ks") else float(value.mean()), "from the config"
    if recipe is not None and name in ("kd", *numbers_of(recipe.brdf.model)):
        value = getattr(recipe.brdf, name)
        if value == "none":
            return None, "from the recipe"
        return value if name in ("kd", "ks") else float(value), "from the recipe"
    model = SIMPLE_PARAMETRIC.get(config.brdf.model, Microfacet)
    shape = model.shape
    if name in _TYPICAL and not issubclass(model, Glossy):
        return _TYPICAL[name], "typical"
    if name == shape.name:
        return float(shape.of_width(TYPICAL_MATERIAL.sigma)), "typical"
    typical = getattr(TYPICAL_MATERIAL, name)
    return typical if name in ("kd", "ks") else float(typical), "typical"


def _noise(
    config: RunConfig, recipe: RecipeConfig | None, noise: float | None
) -> tuple[NoiseModel, str]:
    if noise is not None:
        if not (noise > 0 and math.isfinite(noise)):
            raise InputError(f"--noise {noise:g}: give a relative noise above 0, such as 0.01")
        return NoiseModel(float(noise), 0.0), "as told"
    if config.solve.noise != "estimate":
        own = config.solve.noise
        return NoiseModel(float(own.relative), float(own.floor)), "from the config"
    if recipe is not None and (recipe.noise.relative > 0 or recipe.noise.floor > 0):
        return NoiseModel(
            float(recipe.noise.relative), float(recipe.noise.floor)
        ), "from the recipe"
    return TYPICAL_NOISE, "typical"


def _pair(text: str) -> tuple[str, np.ndarray | float | None]:
    name, _, rest = (part.strip() for part in text.partition("="))
    place = f"--suppose {text}"
    if name not in _NAMES:
        raise InputError(
            f"{place}: suppose {', '.join(_NAMES[:-1])} or {_NAMES[-1]}, as in --suppose sigma=0.1"
        )
    if name == "mu" and rest == "none":
        return name, None
    try:
        values = [float(part) for part in rest.split(",")]
    except ValueError:
        raise InputError(f"{place}: {rest!r} is no number; write {name}=0.2") from None
    most = 3 if name in ("kd", "ks") else 1
    low = {"mu": 1.0, "kd": -1e-300, "ks": -1e-300}.get(name, 0.0)
    if len(values) not in (1, most) or not all(low < v < math.inf for v in values):
        above = f"above {low:g}" if low >= 0 else "at least 0"
        raise InputError(f"{place}: give 1{' or 3 numbers' if most == 3 else ' number'} {above}")
    return name, np.array(values) if most == 3 else values[0]
