"""Matching pursuit: which sources would explain most of what is left?

A source in direction d adds one column to each channel's light.  This column is projected off the
columns that are there already.  Its correlation with the weighted residual gives by how much a
source of the best energy would lower chi-squared:

gain_c(d) = (g_c' W r_c)^2 / (g_c' W g_c - |C^-1 M_c' W g_c|^2),     C C' = M_c' W M_c + Lambda

summed over the channels in which its energy is positive.  The best source joins the columns, the
others are projected off it too, and so on: orthogonal matching pursuit, at fixed material.

The columns that are there already are solved for in full precision.  Of the thousands of candidates
only the order counts: they are held in single precision, which takes half the time.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.factorization.blocks import Measured, in_blocks
from jaxrender.inverse.factorization.projection import Solved, lobes_of, mixed, reduced_system
from jaxrender.inverse.factorization.response import (
    Columns,
    Guess,
    Response,
    specular_share,
)
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int, in_precision

# A direction that the columns already there explain but for this part has nothing to add.
_NOTHING_LEFT = 1e-3


class Pursued(NamedTuple):
    """The candidates chosen, in the order of choice, and what each took off chi-squared."""

    chosen: Int[Array, "found"]
    gains: Float[Array, "found"]


class _Channel(NamedTuple):
    """One channel's candidate columns, whitened, as seen from the columns already there."""

    sources: Float[Array, "sample candidate"]
    inside: Float[Array, "part candidate"]
    along: Float[Array, "candidate"]
    free: Float[Array, "candidate"]


def pursue(
    response: Response,
    guess: Guess,
    measured: Measured,
    towards: Float[AnyArray, "candidate 3"],
    count: int,
    seen: Bool[AnyArray, "sample candidate"] | None = None,
) -> Pursued:
    """Choose ``count`` of the candidate directions one after the other.

    ``seen`` says which of them each sample sees; all, where it is left out.
    """
    # Programs that the fit needs, too: they are compiled already.
    blocks = in_blocks(response, measured)
    lobes = lobes_of(blocks, guess)
    solved = reduced_system(blocks, guess, lobes).solved
    passed = blocks.joined([lobe.passed for lobe in lobes])
    return _pursue(response, guess, measured, passed, solved, towards, count, seen)


@stored(partial(jax.jit, static_argnames="count"), effort="less")
def _pursue(
    response: Response,
    guess: Guess,
    measured: Measured,
    passed: Float[AnyArray, "sample term"],
    solved: Solved,
    towards: Float[AnyArray, "candidate 3"],
    count: int,
    seen: Bool[AnyArray, "sample candidate"] | None,
) -> Pursued:
    with jax.default_matmul_precision("highest"):
        sources = Guess(guess.specular_logit, guess.sigma, guess.mu, jnp.asarray(towards))
        candidates = _pair(*in_precision(np.float32, (response, sources)), seen)
        share = specular_share(guess)
        columns = mixed(response.columns_of(jnp.asarray(passed), guess), share)
        channels = _prepare(columns, solved, guess, measured, candidates)
        size = jnp.sum(channels.sources**2, axis=1)

        def one_more(step: Int[Array, ""], state: tuple) -> tuple:
            chosen, gains, rows, along, free = state
            open_ = free > _NOTHING_LEFT * size
            gain = jnp.where(open_ & (along > 0), along**2 / jnp.where(open_, free, 1), 0)
            total = jnp.sum(gain, axis=0)
            best = jnp.argmax(total)
            across = jnp.einsum("cs,csk->ck", channels.sources[:, :, best], channels.sources)
            across = across - jnp.einsum("cp,cpk->ck", channels.inside[:, :, best], channels.inside)
            across = across - jnp.einsum("cr,crk->ck", rows[:, :, best], rows)
            root = jnp.sqrt(jnp.maximum(free[:, best], _NOTHING_LEFT * size[:, best]))
            row = across / root[:, None]
            # Where its energy would be negative a channel goes without the source.
            amount = jnp.maximum(along[:, best], 0) / root
            along = along - row * amount[:, None]
            return (
                chosen.at[step].set(best),
                gains.at[step].set(total[best]),
                rows.at[:, step].set(row),
                along,
                free - row**2,
            )

        candidates, colours = towards.shape[0], channels.along.shape[0]
        dtype = channels.along.dtype
        empty = (
            jnp.zeros(count, int),
            jnp.zeros(count, dtype),
            jnp.zeros((colours, count, candidates), dtype),
            channels.along,
            channels.free,
        )
        chosen, gains, *_ = jax.lax.fori_loop(0, count, one_more, empty)
        return Pursued(chosen, gains)


def _pair(
    response: Response, sources: Guess, seen: Bool[AnyArray, "sample candidate"] | None
) -> Columns:
    """Evaluate how the samples respond to every candidate."""
    both = response.towards(sources)
    if seen is None:
        return both
    return Columns(*(jnp.where(jnp.asarray(seen), part, 0) for part in both))


def _prepare(
    columns: Float[Array, "channel sample part"],
    solved: Solved,
    guess: Guess,
    measured: Measured,
    candidates: Columns,
) -> _Channel:
    diffuse, specular = candidates
    weights, left = jnp.asarray(measured.weights), measured.radiance - solved.predicted

    def of_channel(columns, weights, left, share, factor) -> _Channel:
        sources = weights[:, None] * ((1 - share) * diffuse + share * specular)
        across = (weights[:, None] * columns).T @ sources
        inside = jax.scipy.linalg.solve_triangular(factor, across, lower=True)
        free = jnp.sum(sources**2, 0) - jnp.sum(inside**2, 0)
        return _Channel(sources, inside, (weights * left) @ sources, free)

    each = (columns, weights, left, specular_share(guess), solved.normal)
    return jax.vmap(of_channel, in_axes=(0, 1, 1, 0, 0))(*in_precision(np.float32, each))
