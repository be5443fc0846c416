"""What a config may name, as plain data: models of materials and kinds of light.

``model``
    what a model and each of its numbers are
``models`` ``layers``
    every model that a fit knows by name; those of renderers
``lights``
    every kind of light that numbers can state, and what they are
``interval``
    where a number may lie
"""

from jaxrender.catalogue.interval import Interval
from jaxrender.catalogue.lights import LIGHTS, LightKey, LightKind
from jaxrender.catalogue.model import Model, Number
from jaxrender.catalogue.models import (
    AMPLITUDES,
    MODELS,
    NAMES,
    STATED,
    described,
    numbers_named,
)

__all__ = [
    "AMPLITUDES",
    "LIGHTS",
    "MODELS",
    "NAMES",
    "STATED",
    "Interval",
    "LightKey",
    "LightKind",
    "Model",
    "Number",
    "described",
    "numbers_named",
]
