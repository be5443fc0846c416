"""Images as quadrature rules on the sphere; here those whose rows are circles of latitude.

A ``Grid`` is a hashable value, all static: the shape of its images, the direction and the solid
angle of every texel, and the highest degree that analysis finds from them.  On a ``SeparableGrid``
row i lies at one polar angle from +Z (row 0 at the top) and column j at azimuth (j + 1/2) 2 pi / W
from +X towards +Y, so that sums over the image separate (``transform``).

For interpolation a grid says which four texels surround a direction and what share each has.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.harmonics.legendre import gauss_legendre
from jaxrender.shapes import Float, Int, checked


class Neighbours(NamedTuple):
    """The texels between which a value is interpolated."""

    index: Int[np.ndarray, "point 4"]
    """Places in the image flattened to [row column, channel]."""
    share: Float[np.ndarray, "point 4"]
    """Bilinear weights: non-negative, summing to 1."""


class Grid(eqx.Module):
    """Sampling of the sphere by the texels of an image."""

    # Compiled programs are looked up by their grid at every call: most often it is the same one.
    def __eq__(self, other: object) -> bool:
        """Tell whether this is the same grid."""
        return self is other or (type(self) is type(other) and vars(self) == vars(other))

    def __hash__(self) -> int:
        """Hash what tells grids of one kind apart."""
        return hash((type(self), *vars(self).values()))

    @property
    @abc.abstractmethod
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""

    @property
    @abc.abstractmethod
    def band_limit(self) -> int:
        """Highest degree of ``analyse``; the class says how exact that is."""

    @abc.abstractmethod
    def directions(self) -> Float[np.ndarray, "row column 3"]:
        """Unit vectors of the texel centres."""

    @abc.abstractmethod
    def weights(self) -> Float[np.ndarray, "row column"]:
        """Solid angle of every texel, steradians."""

    @abc.abstractmethod
    def neighbours(self, directions: Float[np.ndarray, "point 3"]) -> Neighbours:
        """Return the texels around each direction."""


class SeparableGrid(Grid):
    """A grid of ``height`` circles of latitude with ``width`` equal azimuths each."""

    height: eqx.AbstractVar[int]
    width: eqx.AbstractVar[int]

    @abc.abstractmethod
    def polar_angles(self) -> Float[np.ndarray, " row"]:
        """Angle from +Z of each row, radians, increasing, and the same above and below z = 0."""

    @abc.abstractmethod
    def row_weights(self) -> Float[np.ndarray, " row"]:
        """Solid angle of one texel of each row; sums to 4 pi over the grid."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (self.height, self.width)

    def azimuths(self) -> Float[np.ndarray, " column"]:
        """Angle from +X towards +Y of each column, radians."""
        return (np.arange(self.width) + 0.5) * 2.0 * np.pi / self.width

    def directions(self) -> Float[np.ndarray, "row column 3"]:
        """Unit vectors (sin t cos p, sin t sin p, cos t) of the texel centres."""
        polar, azimuth = self.polar_angles()[:, None], self.azimuths()[None, :]
        # Near pi an angle has lost digits of its sine, which its mirror image in the north has.
        sine = np.sin(np.minimum(polar, polar[::-1]))
        x, y = sine * np.cos(azimuth), sine * np.sin(azimuth)
        return np.stack([x, y, np.broadcast_to(np.cos(polar), x.shape)], axis=-1)

    def weights(self) -> Float[np.ndarray, "row column"]:
        """Solid angle of every texel; sums to 4 pi."""
        return np.repeat(self.row_weights()[:, None], self.width, axis=1)

    @checked
    def neighbours(self, directions: Float[np.ndarray, "point 3"]) -> Neighbours:
        """Bilinear in polar angle and azimuth, across the seam and over the poles."""
        x, y, z = np.asarray(directions, np.float64).T
        polar, azimuth = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
        own = self.polar_angles()
        # Over a pole the next row is the same one again, half a turn away.
        rows = np.concatenate([[-own[0]], own, [2.0 * np.pi - own[-1]]])
        upper = np.clip(np.searchsorted(rows, polar, side="right") - 1, 0, self.height)
        down = (polar - rows[upper]) / (rows[upper + 1] - rows[upper])
        parts = []
        for row, share in ((upper - 1, 1.0 - down), (upper, down)):
            over = (row < 0) | (row >= self.height)
            place = (azimuth + np.pi * over) * (self.width / (2.0 * np.pi)) - 0.5
            left = np.floor(place)
            for column, part in ((left, 1.0 - (place - left)), (left + 1, place - left)):
                inside = np.clip(row, 0, self.height - 1) * self.width
                parts.append((inside + column.astype(int) % self.width, share * part))
        index, shares = zip(*parts)
        return Neighbours(np.stack(index, axis=-1), np.stack(shares, axis=-1))


class LatLongGrid(SeparableGrid):
    """The latitude-longitude image: row i at polar angle (i + 1/2) pi / H.

    The polar angles are the nodes of Fejer's first rule, whose weights integrate polynomials in
    cos t up to degree H - 1 exactly; together with W equal azimuths the image therefore determines
    every function up to ``band_limit`` exactly.  Raises ValueError if a side is below 1.
    """

    height: int = eqx.field(static=True)
    width: int = eqx.field(static=True)

    def __check_init__(self):
        _check_sides(self.height, self.width)

    @property
    def band_limit(self) -> int:
        """Highest degree whose analysis from this grid is exact: products reach twice as far."""
        return (min(self.height, self.width) - 1) // 2

    def polar_angles(self) -> Float[np.ndarray, " row"]:
        """Angle from +Z of each row, radians."""
        return (np.arange(self.height) + 0.5) * np.pi / self.height

    def row_weights(self) -> Float[np.ndarray, " row"]:
        """Solid angle of one texel of each row: Fejer's weights times 2 pi / W, steradians.

        w_i = (2 / H) (1 - 2 sum_{k=1}^{H/2} cos(2 k t_i) / (4 k^2 - 1)); the w_i sum to 2.
        """
        # The sum over k is a cosine transform; at these sizes a matrix product is as quick.
        k = np.arange(1, self.height // 2 + 1)
        waves = np.cos(2.0 * np.multiply.outer(self.polar_angles(), k))
        fejer = (2.0 / self.height) * (1.0 - 2.0 * waves @ (1.0 / (4.0 * k**2 - 1.0)))
        return fejer * 2.0 * np.pi / self.width


class GaussLegendreGrid(SeparableGrid):
    """Rows at the Gauss-Legendre nodes: exact at twice the degree for the same number of rows.

    The weights integrate polynomials in cos t up to degree 2 H - 1 exactly.  Raises ValueError if a
    side is below 1.
    """

    height: int = eqx.field(static=True)
    width: int = eqx.field(static=True)

    def __check_init__(self):
        _check_sides(self.height, self.width)

    @property
    def band_limit(self) -> int:
        """Highest degree whose analysis from this grid is exact."""
        return min(self.height - 1, (self.width - 1) // 2)

    def polar_angles(self) -> Float[np.ndarray, " row"]:
        """Angle from +Z of each row, radians."""
        return gauss_legendre(self.height).angles

    def row_weights(self) -> Float[np.ndarray, " row"]:
        """Solid angle of one texel of each row: Gauss's weights times 2 pi / W, steradians."""
        return gauss_legendre(self.height).weights * 2.0 * np.pi / self.width


def _check_sides(height: int, width: int):
    if height < 1 or width < 1:
        raise ValueError(f"a grid of {height} rows and {width} columns; give 1 or more of each")
