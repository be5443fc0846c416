"""Sites whose K_s has a colour, as that of metals: K_d and K_s of each channel, solved exactly.

Photographs that tell K_s may not tell its colour.  So what is expected of it at each site is

    K_s,c = g + d_c,    g ~ N(m, t^2),    d_c ~ N(0, u^2) in each channel c:

one level, about which channels differ.  Where nothing tells them apart K_s has no colour; with
u = 0 it is the one K_s of :mod:`.site_systems`.  For a given g each channel is by itself: with
K_d >= 0 taken out, its K_s >= 0 is a function of g that is made of straight pieces,

    (s + 1/u^2) K_s,c = r + g / u^2,

where s and r are S'S and S'B without D, or with it where K_d is zero.  The equation of g,

    (g - m) / t^2 + sum_c (g - K_s,c(g)) / u^2 = 0,

increases.  Evaluated at the ends of all pieces it tells between which of them its root lies.

Differentiable, where no K_d or K_s is just reaching zero.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.texture.site_sums import ROUNDING, SiteMaterial, SiteSums, quotient
from jaxrender.inverse.texture.site_systems import KnownSpecular, SpecularPrior
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Before their spread is known, channels differ by so much of the mean K_s.
_FIRST_COLOUR = 0.5
# Steps of expectation and maximisation; neither spread is less than this part of the mean.
_STEPS, _SETTLED, _LEAST_SPREAD = 300, 1e-6, 1e-3


class ColouredPrior(NamedTuple):
    """What is known of a coloured K_s beforehand: m, 1 / t^2 and 1 / u^2 (0: nothing)."""

    mean: Float[AnyArray, ""]
    precision: Float[AnyArray, ""]
    colour_precision: Float[AnyArray, ""]

    @classmethod
    def begin(cls, mean: float, precision: float) -> "ColouredPrior":
        """Begin with the level of one K_s for all channels, and with any usual colour."""
        colour = 1 / (_FIRST_COLOUR * mean) ** 2 if mean > 0 else 0.0
        return cls(*map(np.asarray, (mean, precision, colour)))

    def amplitudes(self, channels: int) -> int:
        """Say how many K_s a site has."""
        return channels

    def matrix(self, channels: int) -> Float[Array, "channel channel"]:
        """Return the precisions of all channels of K_s: the inverse of t^2 1 1' + u^2."""
        p, q = jnp.asarray(self.precision), jnp.asarray(self.colour_precision)
        together = q * quotient(q, p + channels * q)
        return q * jnp.eye(channels) - together * jnp.ones((channels, channels))

    def solve(self, sums: SiteSums) -> SiteMaterial:
        """Solve for K_d and K_s of every channel and site."""
        return solve_coloured(sums, self)

    def errors(self, sums: SiteSums) -> "tuple[SiteMaterial, ColouredSpread]":
        """Compute standard errors, and variances of level and colour."""
        return coloured_errors(sums, self)

    def held(self, ks: Float[Array, "site channel"]) -> Float[Array, "site"]:
        """Say what it counts against each site's K_s."""
        off = ks - jnp.asarray(self.mean)
        return jnp.einsum("sc,cd,sd->s", off, self.matrix(ks.shape[1]), off)

    def learned(
        self,
        value: Float[np.ndarray, "site channel"],
        covariance: Float[np.ndarray, "site channel channel"],
    ) -> "ColouredPrior":
        """Learn the spreads from the sites' K_s, which were found with this prior.

        A site counts by what its own photographs tell.  Held at zero in all channels it has no say.
        The likelihood is climbed by expectation and maximisation.
        """
        channels, own = value.shape[1], np.asarray(self.matrix(value.shape[1]), float)
        whole = np.linalg.inv(covariance)
        told = np.where((value > 0)[:, :, None] & (value > 0)[:, None, :], whole - own, 0)
        sizes, axes = np.linalg.eigh((told + np.swapaxes(told, 1, 2)) / 2)
        sizes = np.where(sizes > 1e-6 * np.trace(own), sizes, 0)
        told = np.einsum("sij,sj,skj->sik", axes, sizes, axes)
        pull = np.einsum("sij,sj->si", whole, value) - own @ np.full(channels, float(self.mean))
        pull = np.einsum("sij,sj,skj,sk->si", axes, sizes > 0, axes, pull)
        useful = sizes.any(axis=1)
        if not useful.any():
            return ColouredPrior(*(np.zeros(()) for _ in range(3)))
        told, pull = told[useful], pull[useful]
        level = max(float(np.mean(value[useful])), np.finfo(float).tiny)
        prior = ColouredPrior.begin(level, 1 / level**2)
        least = (_LEAST_SPREAD * level) ** 2
        for _ in range(_STEPS):
            before, prior = prior, prior._climbed(told, pull, least)
            if np.allclose(before, prior, rtol=_SETTLED, atol=0):
                break
        return prior

    def _climbed(
        self,
        told: Float[np.ndarray, "site channel channel"],
        pull: Float[np.ndarray, "site channel"],
        least: float,
    ) -> "ColouredPrior":
        """Take one step up the likelihood; no variance is below the least."""
        p, q, channels = float(self.precision), float(self.colour_precision), pull.shape[1]
        own = q * np.eye(channels) - q**2 / (p + channels * q)
        covariance = np.linalg.inv(told + own)
        right = pull + own @ np.full(channels, float(self.mean))
        value = np.einsum("sij,sj->si", covariance, right)
        mean = float(max(np.mean(value), 0.0))
        moment = np.mean(covariance + np.einsum("si,sj->sij", value - mean, value - mean), axis=0)
        along = moment.sum() / channels
        colour = max(float(np.trace(moment) - along) / max(channels - 1, 1), least)
        level = max(float(along - colour) / channels, least)
        return ColouredPrior(*map(np.asarray, (mean, 1 / level, 1 / colour)))


