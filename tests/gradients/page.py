"""A row of the page, and what is asked of it.

A row is a function, its arguments at a random place, and what they are at the edges.  Each
argument moves in one random direction: unit vectors on the sphere, rotations in their group, all
else freely.  Along it the derivative, forward and reverse, compiled and mapped over the places, is
held against differences of the sixth order, of two lengths of step, the nearer of which counts.
Single precision, where asked for, is held against the same differences, and must stay single.

Errors are relative to the largest derivative of all outputs, or to a thousandth of the largest
value where nothing changes.
"""

import inspect
import math
import typing
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

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


class Unit(NamedTuple):
    """Unit vectors, which move on the sphere."""

    values: np.ndarray


class Turn(NamedTuple):
    """Rotation matrices, which move in their group."""

    values: np.ndarray


class Above(NamedTuple):
    """Numbers above a least one, which move in proportion to what they are above it."""

    values: Any
    least: float = 0.0


class Along(NamedTuple):
    """Numbers that move in a stated direction."""

    values: Any
    move: Any


class Still(NamedTuple):
    """Numbers that do not move."""

    values: Any


_MOTIONS = (Unit, Turn, Above, Along, Still)


@dataclass(frozen=True)
class Row:
    """A function with its arguments by name at a random place, and those that differ at edges.

    ``one_sided`` names the edges that are the end of what is defined, ``kinks`` those without a
    derivative, where it has only to be finite and alike forward and reverse; each with its reason.
    ``at`` tells rows of one function apart.
    """

    function: str
    call: Callable
    arguments: Mapping[str, Any]
    edges: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    one_sided: Mapping[str, str] = field(default_factory=dict)
    kinks: Mapping[str, str] = field(default_factory=dict)
    at: str = ""

    @property
    def name(self) -> str:
        """The function, and what tells its rows apart."""
        return f"{self.function}, {self.at}" if self.at else self.function


class Chapter(NamedTuple):
    """The rows of a package, and its exceptions: names and why they are on no row."""

    rows: Sequence[Row]
    exceptions: Mapping[str, str]


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
    moved = [_moving(row.arguments | dict(row.edges.get(place, {})), rng) for place in places]
    structure = moved[0].structure

    def of_leaves(moving: list, still: list) -> jax.Array:
        arguments = structure.unflatten(_merged(moved[0], moving, still))
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


class _Moving(NamedTuple):
    """The arguments at a place as leaves: paths of those that move, the rest as they are."""

    structure: Any
    owners: list[int]
    """Which argument each moving leaf belongs to."""
    moves: list
    """The direction of each leaf; None where it stands still."""
    pairs: list[bool]
    """Which moving leaves are complex, laid out as pairs of real and imaginary part."""
    paths: list[Callable[[float], np.ndarray]]
    still: list[np.ndarray]

    def at(self, argument: int | None, step: float) -> list[np.ndarray]:
        """Move the leaves of one argument by a step."""
        return [p(step if o == argument else 0.0) for p, o in zip(self.paths, self.owners)]


def _moving(arguments: Mapping[str, Any], rng: np.random.Generator) -> _Moving:
    owners, moves, pairs, paths, still = [], [], [], [], []
    for number, argument in enumerate(arguments.values()):
        for leaf in jax.tree.leaves(argument, is_leaf=_is_motion):
            path, move = _path(leaf, rng)
            if move is None:
                still.append(path(0.0))
            else:
                owners.append(number)
                pairs.append(np.iscomplexobj(move))
                paths.append(lambda step, path=path: _as_pairs(path(step)))
                move = _as_pairs(move)
            moves.append(move)
    structure = jax.tree.structure(tuple(arguments.values()), is_leaf=_is_motion)
    return _Moving(structure, owners, moves, pairs, paths, still)


def _is_motion(leaf: Any) -> bool:
    return isinstance(leaf, _MOTIONS)


