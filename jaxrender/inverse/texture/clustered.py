"""Errors of sites that know of misfit: what a photograph leaves of a site counts together.

Least squares takes what is left of each observation to be noise of its own.  A wrong exposure or
pose leaves the same of all of a site's observations in one photograph, which moves its K_d and K_s
by their sum.  With M the matrix of a site's system, M_g that of photograph g, and s_g the sum of
its weighted columns times what is left, K_d or K_s moves by q_g = v . s_g, v being its row of the
inverse of M.  If all were noise, q_g^2 would be

    v' (M_g - M_g M^-1 M_g) v

on average: the second part is what the fit has taken of it (Bell and McCaffrey 2002).  How far the
sum of all q_g^2 exceeds the sum of these is how much larger the variance is than noise makes it.
Of one site that is a few numbers' chance; so each is drawn to what all sites show, as Smyth (2004)
does with variances: as far as the sites agree better than chance.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq
from scipy.special import polygamma, psi
from scipy.stats import t as student

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture.coloured_sites import ColouredPrior, KsPrior
from jaxrender.inverse.texture.measurements import SiteData, SiteObservations, in_chunks
from jaxrender.inverse.texture.site_sums import SiteSums, site_sums
from jaxrender.inverse.texture.site_systems import SpecularPrior, eliminated
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float, Int

_PERCENT_95 = 0.95
# Keeps a matrix of K_d and K_s that cannot be told apart from being singular.
_ROUNDING = 1e-12
_NORMAL_95 = 1.6448536269514722
# Fewer degrees of freedom of a site say nothing of it, and fewer sites nothing of their spread.
_LEAST_FREEDOM, _FEWEST_SITES = 1.9, 10
# The widest and narrowest spread of the sites' excesses that is looked for, in degrees of freedom.
_FREEDOMS = (1.0, 1e4)


class Groups(NamedTuple):
    """The group of each observation, one for each site and photograph, and the site of each."""

    of_sample: Int[AnyArray, "sample"]
    site: Int[AnyArray, "group"]

    @classmethod
    def of(cls, site: Int[np.ndarray, "sample"], frame: Int[np.ndarray, "sample"]) -> "Groups":
        """Number the runs of one site and one photograph; as many groups as observations."""
        new = np.ones(len(site), bool)
        new[1:] = (np.diff(site) != 0) | (np.diff(frame) != 0)
        number = np.cumsum(new) - 1
        of_group = np.zeros(len(site), int)
        of_group[: number[-1] + 1] = site[new]
        return cls(number, of_group)


class Excess(NamedTuple):
    """What K_d (the mean of its channels) and K_s of each site show, beside what noise would.

    Where a site has numbers of its own, these take the place of K_s (``by_matrices``).

    ``shown`` is the sum of q_g^2 over the photographs, ``expected`` that of noise, both beside the
    site's own variance; ``squares`` is the sum of the squares of what is expected.
    """

    shown: Float[AnyArray, "site kind"]
    expected: Float[AnyArray, "site kind"]
    squares: Float[AnyArray, "site kind"]


def excess_of(
    data: SiteData,
    columns: Columns,
    left: Float[AnyArray, "sample channel"],
    groups: Groups,
    sums: SiteSums,
    prior: KsPrior,
) -> Excess:
    """Compare what the photographs leave of each site together with what noise would."""
    if isinstance(prior, ColouredPrior):
        return _coloured_excess(data, columns, left, groups, sums, prior)
    assert isinstance(prior, SpecularPrior)
    squares, channels = jnp.asarray(data.weights) ** 2, left.shape[1]
    diffuse, specular = columns.diffuse, columns.specular
    site, count = jnp.asarray(groups.site), len(groups.site)

    def gathered(values: Float[Array, "sample *rest"]) -> Float[Array, "group *rest"]:
        return jax.ops.segment_sum(
            values, jnp.asarray(groups.of_sample), num_segments=count, indices_are_sorted=True
        )

    products = (diffuse**2, diffuse * specular, specular**2, diffuse * left, specular * left)
    every = gathered(jnp.stack([squares * part for part in products], axis=1))
    dd, ds, ss, score_d, score_s = (every[:, k] for k in range(len(products)))
    ss, score_s = jnp.sum(ss, axis=1), jnp.sum(score_s, axis=1)
    slope, ratio = eliminated(sums, prior)
    inverse_dd = jnp.where(sums.dd > 0, 1 / jnp.where(sums.dd > 0, sums.dd, 1), 0)
    inverse_slope = jnp.where(slope > 0, 1 / jnp.where(slope > 0, slope, 1), 0)
    # Rows of the inverse: those of K_d by channel, then that of K_s.
    of_ks = jnp.concatenate([-ratio, jnp.ones((len(ratio), 1))], axis=1) * inverse_slope[:, None]
    diagonal = jnp.einsum("sc,cd->scd", inverse_dd, jnp.eye(channels))
    of_kd = diagonal - ratio[:, None, :] * of_ks[:, :-1, None]
    rows = jnp.concatenate([of_kd, of_ks[:, None, :-1]], axis=1)
    own = jnp.concatenate([jnp.diagonal(of_kd, axis1=1, axis2=2), inverse_slope[:, None]], axis=1)
    u, t = rows[site], of_ks[site]
    moved = jnp.sum(u * score_d[:, None, :], axis=2) + t * score_s[:, None]
    along = dd[:, None, :] * u + ds[:, None, :] * t[..., None]
    across = jnp.sum(ds[:, None, :] * u, axis=2) + ss[:, None] * t
    mixed = ratio[site][:, None, :]
    lost = (across - jnp.sum(mixed * along, axis=2)) * inverse_slope[site][:, None]
    taken = inverse_dd[site][:, None, :] * along - mixed * lost[..., None]
    noise = jnp.sum(u * along, axis=2) + t * across
    noise = noise - jnp.sum(along * taken, axis=2) - across * lost
    scale = jnp.where(own > 0, 1 / jnp.where(own > 0, own, 1), 0)[site]

    def both(values: Float[Array, "group unknown"]) -> Float[Array, "group 2"]:
        """Average over the channels of K_d; K_s is one."""
        scaled = values * scale
        return jnp.stack([jnp.mean(scaled[:, :-1], axis=1), scaled[:, -1]], axis=1)

    expected = jnp.maximum(both(noise), 0)

    def of_site(values: Float[Array, "group 2"]) -> Float[Array, "site 2"]:
        return jax.ops.segment_sum(values, site, num_segments=len(slope))

    return Excess(of_site(both(moved**2)), of_site(expected), of_site(expected**2))


def _coloured_excess(
    data: SiteData,
    columns: Columns,
    left: Float[AnyArray, "sample channel"],
    groups: Groups,
    sums: SiteSums,
    prior: ColouredPrior,
) -> Excess:
    """Do the same where K_s has a colour, by whole matrices; K_s counts as the mean of channels."""
    channels, site, count = left.shape[1], jnp.asarray(groups.site), len(groups.site)
    each = jnp.eye(channels)

    def blocks(dd: Float[Array, "any channel"], ds, ss) -> Float[Array, "any both both"]:
        """Lay the products of every channel out as a matrix of K_d and K_s."""
        rows = [[dd, ds], [ds, ss]]
        whole = [[jnp.einsum("sc,cd->scd", part, each) for part in row] for row in rows]
        return jnp.concatenate([jnp.concatenate(row, axis=-1) for row in whole], axis=-2)

    squares = jnp.asarray(data.weights) ** 2
    diffuse, specular = columns.diffuse, columns.specular
    products = (diffuse**2, diffuse * specular, specular**2, diffuse * left, specular * left)
    every = jax.ops.segment_sum(
        jnp.stack([squares * part for part in products], axis=1),
        jnp.asarray(groups.of_sample),
        num_segments=count,
        indices_are_sorted=True,
    )
    matrix = blocks(sums.dd, sums.ds, sums.ss)
    matrix = matrix.at[:, channels:, channels:].add(prior.matrix(channels)[None])
    told = jnp.diagonal(matrix, axis1=1, axis2=2) > 0
    size = jnp.sqrt(jnp.where(told, jnp.diagonal(matrix, axis1=1, axis2=2), 1))
    scale = size[:, :, None] * size[:, None, :]
    # Scaled to ones along the diagonal, as what was not measured is.
    even = matrix / scale + jnp.where(told, _ROUNDING, 1)[:, :, None] * jnp.eye(2 * channels)[None]
    inverse = jnp.where(told[:, :, None] & told[:, None, :], jnp.linalg.inv(even) / scale, 0)
    of_group = blocks(every[:, 0], every[:, 1], every[:, 2])
    scores = jnp.concatenate([every[:, 3], every[:, 4]], axis=1)

    def both(values: Float[Array, "group unknown"]) -> Float[Array, "group 2"]:
        parts = jnp.split(values, 2, axis=1)
        return jnp.stack([jnp.mean(part, axis=1) for part in parts], axis=1)

    return by_matrices(of_group, scores, inverse, site, both)


def by_matrices(
    of_group: Float[Array, "group unknown unknown"],
    scores: Float[Array, "group unknown"],
    inverse: Float[Array, "site unknown unknown"],
    site: Int[Array, "group"],
    gathered: Callable[[Float[Array, "group unknown"]], Float[Array, "group kind"]],
) -> Excess:
    """Do the same by the matrix and the score of each group; ``gathered`` averages unknowns."""
    v = inverse[site]
    moved = jnp.einsum("gij,gj->gi", v, scores)
    along = of_group @ v
    noise = jnp.einsum("gij,gji->gi", v, along) - jnp.einsum("gji,gjk,gki->gi", along, v, along)
    own = jnp.diagonal(inverse, axis1=1, axis2=2)
    unit = jnp.where(own > 0, 1 / jnp.where(own > 0, own, 1), 0)[site]
    expected = jnp.maximum(gathered(noise * unit), 0)
    summed = (gathered(moved**2 * unit), expected, expected**2)
    return Excess(*(jax.ops.segment_sum(part, site, num_segments=len(own)) for part in summed))


def excess_of_surface(
    measured: SiteObservations,
    columns: Columns,
    left: Float[np.ndarray, "observation channel"],
    noise: NoiseModel,
    chunk: int,
) -> Excess:
    """Do the same for a whole surface, so many observations at once.

    ``columns`` and what is ``left`` are of the observations that ``measured`` sorts by site.
    """
    found = Excess(*(np.zeros((measured.count, 2)) for _ in Excess._fields))
    for part, sites, filled in in_chunks(measured, min(chunk, len(measured.site))):
        off, channels = left[part.index], part.radiance.shape[1]
        own = Columns(*(np.asarray(at)[part.index] for at in (columns.diffuse, columns.specular)))
        deviation = np.asarray(noise.standard_deviation(np.maximum(part.radiance - off, 0)))
        weights = np.where(filled, 0, np.sqrt(part.share))[:, None] / np.maximum(deviation, 1e-12)
        data = SiteData(part.radiance, weights * np.ones(channels), part.site, part.count)
        groups = Groups.of(part.site, part.clusters.photograph)
        for whole, some in zip(found, _excess(data, own, off, groups), strict=True):
            whole[sites] = np.asarray(some)[: len(sites)]
    return found


@stored(effort="less")
def _excess(
    data: SiteData, columns: Columns, left: Float[AnyArray, "sample channel"], groups: Groups
) -> Excess:
    columns = columns.map(jnp.asarray)
    none = SpecularPrior(np.zeros(()), np.zeros(()))
    with jax.default_matmul_precision("highest"):
        return excess_of(data, columns, left, groups, site_sums(data, columns), none)


def widening(excess: Excess) -> Float[np.ndarray, "site kind"]:
    """Say by what factor the errors of each site's K_d and K_s are larger than noise makes them.

    Never below 1.  It includes that of Student's distribution where little is known.
    """
    parts = [np.asarray(part, float) for part in excess]
    kinds = range(parts[0].shape[1])
    return np.stack([_widening(*(part[:, k] for part in parts)) for k in kinds], axis=1)


def _widening(
    shown: Float[np.ndarray, "site"],
    expected: Float[np.ndarray, "site"],
    squares: Float[np.ndarray, "site"],
) -> Float[np.ndarray, "site"]:
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = np.nan_to_num(expected**2 / squares)
        ratio = np.nan_to_num(shown / expected)
    told = (freedom > _LEAST_FREEDOM) & (ratio > 0)
    if np.count_nonzero(told) < _FEWEST_SITES:
        return np.ones(len(shown))
    typical, of_all = _of_all(ratio[told], freedom[told])
    known = np.where(told, freedom, 0)
    variance = (of_all * typical + known * np.where(told, ratio, 0)) / (of_all + known)
    tail = student.ppf(_PERCENT_95, of_all + known) / _NORMAL_95
    return np.maximum(np.sqrt(variance) * tail, 1)


def _of_all(
    ratio: Float[np.ndarray, "site"], freedom: Float[np.ndarray, "site"]
) -> tuple[float, float]:
    """Find the typical excess, and the degrees of freedom that its spread over the sites leaves.

    The logarithm of an excess of chance alone has a known mean and variance (Smyth 2004, 6).
    """
    half = freedom / 2
    level = np.log(ratio) - psi(half) + np.log(half)
    spread = float(np.var(level, ddof=1) - np.mean(polygamma(1, half)))
    low, high = (float(polygamma(1, f / 2)) for f in _FREEDOMS[::-1])
    if spread <= low:
        return float(np.exp(np.mean(level))), _FREEDOMS[1]
    wanted = min(spread, high)
    most, fewest = (float(f) / 2 for f in _FREEDOMS)
    found = float(np.asarray(brentq(lambda h: polygamma(1, h) - wanted, most, fewest)))
    return float(np.exp(np.mean(level) + psi(found) - np.log(found))), 2 * found
