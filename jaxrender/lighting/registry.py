"""Lights by the names of the catalogue."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from jaxrender.catalogue import LIGHTS, LightKey
from jaxrender.lighting.base import Light


def light_of(name: str, entries: Sequence[Mapping[str, Any]]) -> Light:
    """Make the light of a section of a config: one entry, or a list of them where there are many.

    Raises ``KeyError`` for a name that there is none of or a key that is left out, and
    ``ValueError`` for what the class refuses.
    """
    kind = LIGHTS[name]
    module, class_name = kind.home.split(".")
    make = getattr(import_module(f"jaxrender.lighting.{module}"), class_name)
    arguments = {}
    for key in kind.keys:
        values = [_argument(key, entry[key.name]) for entry in entries]
        arguments[key.argument] = np.array(values) if kind.many else values[0]
    return make(**arguments)


def _argument(key: LightKey, value: Any) -> Any:
    """Turn what a config states into what a class takes."""
    if key.kind == "word":
        return value
    return np.radians(value) if key.kind == "angle" else np.array(value, float)
