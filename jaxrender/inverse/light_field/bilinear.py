"""Light times BRDF, both unknown: least squares of B_lmpq = Lambda_l L_lm rho_lpq (T 2.59).

Either factor is a linear problem once the other is known, with a diagonal matrix.  So the normal
equations of both together are two diagonals and a rectangle between them.  Eliminating the BRDF (a
Schur complement) leaves a matrix of the size of the light, whose inverse is also the covariance.
One light coefficient is held, since the product does not determine the scale.  Host, float64.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.descent import descend
from jaxrender.shapes import Float, Int

# The search ends when no unknown moves by more than this part of the largest of its kind.
_SETTLED = 1e-14
# A step must not raise chi-squared by more than this part of it: rounding.
_ROUNDING = 1e-12


class Bilinear(NamedTuple):
    """Measured coefficients of some degrees, flat (l, m) first, and what they are products of.

    ``wavelengths`` is Lambda_l of each row.  ``unknown`` is the place of rho_lpq in the vector of
    BRDF unknowns, shared by reciprocity.  ``weights`` are 1 / variance, zero where there is no such
    coefficient.  ``held`` is the light coefficient that keeps its value.
    """

    values: Float[np.ndarray, "row outgoing_degree order"]
    weights: Float[np.ndarray, "row outgoing_degree order"]
    wavelengths: Float[np.ndarray, "row"]
    unknown: Int[np.ndarray, "row outgoing_degree order"]
    held: int

    def residual(self, factors: "Factors") -> Float[np.ndarray, "row outgoing_degree order"]:
        """Measured less predicted."""
        light = (self.wavelengths * factors.light)[:, None, None]
        return self.values - light * factors.brdf[self.unknown]

    def cost(self, factors: "Factors") -> float:
        """Chi-squared."""
        return float(np.sum(self.weights * self.residual(factors) ** 2))


class Factors(NamedTuple):
    """Light coefficients and BRDF unknowns."""

    light: Float[np.ndarray, "row"]
    brdf: Float[np.ndarray, "unknown"]


def refine(problem: Bilinear, start: Factors) -> Factors:
    """Descend by Gauss-Newton from a start near the answer."""

    def settled(before: Factors, after: Factors) -> bool:
        return all(np.abs(a - b).max() <= _SETTLED * np.abs(a).max() for a, b in zip(after, before))

    def step_at(factors: Factors) -> Factors:
        return _Normal.at(problem, factors).step()

    return descend(start, problem.cost, step_at, settled, _ROUNDING).point


def standard_errors(problem: Bilinear, factors: Factors) -> Factors:
    """Compute the standard error of every unknown, that of the others' errors included."""
    normal = _Normal.at(problem, factors)
    covariance = normal.light_covariance()
    through = normal.mixed / normal.brdf[None, :]
    brdf = 1 / normal.brdf + np.einsum("ik,ij,jk->k", through, covariance, through)
    return Factors(np.sqrt(np.diag(covariance)), np.sqrt(brdf))


class _Normal(NamedTuple):
    """Normal equations at a point: two diagonals, the rectangle between, and the gradients."""

    light: Float[np.ndarray, "row"]
    brdf: Float[np.ndarray, "unknown"]
    mixed: Float[np.ndarray, "row unknown"]
    gradient: Factors
    held: int

    @classmethod
    def at(cls, problem: Bilinear, factors: Factors) -> "_Normal":
        residual, weights = problem.residual(factors), problem.weights
        by_light = problem.wavelengths[:, None, None] * factors.brdf[problem.unknown]
        by_brdf = np.broadcast_to(
            (problem.wavelengths * factors.light)[:, None, None], residual.shape
        )
        rows, unknowns = len(factors.light), len(factors.brdf)
        place = problem.unknown.ravel()
        flat = np.arange(rows)[:, None, None] * unknowns + problem.unknown
        return cls(
            np.sum(weights * by_light**2, axis=(1, 2)),
            np.bincount(place, (weights * by_brdf**2).ravel(), unknowns),
            np.bincount(
                flat.ravel(), (weights * by_light * by_brdf).ravel(), rows * unknowns
            ).reshape(rows, unknowns),
            Factors(
                np.sum(weights * by_light * residual, axis=(1, 2)),
                np.bincount(place, (weights * by_brdf * residual).ravel(), unknowns),
            ),
            problem.held,
        )

    def step(self) -> Factors:
        through = self.mixed / self.brdf[None, :]
        light = self.light_covariance() @ (self.gradient.light - through @ self.gradient.brdf)
        return Factors(light, (self.gradient.brdf - self.mixed.T @ light) / self.brdf)

    def light_covariance(self) -> Float[np.ndarray, "row row"]:
        """Invert what is left of the light once the BRDF is taken out; zero for the one held."""
        left = np.diag(self.light) - (self.mixed / self.brdf[None, :]) @ self.mixed.T
        free = np.arange(len(self.light)) != self.held
        scale = 1 / np.sqrt(np.maximum(self.light, np.finfo(float).tiny))
        scaled = (left * scale[:, None] * scale[None, :])[np.ix_(free, free)]
        # What the data say nothing about does not move, and has the error of everything else.
        inverse = np.linalg.pinv(scaled, rcond=1e-15, hermitian=True)
        covariance = np.zeros_like(left)
        covariance[np.ix_(free, free)] = inverse * np.outer(scale[free], scale[free])
        return covariance
