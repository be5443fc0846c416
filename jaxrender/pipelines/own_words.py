"""A material's parameters in the words of its model, as plain data for ``result.json``.

A search knows a lobe by its width sigma; a result says the model's own number in its place, such as
an exponent, by its own name.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Microfacet, WithoutIndex
from jaxrender.inverse.uncertainty import Parameters
from jaxrender.pipelines.config.brdf import chosen_numbers_of


class OwnWords(NamedTuple):
    """How one model says its parameters; with ``one_ks`` a ks that all channels share once."""

    model: str
    brdf: Glossy
    one_ks: bool = False

    @property
    def names(self) -> list[str]:
        """What the model has: kd, ks, the lobe's number, and the index where there is one."""
        if self.model == "lambertian":
            return ["kd"]
        return ["kd", "ks", self.brdf.shape.name] + ([] if self.brdf.mu is None else ["mu"])

    def of_widths(self, parameters: Parameters) -> Parameters:
        """Put the model's own number in the place of the width."""
        return parameters._replace(sigma=self.brdf.shape.of_width(parameters.sigma))

    def values(self, parameters: Parameters) -> dict[str, Any]:
        """Name the numbers of ``parameters``, which are the model's own."""
        return {name: plain(self._of(name, parameters)) for name in self.names}

    def material(self, parameters: Parameters) -> dict[str, Any]:
        """Name them, and a metal's index, which there is none of."""
        values = self.values(parameters)
        indexed = self.model != "lambertian" and not isinstance(self.brdf, WithoutIndex)
        if indexed and self.brdf.mu is None:
            values["mu"] = "none"
        return values

    def choices(self) -> dict[str, Any]:
        """Name what no fit searches for: Fresnel angle and masking, or numbers that are stated."""
        if self.model == "lambertian":
            return {}
        if isinstance(self.brdf, Microfacet):
            return {"fresnel": self.brdf.fresnel, "masking": self.brdf.masking}
        return {name: float(getattr(self.brdf, name)) for name in chosen_numbers_of(self.model)}

    def intervals(self, lower: Parameters, upper: Parameters) -> dict[str, Any]:
        """Lay out each interval as [low, high], or one for each channel."""
        return {name: _pairs(self._of(name, lower), self._of(name, upper)) for name in self.names}

    def biases(self, of_widths: dict[str, np.ndarray]) -> dict[str, Any]:
        """Turn relative biases, that of the width among them, into those of the own numbers."""
        return {name: plain(self._bias(name, of_widths)) for name in self.names}

    def _bias(self, name: str, of_widths: dict[str, np.ndarray]) -> np.ndarray:
        bias, power = np.asarray(of_widths[_attribute(name)]), self.brdf.shape.power
        return (1 + bias) ** power - 1 if _attribute(name) == "sigma" and power != 1 else bias

    def _of(self, name: str, parameters: Parameters) -> np.ndarray:
        value = np.asarray(getattr(parameters, _attribute(name)))
        if name == "ks" and self.one_ks and np.ptp(value) == 0:
            return np.asarray(value[0])
        return value


def plain(value) -> Any:
    """Turn an array into numbers, or lists of them."""
    return np.asarray(value, float).tolist()


def _attribute(name: str) -> str:
    """Where parameters keep what a model calls ``name``: any number for the lobe's width."""
    return name if name in ("kd", "ks", "mu") else "sigma"


def _pairs(lower: np.ndarray, upper: np.ndarray) -> list:
    low, high = plain(lower), plain(upper)
    return [list(pair) for pair in zip(low, high)] if isinstance(low, list) else [low, high]
