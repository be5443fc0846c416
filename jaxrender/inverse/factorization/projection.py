"""The light eliminated: the normal equations of all other unknowns (variable projection).

For a guess of the nonlinear unknowns the light follows from one small linear system a channel.
M_c are the columns of channel c, V_c the derivatives of its prediction at fixed light.  W are the
squared weights, Lambda the penalty on the light.  The reduced system of the other unknowns is

H = sum_c V_c' W V_c - (M_c' W V_c)' (M_c' W M_c + Lambda)^-1 (M_c' W V_c),   g = sum_c V_c' W r_c

There are dozens of columns and thousands of samples, so that all of it costs a few matrix products,
whatever the number of parameters.  Samples are passed through twice, in ``blocks``.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxrender.geometry import world_from_local
from jaxrender.inverse.factorization.blocks import (
    SAMPLES_AT_ONCE,
    Block,
    Measured,
    Part,
    in_blocks,
    summed,
)
from jaxrender.inverse.factorization.response import Columns, Guess, Response, specular_share
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float


class Solved(NamedTuple):
    """The light that fits a guess best, what it predicts, and the penalised cost.

    ``normal`` is the Cholesky factor of each channel's normal equations.
    """

    light: Float[Array, "part channel"]
    predicted: Float[Array, "sample channel"]
    cost: Float[Array, ""]
    normal: Float[Array, "channel part part"]


class System(NamedTuple):
    """The reduced normal equations of the nonlinear unknowns at a guess.

    ``solved`` is the light of that guess; ``across`` is M' W V, of each channel.
    """

    solved: Solved
    curvature: Float[Array, "unknown unknown"]
    slope: Float[Array, "unknown"]
    across: Float[Array, "channel part unknown"]


class Scatter(NamedTuple):
    """Covariances of both sides of the equations by the noise of the samples, not by their weights.

    ``own`` is the covariance of the reduced slope, ``light`` that of each channel's equations of
    the light, ``both`` that of one with the other.
    """

    own: Float[Array, "unknown unknown"]
    light: Float[Array, "channel part part"]
    both: Float[Array, "channel part unknown"]


class Lobe(NamedTuple):
    """What the lobe passes on of slow light to each sample, and its derivatives."""

    passed: Float[Array, "sample term"]
    by_sigma: Float[Array, "sample term"]
    by_mu: Float[Array, "sample term"]


class _SourceSlopes(NamedTuple):
    """Derivatives of the sources' columns: of the lobe, and of both lobes by a step aside."""

    by_sigma: Float[Array, "sample source"]
    by_mu: Float[Array, "sample source"]
    aside: list[Columns]


@stored(jax.jit)
def solve_light(response: Response, guess: Guess, measured: Measured) -> Solved:
    """Solve for the light of every channel."""
    with jax.default_matmul_precision("highest"):
        blocks = in_blocks(response, response.passed(guess), measured, SAMPLES_AT_ONCE)
        light, normal = _solved(response, guess, measured, blocks)

        def predict(block: Block) -> Part:
            columns = _evaluated(response.of_rows(block.rows), block.lobe, guess)
            predicted = _predicted(columns, guess, light)
            return Part(_squares(block, predicted), predicted)

        misfit, predicted = summed(predict, blocks)
        rows = predicted[: len(measured.radiance)]
        return Solved(light, rows, _penalised(misfit, measured, light), normal)


@stored(partial(jax.jit, static_argnames="at_once"))
def reduced_system(
    response: Response, guess: Guess, measured: Measured, *, at_once: int = SAMPLES_AT_ONCE
) -> System:
    """Solve for the light and set up the step of everything else, ``at_once`` samples at a time."""
    with jax.default_matmul_precision("highest"):
        lobe = lobe_slopes(response, guess)
        blocks = in_blocks(response, lobe, measured, at_once)
        light, normal = _solved(response, guess, measured, blocks._replace(lobe=blocks.lobe.passed))

        def add(block: Block) -> Part:
            own = response.of_rows(block.rows)
            columns = _evaluated(own, block.lobe.passed, guess)
            predicted = _predicted(columns, guess, light)
            slopes = prediction_slopes(own, block.lobe, guess, columns, light)
            sums = []
            # One channel after the other: a batch of products is slower than each by itself.
            for k, share in enumerate(specular_share(guess)):
                weights = block.weights[:, k]
                moved = jax.lax.optimization_barrier(weights[:, None] * slopes[k])
                left = weights * (block.radiance[:, k] - predicted[:, k])
                weighted = _weighted(columns, share, weights)
                sums.append((moved.T @ moved, left @ moved, weighted.T @ moved))
            return Part((*map(jnp.stack, zip(*sums)), _squares(block, predicted)), predicted)

        (inner, slope, across, misfit), predicted = summed(add, blocks)
        projected = [
            jax.scipy.linalg.solve_triangular(factor, of_channel, lower=True)
            for factor, of_channel in zip(normal, across)
        ]
        curvature = sum(own - part.T @ part for own, part in zip(inner, projected))
        rows = predicted[: len(measured.radiance)]
        solved = Solved(light, rows, _penalised(misfit, measured, light), normal)
        return System(solved, jnp.asarray(curvature), jnp.sum(slope, axis=0), across)


