"""Panorama conventions: where in its image each of them shows a direction.  Host side, NumPy.

Positions are (row, column) in pixels from the top left corner, so that texel (i, j) has its centre
at (i + 1/2, j + 1/2).

``z-up``
    our own: row from the polar angle to +Z, column from the azimuth
``y-up``
    Mitsuba and OpenEXR latlong: row from the polar angle to +Y, column from
    u = atan2(x, -z) / 2 pi; (x, y, z) are the coordinates of the scene, only the poles differ
``angular``
    Debevec's ball map (T fig. 4.2): the radius grows with the angle from straight ahead, pi at the
    rim of the disc
``cross``
    vertical cross cube, 4 rows x 3 columns of faces; up, left, forward, right, down, and back
    upside down at the foot
``mirror-ball``
    orthographic photograph of a chrome ball, cropped to the ball, taken by a camera that looks
    along z: the centre shows what is behind it (-z), the rim straight ahead (+z)

The last three have *axes of their own*: x to the right and y up in the image, z straight ahead.  In
a scene the world direction is (x, -z, y) of them, so that up is up.  A viewer in the middle who
looks along +z would have +x on the left: these axes have the handedness of the picture, as T table
4.1 has, so a scene lit with such a panorama is the mirror image of the room where it was taken.
"""

import abc
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view

from jaxrender.shapes import ImageArray

# Rows are (x, -z, y): the own axes of a probe seen from the world.
_WORLD_FROM_PROBE = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

Pixels = Float[np.ndarray, "*batch 2"]
_Numbers = np.ndarray | np.floating


