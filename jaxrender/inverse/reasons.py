"""Why a parameter is not identifiable, in words: of a fit and of its forecast alike."""

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.inverse.intervals import Uncertain, within_reach


def not_identifiable(name: str, parameters: Uncertain) -> str:
    """Say that a parameter is not identifiable, with its intervals."""
    low, high = (np.ravel(bound.of(name)) for bound in (parameters.lower, parameters.upper))
    each = (f"{a:.3g} to {b:.3g}" if b < np.inf else f"{a:.3g} or more" for a, b in zip(low, high))
    intervals = ", ".join(dict.fromkeys(each))
    return f"{name} is not identifiable: its 90 % interval is {intervals}"


def out_of_reach_by_misfit(name: str, parameters: Uncertain) -> bool:
    """Tell whether a parameter would be identifiable, were the model right."""
    exact = parameters.if_exact
    return exact is not None and within_reach(exact, name)


# Why it is not then.
MOVED = "what is wrong may have moved it so far"


def missing_under_unknown_light(variant: Parametric, name: str) -> str:
    """Say what the photographs show too little of, where the light is unknown as well."""
    if name in variant.amplitude_names:
        return "too little distinguishes the specular part from the diffuse part"
    if not isinstance(variant, Glossy):
        return "these views show too little of the lobe's shape"
    if name == variant.index.name:
        return "too few grazing samples show how the specular part grows towards the horizon"
    return "a blurred light and a sharper lobe look the same as this light and this lobe"
