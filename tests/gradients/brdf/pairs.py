"""Pairs of directions, at random and at the edges, and a model's row, which is evaluated for them.

Numbers that several lists share stand here too.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..page import Above, Row, Unit
from ..places import repeated

CHANNELS = {"kd": np.array([0.05, 0.1]), "ks": np.array([0.3, 0.2])}
UP = repeated([0.0, 0.0, 1.0])


def directions(cosines: list[float], azimuths: list[float]) -> np.ndarray:
    """Directions of stated cosines to the normal and azimuths."""
    cosine, azimuth = np.array(cosines), np.array(azimuths)
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)


OUT = directions([0.8, 0.35], [0.4, 2.3])
MIRROR = OUT * [-1, -1, 1]
# About a lobe of width .2 away from the mirror's direction, in the plane and out of it.
NEAR = MIRROR + np.array([[0.1, -0.15, 0.02], [-0.1, 0.12, 0.1]])
NEAR /= np.linalg.norm(NEAR, axis=1, keepdims=True)
# A hundredth of a radian away.
CLOSE = MIRROR + np.array([[0.01, -0.008, 0.002], [-0.006, 0.012, 0.004]])
CLOSE /= np.linalg.norm(CLOSE, axis=1, keepdims=True)
GRAZING = directions([0.03, 0.02], [0.4, 2.3])
OPPOSITE = directions([0.04, 0.03], [0.43 + np.pi, 2.26 + np.pi])
PAIR = {"incoming": Unit(NEAR), "outgoing": Unit(OUT)}
# Where the directions themselves are at an edge.
PLACES = {
    "head-on": {"incoming": Unit(UP), "outgoing": Unit(UP)},
    "at the mirror": {"incoming": Unit(MIRROR)},
    "coincident": {"incoming": Unit(OUT)},
    "grazing": {"incoming": Unit(OPPOSITE), "outgoing": Unit(GRAZING)},
    "below": {"incoming": Unit(NEAR * [1, 1, -1])},
}


def scalar(value: float, least: float = 0.0) -> Above:
    """A number above a least one."""
    return Above(np.array(value), least)


def width(name: str, narrow: float = 0.01, wide: float = 1.5) -> dict[str, dict[str, Any]]:
    """A narrow lobe close to its middle, and a wide one."""
    return {
        f"{name} {narrow:g}": {name: Above(np.array(narrow)), "incoming": Unit(CLOSE)},
        f"{name} {wide:g}": {name: Above(np.array(wide))},
    }


MU = {"mu": scalar(1.5, 1)}
INDICES = {
    "mu 1.001": {"mu": Above(np.array(1.001), 1)},
    "mu 100": {"mu": Above(np.array(100.0), 1)},
}
COSINES = np.array([0.8, 0.3])


def model(
    at: str,
    kind: type,
    parameters: Mapping[str, Any],
    edges: Mapping[str, Mapping[str, Any]] | None = None,
    kinks: Mapping[str, str] | None = None,
    **static: Any,
) -> Row:
    """A model of its parameters, evaluated for two directions."""

    def evaluate(incoming, outgoing, **own):
        return kind(**own, **static).evaluate(incoming, outgoing)

    everything = {**PLACES, **(edges or {})}
    arguments = {**parameters, **PAIR}
    return Row(kind.__name__, evaluate, arguments, everything, kinks=kinks or {}, at=at)
