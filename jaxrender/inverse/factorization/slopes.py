"""Derivatives of a prediction by everything that is not linear: shares, lobe, directions."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfaceSamples, world_from_local
from jaxrender.harmonics import band_limit_of
from jaxrender.inverse.factorization.response import (
    Columns,
    Guess,
    MirrorResponse,
    Response,
    lobe_of,
    specular_share,
)
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.spectra import transfer_at, transfer_table


class Lobe(NamedTuple):
    """What the lobe passes on of slow light to each sample, and its derivatives."""

    passed: Float[Array, "sample term"]
    by_sigma: Float[Array, "sample term"]
    by_mu: Float[Array, "sample term"]


class _SourceSlopes(NamedTuple):
    """Derivatives of the sources' columns: of the lobe, and of both lobes by two steps aside.

    Where sources have a variance, the derivatives by that come third.
    """

    by_lobe: Float[Array, "2 sample source"]
    aside: Columns


@stored(jax.jit, effort="least")
def tangent_frames(directions: Float[AnyArray, "source 3"]) -> Float[Array, "source 3 2"]:
    """Make two tangents of the sphere at every source."""
    return jax.vmap(world_from_local)(jnp.asarray(directions))[:, :, :2]


def lobe_slopes(parts: Sequence[Response], guess: Guess) -> list[Lobe]:
    """Evaluate what the lobe passes on and differentiate it by log sigma and log(mu - 1).

    ``parts`` are samples of one surface: what they have in common is evaluated once.
    """
    first = parts[0]
    if not isinstance(first, MirrorResponse):
        return [_integrated(part, guess) for part in parts]
    band_limit, dtype = band_limit_of(first.slow_count), first.samples.normals.dtype
    table = _tabulated(first.variant, guess.sigma, guess.mu, band_limit, dtype)
    return [_looked_up(table, part.samples) for part in parts]


@stored(partial(jax.jit, static_argnums=(3, 4)), effort="less")
def _tabulated(
    variant: Glossy,
    sigma: Float[AnyArray, ""],
    mu: Float[AnyArray, ""],
    band_limit: int,
    dtype: np.dtype,
) -> Lobe:
    """Tabulate the transfer over exit cosines, with its derivatives."""

    def passed(sigma, mu) -> Float[Array, "knot term"]:
        lobe = lobe_of(variant, sigma, mu)
        assert isinstance(lobe, Glossy)
        return transfer_table(lobe, band_limit, dtype)

    value, slopes = _value_and_slopes(passed, jnp.asarray(sigma), jnp.asarray(mu))
    return Lobe(value, *slopes)


@stored(jax.jit, effort="less")
def _looked_up(table: Lobe, samples: SurfaceSamples) -> Lobe:
    return Lobe(*(transfer_at(part, samples.exit_cosines) for part in table))


@stored(jax.jit, effort="less")
def _integrated(response: Response, guess: Guess) -> Lobe:
    """Evaluate the same where every sample has an integral of its own."""

    def passed(sigma, mu) -> Float[Array, "sample term"]:
        return response.passed(guess._replace(sigma=sigma, mu=mu))

    at = (jnp.asarray(guess.sigma), jnp.asarray(guess.mu))
    value, slopes = _value_and_slopes(passed, *at)
    return jax.lax.optimization_barrier(Lobe(value, *slopes))


def _value_and_slopes(function: Callable, *at: Float[Array, ""]) -> tuple[Array, Array]:
    """Evaluate a function of numbers and its derivatives, one after the other along a new axis."""
    steps = tuple(jnp.eye(len(at), dtype=at[0].dtype))
    along = jax.vmap(lambda *step: jax.jvp(function, at, step), out_axes=(None, 0))
    return along(*steps)


@stored(jax.jit, effort="less")
def columns_at(response: Response, guess: Guess, passed: Float[AnyArray, "sample term"]) -> Columns:
    """Evaluate both lobes' responses, of what the lobe passes on: a program by itself, too."""
    with jax.default_matmul_precision("highest"):
        return response.columns_of(jnp.asarray(passed), guess)


@stored(jax.jit, effort="less")
def prediction_slopes(
    response: Response,
    lobe: Lobe,
    guess: Guess,
    columns: Columns,
    light: Float[AnyArray, "part channel"],
) -> Float[Array, "channel sample unknown"]:
    """Differentiate every channel's prediction by every nonlinear unknown, at fixed light."""
    with jax.default_matmul_precision("highest"):
        return _prediction_slopes(response, lobe, guess, columns, jnp.asarray(light))


def _prediction_slopes(
    response: Response,
    lobe: Lobe,
    guess: Guess,
    columns: Columns,
    light: Float[Array, "part channel"],
) -> Float[Array, "channel sample unknown"]:
    share = specular_share(guess)[:, None, None]
    slow, energies = jnp.split(light, [response.slow_count])
    sources = _source_slopes(response, guess)
    by_share = share * (1 - share) * ((columns.specular - columns.diffuse) @ light).T[..., None]
    by_logit = by_share * jnp.eye(len(share), dtype=share.dtype)[:, None, :]
    by_lobe = [
        columns @ slow + towards @ energies
        for columns, towards in zip(
            response.slow_slopes(lobe.by_sigma, lobe.by_mu), sources.by_lobe
        )
    ]
    both = share * jnp.stack(by_lobe, axis=-1).swapaxes(0, 1)
    aside = (
        ((1 - share) * diffuse[None] + share * specular[None]) * energies.T[:, None, :]
        for diffuse, specular in zip(*sources.aside)
    )
    # Joined only when all are there: an element at a time, evaluated as it is joined, is slow.
    return jnp.concatenate(jax.lax.optimization_barrier([by_logit, both, *aside]), axis=2)


def _source_slopes(response: Response, guess: Guess) -> _SourceSlopes:
    """Differentiate the sources' columns: the lobe by sigma and mu, both by their own unknowns."""
    directions = jnp.asarray(guess.directions)

    def by_lobe(sigma, mu) -> Float[Array, "sample source"]:
        return response.source_specular(guess._replace(sigma=sigma, mu=mu))

    def by_directions(directions) -> Columns:
        there = guess._replace(directions=directions)
        return Columns(response.source_diffuse(there), response.source_specular(there))

    def by_variance(variance) -> Columns:
        there = guess._replace(variance=variance)
        return Columns(response.source_diffuse(there), response.source_specular(there))

    steps = jnp.moveaxis(tangent_frames(directions), -1, 0)
    aside = jax.vmap(lambda step: jax.jvp(by_directions, (directions,), (step,))[1])(steps)
    if guess.variance is not None:
        # A column depends on the variance of its own source alone.
        variance = jnp.asarray(guess.variance)
        own = jax.jvp(by_variance, (variance,), (jnp.ones_like(variance),))[1]
        aside = jax.tree.map(lambda both, one: jnp.concatenate([both, one[None]]), aside, own)
    lobe = _value_and_slopes(by_lobe, jnp.asarray(guess.sigma), jnp.asarray(guess.mu))[1]
    return jax.lax.optimization_barrier(_SourceSlopes(lobe, aside))
