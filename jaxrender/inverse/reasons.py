"""Why a parameter is not identifiable, in words: of a fit and of its forecast alike."""

from collections.abc import Iterable

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.inverse.intervals import NORMAL_90, Uncertain, within_reach

# From this correlation on, one unknown makes up for most of an error of another.
_MAKES_UP = 0.9


def not_identifiable(name: str, parameters: Uncertain) -> str:
    """Say that a parameter is not identifiable, with its intervals."""
    low, high = (np.ravel(bound.of(name)) for bound in (parameters.lower, parameters.upper))
    each = (f"{a:.3g} to {b:.3g}" if b < np.inf else f"{a:.3g} or more" for a, b in zip(low, high))
    intervals = ", ".join(dict.fromkeys(each))
    return f"{name} is not identifiable: its 90 % interval is {intervals}"


def made_up_for(name: str, names: Iterable[str], parameters: Uncertain) -> str:
    """Say which one of ``names`` makes up for a wrong value of a parameter; "" if none does.

    Of two amplitudes it is also said how well their sum is known.
    """
    if parameters.covariance is None:
        return ""
    labels, names = parameters.value.labels, set(names)
    each = [label.partition("[")[0] for label in labels]
    error = np.sqrt(np.maximum(np.diag(parameters.covariance), 0))
    own = [k for k, of in enumerate(each) if of == name and error[k] > 0]
    others = [k for k, of in enumerate(each) if of in names - {name} and error[k] > 0]
    if not own or not others:
        return ""
    pairs = parameters.covariance[np.ix_(own, others)] / np.outer(error[own], error[others])
    row, column = np.unravel_index(np.argmax(np.abs(pairs)), pairs.shape)
    correlation = float(pairs[row, column])
    if abs(correlation) < _MAKES_UP:
        return ""
    first, second = own[row], others[column]
    found = f"{each[second]} makes up for it (correlation {correlation:.2f})"
    amplitudes = parameters.value.amplitudes
    if not {name, each[second]} <= amplitudes.keys():
        return found
    total = sum(float(np.ravel(amplitudes[each[k]])[_channel(labels[k])]) for k in (first, second))
    pair = np.ix_([first, second], [first, second])
    reach = NORMAL_90 * np.sqrt(max(float(np.sum(parameters.covariance[pair])), 0))
    return f"{found}; their sum is {total:.3g}, within {reach:.2g} at 90 %"


def _channel(label: str) -> int:
    return int(label.partition("[")[2].rstrip("]"))


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