def _path(leaf: Any, rng: np.random.Generator) -> tuple[Callable[[float], np.ndarray], Any]:
    """Return where a leaf goes by the length of the step, and its direction there."""
    start = np.asarray(leaf.values if _is_motion(leaf) else leaf)
    if isinstance(leaf, Unit):
        move = rng.normal(size=start.shape)
        move -= np.sum(move * start, axis=-1, keepdims=True) * start
        move /= np.linalg.norm(move, axis=-1, keepdims=True)
        return lambda step: start * np.cos(step) + move * np.sin(step), move
    if isinstance(leaf, Turn):
        axis = rng.normal(size=(*start.shape[:-2], 3))
        axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
        cross = np.cross(axis[..., None, :], np.eye(3))

        def turned(step: float) -> np.ndarray:
            return start @ (np.eye(3) + np.sin(step) * cross + (1 - np.cos(step)) * cross @ cross)

        return turned, start @ cross
    if isinstance(leaf, Still) or not np.issubdtype(start.dtype, np.inexact):
        return lambda step: start, None
    if isinstance(leaf, Along):
        move = np.broadcast_to(np.asarray(leaf.move, start.dtype), start.shape)
    elif isinstance(leaf, Above):
        move = (start - leaf.least) * rng.uniform(0.5, 1, start.shape)
    else:
        move = rng.normal(size=start.shape)
        if np.iscomplexobj(start):
            move = move + 1j * rng.normal(size=start.shape)
        size = np.sqrt(np.mean(np.abs(start) ** 2)) if start.size else 0.0
        move = move * (size or 1.0)
    return lambda step: start + step * move, move


def _as_pairs(values: np.ndarray) -> np.ndarray:
    """Split complex numbers, so that derivatives are those of real functions."""
    if not np.iscomplexobj(values):
        return values
    return np.stack([values.real, values.imag], axis=-1)


def _merged(place: _Moving, moving: list, still: list) -> list:
    """Put moving and still leaves back in their order."""
    own = iter(
        jax.lax.complex(leaf[..., 0], leaf[..., 1]) if pairs else leaf
        for leaf, pairs in zip(moving, place.pairs)
    )
    rest = iter(still)
    return [next(rest) if move is None else next(own) for move in place.moves]


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
    row: Row, values: Callable, places: tuple[list[_Moving], list[str]], step: float
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


def unlisted(package: ModuleType, chapter: Chapter) -> list[str]:
    """Name what the package gives that is on neither list, and what is listed that it lacks."""
    rows: dict[str, set[str]] = {}
    for row in chapter.rows:
        rows.setdefault(row.function, set()).update(row.arguments)
    missing = []
    for name in package.__all__:
        thing = getattr(package, name)
        if name in chapter.exceptions or not callable(thing):
            continue
        if inspect.isclass(thing):
            missing += _unlisted_methods(name, thing, rows, chapter.exceptions)
        elif name not in rows:
            missing.append(f"{name}: on neither list")
        else:
            left = _array_parameters(thing) - rows[name]
            missing += [
                f"{name}: no row moves {argument}"
                for argument in sorted(left)
                if f"{name}.{argument}" not in chapter.exceptions
            ]
    known = set(package.__all__)
    listed = {*rows, *chapter.exceptions}
    gone = sorted(name for name in listed if name.split(".")[0] not in {*known, "*"})
    both = sorted({*rows} & {*chapter.exceptions})
    return (
        missing
        + [f"{name}: listed, but the package has no such thing" for name in gone]
        + [f"{name}: on both lists" for name in both]
    )


def _unlisted_methods(
    name: str, thing: type, rows: Mapping[str, set[str]], exceptions: Mapping[str, str]
) -> list[str]:
    """Name the public methods of its own that take arrays and are on neither list."""
    wanted = [
        method
        for method, value in vars(thing).items()
        if not method.startswith("_")
        and not isinstance(value, (classmethod, staticmethod, property))
        and inspect.isfunction(getattr(thing, method))
        and _array_parameters(getattr(thing, method))
    ]
    found = [
        f"{name}.{method}: on neither list"
        for method in wanted
        if not {f"{name}.{method}", f"*.{method}"} & {*rows, *exceptions}
    ]
    if not wanted and name not in {row.split(".")[0] for row in rows}:
        found.append(f"{name}: on neither list")
    return found


def _array_parameters(function: Callable) -> set[str]:
    """Name the parameters whose annotation says that they hold floating or complex arrays."""
    hints = getattr(function, "__annotations__", {})
    parameters = inspect.signature(function).parameters
    return {name for name in parameters if _holds_arrays(hints.get(name))}


def _holds_arrays(hint: Any) -> bool:
    if isinstance(hint, str):
        return any(word in hint for word in ("Float[", "Complex[", "Inexact["))
    inner = typing.get_args(hint)
    if typing.get_origin(hint) is not None and "Callable" in str(typing.get_origin(hint)):
        return False
    if inner:
        return any(_holds_arrays(part) for part in inner)
    kinds = getattr(hint, "dtypes", ())
    return any(str(kind).startswith(("float", "complex")) for kind in kinds)
