"""A material's parameters in the words of its model, as plain data for ``result.json``.

A search knows a lobe by its width sigma; a result says the model's own number in its place, such as
an exponent, by its own name.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.catalogue import MODELS
from jaxrender.inverse.uncertainty import Parameters

_SEARCHED = ("kd", "ks", "sigma", "mu")


class OwnWords(NamedTuple):
    """How one model says its parameters; with ``one_ks`` a ks that all channels share once."""

    model: str
    brdf: Parametric
    one_ks: bool = False

    @property
    def names(self) -> list[str]:
        """What the model has: kd, ks, the lobe's number, and the index where there is one."""
        return list(self._searched)

    def of_widths(self, parameters: Parameters) -> Parameters:
        """Put the model's own numbers in the place of the width and the index."""
        shape, index = self.brdf.shape, self.brdf.index
        return parameters._replace(
            sigma=shape.of_width(parameters.sigma), mu=index.of_index(parameters.mu)
        )

    def values(self, parameters: Parameters) -> dict[str, Any]:
        """Name the numbers of ``parameters``, which are the model's own."""
        return {name: plain(self._of(name, parameters)) for name in self.names}

    def material(self, parameters: Parameters) -> dict[str, Any]:
        """Name them, and a metal's index, which there is none of."""
        values = self.values(parameters)
        if self.model != "lambertian" and self.brdf.has_index() and self.brdf.mu is None:
            values[self.brdf.index.name] = "none"
        return values

    def choices(self) -> dict[str, Any]:
        """Name what no fit searches for: Fresnel angle and masking, or numbers that are stated."""
        model = MODELS[self.model]
        stated = {name: float(getattr(self.brdf, name)) for name in model.names("stated")}
        return stated | {name: getattr(self.brdf, name) for name in model.options}

    def intervals(self, lower: Parameters, upper: Parameters) -> dict[str, Any]:
        """Lay out each interval as [low, high], or one for each channel."""
        return {name: _pairs(self._of(name, lower), self._of(name, upper)) for name in self.names}

    def biases(self, of_widths: dict[str, np.ndarray]) -> dict[str, Any]:
        """Turn relative biases, that of the width among them, into those of the own numbers."""
        return {name: plain(self._bias(name, of_widths)) for name in self.names}

    @property
    def _searched(self) -> dict[str, str]:
        """What the search calls each of the model's own parameters."""
        if self.model == "lambertian":
            return {"kd": "kd"}
        own = {self.brdf.called(name): name for name in _SEARCHED}
        absent = {None} if self.brdf.mu is not None else {None, self.brdf.called("mu")}
        return {name: searched for name, searched in own.items() if name and name not in absent}

    def _bias(self, name: str, of_widths: dict[str, np.ndarray]) -> np.ndarray:
        searched = self._searched[name]
        bias, power = np.asarray(of_widths[searched]), self.brdf.shape.power
        return (1 + bias) ** power - 1 if searched == "sigma" and power != 1 else bias

    def _of(self, name: str, parameters: Parameters) -> np.ndarray:
        value = np.asarray(getattr(parameters, self._searched[name]))
        if name == "ks" and self.one_ks and np.ptp(value) == 0:
            return np.asarray(value[0])
        return value


def called(brdf: Parametric, name: str) -> str:
    """Say what a model calls an unknown of the search; what is no parameter keeps its name."""
    return (brdf.called(name) or name) if name in _SEARCHED else name


def plain(value) -> Any:
    """Turn an array into numbers, or lists of them."""
    return np.asarray(value, float).tolist()


def _pairs(lower: np.ndarray, upper: np.ndarray) -> list:
    low, high = plain(lower), plain(upper)
    return [list(pair) for pair in zip(low, high)] if isinstance(low, list) else [low, high]
