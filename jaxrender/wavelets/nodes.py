"""How the nodes of a coefficient tree are numbered: level by level, each level in Morton's order.

A node stands for the coefficients of one level l and one place m = (m_0, m_1, ...), 0 <= m_a < 2^l
(L 4.3.2).  Its children are at level l + 1 and place 2 m_a + bit a of b, b = 0 .. 2^axes - 1.  With
the bits of the place interleaved, axis 0 lowest,

    code(child b) = 2^axes code(node) + b,

so that nodes sorted by level and code have their children side by side, and two masks a node, which
children and which coefficients there are, are all that a file has to hold.  Host side, but for
values that may be traced.
"""

import dataclasses
import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Bool, Float, Int

Codes = Int[np.ndarray, "entry"]
Masks = Int[np.ndarray, "node"]


class Entries(NamedTuple):
    """Coefficients one by one, in any order: level, code of the place, selector nu >= 1."""

    level: Int[np.ndarray, "entry"]
    code: Codes
    selector: Int[np.ndarray, "entry"]
    values: Float[AnyArray, "entry channel"]

    def chosen(self, rows: Int[np.ndarray, "row"] | Bool[np.ndarray, "entry"]) -> "Entries":
        """Take some of them, by number or by mask."""
        return Entries(self.level[rows], self.code[rows], self.selector[rows], self.values[rows])


@dataclasses.dataclass(frozen=True, eq=False)
class Structure:
    """The masks of a tree, and what follows from them; node 0 is the root.

    Equal if its masks are, and hashable: to JAX it is static, and only values are numbers.  The
    arrays cannot be written to.  Raises ``ValueError`` for masks that do not agree: of different
    number, with bits that there is no child or selector for, and children that are more or fewer
    than the nodes below the root.
    """

    child_masks: Masks
    value_masks: Masks
    axes: int
    level: Int[np.ndarray, "node"] = dataclasses.field(init=False, repr=False)
    code: Int[np.ndarray, "node"] = dataclasses.field(init=False, repr=False)

    def __post_init__(self):
        _refuse_disagreeing(self.child_masks, self.value_masks, self.axes)
        level, code = _levels_and_codes(self.child_masks, self.axes)
        masks = {"child_masks": self.child_masks, "value_masks": self.value_masks}
        for name, part in {**masks, "level": level, "code": code}.items():
            held = np.array(part, np.int64)
            held.flags.writeable = False
            object.__setattr__(self, name, held)

    def __eq__(self, other: object) -> bool:
        if self is other or not isinstance(other, Structure):
            return self is other
        return (
            self.axes == other.axes
            and hash(self) == hash(other)
            and np.array_equal(self.child_masks, other.child_masks)
            and np.array_equal(self.value_masks, other.value_masks)
        )

    def __hash__(self) -> int:
        return self._hash

    @functools.cached_property
    def _hash(self) -> int:
        return hash((self.axes, self.child_masks.tobytes(), self.value_masks.tobytes()))

    def __len__(self) -> int:
        return len(self.child_masks)

    @functools.cached_property
    def first_child(self) -> Int[np.ndarray, "node"]:
        """The node that is the first child of each, where there is one."""
        counts = popcount(self.child_masks)
        return 1 + np.cumsum(counts) - counts

    @functools.cached_property
    def first_value(self) -> Int[np.ndarray, "node"]:
        """The row of each node's first value, where there is one."""
        counts = popcount(self.value_masks)
        return np.cumsum(counts) - counts

    @functools.cached_property
    def value_nodes(self) -> Int[np.ndarray, "value"]:
        """The node of each value."""
        return np.repeat(np.arange(len(self)), popcount(self.value_masks))

    @functools.cached_property
    def value_selectors(self) -> Int[np.ndarray, "value"]:
        """The selector nu of each value, ascending within a node."""
        return np.nonzero(set_bits(self.value_masks))[1]


def _refuse_disagreeing(child_masks: Masks, value_masks: Masks, axes: int) -> None:
    children = 1 << axes
    nodes = len(child_masks)
    if len(value_masks) != nodes or not nodes:
        raise ValueError(f"{nodes} child masks and {len(value_masks)} value masks; one of each")
    for name, masks in (("child", child_masks), ("value", value_masks)):
        wrong = np.flatnonzero((masks < 0) | (masks >> children))
        if len(wrong):
            raise ValueError(f"{name} mask {masks[wrong[0]]:#x} of node {wrong[0]} has stray bits")
    if np.any(value_masks & 1):
        first = int(np.flatnonzero(value_masks & 1)[0])
        raise ValueError(f"value mask of node {first} has bit 0, the scaling function's; clear it")
    below = popcount(child_masks).sum()
    if below != nodes - 1:
        raise ValueError(
            f"the child masks name {below} children, and {nodes - 1} nodes stand below the "
            "root; the masks are damaged"
        )


