"""Sources in groups that move together: each of a few by itself, many as one."""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import frame_nodes
from jaxrender.lighting import LightNodes
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import Float, Int

# More sources than this turn together.
_MOST = 6


class SourceGroup(NamedTuple):
    """Sources that turn together: some of all photographs, or (None) each photograph's own."""

    index: Int[np.ndarray, "source"] | None

    def nodes(
        self, light: KnownLight, frame: Int[np.ndarray, "sample"]
    ) -> tuple[LightNodes | FrameNodes, Float[np.ndarray, "*#frame source"]]:
        """List their point masses as the object's centre sees them, and how near they are."""
        if self.index is None:
            own = frame_nodes(light, frame)
            assert own is not None
            near = np.zeros((1, 1)) if light.near is None else np.asarray(light.near.of_frames)
            return own, np.broadcast_to(near, np.asarray(own.directions).shape[:2])
        directions, irradiance = (np.asarray(a)[self.index] for a in light.directional.nodes())
        near = np.zeros(len(self.index))
        if light.near is not None:
            near = np.asarray(light.near.of_sources)[self.index]
        return LightNodes(directions, irradiance), near


def source_groups(light: KnownLight) -> tuple[SourceGroup, ...]:
    """Sort the sources of a light; dark ones are in no group."""
    lit = np.flatnonzero(np.any(np.asarray(light.directional.irradiance) > 0, axis=1))
    if len(lit) > _MOST:
        found = [SourceGroup(lit)]
    else:
        found = [SourceGroup(lit[k : k + 1]) for k in range(len(lit))]
    return tuple(found) if light.per_frame is None else (*found, SourceGroup(None))
