"""A material to be found: its model, and what is stated of its numbers."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import Parametric, lobe_named
from jaxrender.catalogue import MODELS, Number
from jaxrender.inverse.stated import Stated
from jaxrender.inverse.unknowns import Unknowns, unknowns_of

_CHANNELS = 3


class UnknownMaterial(NamedTuple):
    """A material to be found: its model, and what is stated of its numbers.

    ``model`` is a name of the catalogue, or "" of a model of one's own.  ``table`` asks for a
    table that corrects the model.
    """

    model: str
    lobe: Parametric
    stated: Mapping[str, Stated]
    ks_per_channel: bool = False
    table: bool = False

    def unknowns(self, free_gains: int = 0, free_scale: bool = False) -> Unknowns:
        """Put this in the words of a search.  Raises ``ValueError`` as ``unknowns_of`` does."""
        return unknowns_of(
            self.lobe,
            self.stated,
            diffuse=self.model == "lambertian",
            ks_per_channel=self.ks_per_channel,
            free_gains=free_gains,
            free_scale=free_scale,
        )


def unknown(
    model: str | Parametric, *, ks_per_channel: bool = False, table: bool = False, **numbers: Any
) -> UnknownMaterial:
    """Say what you know of a material, by the numbers of its model; what is left out is free.

    Each of ``numbers`` is a value (one, or one for each of three channels), a pair of bounds,
    ``Stated`` with a start or a prior besides, or None for an index that a metal has none of.
    What a model states or chooses (``c_z``, ``masking``) is a value.  ``model`` is a name, or a
    material of a model of one's own, whose numbers do not matter.  ``table=True`` corrects what is
    found by a table over half and difference angles.

    Raises ``ValueError`` for a model, a number or a choice that there is none of.
    """
    if isinstance(model, Parametric):
        material = UnknownMaterial("", model, _stated(numbers), ks_per_channel, table)
    else:
        entry = MODELS.get(model)
        chosen = () if entry is None else (*entry.options, *entry.names("stated"))
        choices = {name: numbers.pop(name) for name in chosen if name in numbers}
        without = [name for name, value in numbers.items() if value is None]
        lobe = lobe_named(model, metal=bool(without), **choices)
        for name in without:
            if not (lobe.has_index() and lobe.index.name == name):
                raise ValueError(f"{name}=None: only an index may be left out, by a metal")
            del numbers[name]
        stated = _stated(numbers)
        for number in MODELS[model].numbers:
            if number.name in stated:
                _check_domain(number, stated[number.name])
        material = UnknownMaterial(model, lobe, stated, ks_per_channel, table)
    for name, one in material.stated.items():
        linear = name in material.lobe.amplitude_names
        if linear and one.start is not None:
            raise ValueError(f"{name} is solved for outright, from no start; leave it out")
        several = linear and (name in material.lobe.coloured or ks_per_channel)
        if isinstance(one.fixed, tuple) and len(one.fixed) > 1 and not several:
            hint = ", or ks_per_channel=True" if linear else ""
            raise ValueError(f"{name} is one number for all channels; give one{hint}")
    material.unknowns()
    return material


def _check_domain(number: Number, stated: Stated) -> None:
    """Refuse what lies outside the interval of a model's number."""
    mean = None if stated.prior is None else stated.prior.mean
    given = (stated.fixed, stated.start, mean, *(stated.bounds or ()))
    for value in (float(v) for part in given if part is not None for v in np.atleast_1d(part)):
        if not number.domain.holds(value):
            raise ValueError(f"{number.name}={value:g}: it must be {number.domain.words}")


def _stated(numbers: Mapping[str, Any]) -> dict[str, Stated]:
    """Read what is stated of each number."""
    found = {}
    for name, value in numbers.items():
        if isinstance(value, Stated):
            found[name] = value
            continue
        values = tuple(float(part) for part in np.atleast_1d(np.asarray(value, float)))
        if len(values) not in (1, 2, _CHANNELS):
            raise ValueError(f"{name} has {len(values)} values; give one, two bounds, or three")
        if len(values) == 2:
            low, high = values
            if not low < high:
                raise ValueError(f"{name} has the bounds {values}; the first must be the smaller")
            found[name] = Stated(bounds=(low, high))
        else:
            found[name] = Stated(fixed=values)
    return found
