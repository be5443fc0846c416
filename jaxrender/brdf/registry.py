"""Every model by the name that configurations and recipes call it."""

import dataclasses
import difflib
from collections.abc import Iterable
from typing import Any

import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.blinn_phong import BlinnPhong
from jaxrender.brdf.cook_torrance import CookTorrance
from jaxrender.brdf.he_torrance import HeTorrance, HeTorranceLobe
from jaxrender.brdf.kajiya_kay import KajiyaKay
from jaxrender.brdf.lafortune import CosineLobe, Lafortune
from jaxrender.brdf.lambertian import Lambertian
from jaxrender.brdf.microfacet import Microfacet
from jaxrender.brdf.mixture import Mixture
from jaxrender.brdf.oren_nayar import OrenNayar, OrenNayarLobe
from jaxrender.brdf.parametric import Parametric
from jaxrender.brdf.phong import Phong
from jaxrender.brdf.poulin_fournier import PoulinFournier
from jaxrender.brdf.torrance_sparrow import TorranceSparrow
from jaxrender.brdf.ward import AnisotropicWard, Ward

BRDFS: dict[str, type[BRDF]] = {
    "lambertian": Lambertian,
    "oren-nayar": OrenNayar,
    "phong": Phong,
    "blinn-phong": BlinnPhong,
    "microfacet": Microfacet,
    "torrance-sparrow": TorranceSparrow,
    "cook-torrance": CookTorrance,
    "he-torrance": HeTorrance,
    "ward": Ward,
    "anisotropic-ward": AnisotropicWard,
    "lafortune": Lafortune,
    "kajiya-kay": KajiyaKay,
    "poulin-fournier": PoulinFournier,
    "mixture": Mixture,
}

# Those that a fit knows by one number for the lobe and perhaps a second; Microfacet has variants
# besides.  Of Lafortune's model one lobe.  Cook and Torrance's has a lobe for each channel, but if
# all have one real index it is Torrance and Sparrow's with other facets; of He and Torrance's that
# of one wavelength; of Oren and Nayar's the shorter one, whose lobe is linear in the albedo.
_OF_ONE_LOBE: dict[str, type[Parametric]] = {
    "cook-torrance": TorranceSparrow,
    "he-torrance": HeTorranceLobe,
    "lafortune": CosineLobe,
    "oren-nayar": OrenNayarLobe,
}
_FACETS = {"cook-torrance": {"distribution": "beckmann"}}
SIMPLE_PARAMETRIC: dict[str, type[Parametric]] = {
    name: model
    for name, model in {**BRDFS, **_OF_ONE_LOBE}.items()
    if issubclass(model, Parametric) and model is not Microfacet
}
# The width that such a model is made with does not matter.
_ANY_WIDTH = 0.1


def simple_parametric_named(name: str, channels: int = 3, **choices: Any) -> Parametric:
    """Make a black model of ``SIMPLE_PARAMETRIC``, to be given amplitudes, width and index.

    ``choices`` are numbers that are not searched for, such as ``c_z`` of lafortune or
    ``deviation`` of he-torrance.
    """
    model, black = SIMPLE_PARAMETRIC[name], np.zeros(channels)
    number = model.shape.of_width(_ANY_WIDTH)
    given: dict[str, Any] = {"kd": black, "ks": black, model.shape.name: number}
    return model(**{**given, **_FACETS.get(name, {}), **choices})


def brdf_named(name: str, **parameters: Any) -> BRDF:
    """Make the model of that name; lists of numbers become arrays.

    Raises ``ValueError`` for a name, or a parameter, that there is none of (with the nearest one
    that there is), for a parameter left out, and whatever the model itself refuses.
    """
    if name not in BRDFS:
        raise ValueError(f"no BRDF is named {name!r}{_hint(name, BRDFS)}")
    model = BRDFS[name]
    fields = {field.name: field for field in dataclasses.fields(model)}
    for parameter in parameters:
        if parameter not in fields:
            raise ValueError(f"{name} has no parameter {parameter!r}{_hint(parameter, fields)}")
    missing = [key for key, field in fields.items() if _required(field) and key not in parameters]
    if missing:
        raise ValueError(f"{name} needs a value for {', '.join(missing)}")
    return model(**{key: _as_array(value) for key, value in parameters.items()})


def _required(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _as_array(value: Any) -> Any:
    return np.asarray(value, float) if isinstance(value, list) else value


def _hint(wrong: str, known: Iterable[str]) -> str:
    """Name the nearest known name, and all of them."""
    near = difflib.get_close_matches(wrong, known, n=1)
    meant = f", did you mean {near[0]!r}?" if near else ";"
    return f"{meant} choose one of {', '.join(known)}"
