"""The light eliminated: the normal equations of all other unknowns (variable projection).

For a guess of the nonlinear unknowns the light follows from one small linear system a channel.
M_c are the columns of channel c, V_c the derivatives of its prediction at fixed light.  W are the
squared weights, Lambda the penalty on the light.  The reduced system of the other unknowns is

H = sum_c V_c' W V_c - (M_c' W V_c)' (M_c' W M_c + Lambda)^-1 (M_c' W V_c),   g = sum_c V_c' W r_c

There are dozens of columns and thousands of samples, so that all of it costs a few matrix products,
whatever the number of parameters.  Samples are passed through twice, in ``blocks``, and columns of
many samples are made twice.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.factorization.blocks import Block, Blocks, added
from jaxrender.inverse.factorization.response import Columns, Guess, specular_share
from jaxrender.inverse.factorization.slopes import Lobe, columns_at, lobe_slopes, prediction_slopes
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float, Int

# Columns of so many numbers are kept from the first pass to the second (a hundred megabytes).
_MOST_KEPT = 6_000_000
# Groups are filled up to a multiple of this, so that few programs are compiled.
_GROUPS = 256


class Solved(NamedTuple):
    """The light that fits a guess best, what it predicts, and the penalised cost.

    ``normal`` is the Cholesky factor of each channel's normal equations.
    """

    light: Float[AnyArray, "part channel"]
    predicted: Float[AnyArray, "sample channel"]
    cost: Float[AnyArray, ""]
    normal: Float[AnyArray, "channel part part"]


class System(NamedTuple):
    """The reduced normal equations of the nonlinear unknowns at a guess.

    ``solved`` is the light of that guess; ``across`` is M' W V, of each channel.
    """

    solved: Solved
    curvature: Float[AnyArray, "unknown unknown"]
    slope: Float[AnyArray, "unknown"]
    across: Float[AnyArray, "channel part unknown"]


class Scatter(NamedTuple):
    """Covariances of both sides of the equations by the noise of the samples, not by their weights.

    ``own`` is the covariance of the reduced slope, ``light`` that of each channel's equations of
    the light, ``both`` that of one with the other.  ``slopes`` and ``rights`` are what single
    groups of samples leave of the reduced slope and of the light's equations.
    """

    own: Float[AnyArray, "unknown unknown"]
    light: Float[AnyArray, "channel part part"]
    both: Float[AnyArray, "channel part unknown"]
    slopes: Float[AnyArray, "group unknown"]
    rights: Float[AnyArray, "channel group part"]


class _Seen(NamedTuple):
    """Every channel's normal equations of the light: M' W M, and M' W times what was measured."""

    gram: Float[AnyArray, "channel part part"]
    right: Float[AnyArray, "channel part"]


class _Stepped(NamedTuple):
    """V' W V and M' W V of each channel, V' W r of all, and what is left: r' W r."""

    curvature: Float[AnyArray, "channel unknown unknown"]
    slope: Float[AnyArray, "unknown"]
    across: Float[AnyArray, "channel part unknown"]
    misfit: Float[AnyArray, ""]


class Drawn(NamedTuple):
    """How many pixels each sample stands for, relative to their mean, and the group it is in."""

    shares: Float[AnyArray, "sample"]
    group: Int[np.ndarray, "sample"]


def reduced_system(blocks: Blocks, guess: Guess, lobes: list[Lobe] | None = None) -> System:
    """Solve for the light and set up the step of everything else.

    ``lobes`` are those of ``lobes_of``, where they are known.
    """
    lobes, share = lobes_of(blocks, guess) if lobes is None else lobes, specular_share(guess)
    each = _each(blocks, guess, lobes)
    if blocks.count * len(blocks.penalty) <= _MOST_KEPT:
        each = list(each)
    gram, right = added([_seen(block, columns, share) for block, _, columns in each])
    light, normal = _light_of(gram, right, blocks.penalty)
    parts = []
    for block, lobe, columns in each if isinstance(each, list) else _each(blocks, guess, lobes):
        slopes = prediction_slopes(block.response, lobe, guess, columns, light)
        parts.append(_stepped(block, columns, slopes, share, light))
    curvature, slope, across, misfit = added([sums for sums, _ in parts])
    predicted = blocks.joined([rows for _, rows in parts])
    penalised = np.sum(np.asarray(blocks.penalty) * np.asarray(light) ** 2)
    solved = Solved(light, predicted, (misfit + penalised) / 2, normal)
    return System(solved, _reduced(curvature, normal, across), slope, across)


