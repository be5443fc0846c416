"""The ways in which cameras and a mesh may be meant: axes, mirrors, turns, units."""

import itertools
from typing import NamedTuple

import numpy as np

from jaxrender.geometry import CAMERA_AXES, Placement, Shape, Sphere, axis_turns
from jaxrender.shapes import Float

UNITS = (1.0, 0.001, 0.01, 0.1, 10.0, 100.0, 1000.0)
TURNS = tuple(axis_turns())

_WORDS = {
    "opengl": "OpenGL",
    "opencv": "OpenCV",
    "pytorch3d": "PyTorch3D",
    "llff": "LLFF",
    "ros": "ROS",
}


class Framing(NamedTuple):
    """How a capture may be meant: its cameras' axes, mirrored pictures, its mesh's axes and unit.

    ``turn`` is the number of one of ``TURNS``, which the mesh's own axes take before it is placed
    as it is told; ``unit`` multiplies its scale.
    """

    axes: str = "opengl"
    mirrored: bool = False
    turn: int = 0
    unit: float = 1.0

    @property
    def own(self) -> Placement:
        """What becomes of the mesh before it is placed as it is told."""
        return Placement(self.unit, TURNS[self.turn])

    def moved(self, told: Placement) -> Placement:
        """Where it takes what is placed as it is told: from the world to the world."""
        return told.after(self.own).after(told.inverse)

    def changes(self, told: "Framing") -> int:
        """Count what is other than told."""
        return sum(one != other for one, other in zip(self, told, strict=True))

    def aspect(self, name: str) -> str:
        """Say one aspect of it in words."""
        if name == "axes":
            return axes_in_words(self.axes)
        if name == "mirrored":
            return "mirrored pictures" if self.mirrored else "pictures the right way round"
        if name == "turn":
            return up_in_words(TURNS[self.turn])
        return f"lengths of the shape times {self.unit:g}"


def axes_in_words(axes: str) -> str:
    """Say in which axes a pose is."""
    word, inverted = axes.removesuffix("_inverted"), axes.endswith("_inverted")
    return f"{_WORDS[word]} axes" + (", poses inverted (world to camera)" if inverted else "")


def up_in_words(turn: Float[np.ndarray, "3 3"]) -> str:
    """Say which axes of the mesh point to the world's z and x."""
    if np.array_equal(turn, np.eye(3)):
        return "the mesh's axes as they are"
    return f"the mesh's {_axis(turn[2])} up, its {_axis(turn[0])} along x"


def _axis(row: Float[np.ndarray, "3"]) -> str:
    at = int(np.argmax(np.abs(row)))
    return ("-" if row[at] < 0 else "+") + "xyz"[at]


def framings(told: Framing, shape: Shape) -> list[Framing]:
    """List all framings of a shape, the told one first.

    The turns of a sphere about the origin make no difference, and are left out.
    """
    turns = range(len(TURNS))
    if isinstance(shape, Sphere) and np.linalg.norm(shape.center) < 1e-6 * shape.radius:
        turns = (0,)
    found = [
        Framing(axes, mirrored, turn, unit)
        for axes, mirrored, turn, unit in itertools.product(
            CAMERA_AXES, (False, True), turns, UNITS
        )
    ]
    return [told, *(one for one in found if one != told)]