@stored(jax.jit)
def scatter(
    response: Response,
    guess: Guess,
    measured: Measured,
    shares: Float[AnyArray, "sample"],
    system: System,
) -> Scatter:
    """Sum up how the noise of the samples moves the equations of ``reduced_system``.

    The squared weights of ``measured`` contain ``shares``: a sample that stands for c pixels counts
    c times, but is measured once.  So its score has c times the variance that its weight stands
    for.  What is expected of the light counts as it is.
    """
    solved = system.solved
    with jax.default_matmul_precision("highest"):
        blocks = in_blocks(response, lobe_slopes(response, guess), measured, SAMPLES_AT_ONCE)
        alone = measured._replace(weights=jnp.sqrt(jnp.asarray(shares))[:, None])
        own_shares = in_blocks(response, (), alone, SAMPLES_AT_ONCE).weights
        answers = [
            jax.scipy.linalg.cho_solve((factor, True), across)
            for factor, across in zip(solved.normal, system.across)
        ]

        def add(block: Block, share_root: Float[Array, "sample 1"]) -> Part:
            own = response.of_rows(block.rows)
            columns = _evaluated(own, block.lobe.passed, guess)
            slopes = prediction_slopes(own, block.lobe, guess, columns, solved.light)
            sums = []
            for k, share in enumerate(specular_share(guess)):
                weights = block.weights[:, k] * share_root[:, 0]
                weighted = _weighted(columns, share, weights)
                moved = weights[:, None] * slopes[k] - weighted @ answers[k]
                sums.append((moved.T @ moved, weighted.T @ weighted, weighted.T @ moved))
            return Part(tuple(map(jnp.stack, zip(*sums))))

        (own, light, both), _ = summed(add, blocks, own_shares)
        expected = jnp.asarray(measured.penalty).T
        own = jnp.sum(own, axis=0) + sum(
            answer.T @ (penalty[:, None] * answer) for penalty, answer in zip(expected, answers)
        )
        light = light + jax.vmap(jnp.diag)(expected)
        both = both - jnp.stack([p[:, None] * a for p, a in zip(expected, answers)])
        return Scatter(own, light, both)


def mixed(response: Response, guess: Guess) -> Float[Array, "channel sample part"]:
    """Weigh the lobes: what one unit of each part of the light sends to the camera."""
    columns = _evaluated(response, response.passed(guess), guess)
    share = specular_share(guess)[:, None, None]
    return jax.lax.optimization_barrier(
        (1 - share) * columns.diffuse[None] + share * columns.specular[None]
    )


def tangent_frames(directions: Float[Array, "source 3"]) -> Float[Array, "source 3 2"]:
    """Make two tangents of the sphere at every source."""
    return jax.vmap(world_from_local)(directions)[:, :, :2]


def lobe_slopes(response: Response, guess: Guess) -> Lobe:
    """Evaluate what the lobe passes on and differentiate it by log sigma and log(mu - 1)."""

    def passed(sigma, mu) -> Float[Array, "sample term"]:
        return response.passed(guess._replace(sigma=sigma, mu=mu))

    at = (jnp.asarray(guess.sigma), jnp.asarray(guess.mu))
    one, zero = jnp.ones_like(at[0]), jnp.zeros_like(at[0])
    value, by_sigma = jax.jvp(passed, at, (one, zero))
    _, by_mu = jax.jvp(passed, at, (zero, one))
    return jax.lax.optimization_barrier(Lobe(value, by_sigma, by_mu))


