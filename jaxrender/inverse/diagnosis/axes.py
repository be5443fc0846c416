"""An environment in another convention: all axis permutations are tried, and one that fits is said.

The material that was found under a wrong light means nothing.  So amplitudes are solved for anew
under each of the 48, at some widths of the lobe, and the least that is left counts.
"""

import itertools
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.models import columns_under
from jaxrender.inverse.shadowing import concave, nodes_seen
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Widths of the lobe that are tried, besides the one found.
_WIDTHS = (0.06, 0.12, 0.25, 0.5)
# So many samples are looked at, under light in cells this wide (radians).
_SAMPLES, _CELL = 350, 0.09
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
    if grounds.light.environment is None:
        return None
    grounds = grounds.thinned(_SAMPLES)
    every_node = grounds.environment_nodes(_CELL)
    material = grounds.material
    materials = [material]
    if isinstance(material, Glossy) and material.has_frequency_view:
        mu = None if material.mu is None else float(np.clip(float(material.mu), 1.2, 2.5))
        materials += [material.with_roughness(width, mu) for width in _WIDTHS]
    measured = np.asarray(grounds.observations.radiance, float)
    every = []
    for matrix in permutations():
        directions = np.asarray(every_node.directions) @ matrix.T
        nodes = every_node._replace(directions=directions)
        left = min(_left(grounds, one, nodes, measured) for one in materials)
        every.append((left, matrix))
    as_told, (least, matrix) = every[0][0], min(every, key=lambda one: one[0])
    if least >= _LESS * as_told:
        return None
    return OtherAxes(matrix, float(least), float(as_told))


def _left(
    grounds: Grounds,
    material: Parametric,
    nodes: LightNodes,
    measured: Float[np.ndarray, "sample channel"],
) -> float:
    """Solve for the amplitudes, and say what part of the photographs is left (rms)."""
    columns = _columns_of(grounds, material, nodes)
    for source in grounds.sources:
        columns = columns + _columns_of(grounds, material, source.nodes)
    columns = columns * grounds.gain[:, :, None]
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
    return np.asarray(_columns(material, grounds.samples, nodes, seen))


@stored(older_emitters=True)
def _columns(
    brdf: Parametric,
    samples: SurfaceSamples,
    nodes: LightNodes | FrameNodes,
    seen: Bool[AnyArray, "sample node"] | None,
) -> Float[Array, "sample lobe channel"]:
    return columns_under(brdf, samples, nodes, seen)
