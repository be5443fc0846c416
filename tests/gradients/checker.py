"""What is asked of a row: that the derivatives by its arguments are right.

Along the direction of an argument the derivative, forward and reverse, compiled and mapped over the
places, is held against differences of the sixth order, of two lengths of step, the nearer of which
counts.  Single precision, where asked for, is held against the same differences, and must stay
single.

Errors are relative to the largest derivative of all outputs, or to a thousandth of the largest
value where nothing changes.
"""

import math
import zlib
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .motion import Moving, merged, set_moving
from .page import Row

DOUBLE, SINGLE = 1e-6, 1e-2
# Where a derivative vanishes, this part of the value stands for it.
_FLOOR = 1e-3
_STEPS = (1e-3, 1e-4)
# Each program runs once: what counts is how soon it is compiled.
_QUICK_TO_COMPILE = {
    "xla_backend_optimization_level": 0,
    "xla_llvm_disable_expensive_passes": True,
}
# Sixth order: about a point, and from an end of what is defined.
_CENTRAL = np.arange(-3, 4), np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
_ONE_SIDED = np.arange(7), np.array([-147, 360, -450, 400, -225, 72, -10]) / 60


class Found(NamedTuple):
    """The worst relative differences of one argument at one place; infinite where not finite.

    ``single`` is 0 where it was not asked for.
    """

    function: str
    argument: str
    place: str
    double: float
    single: float
    note: str

    @property
    def passes(self) -> bool:
        """Whether both are small enough."""
        return self.double <= DOUBLE and self.single <= SINGLE


def check(row: Row, *, in_single: bool = True) -> list[Found]:
    """Differentiate a function at all places of its row, and hold it against differences."""
    names, places = list(row.arguments), ["random", *row.edges]
    rng = np.random.default_rng(zlib.crc32(row.name.encode()))
    moved = [set_moving(row.arguments | dict(row.edges.get(place, {})), rng) for place in places]
    structure = moved[0].structure

    def of_leaves(moving: list, still: list) -> jax.Array:
        arguments = structure.unflatten(merged(moved[0], moving, still))
        return _flat(row.call(**dict(zip(names, arguments))))

    def derivatives(moving: list, moves: list, still: list):
        value, forward = jax.linearize(partial(of_leaves, still=still), moving)
        owners = np.array(moved[0].owners)
        by_name = [
            [jnp.where(own, move, 0) for own, move in zip(owners == k, moves)]
            for k in range(len(names))
        ]
        stacked = [jnp.stack(column) for column in zip(*by_name)]
        slopes = jax.vmap(forward)(stacked)
        weights = jnp.asarray(np.cos(1 + np.arange(value.size)), value.dtype)
        back = jax.linear_transpose(forward, moving)(weights)[0]
        products = [jnp.sum(a * b) for a, b in zip(back, moves)]
        own = [sum(p for p, o in zip(products, owners) if o == k) for k in range(len(names))]
        return value, slopes, jnp.stack([jnp.asarray(p, value.dtype) for p in own])

    compiled = _jit(jax.vmap(derivatives))
    still = _stacked([m.still for m in moved])
    moves = _stacked([[m for m in p.moves if m is not None] for p in moved])
    at_zero = _stacked([p.at(None, 0.0) for p in moved])
    double = [np.asarray(a) for a in compiled(at_zero, moves, still)]
    single, fault = None, ""
    if in_single:
        single, fault = _in_single(compiled, (at_zero, moves, still), double)
    precisions = [double] if single is None else [double, single]
    values = _jit(jax.vmap(of_leaves))
    found: list[Found] = []
    for step in _STEPS:
        # The shorter step is taken only where the longer one is not good enough.
        if found and all(one.passes for one in found):
            break
        differences, sizes = _differences(row, values, (moved, places), step)
        errors = [
            _errors(row, place, precisions, (p, k), (differences[p, k], sizes[p, k]))
            for p, place in enumerate(places)
            for k in range(len(names))
        ]
        pairs = [(place, name) for place in places for name in names]
        now = [
            Found(
                row.name,
                name,
                place,
                error[0],
                math.inf if fault else error[-1] if in_single else 0.0,
                fault or row.kinks.get(place) or row.one_sided.get(place, ""),
            )
            for (place, name), error in zip(pairs, errors)
        ]
        found = [min(pair, key=lambda one: one.double) for pair in zip(found or now, now)]
    return found


