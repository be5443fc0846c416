"""The normal equations of every site, solved exactly and within bounds.

B = K_d(x) D + K_s(x) S (T 6.13), with K_d of every channel and one K_s (a dielectric's has no
colour): at each site a system whose matrix is an arrow, all channels' K_d meeting in K_s.  Taking
K_d out leaves one equation in K_s,

    (S'S + p) K_s + sum_c (D'S)_c max(0, (D'B - D'S K_s)_c / (D'D)_c) = S'B + p m

whose left side is convex, increasing and made of straight pieces (one more for each channel whose
K_d has reached zero).  Newton's method therefore finds its root in as many steps as there are
pieces, and K_d, K_s >= 0 hold exactly.  p and m are a weak prior: precision and mean of K_s.  The
same equation, summed over all sites, is that of one K_s for the whole surface (phase 1 of T 6.4.2).

Differentiable, where no K_d or K_s is just reaching zero.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxrender.inverse.texture.site_sums import ROUNDING, SiteMaterial, SiteSums, quotient
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Newton steps.  A site's own equation needs at most one more than it has channels; that of one K_s
# for all sites passes the pieces of many sites at once.
_STEPS = 12


class SpecularPrior(NamedTuple):
    """What is known of K_s beforehand: its mean over the sites, and 1 / variance (0: nothing)."""

    mean: Float[AnyArray, ""]
    precision: Float[AnyArray, ""]

    def amplitudes(self, channels: int) -> int:
        """Say how many K_s a site has."""
        return 1

    def matrix(self, channels: int) -> Float[Array, "1 1"]:
        """Return the precision of K_s."""
        return jnp.asarray(self.precision).reshape(1, 1)

    def held(self, ks: Float[Array, "site"]) -> Float[Array, "site"]:
        """Say what it counts against each site's K_s."""
        return jnp.asarray(self.precision) * (ks - jnp.asarray(self.mean)) ** 2

    def solve(self, sums: SiteSums) -> SiteMaterial:
        """Solve for K_d and K_s of every site."""
        return solve_sites(sums, self)

    def errors(self, sums: SiteSums) -> tuple[SiteMaterial, None]:
        """Compute standard errors; K_s has no colour that could have any."""
        return site_errors(sums, self), None


class KnownSpecular(NamedTuple):
    """A K_s that is one and the same everywhere, as that of a clear interface: nothing is free."""

    mean: Float[AnyArray, ""]

    def amplitudes(self, channels: int) -> int:
        """Say how many K_s a site has that are not known."""
        return 0

    def matrix(self, channels: int) -> Float[Array, "0 0"]:
        """Return the precisions of nothing."""
        return jnp.zeros((0, 0))

    def held(self, ks: Float[Array, "site"]) -> Float[Array, "site"]:
        """Count nothing against it."""
        return jnp.zeros_like(ks)

    def solve(self, sums: SiteSums) -> SiteMaterial:
        """Solve for K_d of every channel and site, at least zero."""
        ks = jnp.broadcast_to(jnp.asarray(self.mean, sums.dd.dtype), sums.dd.shape[:1])
        kd = quotient(sums.db - sums.ds * ks[:, None], sums.dd)
        return SiteMaterial(jnp.maximum(kd, 0), ks)

    def errors(self, sums: SiteSums) -> tuple[SiteMaterial, None]:
        """Compute standard errors of K_d; K_s has none."""
        variance = jnp.where(sums.dd > 0, 1 / jnp.where(sums.dd > 0, sums.dd, 1), jnp.inf)
        return SiteMaterial(jnp.sqrt(variance), jnp.zeros(sums.dd.shape[:1])), None


class FreeSites(NamedTuple):
    """K_d and K_s without bounds or prior, and the precision of each K_s (0: not identifiable)."""

    material: SiteMaterial
    precision: Float[Array, "site"]


