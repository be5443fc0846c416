"""One function for each of many samples, some at once: as many as memory or a cache can hold.

``jax.lax.map`` compiles its function once more for the samples that are left over.  Here batches
are of one size, and the last is filled up, so that a program holds the function once.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxrender.shapes import Array


def in_batches(function: Callable, samples: Any, most: int) -> Any:
    """Map a function over the first axis of all arrays of ``samples``, at most ``most`` at once.

    What fills the last batch up is the first sample again, so that no function meets what it does
    not know.
    """
    count = len(jax.tree.leaves(samples)[0])
    batches, size = even(count, most)
    short = batches * size - count

    def filled(rows: Array) -> Array:
        return jnp.concatenate([rows, jnp.broadcast_to(rows[:1], (short, *rows.shape[1:]))])

    given = jax.tree.map(filled, samples) if short else samples
    found = jax.lax.map(function, given, batch_size=max(size, 1))
    return jax.tree.map(lambda rows: rows[:count], found) if short else found


def even(count: int, most: int) -> tuple[int, int]:
    """Split ``count`` things into the fewest batches of ``most``; return how many, and their size.

    All are of one size, with less room left in the last than there are batches.
    """
    batches = -(-count // max(most, 1))
    return batches, -(-count // max(batches, 1))
