"""What a forecast supposes of material and noise, and where each number is from."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import SIMPLE_GLOSSY, Microfacet
from jaxrender.errors import InputError
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.forecast import TYPICAL_MATERIAL, TYPICAL_NOISE, Supposed
from jaxrender.pipelines.config import RecipeConfig, RunConfig
from jaxrender.pipelines.config.brdf import GLOSSY, distribution_of
from jaxrender.pipelines.scene import fault_of

_NAMES = ("kd", "ks", "sigma", "mu")


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
    if config.brdf.model in SIMPLE_GLOSSY:
        raise InputError(
            f"brdf.model: a forecast supposes a microfacet; found {config.brdf.model}, choose "
            f"{GLOSSY}"
        )
    told = dict(_pair(text) for text in given)
    values, sources = {}, {}
    for name in _NAMES:
        values[name], sources[name] = _one(name, config, recipe, told)
    if config.brdf.model == "lambertian":
        values |= {"ks": np.zeros(3), "mu": None}
        sources = {"kd": sources["kd"]}
    with fault_of("--suppose" if told else "brdf"):
        brdf = Microfacet(
            np.broadcast_to(np.asarray(values["kd"], float), (3,)).copy(),
            np.broadcast_to(np.asarray(values["ks"], float), (3,)).copy(),
            float(np.mean(np.asarray(values["sigma"], float))),
            values["mu"],
            config.brdf.fresnel,
            config.brdf.masking,
            distribution_of(config.brdf.model),
        )
    model, of_noise = _noise(config, recipe, noise)
    words: dict[str, list[str]] = {}
    for name, source in {**sources, "noise": of_noise}.items():
        words.setdefault(source, []).append(name)
    source = "; ".join(f"{', '.join(names)} {source}" for source, names in words.items())
    return Supposition(Supposed(brdf, model), source)


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
    if recipe is not None:
        value = getattr(recipe.brdf, name)
        if value == "none":
            return None, "from the recipe"
        return value if name in ("kd", "ks") else float(value), "from the recipe"
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
        raise InputError(f"{place}: suppose kd, ks, sigma or mu, as in --suppose sigma=0.1")
    if name == "mu" and rest == "none":
        return name, None
    try:
        values = [float(part) for part in rest.split(",")]
    except ValueError:
        raise InputError(f"{place}: {rest!r} is no number; write {name}=0.2") from None
    most = 3 if name in ("kd", "ks") else 1
    low = {"sigma": 0.0, "mu": 1.0}.get(name, -1e-300)
    if len(values) not in (1, most) or not all(low < v < math.inf for v in values):
        above = f"above {low:g}" if name in ("sigma", "mu") else "at least 0"
        raise InputError(f"{place}: give 1{' or 3 numbers' if most == 3 else ' number'} {above}")
    return name, np.array(values) if most == 3 else values[0]
