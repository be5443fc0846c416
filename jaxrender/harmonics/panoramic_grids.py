"""Cube and ball map as quadrature rules on the sphere.

Both are midpoint rules: the value at a texel's centre times its solid angle.  Their analysis is not
exact like that of ``grids``; each class states the error of its weights and of ``band_limit``, as
the 2-norm of (analysis of synthesis) minus identity.

These are grids for computing in the world's own axes.  Pictures in files have conventions of their
own, which ``lighting`` turns into latitude-longitude.
"""

import equinox as eqx
import numpy as np

from jaxrender.harmonics.grids import Grid, Neighbours
from jaxrender.shapes import Bool, Float, checked

# Columns: where a face looks, and to where its image's columns and its rows (upwards) increase.
CUBE_FACES = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    ],
    dtype=np.float64,
)


class CubeGrid(Grid):
    """Six faces of n x n texels, one below the other: +X, +Y, -X, -Y, +Z, -Z.

    The four side faces have +Z up and columns that increase with the azimuth, as in a
    latitude-longitude image; +Z joins the upper edge of +X and -Z its lower one.  The solid angles
    are exact, so they sum to 4 pi; the midpoint rule's error falls as (degree / n)^2.  At degree
    n / 2 it is 1e-2 (n = 8), 6e-3 (16), 4e-3 (32), 3e-3 (64); at n - 1, the band limit, 2e-2 or
    less.  Raises ValueError if n is below 1.
    """

    side: int = eqx.field(static=True)

    def __check_init__(self):
        _check_side(self.side)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns: (6 n, n)."""
        return (6 * self.side, self.side)

    @property
    def band_limit(self) -> int:
        """Highest degree found to 2 %: n - 1."""
        return self.side - 1

    def directions(self) -> Float[np.ndarray, "row column 3"]:
        """Unit vectors of the texel centres."""
        across = _centres(self.side)
        plane = np.stack(
            np.broadcast_arrays(1.0, across[None, :], -across[:, None]), axis=-1
        )  # [row, column, (ahead, right, up)]
        rays = np.einsum("rca,fax->frcx", plane, CUBE_FACES).reshape(*self.shape, 3)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def weights(self) -> Float[np.ndarray, "row column"]:
        """Solid angle of every texel, by the corner integral arctan(x y / sqrt(1 + x^2 + y^2))."""
        edges = np.linspace(-1.0, 1.0, self.side + 1)
        x, y = edges[:, None], edges[None, :]
        corner = np.arctan2(x * y, np.sqrt(1.0 + x * x + y * y))
        return np.tile(np.diff(np.diff(corner, axis=0), axis=1), (6, 1))

    @checked
    def neighbours(self, directions: Float[np.ndarray, "point 3"]) -> Neighbours:
        """Bilinear on the face; beyond its edge the texel that lies there on the next face."""
        face, row, column = self._places(np.asarray(directions, np.float64))
        top, left = np.floor(row), np.floor(column)
        parts = []
        for down, share in ((top, 1.0 - (row - top)), (top + 1, row - top)):
            for across, part in ((left, 1.0 - (column - left)), (left + 1, column - left)):
                parts.append((self.texel(face, down, across), share * part))
        index, shares = zip(*parts)
        return Neighbours(np.stack(index, axis=-1), np.stack(shares, axis=-1))

    def _places(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return face and continuous row and column, whole numbers at texel centres."""
        local = np.einsum("fax,px->pfa", CUBE_FACES, directions)
        face = np.argmax(local[:, :, 0], axis=1)
        ahead, right, up = local[np.arange(len(face)), face].T
        scale = 0.5 * self.side
        return face, (1.0 - up / ahead) * scale - 0.5, (1.0 + right / ahead) * scale - 0.5

    def texel(self, face: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Return the flat index of a texel, which may lie one beyond the edge of its face."""
        right, up = (2.0 * column + 1.0) / self.side - 1.0, 1.0 - (2.0 * row + 1.0) / self.side
        plane = np.stack([np.ones_like(right), right, up], axis=-1)
        other, down, across = self._places(np.einsum("pa,pax->px", plane, CUBE_FACES[face]))
        inside = (np.clip(np.rint(place), 0, self.side - 1) for place in (down, across))
        down, across = (place.astype(int) for place in inside)
        return (other * self.side + down) * self.side + across


class AngularMapGrid(Grid):
    """Debevec's ball map of n x n texels, with +Z in the middle (T fig. 4.2).

    The polar angle is pi times the distance from the middle, -Z all around the rim; the azimuth is
    the image's, +X to the right and +Y up.  Texels whose centre is outside the disc weigh nothing.
    The others weigh (2 pi / n)^2 sin(t) / t, the solid angle to second order; their sum misses 4 pi
    by 6e-3 (n = 8), 5e-4 (16), 2e-4 (32), 2e-6 (64).  At degree n / 4, the band limit, the error is
    6e-2 (8), 2e-2 (16), 1.4e-2 (32), 1e-3 (64): the texels around the rim are far apart.  Raises
    ValueError if n is below 1.
    """

    side: int = eqx.field(static=True)

    def __check_init__(self):
        _check_side(self.side)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns: (n, n)."""
        return (self.side, self.side)

    @property
    def band_limit(self) -> int:
        """Highest degree found to 6 %: n / 4."""
        return self.side // 4

    def inside(self) -> Bool[np.ndarray, "row column"]:
        """Tell which texels have their centre in the disc."""
        return np.hypot(*self._plane()) <= 1.0

    def directions(self) -> Float[np.ndarray, "row column 3"]:
        """Unit vectors of the texel centres; outside the disc they repeat those inside."""
        right, up = self._plane()
        radius = np.hypot(right, up)
        slope = np.pi * np.sinc(radius)
        return np.stack([slope * right, slope * up, np.cos(np.pi * radius)], axis=-1)

    def weights(self) -> Float[np.ndarray, "row column"]:
        """Solid angle of every texel to second order, zero outside the disc."""
        solid_angle = (2.0 * np.pi / self.side) ** 2 * np.sinc(np.hypot(*self._plane()))
        return np.where(self.inside(), solid_angle, 0.0)

    @checked
    def neighbours(self, directions: Float[np.ndarray, "point 3"]) -> Neighbours:
        """Bilinear among those of the four texels that are inside the disc."""
        x, y, z = np.asarray(directions, np.float64).T
        sine = np.hypot(x, y)
        # -Z, where the azimuth is free, is on the right.
        radius, polar = np.arctan2(sine, z) / np.pi, sine > 0.0
        length = np.where(polar, sine, 1.0)
        right, up = (
            np.where(polar, x / length, 1.0) * radius,
            np.where(polar, y / length, 0.0) * radius,
        )
        row, column = ((1.0 + place) * (0.5 * self.side) - 0.5 for place in (-up, right))
        top, left = np.floor(row).astype(int), np.floor(column).astype(int)
        inside = np.pad(self.inside(), 1)
        parts = []
        for down, share in ((top, 1.0 - (row - top)), (top + 1, row - top)):
            for across, part in ((left, 1.0 - (column - left)), (left + 1, column - left)):
                shown = share * part * inside[down + 1, across + 1]
                clipped = (np.clip(place, 0, self.side - 1) for place in (down, across))
                parts.append((np.ravel_multi_index(tuple(clipped), self.shape), shown))
        index, shares = (np.stack(part, axis=-1) for part in zip(*parts))
        return Neighbours(index, shares / shares.sum(axis=-1, keepdims=True))

    def _plane(self) -> tuple[Float[np.ndarray, "row column"], Float[np.ndarray, "row column"]]:
        """Return how far right and up of the middle each texel is, the disc's radius being 1."""
        right, up = np.meshgrid(_centres(self.side), -_centres(self.side))
        return right, up


def _centres(side: int) -> Float[np.ndarray, " texel"]:
    return (2.0 * np.arange(side) + 1.0) / side - 1.0


def _check_side(side: int):
    if side < 1:
        raise ValueError(f"a panorama of {side} texels a side; give 1 or more")
