"""How the arguments of a row move, each in one random direction.

Unit vectors move on the sphere, rotations in their group, all else freely.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np

from .page import Above, Along, Still, Turn, Unit

_MOTIONS = (Unit, Turn, Above, Along, Still)


class Moving(NamedTuple):
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


def set_moving(arguments: Mapping[str, Any], rng: np.random.Generator) -> Moving:
    """Choose the direction of each leaf."""
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
    return Moving(structure, owners, moves, pairs, paths, still)


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


def merged(place: Moving, moving: list, still: list) -> list:
    """Put moving and still leaves back in their order."""
    own = iter(
        jax.lax.complex(leaf[..., 0], leaf[..., 1]) if pairs else leaf
        for leaf, pairs in zip(moving, place.pairs)
    )
    rest = iter(still)
    return [next(rest) if move is None else next(own) for move in place.moves]
