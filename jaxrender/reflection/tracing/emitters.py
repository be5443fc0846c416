"""Light that paths can be connected to: drawn from, and seen by rays that happen to meet it.

``Emitter`` is what the path tracer knows of light.  Drawn samples carry the irradiance on a plane
that faces them, radiance / density: for a directional source, whose density is infinite, just its
irradiance.  Rays that reach an emitter ask for its radiance, and for the density with which it
would have been drawn, so that both ways are weighted by the balance heuristic.

Directions are unit vectors in the world, towards the light.
"""

import abc
from typing import NamedTuple

import numpy as np

from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.shapes import AnyArray, Float


class LightSample(NamedTuple):
    """Light drawn for each place; all that is needed to connect it."""

    directions: Float[np.ndarray, "place 3"]
    distance: Float[np.ndarray, "place"]
    """To the emitter, infinite for light from beyond all surfaces."""
    irradiance: Float[np.ndarray, "place channel"]
    """On a plane facing it, unless something is in between; zero where nothing was drawn."""
    density: Float[np.ndarray, "place"]
    """Per steradian; infinite for a point of light, which no ray meets by chance."""


class Emitter(abc.ABC):
    """Light, and how it is sampled."""

    @property
    @abc.abstractmethod
    def channels(self) -> int:
        """How many colour channels it has."""

    @property
    @abc.abstractmethod
    def is_met(self) -> bool:
        """Whether rays can meet it by chance."""

    @abc.abstractmethod
    def draw(
        self, points: Float[np.ndarray, "place 3"], uniforms: Float[np.ndarray, "place 2"]
    ) -> LightSample:
        """Draw light for places on surfaces."""

    @abc.abstractmethod
    def radiance(
        self,
        origins: Float[np.ndarray, "ray 3"],
        directions: Float[np.ndarray, "ray 3"],
        reach: Float[np.ndarray, "ray"],
    ) -> Float[np.ndarray, "ray channel"]:
        """Evaluate the radiance met by rays that end at a surface after ``reach``, or never."""

    @abc.abstractmethod
    def density(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Float[np.ndarray, "ray"]:
        """Evaluate the density with which ``draw`` has these directions, per steradian."""


class DirectionalEmitter(Emitter):
    """Directional sources, of which each place draws one with equal chance."""

    def __init__(self, sources: DirectionalSources):
        self._directions = np.asarray(sources.directions, float)
        self._irradiance = np.asarray(sources.irradiance, float)
        if not len(self._directions):
            raise ValueError("no directional sources: leave the emitter out")

    @property
    def channels(self) -> int:
        """Those of the sources."""
        return self._irradiance.shape[1]

    @property
    def is_met(self) -> bool:
        """Never."""
        return False

    def draw(
        self, points: Float[np.ndarray, "place 3"], uniforms: Float[np.ndarray, "place 2"]
    ) -> LightSample:
        """Choose a source, its irradiance over the chance of the choice."""
        count = len(self._directions)
        chosen = np.minimum((uniforms[:, 0] * count).astype(int), count - 1)
        endless = np.full(len(points), np.inf)
        irradiance = count * self._irradiance[chosen]
        return LightSample(self._directions[chosen], endless, irradiance, endless)

    def radiance(
        self,
        origins: Float[np.ndarray, "ray 3"],
        directions: Float[np.ndarray, "ray 3"],
        reach: Float[np.ndarray, "ray"],
    ) -> Float[np.ndarray, "ray channel"]:
        """None."""
        return np.zeros((len(origins), self.channels))

    def density(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Float[np.ndarray, "ray"]:
        """Zero: no other way finds these directions."""
        return np.zeros(len(origins))


class EnvironmentEmitter(Emitter):
    """An image of the light from everywhere, taken as constant over each texel.

    Texels are drawn by their share of the total, places within them by solid angle.  This is a
    light of area, not the sum over nodes of the reference integral: they differ by the texels' size
    (2e-3 for 128 rows).
    """

    def __init__(self, light: Environment):
        self._radiance = np.asarray(light.radiance, float)
        rows, columns, _ = self._radiance.shape
        if (self._radiance < 0).any() or not self._radiance.any():
            raise ValueError("the environment is black or has negative texels: nothing to draw")
        self._edges = np.cos(np.pi * np.arange(rows + 1) / rows)
        areas = -np.diff(self._edges) * 2 * np.pi / columns
        power = self._radiance.mean(axis=-1) * areas[:, None]
        # By power: the density vanishes only where the light does.
        self._density = power / (areas[:, None] * power.sum())
        self._cumulative = np.cumsum(power.ravel()) / power.sum()

    @classmethod
    def uniform(cls, radiance: Float[AnyArray, "channel"]) -> "EnvironmentEmitter":
        """The same radiance from everywhere."""
        return cls(Environment(np.ones((8, 16, 1)) * np.asarray(radiance, float)))

    @property
    def channels(self) -> int:
        """Those of the image."""
        return self._radiance.shape[2]

    @property
    def is_met(self) -> bool:
        """By all that leaves."""
        return True

    def draw(
        self, points: Float[np.ndarray, "place 3"], uniforms: Float[np.ndarray, "place 2"]
    ) -> LightSample:
        """Draw texels by power; what is left of the numbers places the sample within."""
        last = len(self._cumulative) - 1
        texel = np.minimum(np.searchsorted(self._cumulative, uniforms[:, 0], side="right"), last)
        before = np.where(texel > 0, self._cumulative[texel - 1], 0)
        share = np.maximum(self._cumulative[texel] - before, 1e-300)
        rest = np.clip((uniforms[:, 0] - before) / share, 0, 1)
        row, column = np.divmod(texel, self._radiance.shape[1])
        cosine = self._edges[row] + rest * (self._edges[row + 1] - self._edges[row])
        azimuth = 2 * np.pi * (column + uniforms[:, 1]) / self._radiance.shape[1]
        sine = np.sqrt(np.maximum(1 - cosine**2, 0))
        directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
        density = self._density[row, column]
        irradiance = self._radiance[row, column] / density[:, None]
        return LightSample(directions, np.full(len(points), np.inf), irradiance, density)

    def radiance(
        self,
        origins: Float[np.ndarray, "ray 3"],
        directions: Float[np.ndarray, "ray 3"],
        reach: Float[np.ndarray, "ray"],
    ) -> Float[np.ndarray, "ray channel"]:
        """That of the texel, for rays that meet no surface."""
        free = np.isinf(reach)[:, None]
        return np.where(free, self._radiance[self._texel(directions)], 0)

    def density(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Float[np.ndarray, "ray"]:
        """That of the texel."""
        return self._density[self._texel(directions)]

    def _texel(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows, columns, _ = self._radiance.shape
        polar = np.arccos(np.clip(directions[:, 2], -1, 1)) / np.pi
        turn = np.arctan2(directions[:, 1], directions[:, 0]) / (2 * np.pi) % 1
        row = np.minimum((polar * rows).astype(int), rows - 1)
        return row, np.minimum((turn * columns).astype(int), columns - 1)
