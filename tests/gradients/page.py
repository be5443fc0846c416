"""A row of the page: a function, its arguments at a random place, and what they are at the edges.

``checker`` says what is asked of it, ``motion`` how its arguments move.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np


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
