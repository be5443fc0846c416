"""A luminaire among the lights of a path tracer: drawn over its surface, met by rays (L 8.6).

Both ways of finding its light are weighted by the balance heuristic, as for every ``Emitter``.  A
luminaire casts no shadow: it stands for what leaves its surface, and what is behind it is seen past
it; put a shape there if it has a body.
"""

import numpy as np

from jaxrender.lighting.luminaires import Luminaire
from jaxrender.reflection.tracing.emitters import Emitter, LightSample
from jaxrender.reflection.tracing.luminaire_sampling import LuminaireSampler
from jaxrender.shapes import Float


class LuminaireEmitter(Emitter):
    """One luminaire, its places drawn by ``LuminaireSampler``."""

    def __init__(self, luminaire: Luminaire):
        self._luminaire, self._sampler = luminaire, LuminaireSampler(luminaire)

    @property
    def channels(self) -> int:
        """Those of its trees."""
        return self._luminaire.trees[0].channels

    @property
    def is_met(self) -> bool:
        """By rays that cross its surface."""
        return True

    def draw(
        self, points: Float[np.ndarray, "place 3"], uniforms: Float[np.ndarray, "place 2"]
    ) -> LightSample:
        """Draw places of its surface; dark where none faces the point."""
        drawn = self._sampler.draw(points, uniforms)
        there = (drawn.density > 0)[:, None]
        density = np.where(there, drawn.density[:, None], 1)
        irradiance = np.where(there, np.asarray(drawn.radiance, float) / density, 0)
        return LightSample(drawn.directions, drawn.distance, irradiance, drawn.density)

    def radiance(
        self,
        origins: Float[np.ndarray, "ray 3"],
        directions: Float[np.ndarray, "ray 3"],
        reach: Float[np.ndarray, "ray"],
    ) -> Float[np.ndarray, "ray channel"]:
        """What leaves it along rays that reach it before a surface."""
        seen = self._luminaire.radiance_along(origins, directions)
        before = np.asarray(seen.distance) < reach
        return np.where(before[:, None], np.asarray(seen.radiance, float), 0)

    def density(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Float[np.ndarray, "ray"]:
        """With which its places are drawn; zero past it."""
        return self._sampler.density(origins, directions)
