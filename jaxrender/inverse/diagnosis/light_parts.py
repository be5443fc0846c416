"""The light in parts that a cause may change apart from each other, known or found."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxrender.harmonics import band_limit_of
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import environment_nodes
from jaxrender.inverse.nuisances import source_groups
from jaxrender.lighting import DirectionalSources, HarmonicLight, LightNodes
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import Float, Int

# Nodes are filled up with dark ones to a multiple of this, so that few programs are compiled.
_NODES = 1024
# Of sources that were found so many, the brightest, are by themselves: those are lamps, if any are.
_SINGLE = 4


class SourceNodes(NamedTuple):
    """Point masses of sources that turn together, and how near they are: 0 at infinity."""

    nodes: LightNodes | FrameNodes
    nearness: Float[np.ndarray, "*#frame source"]


class LightParts(NamedTuple):
    """All that lights the samples: what surrounds the object, and groups of sources.

    ``told`` is the whole light, if it was told.

    ``surrounding`` lists point masses in cells of a width (radians); None where there are sources
    alone.  ``sources`` lists those of each group.  Both are asked for samples' photographs.
    """

    surrounding: Callable[[float, Int[np.ndarray, "sample"]], LightNodes | FrameNodes] | None
    sources: Callable[[Int[np.ndarray, "sample"]], tuple[SourceNodes, ...]]
    told: KnownLight | None = None

    @classmethod
    def known(cls, light: KnownLight) -> "LightParts":
        """Take apart a light that was told."""

        def surrounding(cell: float, frame: Int[np.ndarray, "sample"]) -> LightNodes | FrameNodes:
            nodes = environment_nodes(light, 1.0, cell, frame)
            assert nodes is not None
            return filled(nodes) if isinstance(nodes, LightNodes) else nodes

        def sources(frame: Int[np.ndarray, "sample"]) -> tuple[SourceNodes, ...]:
            return tuple(SourceNodes(*g.nodes(light, frame)) for g in source_groups(light))

        return cls(surrounding if light.has_environment else None, sources, light)

    @classmethod
    def found(
        cls, slow: Float[np.ndarray, "coefficient channel"], found: DirectionalSources
    ) -> "LightParts":
        """Take apart a light that was found: slow light, which may be negative, and sources.

        All but the brightest sources are one group.
        """

        def surrounding(cell: float, frame: Int[np.ndarray, "sample"]) -> LightNodes:
            rows = max(math.ceil(np.pi / cell), 2 * band_limit_of(len(slow)) + 1)
            return filled(HarmonicLight(slow, rows).nodes())

        def sources(frame: Int[np.ndarray, "sample"]) -> tuple[SourceNodes, ...]:
            directions, irradiance = (np.asarray(part, float) for part in found.nodes())
            order = np.argsort(-irradiance.sum(axis=1))
            single, rest = np.split(order, [_SINGLE])
            groups = [*single[:, None], *([rest] if len(rest) else [])]
            return tuple(
                SourceNodes(LightNodes(directions[g], irradiance[g]), np.zeros(len(g)))
                for g in groups
            )

        return cls(surrounding, sources)


def filled(nodes: LightNodes) -> LightNodes:
    """Add dark nodes up to a round number."""
    directions, irradiance = (np.asarray(part) for part in nodes)
    more = -len(directions) % _NODES
    dark = np.tile([0.0, 0.0, 1.0], (more, 1))
    return LightNodes(
        np.concatenate([directions, dark]),
        np.concatenate([irradiance, np.zeros((more, irradiance.shape[1]))]),
    )
