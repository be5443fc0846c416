"""The light around a chrome ball, from a photograph of it (T 6.4.1).

A distant camera (orthographic) sees in the ball's point of normal n the light from
R = 2 (n.o) n - o, with o towards the camera.  Every pixel stands for the same solid angle,
4 / radius^2, but its shape is ever longer and thinner towards the rim: an angle 2 / (radius cos t)
along the ball's radius at exit angle t.  That cosine is the ``confidence`` of a direction, 1
straight back into the camera, 0 straight behind the ball, which no ball shows.

Unlike the panorama ``mirror-ball`` of ``layouts``, which has a probe's own axes and is cropped to
the ball, this takes the circle to a fraction of a pixel and the camera's pose, and gives the light
in the world's own handedness.  Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from jaxrender.imaging.silhouette import Circle
from jaxrender.lighting.environment import Environment
from jaxrender.shapes import AnyArray, ImageArray, checked

# Samples along each side of a texel.
_SAMPLES = 3
# The ball's outermost pixel is mixed with what stands behind the ball.
_RIM_PIXELS = 1.0


class BallLight(NamedTuple):
    """The light that a ball showed, and how well it showed each direction (0: not at all)."""

    environment: Environment
    confidence: Float[np.ndarray, "row column"]


@checked
def light_of_ball(
    photograph: ImageArray,
    ball: Circle,
    world_from_camera: Float[AnyArray, "4 4"],
    height: int | None = None,
    *,
    usable: Bool[np.ndarray, "photo_row photo_column"] | None = None,
    reflectance: float | Float[AnyArray, "channel"] = 1.0,
) -> BallLight:
    """Unwrap the photograph, in linear radiance, of a ball of the given ``reflectance``.

    The pose is that of ``Camera`` (x right, y up, z backwards); pixels that are not ``usable``
    (saturated, or showing the camera) are filled from their neighbours and have no confidence.
    ``height`` defaults to the ball's radius, about one texel a pixel.
    Raises ``ValueError`` for a ball without usable pixels, and a reflectance that is not above 0.
    """
    pixels = np.asarray(photograph, np.float64)
    share = np.broadcast_to(np.asarray(reflectance, float), pixels.shape[2:])
    if not (share > 0).all():
        raise ValueError(f"reflectance={reflectance}: it must be above 0")
    good = _on_ball(pixels.shape[:2], ball)
    if usable is not None:
        good &= usable
    if not good.any():
        raise ValueError("no usable pixel lies on the ball: check the circle and the mask")
    rows = max(2, round(ball.radius)) if height is None else height
    filled = _filled(pixels, good) / share
    radiance = np.empty((rows, 2 * rows, pixels.shape[2]))
    confidence = np.empty((rows, 2 * rows))
    camera_from_world = np.asarray(world_from_camera, float)[:3, :3].T
    for row in range(rows):
        directions, weights = _samples_of_row(row, rows)
        at, cosines = _places(directions @ camera_from_world.T, ball)
        values = _interpolate(filled, at)
        seen = _interpolate(good[..., None].astype(float), at)[..., 0] * cosines
        radiance[row] = np.einsum("s,csk->ck", weights, values)
        confidence[row] = seen @ weights
    # Interpolation weights add up to 1 only to rounding.
    return BallLight(Environment(np.maximum(radiance, 0)), confidence)


def _on_ball(shape: tuple[int, ...], ball: Circle) -> Bool[np.ndarray, "row column"]:
    rows, columns = (np.arange(size) + 0.5 for size in shape)
    distance = np.hypot(rows[:, None] - ball.row, columns[None, :] - ball.column)
    return distance <= ball.radius - _RIM_PIXELS


def _filled(pixels: np.ndarray, good: Bool[np.ndarray, "row column"]) -> np.ndarray:
    """Give every other pixel the value of the nearest good one."""
    nearest = np.asarray(
        ndimage.distance_transform_edt(~good, return_distances=False, return_indices=True)
    )
    return pixels[nearest[0], nearest[1]]


def _samples_of_row(row: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Spread directions over each texel of a row; their weights are parts of its solid angle."""
    inside = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    polar = np.repeat((row + inside) * np.pi / rows, _SAMPLES)
    azimuth = (np.arange(2 * rows)[:, None] + np.tile(inside, _SAMPLES)[None, :]) * np.pi / rows
    sines = np.sin(polar)[None, :]
    z = np.broadcast_to(np.cos(polar), azimuth.shape)
    directions = np.stack([sines * np.cos(azimuth), sines * np.sin(azimuth), z], axis=-1)
    return directions, np.sin(polar) / np.sin(polar).sum()


def _places(directions: Float[np.ndarray, "*batch 3"], ball: Circle) -> tuple:
    """Find where on the photograph a direction, in the camera's axes, shows: half way to it."""
    half = directions + np.array([0.0, 0.0, 1.0])
    length = np.linalg.norm(half, axis=-1)
    # Straight behind the ball any point of the rim would do.
    behind = length < 1e-9
    normals = np.where(
        behind[..., None], [1.0, 0, 0], half / np.where(behind, 1, length)[..., None]
    )
    place = [ball.row - ball.radius * normals[..., 1], ball.column + ball.radius * normals[..., 0]]
    return np.stack(place), normals[..., 2]


def _interpolate(image: np.ndarray, places: Float[np.ndarray, "2 *batch"]) -> np.ndarray:
    channels = [
        ndimage.map_coordinates(channel, places - 0.5, order=1, mode="nearest")
        for channel in np.moveaxis(image, -1, 0)
    ]
    return np.stack(channels, axis=-1)
