"""Light and texture of a diffuse object, both unknown (T 6.1.1, class 6).

    B(x) = T(x) E(n),   E(n) = sum_lm A_l L_lm Y_lm(n)

**What is not identifiable.**  For any light E' > 0, T' = B / E' explains the photographs as well.
Where the object rests in one light, T is known only up to a factor.  That factor depends on the
normal alone and has no degrees above those of E.  So the ratio of two sites of one normal is known,
and so is what varies faster than the surface curves.  The scale of each channel is never known.
Where the object turns in the light, sites are seen under several normals.  The ratios E(n) / E(n')
are then measured, and everything but the scale is identifiable.

**What is returned.**  A stated prior picks one member of the family.  It expects log T of least
variance, or of least total variation between neighbouring sites, as paint of few colours has.  It
expects a light whose coefficients fall off with the degree.  The family is returned as well, as
``directions`` of the light, each with what the photographs alone say about it.

Each channel is a problem of its own; its scale is set by the texture's geometric mean.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import eigh

from jaxrender.harmonics import degrees, real_basis
from jaxrender.inverse.solvers import least_squares
from jaxrender.inverse.texture.measurements import SiteObservations
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int
from jaxrender.spectra import lambertian_transfer

PRIORS = ("variance", "total-variation")
# Irradiance is kept above about this part of its mean by a smooth floor.
_DARKEST = 0.02
# Rounds of reweighting towards total variation, and the difference of log T that counts as none.
_ROUNDS, _SMALLEST_STEP = 12, 1e-2
# A coefficient of degree l is expected to be about this / (l + 1) of L_00.
_LIGHT_SPREAD = 2.0
# The texture's own spread, as the prior takes it, in log T.
_TEXTURE_SPREAD = 0.5
# A direction of the light is identifiable where a change of E by 1 has a standard error below this.
IDENTIFIABLE_BELOW = 0.05


class DiffuseProblem(NamedTuple):
    """Observations of a diffuse object, and what each coefficient of the light adds to each.

    ``basis`` is A_l Y_lm(n), or transfer vectors (T 6.10); ``log_error`` the standard error of the
    logarithm of each radiance.  ``pairs`` are neighbouring sites.
    """

    measured: SiteObservations
    basis: Float[np.ndarray, "sample coefficient"]
    log_error: Float[np.ndarray, "sample channel"]
    pairs: Int[np.ndarray, "pair 2"]


class DiffuseFactors(NamedTuple):
    """The light and texture that the prior picks, and the family of equally good answers.

    ``texture`` is NaN at unseen sites.  ``directions`` are changes of each channel's light that
    change log E by 1 (rms over the observations); ``direction_errors`` how well the photographs
    alone tell the amount of each (infinite: not at all).
    """

    light: Float[np.ndarray, "coefficient channel"]
    texture: Float[np.ndarray, "site channel"]
    directions: Float[np.ndarray, "channel direction coefficient"]
    direction_errors: Float[np.ndarray, "channel direction"]
    converged: bool

    @property
    def unidentifiable(self) -> Bool[np.ndarray, "channel direction"]:
        """The directions along which light and texture cannot be told apart."""
        return ~(self.direction_errors < IDENTIFIABLE_BELOW)

    def moved(self, amounts: Float[AnyArray, "channel direction"]):
        """Move the light along the directions: another light, with ``texture_under`` its texture.

        The photographs object only as far as ``direction_errors`` say.
        """
        return self.light + np.einsum("cdk,cd->kc", self.directions, np.asarray(amounts))


def diffuse_problem(
    measured: SiteObservations,
    normals: Float[AnyArray, "sample 3"],
    pairs: Int[np.ndarray, "pair 2"],
    band_limit: int = 2,
    noise: tuple[float, float] = (0.01, 0.0),
    pose: Int[np.ndarray, "sample"] | None = None,
) -> DiffuseProblem:
    """Set the problem up for a convex object under one light.

    ``normals`` are those of all observations (``measured.index`` points into them); of an object
    that turns, in the frame of the light, and ``pose`` then numbers its poses.  The observations of
    a site in one pose count as one place: how the surface turns *within* a texel would tell of the
    light only if its paint were perfectly even.  ``noise`` is the relative and the absolute part of
    the noise.  Raises ``ValueError`` where nothing is brighter than the noise.
    """
    bright = (measured.radiance > 3 * noise[1]).all(axis=1) & (measured.radiance > 0).all(axis=1)
    if not bright.any():
        raise ValueError("no observation is brighter than the noise: there is no light to find")
    measured = measured.take(np.asarray(bright))
    rows = jnp.asarray(np.asarray(normals)[measured.index])
    each = lambertian_transfer(band_limit)[degrees(band_limit)]
    basis = np.asarray(real_basis(rows, band_limit)) * each[None, :]
    place = measured.site if pose is None else measured.site + measured.count * pose[measured.index]
    basis = _means(basis, np.unique(place, return_inverse=True)[1])
    error = np.hypot(noise[0], noise[1] / measured.radiance)
    return DiffuseProblem(measured, basis, np.maximum(error, 1e-6), pairs)


def factor_diffuse(
    problem: DiffuseProblem, prior: str = "total-variation", mean_albedo: float = 0.18
) -> DiffuseFactors:
    """Find the light and the texture that the prior picks, and the family about them.

    The geometric mean of K_d over the sites is ``mean_albedo`` / pi in each channel.  Raises
    ``ValueError`` for a prior that is not in ``PRIORS``, or total variation without neighbours.
    """
    if prior not in PRIORS:
        raise ValueError(f"prior={prior!r}: choose one of {', '.join(PRIORS)}")
    if prior == "total-variation" and not len(problem.pairs):
        raise ValueError("total variation needs pairs of neighbouring sites: none are given")
    channels = range(problem.measured.radiance.shape[1])
    lights, converged = zip(*(_solve_channel(problem, channel, prior) for channel in channels))
    light = np.stack(lights, axis=1)
    texture = texture_under(problem, light)
    scale = np.exp(np.nanmean(np.log(texture), axis=0)) * np.pi / mean_albedo
    light, texture = light * scale, texture / scale
    families = [_family(problem, light[:, channel], channel) for channel in channels]
    directions, errors = (np.stack(parts) for parts in zip(*families))
    return DiffuseFactors(light, texture, directions, errors, all(converged))


def texture_under(
    problem: DiffuseProblem, light: Float[AnyArray, "coefficient channel"]
) -> Float[np.ndarray, "site channel"]:
    """Compute T = B / E for any light: the texture that goes with it, NaN where unseen or E <= 0.

    Of several observations of a site the mean of the logarithms, weighted by their noise.
    """
    measured = problem.measured
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(measured.radiance) - np.log(problem.basis @ np.asarray(light))
        logs = np.where(np.isfinite(logs), logs, np.nan)
        weights = problem.log_error**-2
        sums = [
            np.stack([np.bincount(measured.site, c, measured.count) for c in part.T], axis=1)
            for part in (weights * logs, weights)
        ]
        return np.exp(sums[0] / sums[1])


def _means(
    values: Float[np.ndarray, "sample k"], group: Int[np.ndarray, "sample"]
) -> Float[np.ndarray, "sample k"]:
    """Replace each row by the mean of its group."""
    sums = np.stack([np.bincount(group, column) for column in values.T], axis=1)
    return (sums / np.bincount(group)[:, None])[group]


class _Channel(NamedTuple):
    """One channel as the solver sees it; sites numbered anew."""

    log_radiance: Float[Array, "sample"]
    weights: Float[Array, "sample"]
    basis: Float[Array, "sample coefficient"]
    site: Int[Array, "sample"]
    site_weights: Float[Array, "site"]
    pairs: Int[Array, "pair 2"]
    pair_weights: Float[Array, "pair"]
    spread: Float[Array, "site"]


def _solve_channel(
    problem: DiffuseProblem, channel: int, prior: str
) -> tuple[Float[np.ndarray, "coefficient"], bool]:
    measured, basis = problem.measured, problem.basis
    present = np.flatnonzero(measured.seen)
    number = np.full(measured.count, -1)
    number[present] = np.arange(len(present))
    site = number[measured.site]
    weights = 1 / problem.log_error[:, channel]
    pairs = number[problem.pairs] if prior == "total-variation" else np.zeros((0, 2), int)
    pairs = pairs[(pairs >= 0).all(axis=1)]
    alone = np.full(len(present), 1 / _TEXTURE_SPREAD if prior == "variance" else 0.0)
    data = _Channel(
        jnp.log(jnp.asarray(measured.radiance[:, channel])),
        jnp.asarray(weights),
        jnp.asarray(basis),
        jnp.asarray(site),
        jnp.asarray(np.bincount(site, weights**2)),
        jnp.asarray(pairs),
        jnp.full(len(pairs), 1 / _TEXTURE_SPREAD),
        jnp.asarray(alone),
    )
    # From uniform light: all coefficients but L_00 = 1 are zero.
    point = jnp.zeros(basis.shape[1] - 1)
    for _ in range(_ROUNDS if len(pairs) else 1):
        point, means, converged = _descend(point, data)
        if len(pairs):
            step = jnp.abs(means[data.pairs[:, 0]] - means[data.pairs[:, 1]])
            weight = jax.lax.rsqrt(jnp.maximum(step, _SMALLEST_STEP) * _TEXTURE_SPREAD)
            data = data._replace(pair_weights=weight)
    return np.asarray(_light(point)), bool(converged)


@jax.jit
def _descend(
    point: Float[Array, "unknown"], data: _Channel
) -> tuple[Float[Array, "unknown"], Float[Array, "site"], Bool[Array, ""]]:
    with jax.default_matmul_precision("highest"):
        found = least_squares(lambda p, d: _residuals(p, d)[0], point, data)
        return found.point, _residuals(found.point, data)[1], found.converged


def _residuals(
    point: Float[Array, "unknown"], data: _Channel
) -> tuple[Float[Array, "residual"], Float[Array, "site"]]:
    """What the photographs, the texture's prior and the light's hold against a light."""
    mean = data.basis[0, 0]
    level = data.basis @ _light(point) / (_DARKEST * mean)
    logs = data.log_radiance - jnp.log(_DARKEST * mean * jax.nn.softplus(level))
    sums = partial(jax.ops.segment_sum, num_segments=data.site_weights.shape[0])
    means = sums(data.weights**2 * logs, data.site) / data.site_weights
    within = data.weights * (logs - means[data.site])
    across = data.pair_weights * (means[data.pairs[:, 0]] - means[data.pairs[:, 1]])
    about = data.spread * (means - jnp.mean(means))
    expected = (1 + jnp.asarray(_degree_of(data.basis.shape[1]), point.dtype)) / _LIGHT_SPREAD
    return jnp.concatenate([within, across, about, expected[1:] * point]) / 100, means


def _light(point: Float[Array, "unknown"]) -> Float[Array, "coefficient"]:
    return jnp.concatenate([jnp.ones(1, point.dtype), point])


def _degree_of(count: int) -> Int[np.ndarray, "coefficient"]:
    """The degree of each coefficient of one light."""
    return np.floor(np.sqrt(np.arange(count))).astype(int)


def _family(
    problem: DiffuseProblem, light: Float[np.ndarray, "coefficient"], channel: int
) -> tuple[Float[np.ndarray, "direction coefficient"], Float[np.ndarray, "direction"]]:
    """Find how well the photographs alone tell each change of log E, the least determined first.

    Directions diagonalise both what the photographs measure, the differences within sites, and the
    mean square change of log E.
    """
    measured = problem.measured
    irradiance = problem.basis @ light
    # Odd degrees above 1 make no irradiance, and so have no part in this.
    shown = np.abs(problem.basis).max(axis=0) > 1e-9 * np.abs(problem.basis).max()
    relative = problem.basis[:, shown]
    relative = relative / np.maximum(irradiance, _DARKEST * irradiance.mean())[:, None]
    weights = problem.log_error[:, channel] ** -2
    total = np.bincount(measured.site, weights, measured.count)
    means = np.stack(
        [np.bincount(measured.site, weights * c, measured.count) for c in relative.T], axis=1
    )
    means = means / np.where(total > 0, total, 1)[:, None]
    within = relative - means[measured.site]
    information = within.T @ (weights[:, None] * within)
    strength, vectors = eigh(information, relative.T @ relative / len(relative))
    with np.errstate(divide="ignore"):
        floor = 1e-10 * weights.sum()
        errors = np.where(strength > floor, 1 / np.sqrt(np.maximum(strength, floor)), np.inf)
    directions = np.zeros((len(errors), len(light)))
    directions[:, shown] = vectors.T
    return directions, errors