def _jit(function: Callable) -> Callable:
    return jax.jit(function, compiler_options=_QUICK_TO_COMPILE)


def _errors(
    row: Row,
    place: str,
    precisions: Sequence[list[np.ndarray]],
    index: tuple[int, int],
    reference: tuple[np.ndarray, float],
) -> list[float]:
    """Return the errors of one argument at one place, in each precision."""
    errors = []
    for _, slopes, products in precisions:
        expected = slopes[index] if place in row.kinks else reference[0]
        errors.append(_relative(slopes[index], products[index], expected, _FLOOR * reference[1]))
    return errors


def _in_single(
    compiled: Callable, arguments: tuple[list[np.ndarray], ...], double: list[np.ndarray]
) -> tuple[list[np.ndarray], str]:
    """Differentiate in single precision; say what is wrong with it beyond its numbers."""
    try:
        found = compiled(*map(_single, arguments))
    except (TypeError, ValueError) as error:
        # As where double and single are mixed, which strict promotion refuses.
        return double, f"{type(error).__name__}: {str(error).splitlines()[0][:80]}"
    kept = found[0].dtype == jnp.float32
    return [np.asarray(a) for a in found], "" if kept else f"becomes {found[0].dtype}"


def _stacked(places: list[list[np.ndarray]]) -> list[np.ndarray]:
    return [np.stack(column) for column in zip(*places, strict=True)]


def _single(leaves: list[np.ndarray]) -> list[np.ndarray]:
    kinds = {"f": np.float32, "c": np.complex64}
    return [leaf.astype(kinds.get(leaf.dtype.kind, leaf.dtype)) for leaf in leaves]


def _flat(values: Any) -> jax.Array:
    """Lay all numbers that have derivatives end to end."""
    leaves = [jnp.asarray(leaf) for leaf in jax.tree.leaves(values)]
    leaves = [leaf.ravel() for leaf in leaves if jnp.issubdtype(leaf.dtype, jnp.inexact)]
    leaves = [
        jnp.concatenate([leaf.real, leaf.imag]) if jnp.iscomplexobj(leaf) else leaf
        for leaf in leaves
    ]
    return leaves[0] if len(leaves) == 1 else jnp.concatenate(leaves)


def _differences(
    row: Row, values: Callable, places: tuple[list[Moving], list[str]], step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the differences, [place, argument, output], and the largest values they are of."""
    inputs, rest, count = [], [], len(row.arguments)
    stencils = [_ONE_SIDED if place in row.one_sided else _CENTRAL for place in places[1]]
    for own, (offsets, _) in zip(places[0], stencils):
        for argument in range(count):
            inputs += [own.at(argument, step * offset) for offset in offsets]
            rest += [own.still] * len(offsets)
    found = np.asarray(values(_stacked(inputs), _stacked(rest)))
    found = found.reshape(len(stencils), count, len(_CENTRAL[0]), -1)
    weights = np.stack([weights for _, weights in stencils]) / step
    return np.einsum("pasx,ps->pax", found, weights), np.abs(found).max(axis=(2, 3))


def _relative(forward: np.ndarray, reverse: Any, expected: np.ndarray, floor: float) -> float:
    """Return the larger of the two errors over the derivative's size; infinite if any is not."""
    if not all(np.all(np.isfinite(a)) for a in (forward, reverse, expected)):
        return math.inf
    weights = np.cos(1 + np.arange(expected.size))
    size = max(np.abs(expected).max(initial=0), floor)
    total = max(np.sum(np.abs(weights * expected)), floor)
    if size == 0:
        return float(max(np.abs(forward).max(initial=0), abs(reverse)))
    error = np.abs(forward - expected).max() / size
    return float(max(error, abs(reverse - weights @ expected) / total))
