"""The light eliminated: the normal equations of all other unknowns (variable projection).

For a guess of the nonlinear unknowns the light follows from one small linear system a channel.
M_c are the columns of channel c, V_c the derivatives of its prediction at fixed light.  W are the
squared weights, Lambda the penalty on the light.  The reduced system of the other unknowns is

H = sum_c V_c' W V_c - (M_c' W V_c)' (M_c' W M_c + Lambda)^-1 (M_c' W V_c),   g = sum_c V_c' W r_c

There are dozens of columns and thousands of samples, so that all of it costs a few matrix products,
whatever the number of parameters.  Samples are passed through twice, in ``blocks``.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.factorization.blocks import (
    SAMPLES_AT_ONCE,
    Block,
    Measured,
    Part,
    in_blocks,
    summed,
)
from jaxrender.inverse.factorization.response import Columns, Guess, Response, specular_share
from jaxrender.inverse.factorization.slopes import Lobe, lobe_slopes, prediction_slopes
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float, Int

# Groups are filled up to a multiple of this, so that few programs are compiled.
_GROUPS = 256


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
    the light, ``both`` that of one with the other.  ``slopes`` and ``rights`` are what single
    groups of samples leave of the reduced slope and of the light's equations.
    """

    own: Float[Array, "unknown unknown"]
    light: Float[Array, "channel part part"]
    both: Float[Array, "channel part unknown"]
    slopes: Float[Array, "group unknown"]
    rights: Float[Array, "channel group part"]


class Drawn(NamedTuple):
    """How many pixels each sample stands for, relative to their mean, and the group it is in."""

    shares: Float[AnyArray, "sample"]
    group: Int[np.ndarray, "sample"]


def reduced_system(
    response: Response,
    guess: Guess,
    measured: Measured,
    lobe: Lobe | None = None,
    *,
    at_once: int = SAMPLES_AT_ONCE,
) -> System:
    """Solve for the light and set up the step of everything else, ``at_once`` samples at a time.

    ``lobe`` is that of ``lobe_slopes``, where it is known.
    """
    lobe = lobe_slopes(response, guess) if lobe is None else lobe
    return _reduced(response, guess, measured, lobe, at_once)


@stored(partial(jax.jit, static_argnames="at_once"), effort="less")
def _reduced(
    response: Response, guess: Guess, measured: Measured, lobe: Lobe, at_once: int
) -> System:
    with jax.default_matmul_precision("highest"):
        blocks = in_blocks(response, lobe, measured, at_once)
        light, normal = _solved(response, guess, measured, blocks._replace(lobe=blocks.lobe.passed))

        def add(block: Block) -> Part:
            own = response.of_rows(block.rows)
            columns = _evaluated(own, block.lobe.passed, guess)
            predicted = _predicted(columns, guess, light)
            slopes = prediction_slopes(own, block.lobe, guess, columns, light)

            def of_channel(share, weights, left, slopes):
                moved = jax.lax.optimization_barrier(weights[:, None] * slopes)
                weighted = _weighted(columns, share, weights)
                return moved.T @ moved, (weights * left) @ moved, weighted.T @ moved

            left = (block.radiance - predicted).T
            sums = _by_channel(of_channel, share, block.weights.T, left, slopes)
            return Part((*sums, _squares(block, predicted)), predicted)

        def curvature(factor, own, across):
            part = jax.scipy.linalg.solve_triangular(factor, across, lower=True)
            return own - part.T @ part

        share = specular_share(guess)
        (inner, slope, across, misfit), predicted = summed(add, blocks)
        curvatures = _by_channel(curvature, normal, inner, across)
        rows = predicted[: len(measured.radiance)]
        solved = Solved(light, rows, _penalised(misfit, measured, light), normal)
        return System(solved, jnp.sum(curvatures, axis=0), jnp.sum(slope, axis=0), across)