def lobes_of(blocks: Blocks, guess: Guess) -> list[Lobe]:
    """Evaluate what the lobe passes on to every block, with its derivatives."""
    return lobe_slopes([block.response for block in blocks.blocks], guess)


def _each(blocks: Blocks, guess: Guess, lobes: list[Lobe]) -> Iterator[tuple[Block, Lobe, Columns]]:
    """Evaluate the columns of one block after the other."""
    for block, lobe in zip(blocks.blocks, lobes, strict=True):
        yield block, lobe, columns_at(block.response, guess, lobe.passed)


@stored(jax.jit, effort="less")
def _seen(block: Block, columns: Columns, share: Float[Array, "channel"]) -> _Seen:
    """Sum up one block's part of every channel's normal equations."""

    def of_channel(share, weights, radiance):
        weighted = _weighted(columns, share, weights)
        return weighted.T @ weighted, (weights * radiance) @ weighted

    with jax.default_matmul_precision("highest"):
        return _Seen(*_by_channel(of_channel, share, block.weights.T, block.radiance.T))


@stored(jax.jit, effort="least")
def _light_of(
    gram: Float[AnyArray, "channel part part"],
    right: Float[AnyArray, "channel part"],
    penalty: Float[AnyArray, "part channel"],
) -> tuple[Float[Array, "part channel"], Float[Array, "channel part part"]]:
    """Solve every channel's normal equations by Cholesky factorization; return the factors, too."""

    def solve(normal, seen, penalty):
        normal = normal + jnp.diag(penalty)
        # A source that is switched off has no column: unit diagonal, so that its energy is zero.
        size = jnp.diag(normal)
        normal = normal + jnp.diag(jnp.where(size > 0, 1e-12 * size, 1))
        factor = jnp.linalg.cholesky(normal)
        return jax.scipy.linalg.cho_solve((factor, True), seen), factor

    light, factors = _by_channel(solve, gram, right, jnp.asarray(penalty).T)
    return light.T, factors


@stored(jax.jit, effort="less")
def _stepped(
    block: Block,
    columns: Columns,
    slopes: Float[Array, "channel sample unknown"],
    share: Float[Array, "channel"],
    light: Float[AnyArray, "part channel"],
) -> tuple[_Stepped, Float[Array, "sample channel"]]:
    """Sum up one block's part of the equations of everything else, and predict its samples."""

    def of_channel(share, weights, left, slopes):
        moved = jax.lax.optimization_barrier(weights[:, None] * slopes)
        weighted = _weighted(columns, share, weights)
        return moved.T @ moved, left @ moved, weighted.T @ moved

    with jax.default_matmul_precision("highest"):
        predicted = _predicted(columns, share, light)
        left = (block.weights * (block.radiance - predicted)).T
        curvature, slope, across = _by_channel(of_channel, share, block.weights.T, left, slopes)
        return _Stepped(curvature, jnp.sum(slope, axis=0), across, jnp.sum(left**2)), predicted


@stored(jax.jit, effort="least")
def _reduced(
    curvature: Float[AnyArray, "channel unknown unknown"],
    normal: Float[AnyArray, "channel part part"],
    across: Float[AnyArray, "channel part unknown"],
) -> Float[Array, "unknown unknown"]:
    """Take the light's answer off the curvature."""

    def of_channel(own, factor, across):
        part = jax.scipy.linalg.solve_triangular(factor, across, lower=True)
        return own - part.T @ part

    return jnp.sum(_by_channel(of_channel, curvature, normal, across), axis=0)


