"""The equations of a site's K_d, K_s and numbers: chi-squared with its derivatives.

For given numbers of a site its K_d and K_s are the exact solution of a small system, and follow
where the numbers go.  What the numbers are expected to be counts as one more observation of each.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import block_diag

from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.texture.clustered import Excess, Groups, by_matrices
from jaxrender.inverse.texture.coloured_sites import KsPrior
from jaxrender.inverse.texture.measurements import SiteData
from jaxrender.inverse.texture.search import predicted
from jaxrender.inverse.texture.site_numbers import NUMBERS
from jaxrender.inverse.texture.site_sums import SiteMaterial, by_channel, over_sites, site_sums
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float


class Expected(NamedTuple):
    """What is expected of each number of a site beforehand: its mean, and 1 / variance.

    The same of every site, or of each its own.
    """

    mean: Float[np.ndarray, "*site number"]
    precision: Float[np.ndarray, "*site number"]


class SiteEquations(NamedTuple):
    """Chi-squared of every site with its derivatives: half the slope, and the normal matrix.

    The unknowns of a site are K_d, K_s (of each channel where it has a colour, none where it is
    known) and its numbers.
    """

    cost: Float[AnyArray, "site"]
    gradient: Float[AnyArray, "site unknown"]
    matrix: Float[AnyArray, "site unknown unknown"]
    material: SiteMaterial


class Common(NamedTuple):
    """The normal equations of what all sites share, and what each observation says of it."""

    matrix: Float[AnyArray, "shared shared"]
    gradient: Float[AnyArray, "shared"]
    scores: Float[AnyArray, "sample shared"]


@stored(effort="less")
def chi_squared(
    near: LinearisedModel,
    data: SiteData,
    prior: KsPrior,
    expected: Expected,
    value: Float[AnyArray, "site number"],
) -> tuple[Float[Array, "site"], Float[Array, "sample channel"]]:
    """Evaluate chi-squared of every site, and predict its observations."""
    with jax.default_matmul_precision("highest"):
        material = prior.solve(site_sums(data, near.at))
        foreseen = predicted(material, near.at, data)
        return _squares(data, foreseen, material, prior, expected, value), foreseen


@stored(effort="less")
def equations_of(
    near: LinearisedModel,
    data: SiteData,
    prior: KsPrior,
    expected: Expected,
    value: Float[AnyArray, "site number"],
    names: tuple[str, ...],
) -> tuple[SiteEquations, Float[Array, "sample channel"]]:
    """Evaluate chi-squared of every site with its derivatives, and predict its observations."""
    with jax.default_matmul_precision("highest"):
        material = prior.solve(site_sums(data, near.at))
        foreseen = predicted(material, near.at, data)
        jacobian = _jacobian(near, data, material, prior, names)
        weighted = jnp.asarray(data.weights)[..., None] * jacobian
        left = jnp.asarray(data.weights) * (data.radiance - foreseen)
        matrix = over_sites(jnp.einsum("sci,scj->sij", weighted, weighted), data)
        gradient = over_sites(jnp.einsum("sci,sc->si", weighted, left), data)
        gradient, matrix, _ = _held(gradient, matrix, material, prior, expected, value)
        cost = _squares(data, foreseen, material, prior, expected, value)
    return SiteEquations(cost, gradient, matrix, material), foreseen


@stored(effort="less")
def excess_of_numbers(
    near: LinearisedModel,
    data: SiteData,
    prior: KsPrior,
    names: tuple[str, ...],
    groups: Groups,
    inverse: Float[AnyArray, "site unknown unknown"],
) -> Excess:
    """Compare what photographs leave of a site together with noise.

    Kinds are the mean of K_d, that of a K_s that is not known, and each number.  ``inverse`` is of
    ``SiteEquations.matrix``; an unknown of which it knows nothing (0) shows nothing.
    """
    site = jnp.asarray(groups.site)
    with jax.default_matmul_precision("highest"):
        material = prior.solve(site_sums(data, near.at))
        left = jnp.asarray(data.weights) * (data.radiance - predicted(material, near.at, data))
        jacobian = _jacobian(near, data, material, prior, names)
        weighted = jnp.asarray(data.weights)[..., None] * jacobian
        parts = (
            jnp.einsum("sci,scj->sij", weighted, weighted),
            jnp.einsum("sci,sc->si", weighted, left),
        )
        of_group, scores = (
            jax.ops.segment_sum(
                part, jnp.asarray(groups.of_sample), len(site), indices_are_sorted=True
            )
            for part in parts
        )
        channels = left.shape[1]
        of_ks = prior.amplitudes(channels)

        def gathered(values: Float[Array, "group unknown"]) -> Float[Array, "group kind"]:
            kd, ks, own = jnp.split(values, [channels, channels + of_ks], axis=1)
            means = [jnp.mean(part, axis=1, keepdims=True) for part in (kd, ks) if part.shape[1]]
            return jnp.concatenate([*means, own], axis=1)

        return by_matrices(of_group, scores, jnp.asarray(inverse), site, gathered)


@stored(effort="less")
def common_equations(
    near: LinearisedModel,
    data: SiteData,
    prior: KsPrior,
    expected: Expected,
    value: Float[AnyArray, "site number"],
    names: tuple[str, ...],
    chain: Float[AnyArray, "name shared"],
) -> Common:
    """Write down a part of the equations of what all sites share, whose names come last.

    ``chain`` are their derivatives by the search variables.
    """
    with jax.default_matmul_precision("highest"):
        material = prior.solve(site_sums(data, near.at))
        foreseen = predicted(material, near.at, data)
        every = _jacobian(near, data, material, prior, names)
        weights = jnp.asarray(data.weights)
        own, others = jnp.split(every, [every.shape[2] - len(chain)], axis=2)
        own, others = weights[..., None] * own, weights[..., None] * (others @ chain)
        left = weights * (data.radiance - foreseen)
        matrix = over_sites(jnp.einsum("sci,scj->sij", own, own), data)
        gradient = over_sites(jnp.einsum("sci,sc->si", own, left), data)
        across = over_sites(jnp.einsum("sci,scj->sij", own, others), data)
        _, matrix, free = _held(gradient, matrix, material, prior, expected, value)
        across = jnp.where(free[..., None], across, 0)
        answer = -jnp.linalg.solve(matrix, across)
        rest = others + jnp.einsum("sci,sij->scj", own, answer[jnp.asarray(data.site)])
        scores = jnp.einsum("scj,sc->sj", rest, left)
        return Common(jnp.einsum("sci,scj->ij", rest, others), jnp.sum(scores, axis=0), scores)


def _squares(
    data: SiteData,
    foreseen: Float[Array, "sample channel"],
    material: SiteMaterial,
    prior: KsPrior,
    expected: Expected,
    value: Float[AnyArray, "site number"],
) -> Float[Array, "site"]:
    left = jnp.asarray(data.weights) * (data.radiance - foreseen)
    off = jnp.asarray(value) - jnp.atleast_2d(jnp.asarray(expected.mean))
    held = jnp.sum(jnp.atleast_2d(jnp.asarray(expected.precision)) * off**2, axis=1)
    held = held + prior.held(jnp.asarray(material.ks))
    return jnp.sum(over_sites(left**2, data), axis=1) + held


def _held(
    gradient: Float[Array, "site unknown"],
    matrix: Float[Array, "site unknown unknown"],
    material: SiteMaterial,
    prior: KsPrior,
    expected: Expected,
    value: Float[AnyArray, "site number"],
) -> tuple[
    Float[Array, "site unknown"],
    Float[Array, "site unknown unknown"],
    Bool[Array, "site unknown"],
]:
    """Add what is expected, and hold what is at zero or was not measured; say what is free."""
    kd = jnp.asarray(material.kd)
    sites, channels = kd.shape
    ks = by_channel(jnp.asarray(material.ks))[:, : prior.amplitudes(channels)]
    off = jnp.asarray(value) - jnp.atleast_2d(jnp.asarray(expected.mean))
    precision = jnp.broadcast_to(jnp.atleast_2d(jnp.asarray(expected.precision)), off.shape)
    of_ks = [prior.matrix(channels)] if ks.shape[1] else []
    together = block_diag(jnp.zeros((channels, channels)), *of_ks)
    below = jnp.concatenate([jnp.zeros((sites, channels)), ks - jnp.asarray(prior.mean)], axis=1)
    gradient = gradient - jnp.concatenate([below @ together, precision * off], axis=1)
    own = jnp.concatenate([jnp.zeros((sites, len(together))), precision], axis=1)
    numbers = jnp.zeros(off.shape[1:] * 2)
    matrix = matrix + block_diag(together, numbers)[None] + jax.vmap(jnp.diag)(own)
    free = jnp.concatenate([kd > 0, ks > 0, jnp.ones(off.shape, bool)], axis=1)
    free = free & (jnp.diagonal(matrix, axis1=1, axis2=2) > 0)
    pairs = free[:, :, None] & free[:, None, :]
    return (
        jnp.where(free, gradient, 0),
        jnp.where(pairs, matrix, jnp.eye(matrix.shape[1])[None]),
        free,
    )


def _jacobian(
    near: LinearisedModel,
    data: SiteData,
    material: SiteMaterial,
    prior: KsPrior,
    names: tuple[str, ...],
) -> Float[Array, "sample channel unknown"]:
    """Line up the derivatives by K_d of each channel, by a free K_s, and by the numbers named."""
    site = jnp.asarray(data.site)
    kd, ks = jnp.asarray(material.kd)[site], by_channel(jnp.asarray(material.ks)[site])
    channels = kd.shape[1]
    of_ks = prior.amplitudes(channels)
    amplitudes = (kd, jnp.broadcast_to(ks, kd.shape))
    by_kd = near.at.diffuse[:, :, None] * jnp.eye(channels)[None]
    by_ks = near.at.specular[:, :, None]
    # One K_s goes through all channels.
    columns = [by_kd]
    if of_ks:
        columns.append(by_ks if of_ks == 1 else by_ks * jnp.eye(channels)[None])
    for name in names:
        slopes = zip(near.at.shaped, near.slopes[name])
        slope = sum((amplitudes[place] * part for place, part in slopes), jnp.zeros_like(kd))
        # Those of sites vary, and what all sites share is searched by variables of its own.
        own = name in NUMBERS and jnp.ndim(near.numbers[name])
        if own and NUMBERS[name].logarithmic:
            slope = slope * near.numbers[name][:, None]
        columns.append(slope[:, :, None])
    return jnp.concatenate(columns, axis=2)
