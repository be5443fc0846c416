"""Light around the object as pictures: EXR, Radiance HDR, the six faces of a cube, and KTX 2.

The panoramas are latitude-longitude with z up, seen from within: +x in the middle, +y left of it.
Faces are those of OpenGL and Vulkan with y up, where (x, y, z) of the world is (x, z, -y): ``px``
shows +x, ``nx`` -x and so on; row 0 is the top.  A texel is the light at its centre, interpolated
bilinearly; nothing is filtered, so a face has as many rows as half of the panorama.
"""

from pathlib import Path

import numpy as np

from jaxrender.harmonics import looked_up, over_poles
from jaxrender.io.exports.contents import Contents, Part
from jaxrender.io.exports.gltf import ENVIRONMENT, facing_panorama
from jaxrender.io.exports.ktx import ktx_of_faces
from jaxrender.io.images import write_image
from jaxrender.lighting import Environment
from jaxrender.shapes import Float

RADIANCE, CUBE = "environment.hdr", "environment.ktx2"
# Right, down and ahead of each face, in axes with y up (OpenGL, table of cube map faces).
FACES = {
    "px": ((0, 0, -1), (0, -1, 0), (1, 0, 0)),
    "nx": ((0, 0, 1), (0, -1, 0), (-1, 0, 0)),
    "py": ((1, 0, 0), (0, 0, 1), (0, 1, 0)),
    "ny": ((1, 0, 0), (0, 0, -1), (0, -1, 0)),
    "pz": ((1, 0, 0), (0, -1, 0), (0, 0, 1)),
    "nz": ((-1, 0, 0), (0, -1, 0), (0, 0, -1)),
}
_LATLONG = "latitude-longitude with z up, +x in the middle and +y to the left of it; linear RGB"


def environment_losses(contents: Contents) -> tuple[str, ...]:
    """Say what pictures of the light cannot hold."""
    if np.any(np.asarray(contents.sources.irradiance) > 0) or contents.points is not None:
        return ("sources: a picture has no room for light from a single direction",)
    return ()


def write_environment_pictures(contents: Contents, folder: Path) -> tuple[Part, ...]:
    """Write the panoramas and the faces.  Raises ``ValueError`` where there is no environment."""
    if contents.environment is None:
        raise ValueError("there is no environment to write")
    panorama = facing_panorama(contents.environment)
    write_image(folder / ENVIRONMENT, panorama)
    write_image(folder / RADIANCE, panorama)
    parts = [
        Part(ENVIRONMENT, f"radiance, float: {_LATLONG}"),
        Part(RADIANCE, f"the same, 8 bits and a shared exponent: {_LATLONG}"),
    ]
    faces = cube_faces(contents.environment)
    (folder / CUBE).write_bytes(ktx_of_faces(faces))
    parts.append(Part(CUBE, "the faces below as one texture: KTX 2.0, not compressed, one level"))
    for name, face in faces.items():
        write_image(folder / f"{name}.exr", face)
        about = f"face {name} of a cube with y up (world z), as OpenGL names it; linear RGB"
        parts.append(Part(f"{name}.exr", about))
    return tuple(parts)


def cube_faces(environment: Environment) -> dict[str, Float[np.ndarray, "row column channel"]]:
    """Look the six faces up."""
    size = max(1, environment.radiance.shape[0] // 2)
    across = (2 * np.arange(size) + 1) / size - 1
    image = over_poles(environment.radiance)
    found = {}
    for name, axes in FACES.items():
        right, down, ahead = np.array(axes, float)
        rays = ahead + across[None, :, None] * right + across[:, None, None] * down
        x, y, z = np.moveaxis(rays / np.linalg.norm(rays, axis=-1, keepdims=True), -1, 0)
        found[name] = np.asarray(looked_up(image, np.stack([x, -z, y], axis=-1)))
    return found
