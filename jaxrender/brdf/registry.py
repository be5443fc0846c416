"""Every model by the name that configurations, recipes and command lines call it.

Those of the catalogue are what a fit can recover.  Beside them stand the general forms of four of
them, which have more numbers than a fit can tell, Lambert's, and sums of models.  A bank, whose
lobes nobody names by hand, is made of a list of them.
"""

import dataclasses
import difflib
import importlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from jaxrender.brdf.bank import Bank
from jaxrender.brdf.base import BRDF
from jaxrender.brdf.cook_torrance import CookTorrance
from jaxrender.brdf.he_torrance import HeTorrance
from jaxrender.brdf.lafortune import Lafortune
from jaxrender.brdf.microfacet import Microfacet
from jaxrender.brdf.mixture import Mixture
from jaxrender.brdf.oren_nayar import OrenNayar
from jaxrender.brdf.parametric import Parametric
from jaxrender.catalogue import MODELS, STATED, Model


def _class_of(model: Model) -> type[BRDF]:
    module, _, name = model.home.rpartition(".")
    return getattr(importlib.import_module(f"jaxrender.brdf.{module}"), name)


BRDFS: dict[str, type[BRDF]] = {
    **{name: _class_of(MODELS[name]) for name in STATED},
    # A complex index for each channel; several lobes; the longer series, of light reflected twice.
    "cook-torrance-conductor": CookTorrance,
    "he-torrance-conductor": HeTorrance,
    "lafortune-lobes": Lafortune,
    "oren-nayar-full": OrenNayar,
    "mixture": Mixture,
}
# Those that a fit can recover.
PARAMETRIC: dict[str, type[Parametric]] = {
    name: kind
    for name, kind in ((name, _class_of(model)) for name, model in MODELS.items())
    if issubclass(kind, Parametric)
}
# The width that a lobe is made with where it does not matter, and its index.
_ANY_WIDTH, _ANY_INDEX = 0.1, 1.5


def brdf_named(name: str, **numbers: Any) -> BRDF:
    """Make the model of that name of its own numbers; lists of numbers become arrays.

    Raises ``ValueError`` for a name, or a number, that there is none of (with the nearest one that
    there is), for a number left out, and whatever the model itself refuses.
    """
    if name not in BRDFS:
        raise ValueError(f"no BRDF is named {name!r}{_hint(name, BRDFS)}")
    kind, model = BRDFS[name], MODELS.get(name)
    fixed, options = ({}, {}) if model is None else (dict(model.fixed), dict(model.options))
    fields = {field.name: field for field in dataclasses.fields(kind) if field.name not in fixed}
    for number in numbers:
        if number not in fields:
            raise ValueError(f"{name} has no parameter {number!r}{_hint(number, fields)}")
    given = {**options, **{number: _as_array(value) for number, value in numbers.items()}}
    missing = [key for key, field in fields.items() if _required(field) and key not in given]
    if missing:
        raise ValueError(f"{name} needs a value for {', '.join(missing)}")
    return kind(**given, **fixed)


def lobe_named(name: str, channels: int = 3, *, metal: bool = False, **choices: Any) -> Parametric:
    """Make a black model that a fit gives amplitudes and numbers; these do not matter yet.

    ``metal`` leaves out the index where there may be none.  ``choices`` are what no fit looks for,
    such as ``masking``, ``c_z`` of lafortune or ``deviation`` of he-torrance.  Lambert's is a lobe
    to be left black.

    Raises ``ValueError`` for a name that there is none of.
    """
    kind, model = _parametric(name)
    if kind is Bank:
        return Bank.black(channels)
    numbers: dict[str, float | None] = {
        number.name: number.typical if number.settled is None else number.settled
        for number in model.numbers
        if number.part == "searched"
    }
    numbers[kind.shape.name] = kind.shape.of_width(_ANY_WIDTH)
    if kind.has_index():
        without = metal or not model.has_specular
        numbers[kind.index.name] = None if without else kind.index.of_index(_ANY_INDEX)
    black = dict.fromkeys(kind.amplitude_names, np.zeros(channels))
    return kind(**black, **numbers, **{**model.options, **choices}, **model.fixed)


def material_named(name: str, numbers: Mapping[str, Any]) -> Parametric:
    """Make a material of its own numbers as recipes and results state them.

    The first amplitude has a value for each channel; one number of another serves them all.  An
    index ``"none"`` is that of a metal.  What else stands beside the model's own numbers is left
    alone.

    Raises ``ValueError`` for a name that there is none of and for what the model refuses, and
    ``KeyError`` for a number that is left out.
    """
    kind, model = _parametric(name)
    if kind is Bank:
        return Bank.of_lobes(numbers["lobes"])
    stated, numbers = model.names("amplitude"), {**model.settled, **numbers}
    shape = np.shape(numbers[stated[0]])
    amounts = [
        np.broadcast_to(np.asarray(numbers[own] if own in stated else 0.0, float), shape)
        for own in kind.amplitude_names
    ]
    lobe = lobe_named(name, shape[0])
    if name == "lambertian":
        return lobe.with_amplitudes(*amounts)
    searched = {key: _or_none(numbers[key]) for key in model.names("searched", "stated")}
    chosen = {key: numbers[key] for key in model.options if key in numbers}
    return dataclasses.replace(lobe.with_amplitudes(*amounts), **searched, **chosen)


def _parametric(name: str) -> tuple[type[Parametric], Model]:
    """Find the class that a fit knows a model by; Lambert's is a microfacet without a lobe."""
    if name == "lambertian":
        return Microfacet, MODELS[name]
    if name not in PARAMETRIC:
        raise ValueError(f"no model to fit is named {name!r}{_hint(name, MODELS)}")
    return PARAMETRIC[name], MODELS[name]


def _or_none(value: Any) -> float | None:
    return None if value is None or value == "none" else float(value)


def _required(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _as_array(value: Any) -> Any:
    return np.asarray(value, float) if isinstance(value, list) else value


def _hint(wrong: str, known: Iterable[str]) -> str:
    """Name the nearest known name, and all of them."""
    known = list(known)
    near = difflib.get_close_matches(wrong, known, n=1)
    meant = f", did you mean {near[0]!r}?" if near else ";"
    return f"{meant} choose one of {', '.join(known)}"
