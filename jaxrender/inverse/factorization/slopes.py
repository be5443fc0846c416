"""Derivatives of a prediction by everything that is not linear: shares, lobe, directions."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxrender.geometry import world_from_local
from jaxrender.inverse.factorization.response import Columns, Guess, Response, specular_share
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float


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


@stored(jax.jit, effort="less")
def lobe_slopes(response: Response, guess: Guess) -> Lobe:
    """Evaluate what the lobe passes on and differentiate it by log sigma and log(mu - 1).

    A program by itself, because several others need the same.
    """

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
