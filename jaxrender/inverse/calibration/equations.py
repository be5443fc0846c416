"""Normal equations of a fit and of nuisances, the nuisances held by their priors."""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.diagnosis.causes import CAUSES
from jaxrender.inverse.diagnosis.derivatives import Derivatives
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.nuisances import NUISANCES, Corrections
from jaxrender.shapes import Float

# Degrees of freedom of the priors: a fault is many deviations off more often than Gauss says.
_FREEDOM = 4.0


class Step(NamedTuple):
    """How far to move each nuisance, and what of chi-squared that would gain."""

    by: dict[str, Float[np.ndarray, "number"]]
    gain: float


class Pull(NamedTuple):
    """How far a nuisance is from what was told, in standard deviations of its prior, and the pull.

    A fault that is gross is pulled less: by Student's t of few degrees of freedom.
    """

    off: Float[np.ndarray, "number"]

    @classmethod
    def of(cls, corrections: Corrections, *names: str) -> "Pull":
        """Look at some nuisances, one after the other."""
        numbers = [
            corrections.of(name) / NUISANCES[name].deviations(len(corrections.of(name)))
            for name in names
        ]
        return cls(np.concatenate(numbers))

    @property
    def weights(self) -> Float[np.ndarray, "number"]:
        """The information that a prior has here."""
        return 1 / (1 + self.off**2 / _FREEDOM)

    @property
    def cost(self) -> float:
        """What it adds to chi-squared."""
        return float(np.sum(_FREEDOM * np.log1p(self.off**2 / _FREEDOM)))


class Columns(NamedTuple):
    """Derivatives of what is left by the fit's own unknowns and by what is free, weighted.

    Nuisances are in standard deviations of their priors; ``names`` says whose each column is.
    """

    known: Derivatives
    columns: Float[np.ndarray, "value nuisance"]
    names: np.ndarray

    @classmethod
    def of(
        cls, grounds: Grounds, known: Derivatives, corrections: Corrections, free: tuple[str, ...]
    ) -> "Columns":
        """Differentiate by all that is free; ``known`` are the same samples' own derivatives.

        Raises ``ValueError`` for a nuisance that photographs or light leave no room for.
        """
        found, names = [], []
        for name in free:
            columns = CAUSES[name].columns(grounds)
            if columns is None:
                raise ValueError(f"{name} cannot be freed: {NO_ROOM.get(name, 'there is none')}")
            # The last photographs may have no sample among these.
            every = len(corrections.of(name))
            columns = np.pad(columns, ((0, 0), (0, 0), (0, every - columns.shape[2])))
            found.append(known.weighted(columns * NUISANCES[name].deviations(every)))
            names += [name] * every
        return cls(known, np.hstack(found), np.array(names))


NO_ROOM = {
    "camera": "nobody says where the cameras stand",
    "scale": "nobody says where the cameras stand, or their rays are parallel",
    "object": "nobody says where the samples lie",
    "environment": "the light has no environment",
    "lamps": "the light has no sources",
    "blur": "nobody says which pixels the samples are, or where they lie, or they are too few",
    "nearness": (
        "the light has no source that stands alone, or the places of the sources are given, or "
        "nobody says where the samples lie"
    ),
}


class Equations(NamedTuple):
    """Normal equations of material and nuisances, the nuisances last and called by ``names``."""

    matrix: Float[np.ndarray, "all all"]
    right: Float[np.ndarray, "all"]
    names: np.ndarray

    def step(self, damping: float) -> Step:
        """Solve them; damping shortens what is told worst."""
        diagonal = np.where(np.arange(len(self.right)) < len(self.right) - len(self.names), 0, 1)
        damped = self.matrix + damping * np.diag(diagonal * np.diag(self.matrix))
        found = np.linalg.lstsq(damped, self.right, rcond=1e-12)[0]
        gain = float(2 * self.right @ found - found @ self.matrix @ found)
        own = found[-len(self.names) :]
        by = {
            str(name): own[self.names == name] * deviations_of(name, self.names)
            for name in dict.fromkeys(self.names)
        }
        return Step(by, gain)


def equations_of(
    columns: Columns, corrections: Corrections, free: tuple[str, ...], strength: float
) -> Equations:
    """Set up the fit's own unknowns and nuisances at once, to first order.

    Samples count ``strength`` times as much as their weights say, beside the priors.
    """
    known, columns_of_free, names = columns
    both = np.hstack([unit_columns(known.jacobian), columns_of_free])
    pull = Pull.of(corrections, *free)
    prior = np.zeros(both.shape[1])
    prior[-len(names) :] = pull.weights
    right = strength * both.T @ known.left
    right[-len(names) :] -= pull.weights * pull.off
    return Equations(strength * both.T @ both + np.diag(prior), right, names)


def deviations_of(name: str, names: np.ndarray) -> Float[np.ndarray, "number"]:
    """List the priors of one nuisance's columns."""
    return NUISANCES[name].deviations(int(np.sum(names == name)))


def unit_columns(jacobian: Float[np.ndarray, "value all"]) -> Float[np.ndarray, "value all"]:
    """Let every column have length one, if it has any."""
    size = np.linalg.norm(jacobian, axis=0)
    return jacobian / np.where(size > 0, size, 1)