# What is known of K_s beforehand: of one for all channels, of one for each, or all of it.
KsPrior = SpecularPrior | ColouredPrior | KnownSpecular


class ColouredSpread(NamedTuple):
    """Variances of the level of each site's K_s, which is its mean, and of its colour."""

    level: Float[AnyArray, "site"]
    colour: Float[AnyArray, "site"]

    def marked(
        self, prior: ColouredPrior, channels: int
    ) -> tuple[Bool[np.ndarray, "site"], Bool[np.ndarray, "site"]]:
        """Say where level and colour are the prior's more than the photographs'."""
        colour, level = (float(part) for part in (prior.colour_precision, prior.precision))
        of_level = colour * level / (colour + level / channels) if colour + level > 0 else 0.0
        pairs = ((self.level, of_level), (self.colour, colour))
        with np.errstate(divide="ignore", invalid="ignore"):
            by_level, by_colour = (~(1 / np.asarray(one) - own > own) for one, own in pairs)
        return by_level, by_colour


class _Pieces(NamedTuple):
    """Slope and right side of every channel's equation, K_d taken out, and which K_s are free."""

    slope: Float[Array, "site channel"]
    right: Float[Array, "site channel"]
    free: Bool[Array, "site channel"]


def solve_coloured(sums: SiteSums, prior: ColouredPrior) -> SiteMaterial:
    """Solve for K_d and K_s of every channel and site, all at least zero.

    Where neither observations nor prior tell K_s it is the prior's mean.
    """
    fixed, known = jax.lax.stop_gradient((sums, prior))
    q = jnp.asarray(known.colour_precision)
    upper, lower = _pieces(fixed, True), _pieces(fixed, False)
    # Where K_s reaches zero, and where K_d does.
    last = quotient(fixed.db, fixed.ds)
    at_zero = jnp.where(fixed.db > 0, upper.right, lower.right)
    ends = [-quotient(at_zero, q), quotient(last * (upper.slope + q) - upper.right, q)]
    ends = jnp.sort(jnp.concatenate(ends, axis=1), axis=1)
    middles = (ends[:, 1:] + ends[:, :-1]) / 2
    # One beyond either end stands for all there.
    size = 1 + jnp.abs(ends[:, -1:]) + jnp.abs(ends[:, :1])
    inside = jnp.concatenate([ends[:, :1] - size, middles, ends[:, -1:] + size], axis=1)
    below = jnp.stack([_balance(fixed, known, at) <= 0 for at in ends.T], axis=1)
    piece = jnp.sum(below, axis=1, keepdims=True)
    active, free = _active(fixed, known, jnp.take_along_axis(inside, piece, axis=1)[:, 0])
    parts = _pieces(sums, active)
    ks = _of_level(parts._replace(free=free), prior, _level(parts._replace(free=free), prior))
    kd = quotient(sums.db - sums.ds * ks, sums.dd)
    return SiteMaterial(jnp.maximum(kd, 0), jnp.maximum(ks, 0))


