"""Samples in blocks of one length: what one block gives is added up over all of them.

Every number of samples needs the same programs, memory does not grow with it, and the columns of
one block stay near the processor.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxrender.inverse.factorization.response import Response
from jaxrender.shapes import AnyArray, Array, Float, Int, as_jax

# Samples in a block: what the lobe passes on costs as much of 1,000 as of 2,000.
SAMPLES_AT_ONCE = 2000


class Measured(NamedTuple):
    """Radiance, weights (1 / standard deviation), and the light's penalty (1 / variance)."""

    radiance: Float[AnyArray, "sample channel"]
    weights: Float[AnyArray, "sample channel"]
    penalty: Float[AnyArray, "part channel"]


class Block(NamedTuple):
    """Some of the samples; ``rows`` are theirs among all, the last of them repeated to the end.

    What is repeated has no weight.
    """

    rows: Int[np.ndarray, "sample"]
    response: Response
    radiance: Float[Array, "sample channel"]
    weights: Float[Array, "sample channel"]


class Blocks(NamedTuple):
    """All samples, and the light's penalty."""

    blocks: tuple[Block, ...]
    count: int
    penalty: Float[AnyArray, "part channel"]

    def joined(self, parts: Sequence[AnyArray]) -> Float[np.ndarray, "sample ..."]:
        """Join the rows that every block gives."""
        return np.concatenate([np.asarray(part) for part in parts])[: self.count]

    def lit(self, lit: Float[AnyArray, "sample source"]) -> "Blocks":
        """Let the sources reach other samples than before."""

        def reached(block: Block) -> Block:
            response = eqx.tree_at(
                lambda r: r.lit, block.response, as_jax(np.asarray(lit)[block.rows])
            )
            return block._replace(response=response)

        return self._replace(blocks=tuple(reached(block) for block in self.blocks))


def in_blocks(response: Response, measured: Measured, most: int = SAMPLES_AT_ONCE) -> Blocks:
    """Cut samples into blocks of ``most``; fewer than these are one block of their own length."""
    count, blocks = len(measured.radiance), []
    for rows, filled in cut(count, most):
        weights = np.where(filled[:, None], 0, np.asarray(measured.weights)[rows])
        radiance = np.asarray(measured.radiance)[rows]
        blocks.append(Block(rows, response.take(rows), as_jax(radiance), as_jax(weights)))
    return Blocks(tuple(blocks), count, measured.penalty)


def by_rows(function: Callable[..., Array], *rows: Any) -> Float[np.ndarray, "sample ..."]:
    """Apply a function that treats each row by itself, a block at a time."""
    count, parts = len(jax.tree.leaves(rows)[0]), []
    for index, _ in cut(count, SAMPLES_AT_ONCE):
        own = jax.tree.map(lambda values, index=index: as_jax(np.asarray(values)[index]), rows)
        parts.append(np.asarray(function(*own)))
    return np.concatenate(parts)[:count]


def cut(count: int, most: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Number the rows of each block, and mark those that fill up the last."""
    length = min(count, most)
    for first in range(0, count, length):
        rows = np.arange(first, first + length)
        yield np.minimum(rows, count - 1), rows >= count


def added(parts: list[Any]) -> Any:
    """Add up what every block gives, array by array."""
    return jax.tree.map(lambda *each: sum(np.asarray(part) for part in each), *parts)
