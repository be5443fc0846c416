"""Sources in groups that move together: each of a few by itself, many as one."""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.known_light import KnownLight
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
    ) -> tuple[LightNodes | FrameNodes, Float[np.ndarray, "source"]]:
        """List their point masses as the object's centre sees them, and how near they are."""
        if self.index is None:
            own = light.frame_nodes(frame)
            assert own is not None
            return own, np.full(1, 0.0 if light.near is None else light.near.of_frames)
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
