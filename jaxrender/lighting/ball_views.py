"""The light that a chrome ball shows to a camera, near or distant (T 6.4.1).

In the plane of a ball's centre, the eye and a distant source, let t be the angle of a normal from
the direction of the eye, which stands D radii from the centre.  The eye sees there the light from

    s(t) = 2 t + atan2(sin t, D - cos t)

off its own direction, and the whole of it up to the rim, cos t = 1 / D: what lies within
asin(1 / D) of straight behind the ball is shown nowhere.  s increases, so that Newton's method
finds where each direction shows.  A distant camera has 1 / D = 0.  Host side, NumPy float64.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from jaxrender.geometry.cameras import Camera, Orthographic
from jaxrender.harmonics import LatLongGrid
from jaxrender.shapes import AnyArray, ImageArray, checked

# Samples along each side of a texel.
_SAMPLES = 3
# The ball's outermost pixel is mixed with what stands behind the ball.
_RIM_PIXELS = 1.0
_NEWTON = 8
# Views count with this power of their confidence: what is seen along the rim is blurred.
_POWER = 3


class Ball(NamedTuple):
    """A ball in space, in world units; of distant light only their ratio to the eye counts."""

    centre: Float[np.ndarray, "3"]
    radius: float


class BallView(NamedTuple):
    """What one photograph of a ball shows: radiance, its standard deviation, and confidence.

    Confidence is the cosine of the exit angle, 1 straight back and 0 at the rim and where nothing
    is shown.
    """

    radiance: Float[np.ndarray, "row column channel"]
    deviation: Float[np.ndarray, "row column channel"]
    confidence: Float[np.ndarray, "row column"]


class MergedViews(NamedTuple):
    """Light of several views, as ``BallView``, and the relative rms by which they disagree."""

    radiance: Float[np.ndarray, "row column channel"]
    deviation: Float[np.ndarray, "row column channel"]
    confidence: Float[np.ndarray, "row column"]
    disagreement: float


class Evidence(NamedTuple):
    """What is known of a photograph's pixels beside their radiance.

    ``deviation``: standard deviations (None: not known, and taken for 0).  Pixels that are not
    ``usable`` show nothing (None: all do).
    """

    deviation: Float[np.ndarray, "photo_row photo_column channel"] | None = None
    usable: Bool[np.ndarray, "photo_row photo_column"] | None = None


@checked
def view_of_ball(
    photograph: ImageArray,
    camera: Camera,
    ball: Ball,
    height: int | None = None,
    evidence: Evidence | None = None,
    *,
    reflectance: float | Float[AnyArray, "channel"] = 1.0,
    camera_angle: float = 0.0,
) -> BallView:
    """Unwrap the photograph, in linear radiance, of a ball of the given ``reflectance``.

    ``height`` are the rows of the result, by default the ball's radius in pixels.  Directions
    within ``camera_angle`` (radians) of the eye show the camera itself, and have no confidence.
    Raises ``ValueError`` for a photograph that is not the camera's, a ball without usable pixels,
    an eye inside the ball, and a reflectance that is not above 0.
    """
    pixels = np.asarray(photograph, np.float64)
    if pixels.shape[:2] != (camera.height, camera.width):
        raise ValueError(
            f"a photograph of {pixels.shape[1]} x {pixels.shape[0]} pixels and a camera of "
            f"{camera.width} x {camera.height}: they must be the same"
        )
    share = np.broadcast_to(np.asarray(reflectance, float), pixels.shape[2:])
    if not (share > 0).all():
        raise ValueError(f"reflectance={reflectance}: it must be above 0")
    evidence = evidence or Evidence()
    sight = _Sight.of(camera, ball)
    good = sight.on_ball()
    if evidence.usable is not None:
        good &= evidence.usable
    if not good.any():
        raise ValueError("no usable pixel lies on the ball: check the ball and the mask")
    variance = np.zeros_like(pixels)
    if evidence.deviation is not None:
        variance = np.where(good[..., None], np.asarray(evidence.deviation) ** 2, 0)
    rows = max(2, round(sight.radius_in_pixels)) if height is None else height
    layers = np.concatenate([pixels / share, variance / share**2], axis=-1)
    layers = np.concatenate([_filled(layers, good), good[..., None].astype(float)], axis=-1)
    found = np.empty((rows, 2 * rows, layers.shape[-1]))
    for row in range(rows):
        directions, weights = samples_of_row(row, rows)
        seen = sight.of_directions(directions)
        values = _interpolate(layers, seen.places)
        shown = seen.cosines * (seen.angles >= camera_angle) * seen.visible
        values[..., -1] *= shown
        found[row] = np.einsum("s,csk->ck", weights, values)
    channels = pixels.shape[2]
    # Pixels of a texel are independent; where a texel is less than a pixel, they are not.
    solid_angle = LatLongGrid(rows, 2 * rows).weights()[..., None]
    count = np.maximum(1, solid_angle * sight.radius_in_pixels**2 / 4)
    deviation = np.sqrt(np.maximum(found[..., channels:-1], 0) / count)
    # Interpolation weights add up to 1 only to rounding.
    return BallView(np.maximum(found[..., :channels], 0), deviation, found[..., -1])


@checked
def merge_views(views: Sequence[BallView]) -> MergedViews:
    """Merge views in one frame and one size, each with the third power of its confidence.

    Raises ``ValueError`` for no views, or views of unlike sizes.
    """
    if not views:
        raise ValueError("no views given: give at least one")
    shapes = {view.radiance.shape for view in views}
    if len(shapes) > 1:
        raise ValueError(f"views of shapes {sorted(shapes)}: give all the same height")
    weights = np.stack([view.confidence for view in views])[..., None] ** _POWER
    total = weights.sum(axis=0)
    some = np.where(total > 0, total, 1)
    radiances = np.stack([view.radiance for view in views])
    radiance = np.sum(weights * radiances, axis=0) / some
    variances = np.stack([view.deviation for view in views]) ** 2
    deviation = np.sqrt(np.sum(weights**2 * variances, axis=0)) / some
    confidence = np.max([view.confidence for view in views], axis=0)
    solid_angle = LatLongGrid(*radiance.shape[:2]).weights()[..., None]
    apart = np.sum(solid_angle * weights * (radiances - radiance) ** 2)
    level = np.sum(solid_angle * weights * radiance**2)
    disagreement = float(np.sqrt(apart / level)) if level > 0 else 0.0
    return MergedViews(radiance, deviation, confidence, disagreement)


class _Seen(NamedTuple):
    """Where directions show in a photograph, at which angle from the eye, and how steeply."""

    places: Float[np.ndarray, "2 *batch"]
    angles: Float[np.ndarray, "*batch"]
    cosines: Float[np.ndarray, "*batch"]
    visible: Bool[np.ndarray, "*batch"]


class _Sight(NamedTuple):
    """A ball before a camera: the direction of the eye, and radii over its distance."""

    camera: Camera
    ball: Ball
    towards_eye: Float[np.ndarray, "3"]
    nearness: float
    pixel: float

    @classmethod
    def of(cls, camera: Camera, ball: Ball) -> "_Sight":
        if isinstance(camera, Orthographic):
            backwards = camera.world_from_camera[:3, 2]
            return cls(camera, ball, backwards / np.linalg.norm(backwards), 0.0, camera.scale)
        offset = camera.position - np.asarray(ball.centre, float)
        distance = float(np.linalg.norm(offset))
        if not distance > ball.radius > 0:
            raise ValueError(
                f"the camera stands {distance:g} from the centre of a ball of radius "
                f"{ball.radius:g}: it must stand outside"
            )
        # The size of a pixel at the ball: neighbouring rays part by so much.
        rays = camera.rays().directions
        row, column = camera.height // 2, camera.width // 2
        apart = np.linalg.norm(rays[row, column] - rays[row, max(column - 1, 0)])
        return cls(camera, ball, offset / distance, ball.radius / distance, float(apart * distance))

    @property
    def radius_in_pixels(self) -> float:
        return self.ball.radius / self.pixel

    def on_ball(self) -> Bool[np.ndarray, "row column"]:
        """Mark the pixels whose rays meet the ball, but for the outermost."""
        rays = self.camera.rays()
        across = np.cross(self.ball.centre - rays.origins, rays.directions)
        distance = np.linalg.norm(across, axis=-1)
        return distance <= self.ball.radius - _RIM_PIXELS * self.pixel

    def of_directions(self, directions: Float[np.ndarray, "*batch 3"]) -> _Seen:
        """Find the point of the ball that reflects each direction to the eye."""
        along = directions @ self.towards_eye
        across = directions - along[..., None] * self.towards_eye
        length = np.linalg.norm(across, axis=-1)
        angles = np.arctan2(length, along)
        near, rim = self.nearness, np.arccos(self.nearness)
        at = np.clip(angles / (2 + near / (1 - near)), 0, rim)
        for _ in range(_NEWTON):
            sine, cosine = np.sin(at), np.cos(at)
            value = 2 * at + np.arctan2(near * sine, 1 - near * cosine) - angles
            slope = 2 + near * (cosine - near) / (1 - 2 * near * cosine + near**2)
            at = np.clip(at - value / slope, 0, rim)
        # Straight behind the ball any point of the rim would do.
        sideways = np.where(length > 1e-12, length, 1)[..., None]
        tangents = np.where(length[..., None] > 1e-12, across / sideways, _any_across(self))
        normals = np.cos(at)[..., None] * self.towards_eye + np.sin(at)[..., None] * tangents
        points = self.ball.centre + self.ball.radius * normals
        xy = self.camera.project(points.reshape(-1, 3)).reshape(*at.shape, 2)
        # n.o, with o towards the eye.
        cosines = (np.cos(at) - near) / np.sqrt(1 - 2 * near * np.cos(at) + near**2)
        visible = angles <= rim + np.pi / 2
        return _Seen(np.stack([xy[..., 1], xy[..., 0]]), angles, np.maximum(cosines, 0), visible)


def _any_across(sight: _Sight) -> Float[np.ndarray, "3"]:
    axis = np.eye(3)[int(np.argmin(np.abs(sight.towards_eye)))]
    across = np.cross(sight.towards_eye, axis)
    return across / np.linalg.norm(across)


def _filled(pixels: np.ndarray, good: Bool[np.ndarray, "row column"]) -> np.ndarray:
    """Give every other pixel the value of the nearest good one."""
    nearest = np.asarray(
        ndimage.distance_transform_edt(~good, return_distances=False, return_indices=True)
    )
    return pixels[nearest[0], nearest[1]]


def samples_of_row(row: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Spread directions over each texel of a row of an environment of so many rows.

    Returned are [texel, sample, 3] directions and the samples' parts of the texel's solid angle.
    """
    inside = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    polar = np.repeat((row + inside) * np.pi / rows, _SAMPLES)
    azimuth = (np.arange(2 * rows)[:, None] + np.tile(inside, _SAMPLES)[None, :]) * np.pi / rows
    sines = np.sin(polar)[None, :]
    z = np.broadcast_to(np.cos(polar), azimuth.shape)
    directions = np.stack([sines * np.cos(azimuth), sines * np.sin(azimuth), z], axis=-1)
    return directions, np.sin(polar) / np.sin(polar).sum()


def _interpolate(image: np.ndarray, places: Float[np.ndarray, "2 *batch"]) -> np.ndarray:
    # Of a point behind the camera there is no place; it is not visible either.
    places = np.nan_to_num(places - 0.5)
    channels = [
        ndimage.map_coordinates(channel, places, order=1, mode="nearest")
        for channel in np.moveaxis(image, -1, 0)
    ]
    return np.stack(channels, axis=-1)