def _levels_and_codes(
    child_masks: Masks, axes: int
) -> tuple[Int[np.ndarray, "node"], Int[np.ndarray, "node"]]:
    nodes, counts = len(child_masks), popcount(child_masks)
    level, code = np.zeros(nodes, np.int64), np.zeros(nodes, np.int64)
    start, stop = 0, 1
    while start < stop < nodes:
        parents = np.repeat(np.arange(start, stop), counts[start:stop])
        if not len(parents):
            raise ValueError(f"node {stop} has no parent; the masks are damaged")
        bit = np.nonzero(set_bits(child_masks[start:stop]))[1]
        start, stop = stop, stop + len(parents)
        level[start:stop] = level[parents[0]] + 1
        code[start:stop] = (code[parents] << axes) + bit
    return level, code


class ArrangedEntries(NamedTuple):
    """The structure of a tree, and its coefficients in the structure's order."""

    structure: Structure
    values: Float[AnyArray, "value channel"]


def structure_from(entries: Entries, axes: int) -> ArrangedEntries:
    """Arrange coefficients as a tree; those of the same place and selector are added up."""
    depth = int(entries.level.max(initial=0)) + 1
    codes = _codes_by_level(entries, axes, depth)
    starts = np.cumsum([0, *(len(c) for c in codes)])
    child_masks, value_masks = np.zeros((2, starts[-1]), np.int64)
    for level in range(1, depth):
        parent = starts[level - 1] + np.searchsorted(codes[level - 1], codes[level] >> axes)
        bit = codes[level] & ((1 << axes) - 1)
        np.bitwise_or.at(child_masks, parent, 1 << bit)
    node = np.zeros(len(entries.code), np.int64)
    for level in range(depth):
        held = entries.level == level
        node[held] = starts[level] + np.searchsorted(codes[level], entries.code[held])
    np.bitwise_or.at(value_masks, node, 1 << entries.selector)
    order, row = np.unique((node << axes) + entries.selector, return_inverse=True)
    structure = Structure(child_masks, value_masks, axes)
    shape = len(order), entries.values.shape[1]
    if isinstance(entries.values, np.ndarray):
        values = np.zeros(shape, entries.values.dtype)
        np.add.at(values, row, entries.values)
    else:
        values = jnp.zeros(shape, entries.values.dtype).at[row].add(entries.values)
    return ArrangedEntries(structure, values)


def interleaved(places: Int[np.ndarray, "entry axis"], bits: int) -> Codes:
    """Interleave the bits of places, axis 0 lowest; ``bits`` of each."""
    axes = places.shape[1]
    code = np.zeros(len(places), np.int64)
    for bit in range(bits):
        for axis in range(axes):
            code |= ((places[:, axis].astype(np.int64) >> bit) & 1) << (bit * axes + axis)
    return code


def separated(codes: Codes, axes: int) -> Int[np.ndarray, "entry axis"]:
    """Undo ``interleaved``."""
    places = np.zeros((len(codes), axes), np.int64)
    bits = -(-int(codes.max(initial=0)).bit_length() // axes)
    for bit in range(bits):
        for axis in range(axes):
            places[:, axis] |= ((codes >> (bit * axes + axis)) & 1) << bit
    return places


def popcount(masks: Int[np.ndarray, "*any"]) -> Int[np.ndarray, "*any"]:
    """Count the bits that are set."""
    return np.bitwise_count(masks).astype(np.int64)


def set_bits(masks: Masks) -> Bool[np.ndarray, "node bit"]:
    """Spread masks of 16 bits or fewer."""
    return ((masks[:, None] >> np.arange(16)) & 1).astype(bool)


def _codes_by_level(entries: Entries, axes: int, depth: int) -> list[Codes]:
    """Find the nodes of each level: those with coefficients, and their ancestors."""
    codes = [np.zeros(0, np.int64)] * depth
    below = np.zeros(0, np.int64)
    for level in reversed(range(depth)):
        codes[level] = np.unique(np.concatenate([entries.code[entries.level == level], below]))
        below = codes[level] >> axes
    if not len(codes[0]):
        codes[0] = np.zeros(1, np.int64)
    return codes
