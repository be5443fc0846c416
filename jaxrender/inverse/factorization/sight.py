"""Which directions the samples of a concave object see, past the object itself.  Host side."""

from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Shape, SurfacePlaces, visible
from jaxrender.harmonics import LatLongGrid
from jaxrender.shapes import AnyArray, Bool, Float, Int

# Light that a concave object hides from itself is summed over this grid, and no other light.
_HIDDEN_GRID = LatLongGrid(48, 96)


class HiddenNodes(NamedTuple):
    """Directions by which hidden light is summed, with their solid angles."""

    directions: Float[np.ndarray, "node 3"]
    solid_angle: Float[np.ndarray, "node"]


class Sight:
    """Traces towards sources anew whenever they move, and towards fixed directions only once."""

    def __init__(self, shape: Shape, places: SurfacePlaces):
        self._shape, self._places = shape, places
        self._known: dict[bytes, Bool[np.ndarray, "sample direction"]] = {}

    def take(self, index: Int[np.ndarray, "kept"]) -> "Sight":
        """Keep the samples of the given indices."""
        return Sight(self._shape, SurfacePlaces(*(np.asarray(a)[index] for a in self._places)))

    def of(self, towards: Float[AnyArray, "direction 3"]) -> Bool[np.ndarray, "sample direction"]:
        """Trace which of the directions each sample sees."""
        return visible(self._shape, self._places, np.asarray(towards))

    def of_fixed(
        self, towards: Float[AnyArray, "direction 3"]
    ) -> Bool[np.ndarray, "sample direction"]:
        """Trace the same, and remember it for sets of directions that are asked for again."""
        key = np.asarray(towards).tobytes()
        if key not in self._known:
            self._known[key] = self.of(towards)
        return self._known[key]

    def hidden(self) -> Bool[np.ndarray, "sample node"]:
        """Mark the ``hidden_nodes`` that each sample does not see."""
        return ~self.of_fixed(hidden_nodes().directions)


def hidden_nodes() -> HiddenNodes:
    """Make the nodes, the same for every object."""
    return HiddenNodes(_HIDDEN_GRID.directions().reshape(-1, 3), _HIDDEN_GRID.weights().ravel())