def prediction_slopes(
    response: Response,
    lobe: Lobe,
    guess: Guess,
    columns: Columns,
    light: Float[Array, "part channel"],
) -> list[Float[Array, "sample unknown"]]:
    """Differentiate every channel's prediction by every nonlinear unknown, at fixed light."""
    share = specular_share(guess)
    slow, energies = jnp.split(light, [response.slow_count])
    sources = _source_slopes(response, guess)
    by_share = (columns.specular - columns.diffuse) @ light
    by_sigma, by_mu = (
        response.slow_radiance(passed, slow) + towards @ energies
        for passed, towards in zip(lobe[1:], (sources.by_sigma, sources.by_mu))
    )
    found = []
    for k, of_channel in enumerate(share):
        by_logit = jnp.zeros((len(by_share), len(share)), by_share.dtype)
        by_logit = by_logit.at[:, k].set(of_channel * (1 - of_channel) * by_share[:, k])
        both = of_channel * jnp.stack([by_sigma[:, k], by_mu[:, k]], axis=1)
        aside = [
            ((1 - of_channel) * diffuse + of_channel * specular) * energies[None, :, k]
            for diffuse, specular in sources.aside
        ]
        # Joined only when all are there: an element at a time, evaluated as it is joined, is slow.
        parts = jax.lax.optimization_barrier([by_logit, both, *aside])
        found.append(jnp.concatenate(parts, axis=1))
    return jax.lax.optimization_barrier(found)


def _source_slopes(response: Response, guess: Guess) -> _SourceSlopes:
    """Differentiate the sources' columns: the lobe by sigma and mu, both by steps aside."""
    directions = jnp.asarray(guess.directions)
    at = (jnp.asarray(guess.sigma), jnp.asarray(guess.mu), directions)
    one, zero, still = jnp.ones_like(at[0]), jnp.zeros_like(at[0]), jnp.zeros_like(directions)

    def specular(sigma, mu, directions) -> Float[Array, "sample source"]:
        return response.source_specular(Guess(guess.specular_logit, sigma, mu, directions))

    def along(*step) -> Float[Array, "sample source"]:
        return jax.jvp(specular, at, step)[1]

    aside = [
        Columns(
            jax.jvp(response.source_diffuse, (directions,), (step,))[1], along(zero, zero, step)
        )
        for step in jnp.moveaxis(tangent_frames(directions), -1, 0)
    ]
    slopes = _SourceSlopes(along(one, zero, still), along(zero, one, still), aside)
    return jax.lax.optimization_barrier(slopes)


def _solved(
    response: Response, guess: Guess, measured: Measured, blocks: Block
) -> tuple[Float[Array, "part channel"], Float[Array, "channel part part"]]:
    """Solve every channel's normal equations by Cholesky factorization; return the factors, too."""

    def add(block: Block) -> Part:
        columns = _evaluated(response.of_rows(block.rows), block.lobe, guess)
        sums = []
        for k, share in enumerate(specular_share(guess)):
            weights = block.weights[:, k]
            weighted = _weighted(columns, share, weights)
            seen = (weights * block.radiance[:, k]) @ weighted
            sums.append((weighted.T @ weighted, seen))
        return Part(tuple(map(jnp.stack, zip(*sums))))

    (gram, right), _ = summed(add, blocks)
    light, factors = [], []
    for normal, seen, penalty in zip(gram, right, jnp.asarray(measured.penalty).T):
        normal = normal + jnp.diag(penalty)
        # A source that is switched off has no column: unit diagonal, so that its energy is zero.
        size = jnp.diag(normal)
        normal = normal + jnp.diag(jnp.where(size > 0, 1e-12 * size, 1))
        factors.append(jnp.linalg.cholesky(normal))
        light.append(jax.scipy.linalg.cho_solve((factors[-1], True), seen))
    return jnp.stack(light, axis=1), jnp.stack(factors)


def _evaluated(response: Response, passed: Float[Array, "sample term"], guess: Guess) -> Columns:
    """Evaluate both lobes' responses once: the compiler is kept from doing so in every product."""
    return jax.lax.optimization_barrier(response.columns_of(passed, guess))


def _weighted(
    columns: Columns, share: Float[Array, ""], weights: Float[Array, "sample"]
) -> Float[Array, "sample part"]:
    """Make one channel's columns, each row times its weight."""
    weighted = weights[:, None] * ((1 - share) * columns.diffuse + share * columns.specular)
    return jax.lax.optimization_barrier(weighted)


def _predicted(
    columns: Columns, guess: Guess, light: Float[Array, "part channel"]
) -> Float[Array, "sample channel"]:
    share = specular_share(guess)[None, :]
    return (1 - share) * (columns.diffuse @ light) + share * (columns.specular @ light)


def _squares(block: Block, predicted: Float[Array, "sample channel"]) -> Float[Array, ""]:
    return jnp.sum((block.weights * (block.radiance - predicted)) ** 2)


def _penalised(
    misfit: Float[Array, ""], measured: Measured, light: Float[Array, "part channel"]
) -> Float[Array, ""]:
    return (misfit + jnp.sum(jnp.asarray(measured.penalty) * light**2)) / 2