def coloured_errors(sums: SiteSums, prior: ColouredPrior) -> tuple[SiteMaterial, ColouredSpread]:
    """Compute the standard errors of K_d and K_s, and the variances of level and colour.

    They ignore the bounds, and are what ``site_errors`` says of one K_s.
    """
    q, channels = jnp.asarray(prior.colour_precision), sums.dd.shape[1]
    slope = _pieces(sums, True).slope
    whole = slope + q
    of_level = jnp.asarray(prior.precision) + jnp.sum(quotient(q * slope, whole), axis=1)
    known = of_level > 0
    level = jnp.where(known, quotient(jnp.ones_like(of_level), of_level), 0)
    follows = quotient(q * jnp.ones_like(slope), whole)
    alone = quotient(jnp.ones_like(slope), whole)
    variance = alone + follows**2 * level[:, None]
    known = (slope > 0) | (known[:, None] & (q > 0))
    ks_variance = jnp.where(known, variance, jnp.inf)
    most = jnp.where(sums.ds > 0, quotient(sums.db, sums.ds), 1)
    # The mean square of what is uniform from 0, where it is taken to be.
    through = jnp.where(known, variance, jnp.clip(most, 0, 1) ** 2 / 3)
    ratio = quotient(sums.ds, sums.dd)
    kd_variance = 1 / jnp.where(sums.dd > 0, sums.dd, 1) + ratio**2 * through
    kd_variance = jnp.where(sums.dd > 0, kd_variance, jnp.inf)
    of_mean = jnp.mean(alone, axis=1) / channels + jnp.mean(follows, axis=1) ** 2 * level
    rest = (jnp.mean(variance, axis=1) - of_mean) * channels / max(channels - 1, 1)
    every = jnp.all(known, axis=1)
    spread = ColouredSpread(*(jnp.where(every, part, jnp.inf) for part in (of_mean, rest)))
    return SiteMaterial(jnp.sqrt(kd_variance), jnp.sqrt(ks_variance)), spread


def _pieces(sums: SiteSums, active: Bool[Array, "site channel"] | bool) -> _Pieces:
    """Take K_d out of the equations of the channels where it is ``active``."""
    slope = sums.ss - jnp.where(active, quotient(sums.ds**2, sums.dd), 0)
    right = sums.sb - jnp.where(active, quotient(sums.ds * sums.db, sums.dd), 0)
    told = slope > ROUNDING[slope.dtype.name] * sums.ss
    return _Pieces(jnp.where(told, slope, 0), jnp.where(told, right, 0), told)


def _of_level(
    parts: _Pieces, prior: ColouredPrior, level: Float[Array, "site"]
) -> Float[Array, "site channel"]:
    """Solve for K_s of free channels at a level; that itself where nothing else is known."""
    q = jnp.asarray(prior.colour_precision)
    whole, right = parts.slope + q, parts.right + q * level[:, None]
    ks = jnp.where(whole > 0, quotient(right, whole), level[:, None])
    return jnp.where(parts.free, ks, 0)


def _level(parts: _Pieces, prior: ColouredPrior) -> Float[Array, "site"]:
    p, q = jnp.asarray(prior.precision), jnp.asarray(prior.colour_precision)
    share = quotient(q * jnp.ones_like(parts.slope), parts.slope + q)
    slope = p + jnp.sum(jnp.where(parts.free, share * parts.slope, q), axis=1)
    right = p * prior.mean + jnp.sum(jnp.where(parts.free, share * parts.right, 0), axis=1)
    return jnp.where(slope > 0, quotient(right, slope), prior.mean)


def _active(
    sums: SiteSums, prior: ColouredPrior, level: Float[Array, "site"]
) -> tuple[Bool[Array, "site channel"], Bool[Array, "site channel"]]:
    """Say which K_d and which K_s are above zero at a level."""
    every = jnp.ones(sums.dd.shape, bool)
    with_kd = _of_level(_pieces(sums, True)._replace(free=every), prior, level)
    active = sums.db - sums.ds * jnp.maximum(with_kd, 0) > 0
    ks = jnp.where(
        active, with_kd, _of_level(_pieces(sums, False)._replace(free=every), prior, level)
    )
    return active, ks > 0


def _balance(
    sums: SiteSums, prior: ColouredPrior, level: Float[Array, "site"]
) -> Float[Array, "site"]:
    """Evaluate the equation of the level."""
    active, free = _active(sums, prior, level)
    ks = _of_level(_pieces(sums, active)._replace(free=free), prior, level)
    q = jnp.asarray(prior.colour_precision)
    return jnp.asarray(prior.precision) * (level - prior.mean) + q * jnp.sum(
        level[:, None] - ks, axis=1
    )
