"""Newton's method on the host, with steps that are halved until the cost does not grow."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

_STEPS, _HALVINGS = 60, 30

_Point = TypeVar("_Point")


class Descent(NamedTuple):
    """Where a descent stopped, and whether it may: False where the steps ran out."""

    point: Any
    converged: bool


def descend(
    start: _Point,
    cost: Callable[[_Point], float],
    step_at: Callable[[_Point], _Point],
    ended: Callable[[_Point, _Point], bool],
    rounding: float = 0.0,
) -> Descent:
    """Go down from ``start``, an array or a pytree of arrays, by the steps of ``step_at``.

    A step may raise the cost by no more than the part ``rounding`` of it.  The descent ends where
    no part of a step does better, or where ``ended(before, after)`` says so of a step's two ends.
    """
    point, value = start, cost(start)
    for _ in range(_STEPS):
        step = step_at(point)
        for _ in range(_HALVINGS):
            after = jax.tree.map(np.add, point, step)
            there = cost(after)
            if there <= value * (1 + rounding):
                break
            step = jax.tree.map(lambda change: change / 2, step)
        else:
            return Descent(point, True)
        before, point, value = point, after, there
        if ended(before, point):
            return Descent(point, True)
    return Descent(point, False)
