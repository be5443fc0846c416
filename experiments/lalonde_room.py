"""Radiance that arrives at the back wall of a cubic room, sampled as in L 6.4; shared by scripts.

The room is the unit cube in the wall's own frame: the wall is z = 0, x to the right and y up as
seen from inside, +z into the room.  Red wall at x = 0, blue at x = 1, green floor at y = 0, white
ceiling and front.  Light is direct, from a square light in the ceiling, and one bounce: a constant
share of what a wall gets, since the experiment is about reflection and not about transport.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.geometry import NUSSELT, Sphere
from jaxrender.wavelets import Wavelet, analyse_nonstandard, haar, keep_fraction
from jaxrender.wavelets.tree import CoefficientTree

# Albedo of the sides x = 0, y = 0, x = 1, y = 1, z = 1.
ALBEDO = {
    (0, 0): (0.75, 0.1, 0.1),
    (1, 0): (0.1, 0.65, 0.1),
    (0, 1): (0.1, 0.15, 0.75),
    (1, 1): (0.75, 0.75, 0.75),
    (2, 1): (0.75, 0.75, 0.75),
}
BOUNCE = 0.12
_RAYS_AT_ONCE = 1 << 17


class AreaLight(NamedTuple):
    """A square parallel to the axes: centre, the axis it faces along, half a side, radiance."""

    centre: np.ndarray
    axis: int
    facing: float
    half: float
    radiance: float

    def points(self, count: int) -> np.ndarray:
        """Centres of ``count`` x ``count`` equal squares."""
        along = (2 * (np.arange(count) + 0.5) / count - 1) * self.half
        places = np.zeros((count, count, 3))
        first, second = [axis for axis in range(3) if axis != self.axis]
        places[..., first], places[..., second] = np.meshgrid(along, along, indexing="ij")
        return self.centre + places.reshape(-1, 3)

    def lies_at(self, points: np.ndarray) -> np.ndarray:
        """Which points of its plane are on it."""
        off = np.abs(points - self.centre)
        off[:, self.axis] = 0
        return off.max(axis=1) <= self.half


CEILING_LIGHT = AreaLight(np.array([0.5, 1.0, 0.55]), 1, -1.0, 0.2, 18.0)
SPHERE = Sphere(np.array([0.52, 0.42, 0.3]), 0.22)
# The scene of fig. 6.4: a light in front of the wall, half hidden by a ball, and nothing else.
AREA_LIGHT = AreaLight(np.array([0.5, 0.62, 1.0]), 2, -1.0, 0.28, 12.0)
BLOCKER = Sphere(np.array([0.62, 0.5, 0.55]), 0.17)


def wall_rays(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins [place, 3], directions [direction, 3] at the cells' centres, and which are above."""
    centre = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(centre, centre, indexing="ij")
    origins = np.stack([u, v, np.zeros_like(u)], axis=-1).reshape(-1, 3)
    directions = NUSSELT.cell_directions((size, size)).reshape(-1, 3)
    above = np.asarray(NUSSELT.covers(NUSSELT.centres((size, size)))).ravel()
    return origins, directions, above


