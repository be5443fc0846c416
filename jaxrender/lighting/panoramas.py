"""Other panoramas as latitude-longitude images of the world.  Host side, NumPy float64.

The conventions are those of ``layouts``.  A texel of the result is the mean over its own solid
angle of the bilinearly interpolated panorama, so uniform light stays uniform exactly, and the
energy (the integral of radiance over solid angle) is kept whatever the two resolutions.  The one
place that cannot be honoured is a lone bright texel at the rim of an ``angular`` map, whose solid
angle vanishes: samples may miss it.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxrender.lighting.layouts import PANORAMAS, Panorama, panorama_named
from jaxrender.shapes import ImageArray, checked

# Samples along each side of a texel, of the result and of the panorama: the weights that a
# texel of the panorama gets over all samples then add up to its solid angle.
_SAMPLES_PER_RESULT = 4
_SAMPLES_PER_SOURCE = 3

# Samples handled at once, to bound the memory (some 300 bytes each).
_CHUNK = 1 << 18


@checked
def to_latlong(
    image: ImageArray, convention: str, height: int | None = None, yaw: float | int = 0.0
) -> Float[np.ndarray, "latlong_row latlong_column channel"]:
    """Resample a panorama to [height, 2 height] in the world's z-up latitude-longitude.

    ``height`` defaults to about the panorama's own resolution.  ``yaw`` turns it about its own up,
    counter-clockwise seen from above, in degrees.  Raises ValueError for an unknown
    convention or an image whose aspect is not the convention's.
    """
    source = _source(image, convention)
    turn = np.eye(3)
    if yaw:
        turn = Rotation.from_rotvec(yaw * source.panorama.up, degrees=True).as_matrix()
    return _resample(source, source.panorama.world_from_own.T @ turn.T, height)


@checked
def to_own_latlong(
    image: ImageArray, convention: str, height: int | None = None
) -> Float[np.ndarray, "latlong_row latlong_column channel"]:
    """The same with the panorama's own axes in the place of the world's (poles at own +-z).

    For tools that speak of a probe alone: T table 4.1 is in these axes.
    """
    return _resample(_source(image, convention), np.eye(3), height)


@checked
def from_polar_rows(image: ImageArray) -> Float[np.ndarray, "latlong_row latlong_column channel"]:
    """Read a latitude-longitude image whose first and last rows lie at the poles, as Mitsuba does.

    Rows are interpolated linearly at the middles of ours, half as many as there are columns,
    rounded down; columns have their middles where ours do.  Raises ValueError for fewer than two
    rows or columns.
    """
    pixels = np.asarray(image, np.float64)
    height, width = pixels.shape[:2]
    if height < 2 or width < 2:
        raise ValueError(f"the panorama is {width} x {height}: give two rows and columns or more")
    rows = width // 2
    down = (np.arange(rows) + 0.5) / rows * (height - 1)
    upper = np.minimum(down.astype(int), height - 2)
    far = (down - upper)[:, None, None]
    found = (1 - far) * pixels[upper] + far * pixels[upper + 1]
    if width == 2 * rows:
        return found
    across = (np.arange(2 * rows) + 0.5) / (2 * rows) * width - 0.5
    left = np.floor(across).astype(int)
    far = (across - left)[None, :, None]
    return (1 - far) * found[:, left % width] + far * found[:, (left + 1) % width]


@checked
def turned_latlong(
    image: ImageArray, rotation: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "latlong_row latlong_column channel"]:
    """Turn a z-up latitude-longitude image: what lay in direction d lies at ``rotation`` @ d."""
    source = _source(image, "z-up")
    return _resample(source, source.panorama.world_from_own.T @ rotation.T, len(source.pixels))


class _Source(NamedTuple):
    """A panorama with what is known about its texels."""

    pixels: Float[np.ndarray, "row column channel"]
    covers: Bool[np.ndarray, "row column"]
    panorama: Panorama


def _source(image: ImageArray, convention: str) -> _Source:
    panorama = panorama_named(convention)
    pixels = np.asarray(image, np.float64)
    _check_aspect(pixels, convention, panorama)
    return _Source(pixels, panorama.covers(len(pixels)), panorama)


def _resample(source: _Source, own_from_result: np.ndarray, height: int | None) -> np.ndarray:
    own_rows = max(1, round(source.panorama.latlong_rows * len(source.pixels)))
    rows = own_rows if height is None else height
    if rows < 1:
        raise ValueError(f"height is {height}: a latitude-longitude image has at least one row")
    same = source.panorama is PANORAMAS["z-up"] and np.array_equal(own_from_result, np.eye(3))
    if same and rows == own_rows:
        return source.pixels.copy()
    source = source._replace(pixels=source.panorama.resolvable(source.pixels))
    samples = max(_SAMPLES_PER_RESULT, math.ceil(_SAMPLES_PER_SOURCE * own_rows / rows))
    return np.stack([_row(source, own_from_result, (i, rows), samples) for i in range(rows)])


def _check_aspect(pixels: np.ndarray, convention: str, panorama: Panorama) -> None:
    height, width = pixels.shape[:2]
    across, down = panorama.aspect
    if height < 1 or height % down or width * down != height * across:
        raise ValueError(
            f"the panorama is {width} x {height} (width x height); the convention {convention!r} "
            f"wants {across}:{down}, such as {across * max(1, height // down)} x "
            f"{down * max(1, height // down)}"
        )


def _row(
    source: _Source, own_from_result: np.ndarray, row_of: tuple[int, int], samples: int
) -> np.ndarray:
    """One row of the result, by the midpoint rule in polar angle and azimuth within each texel."""
    row, rows = row_of
    polar = (row + (np.arange(samples) + 0.5) / samples) * (np.pi / rows)
    azimuths = (np.arange(2 * rows * samples) + 0.5) * (np.pi / (rows * samples))
    total = np.empty((2 * rows, source.pixels.shape[-1]))
    step = max(samples, _CHUNK // samples // samples * samples)
    for start in range(0, len(azimuths), step):
        azimuth = azimuths[start : start + step]
        directions = _directions(polar[:, None], azimuth[None, :]) @ own_from_result.T
        values = _interpolate(source, directions)
        ring = np.einsum("p,pac->ac", np.sin(polar) / np.sin(polar).sum(), values)
        first, last = start // samples, (start + len(azimuth)) // samples
        total[first:last] = ring.reshape(last - first, samples, -1).mean(axis=1)
    return total


def _directions(polar: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
    return np.stack([x, y, np.broadcast_to(np.cos(polar), x.shape)], axis=-1)


def _interpolate(source: _Source, directions: np.ndarray) -> np.ndarray:
    """Bilinear interpolation between those of the four texels that show anything."""
    pixels, covers, panorama = source
    height, width = covers.shape
    centred = panorama.confine(panorama.pixels(directions, height), height) - 0.5
    corner = np.floor(centred).astype(int)
    far = centred - corner
    total = np.zeros((*directions.shape[:-1], pixels.shape[-1]))
    weights = np.zeros(directions.shape[:-1])
    for down in (0, 1):
        for across in (0, 1):
            row = np.minimum(corner[..., 0] + down, height - 1)
            column = corner[..., 1] + across
            column = column % width if panorama.wraps else np.minimum(column, width - 1)
            weight = np.abs(1 - down - far[..., 0]) * np.abs(1 - across - far[..., 1])
            weight = weight * covers[row, column]
            total += weight[..., None] * pixels[row, column]
            weights += weight
    return total / weights[..., None]
