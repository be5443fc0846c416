"""Samples in blocks: what one block gives is added up over all of them.

Columns and derivatives of one block stay in the processor's cache.  Memory does not grow with the
number of samples.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxrender.inverse.factorization.response import Response
from jaxrender.shapes import AnyArray, Array, Float

# Samples in a block: at 169 columns and 101 unknowns, 256 to 1024 take the same time to a tenth.
SAMPLES_AT_ONCE = 512


class Measured(NamedTuple):
    """Radiance, weights (1 / standard deviation), and the light's penalty (1 / variance)."""

    radiance: Float[AnyArray, "sample channel"]
    weights: Float[AnyArray, "sample channel"]
    penalty: Float[AnyArray, "part channel"]


class Part(NamedTuple):
    """What one block gives: ``sums`` are added up over the blocks, ``rows`` are joined."""

    sums: Any
    rows: Any = None


class Block(NamedTuple):
    """Some of the samples: of ``lobe`` what is asked for; or, with one more axis, all blocks."""

    rows: dict[str, Any]
    lobe: Any
    radiance: Float[Array, "sample channel"]
    weights: Float[Array, "sample channel"]


def in_blocks(response: Response, lobe: Any, measured: Measured, most: int) -> Block:
    """Cut all that has a row for each sample into blocks of equal length, no longer than ``most``.

    The last is filled up with samples of no weight.
    """
    radiance, weights = jnp.asarray(measured.radiance), jnp.asarray(measured.weights)
    count = len(radiance)
    blocks = max(1, -(-count // most))
    length = -(-count // blocks)

    def cut(rows: Array, mode: str = "edge") -> Array:
        fill = ((0, blocks * length - count), *((0, 0),) * (rows.ndim - 1))
        return jnp.pad(rows, fill, mode=mode).reshape(blocks, length, *rows.shape[1:])

    every = Block(response.rows, lobe, radiance, weights)
    return jax.tree.map(cut, every)._replace(weights=cut(weights, "constant"))


def summed(of_block: Callable[..., Part], *blocks: Any) -> Part:
    """Add up the sums of every block, and join its rows."""
    one = jax.tree.map(lambda rows: rows[0], blocks)
    shapes = jax.eval_shape(of_block, *one).sums
    zeros = jax.tree.map(lambda like: jnp.zeros(like.shape, like.dtype), shapes)

    def add(sums: Any, block: Any):
        more, rows = of_block(*block)
        return jax.tree.map(jnp.add, sums, more), rows

    sums, rows = jax.lax.scan(add, zeros, blocks)
    return Part(sums, jax.tree.map(lambda part: part.reshape(-1, *part.shape[2:]), rows))
