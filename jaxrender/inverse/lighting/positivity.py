"""Light that is not negative: the soft penalty of T 6.24, and a hard constraint.

nu' = nu + lambda (nu_0 / kappa_0) kappa                                                 (T 6.24)

nu is the root mean square of the weighted residuals.  kappa is the integral over the sphere of the
squared light where it is negative.  nu_0 and kappa_0 are their values for the unregularised light.
(The thesis adds up pixels of a latitude-longitude image as they are, which counts the poles more.)

Both are convex and quadratic by pieces.  The set of negative nodes is the only nonlinearity, so
Newton's method ends after a few exact solves.  The hard constraint is light that is non-negative at
the nodes: the limit of such penalties with multipliers (augmented Lagrangian).  Host side, NumPy.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy.linalg import cho_factor, cho_solve

from jaxrender.inverse.descent import descend
from jaxrender.shapes import Float

_PENALTY_STEPS = 60
_MULTIPLIER_STEPS = 200
# Stiffer than this beside the data's own, rounding of the data's part would show.
_STIFFEST = 1e5
# A node counts as non-negative when it is above minus this part of the brightest.
_NEGLIGIBLE = 1e-7


class Misfit(eqx.Module):
    """chi^2 of a light, a quadratic, over ``measured`` residuals; and the nodes it is seen at."""

    measured: eqx.AbstractVar[float]
    weights: eqx.AbstractVar[Float[np.ndarray, "node"]]
    """Solid angle of each node."""

    @property
    @abc.abstractmethod
    def own_stiffness(self) -> Float[np.ndarray, "node"]:
        """About how stiffly the data themselves hold each node."""

    @abc.abstractmethod
    def squares(self, light: Float[np.ndarray, "unknown"]) -> float:
        """Compute chi^2."""

    @abc.abstractmethod
    def at_nodes(self, light: Float[np.ndarray, "unknown"]) -> Float[np.ndarray, "node"]:
        """Evaluate the light at the nodes."""

    @abc.abstractmethod
    def minimum(
        self, stiffness: Float[np.ndarray, "node"], aim: Float[np.ndarray, "node"]
    ) -> Float[np.ndarray, "unknown"]:
        """Minimise chi^2 + sum stiffness (light at node - aim)^2."""

    def rms(self, light: Float[np.ndarray, "unknown"]) -> float:
        """Compute nu, the root mean square residual."""
        return float(np.sqrt(max(self.squares(light), 0.0) / self.measured))

    def unregularised(self) -> Float[np.ndarray, "unknown"]:
        """Minimise chi^2 alone."""
        return self.minimum(np.zeros(len(self.weights)), np.zeros(len(self.weights)))


class CoefficientMisfit(Misfit):
    """energy - 2 moment'x + x' gram x of coefficients x; ``basis`` are the harmonics at the nodes.

    ``gram`` must be positive definite.
    """

    gram: Float[np.ndarray, "coefficient coefficient"]
    moment: Float[np.ndarray, "coefficient"]
    energy: float
    measured: float
    basis: Float[np.ndarray, "node coefficient"]
    weights: Float[np.ndarray, "node"]

    @property
    def own_stiffness(self) -> Float[np.ndarray, "node"]:
        """The mean information on a coefficient: the basis is orthonormal over the sphere."""
        return np.trace(self.gram) / len(self.moment) * self.weights

    def squares(self, light: Float[np.ndarray, "coefficient"]) -> float:
        """Compute chi^2."""
        return float(self.energy - 2 * self.moment @ light + light @ self.gram @ light)

    def at_nodes(self, light: Float[np.ndarray, "coefficient"]) -> Float[np.ndarray, "node"]:
        """Evaluate the light at the nodes."""
        return self.basis @ light

    def minimum(
        self, stiffness: Float[np.ndarray, "node"], aim: Float[np.ndarray, "node"]
    ) -> Float[np.ndarray, "coefficient"]:
        """Solve the normal equations with the stiff nodes as further measurements."""
        held = stiffness > 0
        rows = self.basis[held]
        weighted = rows.T * stiffness[held][None, :]
        return cho_solve(
            cho_factor(self.gram + weighted @ rows), self.moment + weighted @ aim[held]
        )


class Positive(NamedTuple):
    """A light with its negative parts penalised or removed, and whether the iteration ended."""

    light: Float[np.ndarray, "unknown"]
    converged: bool


def negative_energy(misfit: Misfit, light: Float[np.ndarray, "unknown"]) -> float:
    """Compute kappa, the integral of the squared negative part."""
    return float(misfit.weights @ np.minimum(misfit.at_nodes(light), 0) ** 2)


def soft_positive(misfit: Misfit, strength: float = 1.0) -> Positive:
    """Minimise T 6.24 with lambda = ``strength`` from the unregularised light.

    The gradient of nu is that of chi^2 over 2 nu times the count.  So the minimum is that of
    chi^2 + stiffness x kappa, for the stiffness that belongs to nu there, found by repetition.
    """
    light = misfit.unregularised()
    rms, negative = misfit.rms(light), negative_energy(misfit, light)
    if negative == 0 or rms == 0:
        # Nothing to penalise; or exact data, which T 6.24 leaves as they are.
        return Positive(light, True)
    none = np.zeros(len(misfit.weights))
    before = rms
    for _ in range(_PENALTY_STEPS):
        stiffness = 2 * strength * rms / negative * misfit.measured * before
        light, converged = _penalised(misfit, stiffness * misfit.weights, none, light)
        now = misfit.rms(light)
        if abs(now / before - 1) < 1e-9:
            return Positive(light, converged)
        before = now
    return Positive(light, False)


def hard_positive(misfit: Misfit) -> Positive:
    """Minimise chi^2 over lights that are non-negative at every node, up to 1e-7 of the brightest.

    Where multipliers alone are slow, the penalty stiffens.
    """
    light = misfit.unregularised()
    factor, worst = 1.0, np.inf
    shift = np.zeros(len(misfit.weights))
    for _ in range(_MULTIPLIER_STEPS):
        light, converged = _penalised(misfit, factor * misfit.own_stiffness, shift, light)
        values = misfit.at_nodes(light)
        before, shift = shift, np.minimum(values + shift, 0)
        brightest = max(np.abs(values).max(), np.finfo(float).tiny)
        # The change of the multipliers: what is still negative, or held up without need.
        least = np.abs(shift - before).max() / brightest
        if least < _NEGLIGIBLE and converged:
            return Positive(light, True)
        if least > 0.25 * worst and factor < _STIFFEST:
            factor, shift = 4 * factor, shift / 4
        worst = least
    return Positive(light, False)


def _penalised(
    misfit: Misfit,
    stiffness: Float[np.ndarray, "node"],
    shift: Float[np.ndarray, "node"],
    start: Float[np.ndarray, "unknown"],
) -> Positive:
    """Minimise chi^2 + sum stiffness min(light + shift, 0)^2 by Newton's method."""

    def cost(light: np.ndarray) -> float:
        penalty = stiffness @ np.minimum(misfit.at_nodes(light) + shift, 0) ** 2
        return float(misfit.squares(light) + penalty)

    def negative(light: np.ndarray) -> np.ndarray:
        return misfit.at_nodes(light) + shift < 0

    def step_at(light: np.ndarray) -> np.ndarray:
        return misfit.minimum(np.where(negative(light), stiffness, 0), -shift) - light

    def settled(before: np.ndarray, after: np.ndarray) -> bool:
        return np.array_equal(negative(before), negative(after))

    return Positive(*descend(start, cost, step_at, settled))
