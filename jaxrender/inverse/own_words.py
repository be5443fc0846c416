"""A material's parameters in the words of its model, as plain data for ``result.json``."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import Bank, Parametric
from jaxrender.catalogue import MODELS
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.parameters import Parameters


class OwnWords(NamedTuple):
    """How one model says its parameters; with ``one_ks`` a ks that all channels share once.

    Amplitudes that stand in for one another are said as their sums (``Uncertain.summed``).
    """

    model: str
    brdf: Parametric
    one_ks: bool = False

    @property
    def names(self) -> list[str]:
        """What the model has: its amplitudes, and the numbers of its lobe."""
        if self.model == "lambertian":
            return ["kd"]
        sums = self.brdf.sums
        parts = {part for own in sums.values() for part in own}
        alone = [name for name in self.brdf.amplitude_names if name not in parts]
        return [*sums, *alone, *self.brdf.numbers]

    def values(self, parameters: Parameters) -> dict[str, Any]:
        """Name the numbers of ``parameters``."""
        return {name: plain(self._of(name, parameters)) for name in self.names}

    def material(self, parameters: Parameters) -> dict[str, Any]:
        """Name them, and a metal's index, which there is none of."""
        values = self.values(parameters)
        if self.model != "lambertian" and self.brdf.has_index() and self.brdf.mu is None:
            values[self.brdf.index.name] = "none"
        return values

    def choices(self) -> dict[str, Any]:
        """Name what no fit searches for: Fresnel angle and masking, or numbers that are stated.

        Of a bank these are its lobes, with their weights.
        """
        model = MODELS[self.model]
        stated = {name: float(getattr(self.brdf, name)) for name in model.names("stated")}
        chosen = stated | {name: getattr(self.brdf, name) for name in model.options}
        return chosen | {"lobes": self.brdf.as_lobes()} if isinstance(self.brdf, Bank) else chosen

    def intervals(self, lower: Parameters, upper: Parameters) -> dict[str, Any]:
        """Lay out each interval as [low, high], or one for each channel.

        It ends where the domain of a model in the catalogue does.
        """
        found = {}
        for name in self.names:
            known = self.model in MODELS
            highest = MODELS[self.model].number(name).domain.high if known else np.inf
            high = np.minimum(self._of(name, upper), highest)
            found[name] = _pairs(self._of(name, lower), np.asarray(high))
        return found

    def correlations(self, uncertain: Uncertain) -> dict[str, Any] | None:
        """Name what was free, and lay out its correlations; None where they are not known.

        Gains stay out; a shared ks is one number.
        """
        if uncertain.covariance is None:
            return None
        shared = [name for name in self.names if np.ndim(self._of(name, uncertain.value)) == 0]

        def own(label: str) -> str | None:
            name, _, place = label.partition("[")
            if name == "gains" or (name in shared and place not in ("", "0]")):
                return None
            return name if name in shared else label

        covariance = np.asarray(uncertain.covariance)
        error = np.sqrt(np.maximum(np.diag(covariance), 0))
        names = dict(enumerate(map(own, uncertain.value.labels)))
        free = [k for k, name in names.items() if name is not None and error[k] > 0]
        matrix = covariance[np.ix_(free, free)] / np.outer(error[free], error[free])
        return {"numbers": [names[k] for k in free], "matrix": plain(matrix)}

    def biases(self, relative: dict[str, np.ndarray]) -> dict[str, Any]:
        """Name the relative biases of a fit's unknowns."""
        return {name: plain(relative[name]) for name in self.names}

    def _of(self, name: str, parameters: Parameters) -> np.ndarray:
        value = np.asarray(parameters.of(name))
        is_shared = name in self.brdf.amplitude_names and name not in self.brdf.coloured
        if is_shared and self.one_ks and np.ptp(value) == 0:
            return np.asarray(value[0])
        return value


def plain(value) -> Any:
    """Turn an array into numbers, or lists of them."""
    return np.asarray(value, float).tolist()


def _pairs(lower: np.ndarray, upper: np.ndarray) -> list:
    low, high = plain(lower), plain(upper)
    return [list(pair) for pair in zip(low, high)] if isinstance(low, list) else [low, high]