def scatter(
    response: Response,
    guess: Guess,
    measured: Measured,
    drawn: Drawn,
    system: System,
) -> Scatter:
    """Sum up how the noise of the samples moves the equations of ``reduced_system``.

    The squared weights of ``measured`` contain the shares: a sample that stands for c pixels counts
    c times, but is measured once.  So its score has c times the variance that its weight stands
    for.  What is expected of the light counts as it is.
    """
    groups = -(-(int(drawn.group.max()) + 1) // _GROUPS) * _GROUPS
    return _scatter(response, guess, measured, lobe_slopes(response, guess), drawn, system, groups)


@stored(partial(jax.jit, static_argnames="groups"), effort="least")
def _scatter(
    response: Response,
    guess: Guess,
    measured: Measured,
    lobe: Lobe,
    drawn: Drawn,
    system: System,
    groups: int,
) -> Scatter:
    solved = system.solved
    with jax.default_matmul_precision("highest"):
        blocks = in_blocks(response, lobe, measured, SAMPLES_AT_ONCE)
        alone = measured._replace(
            radiance=jnp.asarray(measured.radiance) - solved.predicted,
            weights=jnp.sqrt(jnp.asarray(drawn.shares))[:, None],
        )
        others = in_blocks(response, jnp.asarray(drawn.group), alone, SAMPLES_AT_ONCE)
        answers = _by_channel(
            lambda factor, across: jax.scipy.linalg.cho_solve((factor, True), across),
            solved.normal,
            system.across,
        )

        def add(block: Block, other: Block) -> Part:
            own = response.of_rows(block.rows)
            columns = _evaluated(own, block.lobe.passed, guess)
            slopes = prediction_slopes(own, block.lobe, guess, columns, solved.light)
            in_group = jax.nn.one_hot(other.lobe, groups, axis=0, dtype=slopes.dtype)

            def of_channel(share, weights, roots, left, slopes, answer):
                weighted = _weighted(columns, share, weights)
                moved = weights[:, None] * slopes - weighted @ answer
                # A sample that stands for c pixels has c times the variance, not c^2 times.
                spread, own = roots[:, None] * weighted, roots[:, None] * moved
                score = in_group * (weights * left)[None, :]
                sums = own.T @ own, spread.T @ spread, spread.T @ own
                return (*sums, score @ moved, score @ weighted)

            rows = (block.weights.T, other.weights.T, other.radiance.T)
            weights, roots, left = rows[0], jnp.broadcast_to(rows[1], rows[0].shape), rows[2]
            return Part(_by_channel(of_channel, share, weights, roots, left, slopes, answers))

        share = specular_share(guess)
        (own, light, both, by_group, rights), _ = summed(add, blocks, others)
        expected = jnp.asarray(measured.penalty).T
        held = expected[:, :, None] * answers
        own = jnp.sum(own, axis=0) + jnp.einsum("cpu,cpv->uv", answers, held)
        light = light + jax.vmap(jnp.diag)(expected)
        return Scatter(own, light, both - held, jnp.sum(by_group, axis=0), rights)


def mixed(
    response: Response, guess: Guess, passed: Float[Array, "sample term"] | None = None
) -> Float[Array, "channel sample part"]:
    """Weigh the lobes: what one unit of each part of the light sends to the camera.

    ``passed`` is what the lobe passes on, where it is known.
    """
    columns = _evaluated(response, response.passed(guess) if passed is None else passed, guess)
    share = specular_share(guess)[:, None, None]
    return jax.lax.optimization_barrier(
        (1 - share) * columns.diffuse[None] + share * columns.specular[None]
    )


def _solved(
    response: Response, guess: Guess, measured: Measured, blocks: Block
) -> tuple[Float[Array, "part channel"], Float[Array, "channel part part"]]:
    """Solve every channel's normal equations by Cholesky factorization; return the factors, too."""

    def add(block: Block) -> Part:
        columns = _evaluated(response.of_rows(block.rows), block.lobe, guess)

        def of_channel(share, weights, radiance):
            weighted = _weighted(columns, share, weights)
            return weighted.T @ weighted, (weights * radiance) @ weighted

        return Part(_by_channel(of_channel, share, block.weights.T, block.radiance.T))

    def solve(normal, seen, penalty):
        normal = normal + jnp.diag(penalty)
        # A source that is switched off has no column: unit diagonal, so that its energy is zero.
        size = jnp.diag(normal)
        normal = normal + jnp.diag(jnp.where(size > 0, 1e-12 * size, 1))
        factor = jnp.linalg.cholesky(normal)
        return jax.scipy.linalg.cho_solve((factor, True), seen), factor

    share = specular_share(guess)
    (gram, right), _ = summed(add, blocks)
    light, factors = _by_channel(solve, gram, right, jnp.asarray(measured.penalty).T)
    return light.T, factors


def _by_channel(function: Callable, *of_channels: Array):
    """Apply a function to one channel after the other: a batch of products is slower."""
    return jax.lax.map(lambda of_channel: function(*of_channel), of_channels)


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
