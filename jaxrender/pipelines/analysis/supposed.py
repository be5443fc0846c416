"""The material and noise that a forecast supposes, and the origin of each number."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import material_named
from jaxrender.catalogue import MODELS, Model
from jaxrender.errors import InputError
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.forecast import TYPICAL_NOISE, Supposed
from jaxrender.pipelines.config import RecipeConfig, RunConfig
from jaxrender.pipelines.scene import fault_of


class Supposition(NamedTuple):
    """Material and noise, and their origins in words."""

    supposed: Supposed
    source: str


def supposition_of(
    config: RunConfig, recipe: RecipeConfig | None, given: Sequence[str], noise: float | None
) -> Supposition:
    """Take each number from the command line, the config, the recipe, or what is typical.

    ``given`` are ``name=value``, or ``name=red,green,blue`` for kd and ks.  Raises ``InputError``
    for other texts, and for values that no material has.
    """
    model = MODELS[config.brdf.model]
    if not model.is_stated:
        raise InputError(
            f"brdf.model: {model.name}: its lobes are found from photographs, and nobody can "
            "suppose them beforehand; choose a model whose numbers tell the whole material"
        )
    supposed = dict(_pair(model, text) for text in given)
    own = model.names("amplitude", "searched")
    values, sources = {}, {}
    for name in own:
        values[name], sources[name] = _one(name, config, recipe, supposed)
    first = model.names("amplitude")[0]
    values[first] = np.broadcast_to(values[first], (3,))
    with fault_of("--suppose" if supposed else "brdf"):
        brdf = material_named(model.name, {**config.brdf.chosen(), **values})
    if sources.get("ks") == "typical":
        # The typical value is an albedo, whatever ks means in the model.
        own = zip(brdf.amplitude_names, np.asarray(brdf.amplitudes))
        energies = {"ks": float(brdf.energy)}
        brdf = brdf.with_amplitudes(*(value / energies.get(name, 1.0) for name, value in own))
    noise_model, of_noise = _noise(config, recipe, noise)
    words: dict[str, list[str]] = {}
    for name, source in {**sources, "noise": of_noise}.items():
        words.setdefault(source, []).append(name)
    source = "; ".join(f"{', '.join(names)} {source}" for source, names in words.items())
    return Supposition(Supposed(brdf, noise_model), source)


def _one(
    name: str, config: RunConfig, recipe: RecipeConfig | None, supposed: Mapping[str, Any]
) -> tuple[Any, str]:
    """Find one number, and its origin in words."""
    model, known = MODELS[config.brdf.model], config.brdf.known(name)
    if name in supposed:
        return supposed[name], "as supposed"
    if known is None:
        return "none", "from the config"
    value, source = known.fixed if known.fixed is not None else known.start, "from the config"
    if value is None and recipe is not None:
        truth = MODELS[recipe.brdf.model].names("amplitude", "searched")
        value, source = recipe.brdf.number(name) if name in truth else None, "from the recipe"
    if value is None:
        value, source = model.number(name).typical, "typical"
    if value == "none" or model.number(name).part == "amplitude":
        return value, source
    return float(np.mean(value)), source


def _noise(
    config: RunConfig, recipe: RecipeConfig | None, noise: float | None
) -> tuple[NoiseModel, str]:
    if noise is not None:
        if not (noise > 0 and math.isfinite(noise)):
            raise InputError(f"--noise {noise:g}: give a relative noise above 0, such as 0.01")
        return NoiseModel(float(noise), 0.0), "as given"
    if config.solve.noise != "estimate":
        own = config.solve.noise
        return NoiseModel(float(own.relative), float(own.floor)), "from the config"
    if recipe is not None and (recipe.noise.relative > 0 or recipe.noise.floor > 0):
        return NoiseModel(
            float(recipe.noise.relative), float(recipe.noise.floor)
        ), "from the recipe"
    return TYPICAL_NOISE, "typical"


def _pair(model: Model, text: str) -> tuple[str, np.ndarray | float | str]:
    """Read one number of a model."""
    name, _, rest = (part.strip() for part in text.partition("="))
    place, own = f"--suppose {text}", model.names("amplitude", "searched")
    if name not in own:
        known = ", ".join(own)
        raise InputError(f"{place}: {model.name} has {known}, as in --suppose {own[0]}=0.1")
    number = model.number(name)
    if number.may_be_none and rest == "none":
        return name, rest
    try:
        values = [float(part) for part in rest.split(",")]
    except ValueError:
        raise InputError(f"{place}: {rest!r} is no number; write {name}=0.2") from None
    most = 3 if number.part == "amplitude" else 1
    if len(values) not in (1, most) or not all(map(number.domain.holds, values)):
        count = "1 or 3 numbers" if most == 3 else "1 number"
        raise InputError(f"{place}: give {count} {number.domain.words}")
    return name, np.array(values) if most == 3 else values[0]
