"""A coefficient tree over two pairs of axes, with one pair held: a function of the other pair.

With a place given along two axes, the coefficients that reach it are multiplied by their functions'
values there, and what is left is a sum over functions of the other two,

    sum over (l, s, m) of a_{l,s,m} G_{l,m_0,s[0]} G_{l,m_1,s[1]},       s = 0 .. 3,

in which s = 0 occurs at every level.  Such a sum is laid out as a *pyramid*, of which a column is

    4 (4^l - 1) / 3 + s 4^l + 2^l m_0 + m_1.

The coefficients that reach a sample stand together, so that the work is that for those and no more.
Indices are made on the host, sums on the device.
"""

from typing import NamedTuple

import jax
import numpy as np

from jaxrender.shapes import AnyArray, Array, Float, Int
from jaxrender.wavelets.filters import Wavelet
from jaxrender.wavelets.nodes import separated
from jaxrender.wavelets.supports import windows
from jaxrender.wavelets.tree import CoefficientTree

Samples = Int[np.ndarray, "row 2"]


class LevelGroups(NamedTuple):
    """The groups of one level that reach each sample, and their places along the held axes."""

    group: Int[np.ndarray, "row place"]
    places: tuple[Int[np.ndarray, "row place"], Int[np.ndarray, "row place"]]


class Slices(NamedTuple):
    """The coefficients of a tree, the root's first of all, by the places along the held axes."""

    wavelet: Wavelet
    size: int
    start: Int[np.ndarray, "group"]
    """Of the coefficients of a level and place: group (4^l - 1) / 3 + 2^l m_0 + m_1."""
    coefficient: Int[np.ndarray, "value"]
    """Which one: 0 is the root's, i + 1 the tree's value i."""
    column: Int[np.ndarray, "value"]
    held_column: Int[np.ndarray, "value"]
    """The place in a pyramid of the held axes."""
    kinds: Int[np.ndarray, "value 2"]
    """Along the held axes: 0 a scaling function, 1 a wavelet."""

    def counts(self, samples: Samples) -> Int[np.ndarray, "row"]:
        """Count the coefficients that are looked at for each sample."""
        groups = np.concatenate([level.group for level in self.groups(samples)], axis=1)
        return (self.start[groups + 1] - self.start[groups]).sum(axis=1)

    def groups(self, samples: Samples) -> list[LevelGroups]:
        """List, for each level, the groups that reach each sample."""
        found = []
        for level, window in enumerate(windows(self.wavelet, self.size)):
            run = np.arange(window.width)
            places = (window.first[samples][..., None] + run) % (1 << level)
            pair = np.broadcast_arrays(places[:, 0, :, None], places[:, 1, None, :])
            first, second = (part.reshape(len(samples), -1) for part in pair)
            group = _before(level) + (first << level) + second
            found.append(LevelGroups(group, (first, second)))
        if not found:
            nowhere = np.zeros((len(samples), 1), np.int64)
            return [LevelGroups(nowhere, (nowhere, nowhere))]
        return found


class Pairs(NamedTuple):
    """Which coefficient adds how much to which column of which row."""

    row: Int[np.ndarray, "pair"]
    coefficient: Int[np.ndarray, "pair"]
    column: Int[np.ndarray, "pair"]
    weight: Float[np.ndarray, "pair"]


def columns(size: int) -> int:
    """Count the columns of a pyramid over ``size`` samples along either axis."""
    return 4 * _before(max(size.bit_length() - 1, 1))


def sliced(tree: CoefficientTree, held: tuple[int, int]) -> Slices:
    """Sort the coefficients of a tree of four axes by the places along two of them."""
    structure = tree.structure
    node = structure.value_nodes
    level = np.append(0, structure.level[node])
    places = separated(np.append(0, structure.code[node]), 4)
    selector = np.append(0, structure.value_selectors)
    bits = (selector[:, None] >> np.arange(4)) & 1
    free = [axis for axis in range(4) if axis not in held]
    group = _before(level) + (places[:, held[0]] << level) + places[:, held[1]]
    order = np.argsort(group, kind="stable")
    groups = columns(tree.size) // 4
    return Slices(
        tree.wavelet,
        tree.size,
        np.searchsorted(group[order], np.arange(groups + 1)),
        order,
        _column(level, bits[:, free], places[:, free])[order],
        _column(level, bits[:, held], places[:, held])[order],
        bits[:, held][order],
    )


def pairs_at(slices: Slices, samples: Samples) -> Pairs:
    """List what adds to the pyramids of samples of the held axes, row by row."""
    found = []
    tables = [(w.scaling, w.wavelet) for w in windows(slices.wavelet, slices.size)]
    for level, (group, places) in enumerate(slices.groups(samples)):
        counts = slices.start[group + 1] - slices.start[group]
        flat = counts.ravel()
        which = np.repeat(np.arange(flat.size), flat)
        at = slices.start[group].ravel()[which] + np.arange(len(which))
        at -= np.repeat(np.cumsum(flat) - flat, flat)
        row = which // counts.shape[1]
        weight = np.ones(len(which))
        for axis in range(2) if tables else ():
            table = np.stack(tables[level])
            place = places[axis].ravel()[which]
            weight *= table[slices.kinds[at, axis], place, samples[row, axis]]
        there = np.flatnonzero(weight)
        at = at[there]
        parts = row[there], slices.coefficient[at], slices.column[at], weight[there]
        found.append(parts)
    return Pairs(*(np.concatenate(part) for part in zip(*found)))


def levels_apart(pyramid: Float[Array, "*batch column"]) -> list[Array]:
    """Take a pyramid apart, each level [*batch, kind of axis 1, kind of axis 0, m_0, m_1]."""
    found, level = [], 0
    while 4 * _before(level) < pyramid.shape[-1]:
        part = pyramid[..., 4 * _before(level) : 4 * _before(level + 1)]
        found.append(part.reshape(*pyramid.shape[:-1], 2, 2, 1 << level, 1 << level))
        level += 1
    return found


def added_up(
    rows: Float[AnyArray, "pair channel"], to: Int[AnyArray, "pair"], count: int
) -> Float[Array, "sum channel"]:
    """Sum rows that go to the same place; those that go beyond the last one are dropped."""
    return jax.ops.segment_sum(rows, to, count)


def _before(level):
    """Count the places of all coarser levels, (4^l - 1) / 3."""
    return ((1 << (2 * level)) - 1) // 3


def _column(level: np.ndarray, bits: np.ndarray, places: np.ndarray) -> np.ndarray:
    selector = bits[:, 0] + 2 * bits[:, 1]
    inside = (selector << (2 * level)) + (places[:, 0] << level) + places[:, 1]
    return 4 * _before(level) + inside
