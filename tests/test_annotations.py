"""Annotations are executed: what contradicts them ends a test.

- Axes of one name have one length, in arguments and in the result.
- Where no axes are named, types are held all the same; where annotations are text, too.
"""

import typing

import annotations
import jaxtyping
import numpy as np
import pytest
from beartype.roar import BeartypeCallHintViolation
from jaxtyping import Float

from jaxrender.geometry.convexity import is_closed
from jaxrender.pipelines.config.stated import is_stated
from jaxrender.shapes import Directions


def test_axes_of_one_name_have_one_length():
    corners, faces = np.zeros((3, 3)), np.zeros((1, 3), int)
    assert not is_closed(corners, faces)
    with pytest.raises(jaxtyping.TypeCheckError):
        is_closed(corners[:, :2], faces)


def test_types_are_held_where_no_axes_are_named():
    with pytest.raises(BeartypeCallHintViolation):
        is_stated("no model", "key")


@pytest.mark.parametrize(
    ("hint", "names"),
    [
        (Float[np.ndarray, "row column"], True),
        (Directions, True),
        (tuple[int, Float[np.ndarray, "row"] | None], True),
        (typing.Callable[[Directions], int], True),
        ("Nobody knows", True),
        (dict[str, int | None], False),
        (np.ndarray, False),
    ],
)
def test_which_hints_name_axes(hint, names):
    assert annotations._names_axes(hint) is names
