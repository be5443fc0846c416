"""A roughness that varies slowly over the surface (T 6.4.2 takes one for all).

    log sigma(x) = sum_k w_k(x) log sigma_k

Control points are spread over the sites.  w_k is the thin-plate spline that is 1 at one of them and
0 at the others.  Distances are in space, so the field is smooth across the seams of the texture.
The photographs may say little of one control point.  So a weak prior on differences holds
neighbours together, and unseen places have the sigma of their neighbourhood.  The errors suppose
that the field has enough control points to follow sigma.

The search for it is that of one sigma (:mod:`.search`), with more unknowns: ``VaryingSigma`` stands
in for ``Unknowns``, and every sample has its own sigma.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import RBFInterpolator

from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.unknowns import Physical, Unknowns
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

# Neighbouring control points differ in log sigma by about this much, as far as is known beforehand.
_EXPECTED_STEP = 0.3
# Control points that lie this much flatter than wide are taken to lie in a plane (or on a line).
_FLAT = 1e-6


class SigmaField(NamedTuple):
    """Weights of the control points at every site, and the pairs of points that are neighbours.

    The weights of a site sum to one; all are zero where the site's place is not known.
    """

    weights: Float[np.ndarray, "site control"]
    pairs: Int[np.ndarray, "pair 2"]

    @classmethod
    def over(cls, places: Float[np.ndarray, "site 3"], controls: int) -> "SigmaField":
        """Spread control points over the sites, every one as far from the others as can be.

        ``places`` are where the sites lie; NaN where that is not known.  Raises ``ValueError`` for
        fewer than two control points, or fewer sites than those.
        """
        known = np.isfinite(places).all(axis=1)
        if not 2 <= controls <= known.sum():
            raise ValueError(
                f"{controls} control points of sigma for {known.sum()} sites: "
                "give at least 2, and no more than there are sites; or fit one sigma"
            )
        points = _far_apart(places[known], controls)
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        np.fill_diagonal(apart, np.inf)
        if not apart.min() > 0:
            raise ValueError("too many sites lie in one place: give fewer control points of sigma")
        axes = _axes(points)
        spline = RBFInterpolator(points @ axes, np.eye(controls), kernel="thin_plate_spline")
        weights = np.zeros((len(places), controls))
        weights[known] = spline(places[known] @ axes)
        return cls(weights, _neighbours(apart))

    def unknowns(self, one: Unknowns, site: Int[np.ndarray, "sample"]) -> "VaryingSigma":
        """Make the unknowns of samples that show the given sites."""
        return VaryingSigma(one, self.weights[site], self.pairs)


class VaryingSigma(eqx.Module):
    """A sigma at every control point, within the bounds of ``one`` sigma, and one mu for all."""

    one: Unknowns
    weights: Float[AnyArray, "sample control"]
    pairs: Int[AnyArray, "pair 2"]

    @property
    def controls(self) -> int:
        """The number of control points."""
        return self.weights.shape[1]

    @property
    def names(self) -> tuple[str, ...]:
        """The unknowns in the order of the search vector."""
        first, *rest = self.one.names
        return (*(f"{first} at control point {k}" for k in range(1, self.controls + 1)), *rest)

    @eqx.filter_jit
    def unpack(self, point: Float[Array, "unknown"]) -> Physical:
        """Turn a search vector into parameters in their own units, with a sigma for each sample."""
        logs = self.logs(point)
        weights = jnp.asarray(self.weights, logs.dtype)
        sigma = jnp.exp(jnp.matmul(weights, logs, precision="highest"))
        others = self.one.unpack(self.alone(point, 0))
        return Physical({**others.numbers, "sigma": sigma}, others.gains)

    def logs(self, point: Float[Array, "unknown"]) -> Float[Array, "control"]:
        """Return log sigma at the control points."""

        def log_of(own: Float[Array, "1"]) -> Float[Array, ""]:
            one = self.one.unpack(jnp.concatenate([own, point[self.controls :]]))
            return jnp.log(one.numbers["sigma"])

        return jax.vmap(log_of)(point[: self.controls, None])

    def steps(self, point: Float[Array, "unknown"]) -> Float[Array, "pair"]:
        """Return how far neighbours differ, in units of how far they are expected to."""
        logs, pairs = self.logs(point), jnp.asarray(self.pairs)
        return (logs[pairs[:, 0]] - logs[pairs[:, 1]]) / _EXPECTED_STEP

    def alone(self, point: Float[Array, "unknown"], control: int) -> Float[Array, "of_one"]:
        """Pick the search vector of one sigma for all: that of a control point."""
        return jnp.concatenate([point[control : control + 1], point[self.controls :]])

    def spread(self, point: Float[np.ndarray, "of_one"]) -> Float[np.ndarray, "unknown"]:
        """Turn the search vector of one sigma into that of the same at every control point."""
        return np.concatenate([np.repeat(point[:1], self.controls), point[1:]])

    def at_bound(self, point: Float[Array, "unknown"]) -> Bool[np.ndarray, "unknown"]:
        """Say which of them ended at a bound."""
        each = [self.one.at_bound(self.alone(point, k)) for k in range(self.controls)]
        return np.concatenate([np.array([own[0] for own in each]), each[0][1:]])


class SigmaMap(NamedTuple):
    """sigma at every site with its standard error; NaN and infinite where the place is unknown."""

    sigma: Float[np.ndarray, "site"]
    error: Float[np.ndarray, "site"]

    @property
    def marked(self) -> Bool[np.ndarray, "site"]:
        """Say where the interval is too wide to speak of a value."""
        return np.asarray(~(NORMAL_90 * self.error <= IDENTIFIABLE_WITHIN * self.sigma))


def sigma_map(
    field: SigmaField,
    one: Unknowns,
    point: Float[np.ndarray, "unknown"],
    covariance: Float[np.ndarray, "unknown unknown"],
) -> SigmaMap:
    """Evaluate the field that was found at every site."""
    unknowns = field.unknowns(one, np.arange(len(field.weights)))
    logs = np.asarray(unknowns.logs(jnp.asarray(point)))
    slopes = np.asarray(jax.jacfwd(unknowns.logs)(jnp.asarray(point)))
    by_point = field.weights @ slopes
    known = field.weights.any(axis=1)
    sigma = np.where(known, np.exp(field.weights @ logs), np.nan)
    variance = np.einsum("si,ij,sj->s", by_point, covariance, by_point)
    error = np.where(known, sigma * np.sqrt(np.maximum(variance, 0)), np.inf)
    return SigmaMap(sigma, error)


def _far_apart(places: Float[np.ndarray, "site 3"], count: int) -> Float[np.ndarray, "control 3"]:
    """Choose places each of which is the farthest from those before it."""
    chosen = [int(np.argmax(np.square(places - places.mean(axis=0)).sum(axis=1)))]
    nearest = np.full(len(places), np.inf)
    while len(chosen) < count:
        to_last = np.square(places - places[chosen[-1]]).sum(axis=1)
        nearest = np.minimum(nearest, to_last)
        chosen.append(int(np.argmax(nearest)))
    return places[chosen]


def _axes(points: Float[np.ndarray, "control 3"]) -> Float[np.ndarray, "3 axis"]:
    """Return the principal axes along which points differ: a spline cannot have others."""
    _, sizes, axes = np.linalg.svd(points - points.mean(axis=0))
    return axes[sizes > _FLAT * sizes[0]].T


def _neighbours(apart: Float[np.ndarray, "control control"]) -> Int[np.ndarray, "pair 2"]:
    """Pair every point with those that are nearly as close as its nearest."""
    close = apart <= 1.5 * apart.min(axis=1, keepdims=True)
    # At least as many neighbours as hold a surface together.
    rank = np.argsort(np.argsort(apart, axis=1), axis=1)
    close |= rank < min(3, len(apart) - 1)
    return np.argwhere(np.triu(close | close.T, 1))