class Panorama(eqx.Module):
    """Where the directions of a convention lie in an image of ``height`` rows."""

    # Width over height, as whole numbers.
    aspect: ClassVar[tuple[int, int]]
    # Rows of a latitude-longitude image of about the same resolution, per row of this one.
    latlong_rows: ClassVar[float]
    world_from_own: ClassVar[np.ndarray] = np.eye(3)
    wraps: ClassVar[bool] = False
    # Which way is up in the world, as the picture shows it.
    up: ClassVar[np.ndarray] = np.array([0.0, 0, 1])

    @abc.abstractmethod
    def pixels(self, directions: Float[np.ndarray, "*batch 3"], height: int) -> Pixels:
        """Row and column of unit directions in the panorama's own axes."""

    @abc.abstractmethod
    def confine(self, pixels: Pixels, height: int) -> Pixels:
        """Positions moved inwards until interpolation uses only neighbours on the sphere."""

    def covers(self, height: int) -> Bool[np.ndarray, "row column"]:
        """Which texels show anything."""
        width, rows = self.aspect
        return np.ones((height, height * width // rows), bool)

    def resolvable(self, pixels: ImageArray) -> ImageArray:
        """The same light without detail much finer than a texel elsewhere in the image."""
        return pixels


class _LatLong(Panorama):
    """What the two latitude-longitude images share."""

    aspect: ClassVar[tuple[int, int]] = (2, 1)
    latlong_rows: ClassVar[float] = 1
    wraps: ClassVar[bool] = True

    def confine(self, pixels: Pixels, height: int) -> Pixels:
        """Nothing lies beyond a pole; the columns wrap round."""
        rows, columns = np.moveaxis(pixels, -1, 0)
        return np.stack([rows.clip(0.5, height - 0.5), columns], axis=-1)

    def resolvable(self, pixels: ImageArray) -> ImageArray:
        """Texels near a pole are slivers; each becomes the mean over a texel's width of its row.

        All texels of a row have the same solid angle, so the energy stays what it was.
        """
        rows, columns = pixels.shape[:2]
        sines = np.sin((np.arange(rows) + 0.5) * np.pi / rows)
        # Odd, so that the mean is centred, and at most once round.
        reach = np.minimum((1 / sines).astype(int), columns - 1) // 2
        rounds = [np.pad(row, ((k, k), (0, 0)), mode="wrap") for row, k in zip(pixels, reach)]
        return np.stack(
            [sliding_window_view(row, 2 * k + 1, 0).mean(-1) for row, k in zip(rounds, reach)]
        )


class ZUp(_LatLong):
    """Our own latitude-longitude image."""

    def pixels(self, directions: Float[np.ndarray, "*batch 3"], height: int) -> Pixels:
        """Row t H / pi, column p W / 2 pi."""
        x, y, z = np.moveaxis(directions, -1, 0)
        return _latlong_pixels(np.arctan2(np.hypot(x, y), z), np.arctan2(y, x), height)


class YUp(_LatLong):
    """The latitude-longitude image of Mitsuba and OpenEXR."""

    up: ClassVar[np.ndarray] = np.array([0.0, 1, 0])

    def pixels(self, directions: Float[np.ndarray, "*batch 3"], height: int) -> Pixels:
        """Row arccos(y) H / pi, column atan2(x, -z) W / 2 pi."""
        x, y, z = np.moveaxis(directions, -1, 0)
        return _latlong_pixels(np.arctan2(np.hypot(x, z), y), np.arctan2(x, -z), height)


class _Disc(Panorama):
    """What the two round images share."""

    aspect: ClassVar[tuple[int, int]] = (1, 1)
    latlong_rows: ClassVar[float] = 0.5
    world_from_own: ClassVar[np.ndarray] = _WORLD_FROM_PROBE

    def confine(self, pixels: Pixels, height: int) -> Pixels:
        """Half a texel inside the rim, where the disc is all there is."""
        # There at least one of the four neighbours has its centre inside.
        offset = pixels - height / 2
        radius = np.linalg.norm(offset, axis=-1, keepdims=True)
        inner = (height - 1) / 2
        return height / 2 + offset * np.where(radius > inner, inner / np.maximum(radius, inner), 1)

    def covers(self, height: int) -> Bool[np.ndarray, "row column"]:
        """The texels with their centre on the disc."""
        offset = np.arange(height) + 0.5 - height / 2
        return np.hypot(offset[:, None], offset[None, :]) <= height / 2


class Angular(_Disc):
    """Debevec's ball map."""

    def pixels(self, directions: Float[np.ndarray, "*batch 3"], height: int) -> Pixels:
        """Radius (angle from +z) / pi of the disc's radius, T fig. 4.2."""
        x, y, z = np.moveaxis(directions, -1, 0)
        sine = np.hypot(x, y)
        # sin(t) / t has its limit 1 straight ahead; exactly behind, any point of the rim will do.
        scale = np.where(sine > 0, np.arctan2(sine, z) / np.where(sine > 0, sine, 1), 1) / np.pi
        behind = (sine == 0) & (z < 0)
        return _disc_pixels(np.where(behind, 1, x * scale), y * scale, height)


class MirrorBall(_Disc):
    """Orthographic photograph of a chrome ball."""

    def pixels(self, directions: Float[np.ndarray, "*batch 3"], height: int) -> Pixels:
        """Position of the normal half way between the direction and the camera at -z."""
        x, y, z = np.moveaxis(directions, -1, 0)
        # |D - (0, 0, 1)| = sqrt(2 - 2 z), written so that it loses nothing near z = 1.
        length = np.sqrt(x**2 + y**2 + (1 - z) ** 2)
        ahead = length == 0
        safe = np.where(ahead, 1, length)
        return _disc_pixels(np.where(ahead, 1, x / safe), y / safe, height)


# The faces of the cross in the order +x, -x, +y, -y, +z, -z: tile (row, column), and the axes
# (image right, image down, straight into the face).
_FACE_TILES = np.array([[1, 2], [1, 0], [0, 1], [2, 1], [1, 1], [3, 1]])
_FACE_AXES = np.array(
    [
        [[0, 0, -1], [0, -1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, -1]],
    ]
)
_EDGE = 1e-12


class Cross(Panorama):
    """Vertical cross of the six faces of a cube."""

    aspect: ClassVar[tuple[int, int]] = (3, 4)
    latlong_rows: ClassVar[float] = 0.5
    world_from_own: ClassVar[np.ndarray] = _WORLD_FROM_PROBE

    def pixels(self, directions: Float[np.ndarray, "*batch 3"], height: int) -> Pixels:
        """Face of the largest coordinate, then central projection on it."""
        axis_of_largest = np.argmax(np.abs(directions), axis=-1)
        largest = np.take_along_axis(directions, axis_of_largest[..., None], -1)[..., 0]
        face = 2 * axis_of_largest + (largest < 0)
        right, down, depth = np.moveaxis(
            np.einsum("...ax,...x->...a", np.take(_FACE_AXES, face, axis=0), directions), -1, 0
        )
        within = (np.stack([down / depth, right / depth], axis=-1) + 1) / 2
        # The far edges belong to this face, not to the tile beyond, which may show nothing.
        within = np.minimum(within, 1 - _EDGE)
        return (np.take(_FACE_TILES, face, axis=0) + within) * (height / 4)

    def confine(self, pixels: Pixels, height: int) -> Pixels:
        """Neighbours in the image are neighbours on the sphere only within a face."""
        size = height / 4
        tile = np.floor(pixels / size)
        return np.clip(pixels, tile * size + 0.5, (tile + 1) * size - 0.5)

    def directions(self, height: int) -> Float[np.ndarray, "row column 3"]:
        """Unit vectors of the texel centres, in own axes; zero where there is no face."""
        size = height // 4
        across = (2 * np.arange(size) + 1) / size - 1
        found = np.zeros((height, 3 * size, 3))
        for (row, column), (right, down, ahead) in zip(_FACE_TILES * size, _FACE_AXES):
            ray = ahead + across[None, :, None] * right + across[:, None, None] * down
            unit = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
            found[row : row + size, column : column + size] = unit
        return found

    def covers(self, height: int) -> Bool[np.ndarray, "row column"]:
        """The six tiles that are faces."""
        faces = np.zeros((4, 3), bool)
        faces[tuple(_FACE_TILES.T)] = True
        return np.kron(faces, np.ones((height // 4, height // 4), bool))


PANORAMAS: dict[str, Panorama] = {
    "z-up": ZUp(),
    "y-up": YUp(),
    "angular": Angular(),
    "cross": Cross(),
    "mirror-ball": MirrorBall(),
}


def panorama_named(convention: str) -> Panorama:
    """Look a convention up; ValueError lists those that are known."""
    if convention not in PANORAMAS:
        raise ValueError(
            f"unknown panorama convention {convention!r}; known are {', '.join(PANORAMAS)}"
        )
    return PANORAMAS[convention]


def _latlong_pixels(polar: _Numbers, azimuth: _Numbers, height: int) -> np.ndarray:
    return np.stack([polar, azimuth % (2 * np.pi)], axis=-1) * (height / np.pi)


def _disc_pixels(right: _Numbers, up: _Numbers, height: int) -> np.ndarray:
    return (1 + np.stack([-up, right], axis=-1)) * (height / 2)
