"""Lenses: from the directions that light comes from to places in the image plane, and back.

Directions are in the camera's frame as OpenCV and COLMAP have it: x right, y down, z ahead.  Places
are (x, y) in focal lengths from the principal point.  A ``PerspectiveLens`` begins with the ideal
places (x, y) / z of a pinhole.  A ``FisheyeLens`` begins with those at a distance of the angle
from the axis, so that it may see more than 90 degrees aside.  Distortions then follow one upon the
other.  An ``EnhancedUnifiedLens`` and an ``EquirectangularLens`` are whole formulas without any.
Where a lens has no value, both ways give NaN.  Host side, NumPy float64.

``lens_models`` makes lenses by the names that programs have for them.
"""

import abc
import math

import equinox as eqx
import numpy as np

from jaxrender.geometry.distortions import Distortion
from jaxrender.shapes import Float, checked

# As many places at a time as stay in a processor's cache.
_BLOCK = 2**15
# Closer to the axis (radians) the series takes the place of the quotient.
_ON_AXIS = 1e-5


class Lens(eqx.Module):
    """What a lens does to the directions of a camera."""

    distortions: eqx.AbstractVar[tuple[Distortion, ...]]

    @abc.abstractmethod
    def _ideal(self, directions: np.ndarray) -> np.ndarray:
        """Find the ideal places of directions; NaN where there are none."""

    @abc.abstractmethod
    def _direction(self, places: np.ndarray) -> np.ndarray:
        """Find the unit directions of ideal places; NaN where there are none."""

    @abc.abstractmethod
    def _slopes(self, directions: np.ndarray) -> np.ndarray:
        """Differentiate ``_ideal``."""

    @checked
    def distort(self, directions: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
        """Find where the lens shows directions of any length; NaN where it does not."""
        places = self._ideal(directions.reshape(-1, 3))
        for distortion in self.distortions:
            places = distortion.distort(places)
        return places.reshape(*directions.shape[:-1], 2)

    @checked
    def undistort(self, places: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 3"]:
        """Find the unit directions that the lens shows at places; NaN where there are none."""
        flat = places.reshape(-1, 2)
        found = np.empty((len(flat), 3))
        for start in range(0, len(flat), _BLOCK):
            block = flat[start : start + _BLOCK]
            for distortion in reversed(self.distortions):
                block = distortion.undistort(block)
            found[start : start + _BLOCK] = self._direction(block)
        return found.reshape(*places.shape[:-1], 3)

    @checked
    def jacobian(
        self, directions: Float[np.ndarray, "*batch 3"]
    ) -> Float[np.ndarray, "*batch 2 3"]:
        """Differentiate ``distort``: rows are the place, columns the direction."""
        flat = directions.reshape(-1, 3)
        places, slopes = self._ideal(flat), self._slopes(flat)
        for distortion in self.distortions:
            slopes = distortion.jacobian(places) @ slopes
            places = distortion.distort(places)
        return slopes.reshape(*directions.shape[:-1], 2, 3)


class PerspectiveLens(Lens):
    """A lens that shows straight lines as straight lines, but for its distortions."""

    distortions: tuple[Distortion, ...]

    def _ideal(self, directions: np.ndarray) -> np.ndarray:
        depth = np.where(directions[..., 2:] > 0, directions[..., 2:], np.nan)
        return directions[..., :2] / depth

    def _direction(self, places: np.ndarray) -> np.ndarray:
        directions = np.concatenate([places, np.ones_like(places[..., :1])], axis=-1)
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def _slopes(self, directions: np.ndarray) -> np.ndarray:
        depth = np.where(directions[..., 2] > 0, directions[..., 2], np.nan)[..., None, None]
        places = directions[..., :2, None] / depth
        across = np.broadcast_to(np.eye(2), (len(directions), 2, 2))
        return np.concatenate([across, -places], axis=-1) / depth


class FisheyeLens(Lens):
    """A lens that shows angles from its axis as distances, but for its distortions."""

    distortions: tuple[Distortion, ...]

    def _ideal(self, directions: np.ndarray) -> np.ndarray:
        return self._gain(directions)[0][..., None] * directions[..., :2]

    def _direction(self, places: np.ndarray) -> np.ndarray:
        angle = np.linalg.norm(places, axis=-1)
        angle = np.where(angle < math.pi, angle, np.nan)[..., None]
        return np.concatenate([np.sinc(angle / math.pi) * places, np.cos(angle)], axis=-1)

    def _slopes(self, directions: np.ndarray) -> np.ndarray:
        aside, square = directions[..., :2], np.sum(directions**2, axis=-1)[..., None, None]
        gain, rise = (part[..., None, None] for part in self._gain(directions))
        outer = aside[..., :, None] * aside[..., None, :]
        across = gain * np.eye(2) + rise * outer
        return np.concatenate([across, -aside[..., None] / square], axis=-1)

    @staticmethod
    def _gain(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate angle / r and its derivative to r, over r; r the distance from the axis."""
        radius, depth = np.linalg.norm(directions[..., :2], axis=-1), directions[..., 2]
        near = radius < _ON_AXIS * np.abs(depth)
        # Straight behind no side is told from another.
        ahead = np.where(near & (depth > 0), depth, np.where(near, np.nan, 1.0))
        r = np.where(near, 1.0, radius)
        gain = np.arctan2(r, depth) / r
        rise = (depth / np.where(near, 1.0, r * r + depth * depth) - gain) / (r * r)
        return (
            np.where(near, 1 / ahead - radius**2 / (3 * ahead**3), gain),
            np.where(near, -2 / (3 * ahead**3), rise),
        )


class EnhancedUnifiedLens(Lens):
    """The enhanced unified camera model, EUCM (Khomutenko, Garcia and Martinet 2016).

    (x, y) / (alpha d + (1 - alpha) z) with d^2 = beta (x^2 + y^2) + z^2.  Raises ``ValueError``
    unless alpha is from 0 to 1 and beta positive.
    """

    alpha: float
    beta: float
    distortions: tuple[Distortion, ...] = eqx.field(default=(), init=False)

    def __check_init__(self):
        if not 0 <= self.alpha <= 1:
            raise ValueError(f"alpha is {self.alpha}: give a number from 0 to 1")
        if not (math.isfinite(self.beta) and self.beta > 0):
            raise ValueError(f"beta is {self.beta}: give a finite number above 0")

    def _ideal(self, directions: np.ndarray) -> np.ndarray:
        return directions[..., :2] / self._divisor(directions)[0][..., None]

    def _direction(self, places: np.ndarray) -> np.ndarray:
        square = np.sum(places**2, axis=-1)
        inside = 1 - (2 * self.alpha - 1) * self.beta * square
        root = np.sqrt(np.where(inside >= 0, inside, np.nan))
        depth = (1 - self.beta * self.alpha**2 * square) / (self.alpha * root + 1 - self.alpha)
        directions = np.concatenate([places, depth[..., None]], axis=-1)
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def _slopes(self, directions: np.ndarray) -> np.ndarray:
        divisor, distance = (part[..., None] for part in self._divisor(directions))
        rise = self.alpha * np.array([self.beta, self.beta, 1.0]) * directions / distance
        rise[..., 2] += 1 - self.alpha
        places = directions[..., :2] / divisor
        straight = np.broadcast_to(np.eye(2, 3), (len(directions), 2, 3))
        return (straight - places[..., :, None] * rise[..., None, :]) / divisor[..., None]

    def _divisor(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate alpha d + (1 - alpha) z, NaN beyond the formula's range, and d."""
        depth, low = directions[..., 2], min(self.alpha, 1 - self.alpha)
        distance = np.sqrt(self.beta * np.sum(directions[..., :2] ** 2, axis=-1) + depth**2)
        seen = depth > -low / (1 - low) * distance
        divisor = self.alpha * distance + (1 - self.alpha) * depth
        return np.where(seen, divisor, np.nan), distance


class EquirectangularLens(Lens):
    """A panorama of all directions: longitude (0 ahead, to the right) and latitude (down)."""

    distortions: tuple[Distortion, ...] = eqx.field(default=(), init=False)

    def _ideal(self, directions: np.ndarray) -> np.ndarray:
        x, y, z = np.moveaxis(directions, -1, 0)
        return np.stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))], axis=-1)

    def _direction(self, places: np.ndarray) -> np.ndarray:
        longitude, latitude = np.moveaxis(places, -1, 0)
        shown = (np.abs(longitude) <= math.pi) & (np.abs(latitude) <= math.pi / 2)
        latitude = np.where(shown, latitude, np.nan)
        x, z = (np.cos(latitude) * part(longitude) for part in (np.sin, np.cos))
        return np.stack([x, np.sin(latitude), z], axis=-1)

    def _slopes(self, directions: np.ndarray) -> np.ndarray:
        x, y, z = np.moveaxis(directions, -1, 0)
        level = np.hypot(x, z)
        square = level**2 + y**2
        longitude = np.stack([z, 0 * y, -x], axis=-1) / (level**2)[..., None]
        latitude = np.stack([-x * y / level, level, -y * z / level], axis=-1) / square[..., None]
        return np.stack([longitude, latitude], axis=-2)