def solve_sites(
    sums: SiteSums, prior: SpecularPrior, shared: Bool[AnyArray, ""] | bool = False
) -> SiteMaterial:
    """Solve for K_d and K_s of every site, both at least zero; ``shared`` for one K_s of all sites.

    Where the observations do not tell K_s it is the prior's mean, where they do not tell K_d zero.
    """
    fixed_sums, fixed_prior = jax.lax.stop_gradient((sums, prior))

    def step(_, active: Bool[Array, "site channel"]) -> Bool[Array, "site channel"]:
        ks = _root(fixed_sums, fixed_prior, active, shared)
        return fixed_sums.db - fixed_sums.ds * ks[:, None] > 0

    active = jax.lax.fori_loop(0, _STEPS, step, jnp.ones(sums.dd.shape, bool))
    ks = jnp.maximum(_root(sums, prior, active, shared), 0)
    kd = quotient(sums.db - sums.ds * ks[:, None], sums.dd)
    return SiteMaterial(jnp.maximum(kd, 0), ks)


def solve_freely(sums: SiteSums) -> FreeSites:
    """Solve without bounds or prior."""
    zero = jnp.zeros((), sums.dd.dtype)
    every = jnp.ones(sums.dd.shape, bool)
    slope, right = _piece(sums, SpecularPrior(zero, zero), every, False)
    ks = quotient(right, slope)
    kd = quotient(sums.db - sums.ds * ks[:, None], sums.dd)
    return FreeSites(SiteMaterial(kd, ks), slope)


def site_errors(sums: SiteSums, prior: SpecularPrior) -> SiteMaterial:
    """Compute the standard errors of K_d and K_s: the roots of the inverse system's diagonal.

    They ignore the bounds: a value held at zero may be anything up to about its error.  They are
    infinite where nothing was measured.  Where neither data nor prior tell K_s, it may be anything
    from 0 to 1, or up to where it alone explains the measurement.  K_d follows it.
    """
    slope, ratio = eliminated(sums, prior)
    ks_variance = jnp.where(slope > 0, 1 / jnp.where(slope > 0, slope, 1), jnp.inf)
    most = jnp.min(jnp.where(sums.ds > 0, quotient(sums.db, sums.ds), 1), axis=1)
    # The mean square of what is uniform from 0, where it is taken to be.
    uniform = jnp.clip(most, 0, 1) ** 2 / 3
    through = jnp.where(slope > 0, ks_variance, uniform)[:, None]
    kd_variance = 1 / jnp.where(sums.dd > 0, sums.dd, 1) + ratio**2 * through
    kd_variance = jnp.where(sums.dd > 0, kd_variance, jnp.inf)
    return SiteMaterial(jnp.sqrt(kd_variance), jnp.sqrt(ks_variance))


def eliminated(
    sums: SiteSums, prior: SpecularPrior
) -> tuple[Float[Array, "site"], Float[Array, "site channel"]]:
    """Take K_d out of every system: what is left of the matrix for K_s, and D'S / D'D."""
    slope, _ = _piece(sums, prior, jnp.ones(sums.dd.shape, bool), False)
    return slope, quotient(sums.ds, sums.dd)


def _root(
    sums: SiteSums,
    prior: SpecularPrior,
    active: Bool[Array, "site channel"],
    shared: Bool[AnyArray, ""] | bool,
) -> Float[Array, "site"]:
    """Find where the straight piece of the equation in K_s meets its right side."""
    slope, right = _piece(sums, prior, active, shared)
    return jnp.where(slope > 0, quotient(right, slope), prior.mean)


def _piece(
    sums: SiteSums,
    prior: SpecularPrior,
    active: Bool[Array, "site channel"],
    shared: Bool[AnyArray, ""] | bool,
) -> tuple[Float[Array, "site"], Float[Array, "site"]]:
    """Compute slope and right side of the piece where ``active`` channels have K_d > 0."""
    taken_out = jnp.where(active, quotient(sums.ds**2, sums.dd), 0)
    explained = jnp.where(active, quotient(sums.ds * sums.db, sums.dd), 0)
    parts = (sums.ss - taken_out, sums.ss, sums.sb - explained)
    slope, whole, right = (_gathered(jnp.sum(part, axis=1), shared) for part in parts)
    determined = slope > ROUNDING[slope.dtype.name] * whole
    precision = jnp.where(jnp.asarray(shared), 0, jnp.asarray(prior.precision))
    slope = jnp.where(determined, slope, 0) + precision
    return slope, jnp.where(determined, right, 0) + precision * prior.mean


def _gathered(values: Float[Array, "site"], shared: Bool[AnyArray, ""] | bool):
    """Give every site the sum over all, if they share their K_s."""
    return jnp.where(jnp.asarray(shared), jnp.sum(values), values)