def sampled(size: int, radiance) -> np.ndarray:
    """Sample ``radiance(origins, directions)`` [u, v, kappa, lambda, channel], 0 off the disc."""
    origins, directions, above = wall_rays(size)
    directions = directions[above]
    found = np.zeros((len(origins), size * size, 3))
    step = max(_RAYS_AT_ONCE // len(directions), 1)
    for start in range(0, len(origins), step):
        some = origins[start : start + step]
        pairs = np.repeat(some, len(directions), axis=0), np.tile(directions, (len(some), 1))
        found[start : start + step, above] = radiance(*pairs).reshape(len(some), -1, 3)
    return found.reshape(size, size, size, size, 3)


def room_radiance(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """What arrives along rays from the wall: light, sides and sphere of the room."""
    box, axis, side = _leave(origins, directions)
    hits = SPHERE.first_hits(origins, directions)
    on_sphere = hits.hit & (hits.distance < box)
    points = np.where(on_sphere[:, None], hits.points, origins + box[:, None] * directions)
    normals = np.zeros_like(points)
    normals[np.arange(len(axis)), axis] = 1 - 2 * side
    normals[on_sphere] = hits.normals[on_sphere]
    albedo = np.full_like(points, 0.7)
    for (a, s), colour in ALBEDO.items():
        albedo[(axis == a) & (side == s) & ~on_sphere] = colour
    light = albedo / np.pi * (_irradiance(points + 1e-6 * normals, normals) + BOUNCE)[:, None]
    on_light = (axis == 1) & (side == 1) & ~on_sphere
    on_light[on_light] = CEILING_LIGHT.lies_at(points[on_light])
    light[on_light] = CEILING_LIGHT.radiance
    return light


def light_radiance(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The light of fig. 6.4 behind its ball, black elsewhere."""
    distance = (AREA_LIGHT.centre[2] - origins[:, 2]) / directions[:, 2]
    lit = AREA_LIGHT.lies_at(origins + distance[:, None] * directions)
    lit[lit] = ~BLOCKER.occluded(origins[lit], directions[lit])
    return np.where(lit[:, None], AREA_LIGHT.radiance, 0.0) * np.ones(3)


def _leave(origins, directions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance to the side of the cube that a ray from within leaves by, its axis, which end."""
    towards = directions > 0
    speed = np.where(np.abs(directions) > 1e-12, directions, 1e-12)
    distances = np.where(towards, 1 - origins, -origins) / speed
    distances = np.where(np.abs(directions) > 1e-12, distances, np.inf)
    distances[:, 2] = np.where(towards[:, 2], distances[:, 2], np.inf)
    axis = np.argmin(distances, axis=1)
    row = np.arange(len(axis))
    return distances[row, axis], axis, towards[row, axis].astype(int)


def _irradiance(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """From the light, at 3 x 3 of its points, with the ball's shadow."""
    total = np.zeros(len(points))
    places = CEILING_LIGHT.points(3)
    area = (2 * CEILING_LIGHT.half) ** 2 / len(places)
    for place in places:
        towards = place - points
        square = np.einsum("ri,ri->r", towards, towards)
        towards = towards / np.sqrt(square)[:, None]
        cosines = np.maximum(np.einsum("ri,ri->r", towards, normals), 0)
        cosines = cosines * np.maximum(towards[:, 1], 0)
        lit = np.flatnonzero(cosines > 0)
        lit = lit[~SPHERE.occluded(points[lit], towards[lit])]
        total[lit] += CEILING_LIGHT.radiance * area * cosines[lit] / square[lit]
    return total


def tree_of(
    wavelet: Wavelet, samples: np.ndarray, fraction: float | None = None
) -> CoefficientTree:
    """Analyse samples, and keep a fraction of the coefficients that are not zero."""
    coefficients = analyse_nonstandard(wavelet, samples)
    if fraction is not None:
        coefficients = keep_fraction(coefficients, fraction).coefficients
    return CoefficientTree.of_coefficients(wavelet, np.asarray(coefficients))


def light_tree(samples: np.ndarray, fraction: float | None = None) -> CoefficientTree:
    """The radiance's tree, in Haar's wavelet."""
    return tree_of(haar(), samples, fraction)


def table_of(brdf: BRDF, size: int) -> np.ndarray:
    """Sample a BRDF at pairs of cells, 0 off the disc as L has it."""
    return np.asarray(TabulatedBRDF.of(brdf, size, outside="zero").values)


def displayed(image: np.ndarray, white: float) -> np.ndarray:
    """Image [u, v] to rows from the top, with a display's curve."""
    return np.clip(np.moveaxis(image, 1, 0)[::-1] / white, 0, 1) ** (1 / 2.2)
