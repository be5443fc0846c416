"""The light that a camera sees by itself, through a fisheye or as a panorama.

Each texel of the result is the mean over its own solid angle of what the photograph shows there.
Host side, NumPy float64.
"""

import math

import numpy as np
from jaxtyping import Bool
from scipy import ndimage

from jaxrender.geometry.cameras import Pinhole
from jaxrender.geometry.lenses import EquirectangularLens
from jaxrender.harmonics import LatLongGrid
from jaxrender.lighting.ball_views import BallView, Evidence, samples_of_row
from jaxrender.shapes import ImageArray, checked

# A point so far away shows the direction alone.
_FAR = 1e6


@checked
def view_of_lens(
    photograph: ImageArray,
    camera: Pinhole,
    height: int,
    evidence: Evidence | None = None,
    field: float = 2 * math.pi,
) -> BallView:
    """Unwrap a photograph, in linear radiance, of the light itself, to ``height`` rows.

    ``field`` is the full angle of view in radians: beyond it a lens shows nothing.  Confidence is
    the part of a texel that is shown by usable pixels.  Raises ``ValueError`` for a photograph that
    is not the camera's, and where no usable pixel shows a direction.
    """
    pixels = np.asarray(photograph, np.float64)
    if pixels.shape[:2] != (camera.height, camera.width):
        raise ValueError(
            f"a photograph of {pixels.shape[1]} x {pixels.shape[0]} pixels and a camera of "
            f"{camera.width} x {camera.height}: they must be the same"
        )
    evidence = evidence or Evidence()
    good = np.ones(pixels.shape[:2], bool) if evidence.usable is None else evidence.usable
    variance = np.zeros_like(pixels)
    if evidence.deviation is not None:
        variance = np.where(good[..., None], np.asarray(evidence.deviation) ** 2, 0)
    values = np.concatenate([pixels, variance], axis=-1)
    layers = np.concatenate([values * good[..., None], good[..., None]], axis=-1)
    found = np.stack([_row(layers, camera, row, height, field) for row in range(height)])
    share = found[..., -1]
    if not share.any():
        raise ValueError("no usable pixel shows a direction: check the field of view and the mask")
    some = np.where(share > 0, share, 1)[..., None]
    channels = pixels.shape[2]
    # Pixels of a texel are independent; where a texel is less than a pixel, they are not.
    solid_angle = LatLongGrid(height, 2 * height).weights()[..., None]
    count = np.maximum(1, solid_angle * camera.fl_x * camera.fl_y)
    deviation = np.sqrt(np.maximum(found[..., channels:-1] / some, 0) / count)
    return BallView(np.maximum(found[..., :channels] / some, 0), deviation, np.minimum(share, 1))


def _row(layers: np.ndarray, camera: Pinhole, row: int, rows: int, field: float) -> np.ndarray:
    """Take the mean of what is shown over each texel of a row; the last layer is how much is."""
    directions, weights = samples_of_row(row, rows)
    points = camera.position + _FAR * directions.reshape(-1, 3)
    xy = camera.project(points).reshape(*directions.shape[:-1], 2)
    backwards = camera.world_from_camera[:3, 2]
    inside = _inside(xy, camera) & (directions @ -backwards >= math.cos(min(field / 2, math.pi)))
    places = np.nan_to_num(np.stack([xy[..., 1], xy[..., 0]]) - 0.5)
    wraps = isinstance(camera.lens, EquirectangularLens)
    if wraps:
        # One more column on either side is that of the other edge.
        layers, places[1] = np.pad(layers, ((0, 0), (1, 1), (0, 0)), mode="wrap"), places[1] + 1
    values = np.stack(
        [
            ndimage.map_coordinates(layer, places, order=1, mode="nearest")
            for layer in np.moveaxis(layers, -1, 0)
        ],
        axis=-1,
    )
    return np.einsum("s,csk->ck", weights, values * inside[..., None])


def _inside(xy: np.ndarray, camera: Pinhole) -> Bool[np.ndarray, "texel sample"]:
    with np.errstate(invalid="ignore"):
        across = (xy[..., 0] >= 0) & (xy[..., 0] <= camera.width)
        return across & (xy[..., 1] >= 0) & (xy[..., 1] <= camera.height)
