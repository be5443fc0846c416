"""An environment in another convention: all axis permutations are tried, and one that fits is said.

The material that was found under a wrong light means nothing.  So amplitudes are solved for anew
under each of the 48, at some widths of the lobe, and the least that is left counts.
"""

import itertools
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.diagnosis.turning import lobes_under
from jaxrender.inverse.shadowing import concave, nodes_seen
from jaxrender.lighting import LightNodes
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import Float

# So many samples are looked at.
_SAMPLES = 250
# Widths of the lobe tried besides the one found, under light in cells this wide (radians).
_WIDTHS, _CELL = (0.06, 0.12, 0.25, 0.5), 0.09
# Wide lobes under wide cells say first which permutations are worth it, and so many of them are.
_WIDE, _WIDE_CELL, _WORTH = (0.25, 0.5), 0.25, 7
# Other axes are said where they leave less than this part of what the told ones leave.
_LESS = 0.5
_NAMES = ("x", "y", "z")


class OtherAxes(NamedTuple):
    """A signed permutation that fits better: world directions by those told.

    ``left`` is the part of the photographs (rms) that is left then, ``as_told`` that as things are.
    """

    matrix: Float[np.ndarray, "3 3"]
    left: float
    as_told: float

    def sentence(self) -> str:
        """Say it in words."""
        axes = ", ".join(_signed(column) for column in self.matrix.T)
        return (
            f"the environment is in another convention: its axes x, y, z should lie along {axes} "
            f"(that leaves {100 * self.left:.2g} %, as told {100 * self.as_told:.2g} %)"
        )


def _signed(axis: Float[np.ndarray, "3"]) -> str:
    at = int(np.argmax(np.abs(axis)))
    return ("-" if axis[at] < 0 else "+") + _NAMES[at]


def permutations() -> list[Float[np.ndarray, "3 3"]]:
    """List all 48 signed permutations of the axes, the one that changes nothing first."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            found.append(np.eye(3)[:, order] * np.array(signs))
    return found


def other_axes(grounds: Grounds) -> OtherAxes | None:
    """Try all permutations; None where the told one does as well, or there is no environment."""
    if grounds.light.surrounding is None:
        return None
    grounds = grounds.thinned(_SAMPLES)
    told, *others = permutations()
    screened = _left_under(grounds, [told, *others], _WIDE, _WIDE_CELL)
    worth = [others[at] for at in np.argsort(screened[1:])[:_WORTH]]
    tried = [told, *worth]
    left = _left_under(grounds, tried, _WIDTHS, _CELL)
    best = int(np.argmin(left))
    if left[best] >= _LESS * left[0]:
        return None
    return OtherAxes(tried[best], float(left[best]), float(left[0]))


def _left_under(
    grounds: Grounds,
    matrices: list[Float[np.ndarray, "3 3"]],
    widths: tuple[float, ...],
    cell: float,
) -> Float[np.ndarray, "matrix"]:
    """Say what is left under each permutation, with the best of the widths (rms)."""
    assert grounds.light.surrounding is not None
    every_node = grounds.light.surrounding(cell, grounds.frame)
    least = np.full(len(matrices), np.inf)
    for material in _of_widths(grounds.material, widths):
        lit = sum(_columns_of(grounds, material, source.nodes) for source in grounds.sources)
        for at, matrix in enumerate(matrices):
            directions = np.asarray(every_node.directions) @ matrix.T
            nodes = every_node._replace(directions=directions)
            columns = (_columns_of(grounds, material, nodes) + lit) * grounds.gain[:, :, None]
            least[at] = min(least[at], _left(grounds, columns))
    return least


def _of_widths(material: Parametric, widths: tuple[float, ...]) -> list[Parametric]:
    found: list[Parametric] = [material]
    if isinstance(material, Glossy) and material.has_frequency_view:
        mu = None if material.mu is None else float(np.clip(float(material.mu), 1.2, 2.5))
        found += [material.with_roughness(width, mu) for width in widths]
    return found


def _left(grounds: Grounds, columns: Float[np.ndarray, "sample lobe channel"]) -> float:
    """Solve for the amplitudes, and say what part of the photographs is left (rms)."""
    measured = np.asarray(grounds.observations.radiance, float)
    squares, total = 0.0, 0.0
    for channel, values in enumerate(measured.T):
        some = columns[:, :, channel]
        found = np.linalg.lstsq(some, values, rcond=None)[0]
        squares += float(np.sum((values - some @ found) ** 2))
        total += float(np.sum(values**2))
    return float(np.sqrt(squares / total))


def _columns_of(
    grounds: Grounds, material: Parametric, nodes: LightNodes | FrameNodes
) -> Float[np.ndarray, "sample lobe channel"]:
    traced = nodes_seen(concave(grounds.shape), grounds.observations, (nodes,))
    seen = None if traced is None else traced[0]
    return np.asarray(lobes_under(material, grounds.samples, nodes, seen))
