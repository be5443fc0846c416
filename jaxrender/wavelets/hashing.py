"""The table of L 4.3.1: coefficients by open addressing, keyed on their index.  The trees' twin.

Probe i of key k looks at (h_1(k) + i h_2(k)) mod m, with m a prime about twice the number of
coefficients, h_1(k) = k mod m and h_2(k) = 1 + k mod (m - 1).  (L prints h_2 without the 1; it
would be 0 for k = 0, m - 1, ..., and a probe that meets another key there never ends: ERRATA 62.)
A key is the coefficient's flat index in Mallat's order.  Half of the slots are empty, so that a
search in vain, the common case in a sparse tree, takes two looks.

A tree knows where a branch ends, a table does not: evaluation asks for every coefficient that
reaches the point.
"""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Float, Int
from jaxrender.wavelets.filters import Wavelet
from jaxrender.wavelets.nodes import separated
from jaxrender.wavelets.supports import Window, windows
from jaxrender.wavelets.traversal import Points, between_samples, levels_to_look_at, weights_of
from jaxrender.wavelets.tree import CoefficientTree

_EMPTY = -1
# A key that no coefficient has.
NOT_A_KEY = -2
_SLOTS_PER_COEFFICIENT = 2


class CoefficientHash(eqx.Module):
    """Keys and values of m slots; empty ones have key -1 and value 0."""

    wavelet: Wavelet = eqx.field(static=True)
    size: int = eqx.field(static=True)
    axes: int = eqx.field(static=True)
    offset: float = eqx.field(static=True)
    root: Float[np.ndarray, "channel"]
    keys: Int[np.ndarray, "slot"]
    values: Float[np.ndarray, "slot channel"]

    @classmethod
    def of(cls, tree: CoefficientTree) -> "CoefficientHash":
        """Store the coefficients of a tree."""
        entries = tree.entries()
        bits = (entries.selector[:, None] >> np.arange(tree.axes)) & 1
        places = separated(entries.code, tree.axes) + (bits << entries.level[:, None])
        sides = (tree.size,) * tree.axes
        keys = np.asarray(np.ravel_multi_index(tuple(places.T), sides))
        slots = smallest_prime(max(_SLOTS_PER_COEFFICIENT * len(keys), 3))
        table, held = np.full(slots, _EMPTY, np.int64), np.zeros((slots, tree.channels))
        values = np.asarray(entries.values)
        held = held.astype(values.dtype)
        waiting: np.ndarray = np.arange(len(keys))
        for probe in itertools.count():
            if not len(waiting):
                break
            slot = slots_of(keys[waiting], probe, slots)
            # Of those that want one empty slot the first gets it, the others try again.
            first = np.unique(slot, return_index=True)[1]
            lucky = first[table[slot[first]] == _EMPTY]
            table[slot[lucky]] = keys[waiting[lucky]]
            held[slot[lucky]] = values[waiting[lucky]]
            waiting = np.delete(waiting, lucky)
        root = np.asarray(tree.root)
        return cls(tree.wavelet, tree.size, tree.axes, tree.offset, root, table, held)

    def evaluate(self, points: Points) -> Float[Array, "point channel"]:
        """Evaluate at points of the unit cube, as ``traversal.evaluate`` does; raises the same."""
        levels_to_look_at(self.axes, self.size.bit_length() - 1, points, None)
        return _evaluate(self, jnp.asarray(points))


def slots_of(keys: Int[AnyArray, "*any"], probe: int | Array, slots: int) -> Int[AnyArray, "*any"]:
    """Return the slot that a probe of each key looks at."""
    return (keys % slots + probe * (1 + keys % (slots - 1))) % slots


def smallest_prime(at_least: int) -> int:
    """Return the smallest prime that is not below a number."""
    for candidate in itertools.count(max(at_least, 2)):
        divisors = np.arange(2, int(candidate**0.5) + 1)
        if np.all(candidate % divisors):
            return candidate
    raise AssertionError("there is always a larger prime")


def look_up(keys: Int[AnyArray, "slot"], wanted: Int[AnyArray, "*any"]) -> Int[Array, "*any"]:
    """Return the slot of each key, or the number of slots for those that are not there."""
    table, wanted = jnp.asarray(keys), jnp.asarray(wanted)
    slots = len(table)

    def goes_on(state: tuple[Array, Array, Array]) -> Array:
        return jnp.any(~state[2])

    def probe(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        number, found, done = state
        slot = slots_of(wanted, number, slots)
        key = table[slot]
        found = jnp.where(~done & (key == wanted), slot, found)
        return number + 1, found, done | (key == wanted) | (key == _EMPTY)

    start = jnp.zeros((), wanted.dtype), jnp.full_like(wanted, slots), wanted < 0
    return jax.lax.while_loop(goes_on, probe, start)[1]


@jax.jit
def _evaluate(table: CoefficientHash, points: Array) -> Float[Array, "point channel"]:
    root, values = jnp.asarray(table.root), jnp.asarray(table.values)
    where = between_samples(table.wavelet, table.size, table.offset, points)
    total = jnp.broadcast_to(root[None], (len(points), len(root))).astype(values.dtype)
    for level, window in enumerate(windows(table.wavelet, table.size)):
        first = jnp.asarray(window.first)[where.sample]
        weights = weights_of(level, first, window, where, values.dtype)
        slot = look_up(table.keys, _keys(level, first, window, table.size))
        found = values.at[slot].get(mode="fill", fill_value=0)
        total = total + jnp.einsum("psn,psnc->pc", weights, found, precision="highest")
    return total


def _keys(
    level: int, first: Int[Array, "point axis"], window: Window, size: int
) -> Int[Array, "point selector place"]:
    """Lay out the flat indices of the coefficients that ``weights_of`` has weights for.

    Selector 0 names a scaling function, which only the root has: its keys are not there to find.
    """
    points, axes = first.shape
    run = jnp.arange(window.width, dtype=first.dtype)[None, None]
    place = ((first[..., None] + run) % (1 << level)).astype(np.int64)
    kinds = jnp.asarray([0, 1 << level])[None, :, None, None, None]
    keys = jnp.zeros((points, 1, 1), np.int64)
    for axis in range(axes):
        index = place[:, axis, None, None, None, :] + kinds
        keys = (keys[:, None, :, :, None] * size + index).reshape(points, 2 * keys.shape[1], -1)
    return keys.at[:, 0].set(NOT_A_KEY)