def scatter(blocks: Blocks, guess: Guess, drawn: Drawn, system: System) -> Scatter:
    """Sum up how the noise of the samples moves the equations of ``reduced_system``.

    The squared weights of the blocks contain the shares: a sample that stands for c pixels counts
    c times, but is measured once.  So its score has c times the variance that its weight stands
    for.  What is expected of the light counts as it is.
    """
    groups = -(-(int(drawn.group.max()) + 1) // _GROUPS) * _GROUPS
    answers = _answers(system.solved.normal, system.across)
    light, share, parts = system.solved.light, specular_share(guess), []
    for block, lobe, columns in _each(blocks, guess, lobes_of(blocks, guess)):
        own = Drawn(np.asarray(drawn.shares)[block.rows], np.asarray(drawn.group)[block.rows])
        slopes = prediction_slopes(block.response, lobe, guess, columns, light)
        parts.append(_scattered(block, columns, slopes, share, own, light, answers, groups))
    of_own, of_light, both, slopes, rights = added(parts)
    expected, answers = np.asarray(blocks.penalty).T, np.asarray(answers)
    held = expected[:, :, None] * answers
    of_own = of_own + np.einsum("cpu,cpv->uv", answers, held)
    of_light = of_light + expected[:, :, None] * np.eye(expected.shape[1])
    return Scatter(of_own, of_light, both - held, slopes, rights)


@stored(jax.jit, effort="least")
def _answers(
    normal: Float[AnyArray, "channel part part"], across: Float[AnyArray, "channel part unknown"]
) -> Float[Array, "channel part unknown"]:
    """Evaluate how the light answers to everything else."""
    return _by_channel(
        lambda factor, across: jax.scipy.linalg.cho_solve((factor, True), across), normal, across
    )


@stored(partial(jax.jit, static_argnames="groups"), effort="least")
def _scattered(
    block: Block,
    columns: Columns,
    slopes: Float[Array, "channel sample unknown"],
    share: Float[Array, "channel"],
    drawn: Drawn,
    light: Float[AnyArray, "part channel"],
    answers: Float[Array, "channel part unknown"],
    groups: int,
) -> Scatter:
    """Sum up one block's part of it."""

    def of_channel(share, weights, left, slopes, answer):
        weighted = _weighted(columns, share, weights)
        moved = weights[:, None] * slopes - weighted @ answer
        # A sample that stands for c pixels has c times the variance, not c^2 times.
        spread, own = roots[:, None] * weighted, roots[:, None] * moved
        score = in_group * (weights * left)[None, :]
        sums = own.T @ own, spread.T @ spread, spread.T @ own
        return (*sums, score @ moved, score @ weighted)

    with jax.default_matmul_precision("highest"):
        left = (block.radiance - _predicted(columns, share, light)).T
        in_group = jax.nn.one_hot(drawn.group, groups, axis=0, dtype=slopes.dtype)
        roots = jnp.sqrt(jnp.asarray(drawn.shares))
        own, light, both, by_group, rights = _by_channel(
            of_channel, share, block.weights.T, left, slopes, answers
        )
        return Scatter(jnp.sum(own, axis=0), light, both, jnp.sum(by_group, axis=0), rights)


def mixed(
    columns: Columns, share: Float[AnyArray, "channel"]
) -> Float[Array, "channel sample part"]:
    """Weigh the lobes: what one unit of each part of the light sends to the camera."""
    share = jnp.asarray(share)[:, None, None]
    return (1 - share) * columns.diffuse[None] + share * columns.specular[None]


def _by_channel(function: Callable, *of_channels: AnyArray):
    """Apply a function to one channel after the other: a batch of products is slower."""
    return jax.lax.map(lambda of_channel: function(*of_channel), of_channels)


def _weighted(
    columns: Columns, share: Float[Array, ""], weights: Float[Array, "sample"]
) -> Float[Array, "sample part"]:
    """Make one channel's columns, each row times its weight."""
    weighted = weights[:, None] * ((1 - share) * columns.diffuse + share * columns.specular)
    return jax.lax.optimization_barrier(weighted)


def _predicted(
    columns: Columns, share: Float[Array, "channel"], light: Float[AnyArray, "part channel"]
) -> Float[Array, "sample channel"]:
    share = share[None, :]
    return (1 - share) * (columns.diffuse @ light) + share * (columns.specular @ light)
