"""Poses of other programs: which way a camera's axes point, and which way round a pose is given.

Ours is that of ``cameras``: world from camera, x right, y up, z backwards.  Each name below is what
another program writes; ``_inverted`` poses take the world into the camera.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from jaxrender.geometry.cameras import Camera
from jaxrender.shapes import checked

# Columns are right, up and backwards, each in the camera's own axes.
_OWN_FROM_OURS = {
    "opengl": np.eye(3),
    "opencv": np.diag([1.0, -1.0, -1.0]),
    "pytorch3d": np.diag([-1.0, 1.0, -1.0]),
    "llff": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "ros": np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]),
}
_INVERTED = "_inverted"

CAMERA_AXES = (*_OWN_FROM_OURS, *(name + _INVERTED for name in _OWN_FROM_OURS))


@checked
def pose_from(pose: Float[np.ndarray, "4 4"], axes: str) -> Float[np.ndarray, "4 4"]:
    """Turn a pose in the named axes into ours; ``ValueError`` for an unknown name.

    ``opengl``, x right, y up, z backwards; ``opencv``, x right, y down, z ahead; ``pytorch3d``,
    x left, y up, z ahead; ``llff``, x down, y right, z backwards; ``ros``, x ahead, y left, z up.
    """
    if axes not in CAMERA_AXES:
        raise ValueError(f"unknown camera axes {axes!r}; known are {', '.join(CAMERA_AXES)}")
    world_from_own = np.linalg.inv(pose) if axes.endswith(_INVERTED) else pose
    turned = world_from_own.copy()
    turned[:3, :3] = world_from_own[:3, :3] @ _OWN_FROM_OURS[axes.removesuffix(_INVERTED)]
    # An inverse of whole numbers may end in 0 0 0 1 up to a rounding.
    turned[3] = [0, 0, 0, 1]
    return turned


def camera_from(camera: Camera, axes: str) -> Camera:
    """Read a camera's pose anew, in the named axes."""
    if axes == "opengl":
        return camera
    pose = pose_from(camera.world_from_camera, axes)
    return eqx.tree_at(lambda one: one.world_from_camera, camera, pose)


def shrunk_camera(camera: Camera, factor: int) -> Camera:
    """Make pixels ``factor`` times as large; what is left over at the right and below is cut."""
    if factor == 1:
        return camera
    sizes = (camera.width // factor, camera.height // factor)
    small = eqx.tree_at(lambda one: (one.width, one.height), camera, sizes)
    for name in ("fl_x", "fl_y", "cx", "cy"):
        if hasattr(camera, name):
            small = eqx.tree_at(_field(name), small, getattr(camera, name) / factor)
    if hasattr(camera, "scale"):
        small = eqx.tree_at(_field("scale"), small, camera.scale * factor)
    return small


def _field(name: str):
    return lambda one: getattr(one, name)
