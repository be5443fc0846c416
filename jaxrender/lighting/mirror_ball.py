"""The light around a chrome ball, from a photograph of it by a distant camera (T 6.4.1).

A distant camera (orthographic) sees in the ball's point of normal n the light from
R = 2 (n.o) n - o, with o towards the camera.  Every pixel stands for the same solid angle,
4 / radius^2, but its shape is ever longer and thinner towards the rim: an angle 2 / (radius cos t)
along the ball's radius at exit angle t.  That cosine is the ``confidence`` of a direction, 1
straight back into the camera, 0 straight behind the ball, which no ball shows.

Unlike the panorama ``mirror-ball`` of ``layouts``, which has a probe's own axes and is cropped to
the ball, this takes the circle to a fraction of a pixel and the camera's pose, and gives the light
in the world's own handedness.  ``ball_views`` does the same for any camera and ball in space.
Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxrender.geometry.cameras import Orthographic
from jaxrender.imaging.silhouette import Circle
from jaxrender.lighting.ball_views import Ball, Evidence, view_of_ball
from jaxrender.lighting.environment import Environment
from jaxrender.shapes import AnyArray, ImageArray, checked


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
    pose = np.array(world_from_camera, np.float64)
    rows, columns = np.shape(photograph)[:2]
    camera = Orthographic(columns, rows, pose, scale=1.0, cx=ball.column, cy=ball.row)
    # In front of the camera by any distance.
    centre = pose[:3, 3] - 2 * ball.radius * pose[:3, 2]
    view = view_of_ball(
        photograph,
        camera,
        Ball(centre, ball.radius),
        height,
        Evidence(None, usable),
        reflectance=reflectance,
    )
    return BallLight(Environment(view.radiance), view.confidence)
