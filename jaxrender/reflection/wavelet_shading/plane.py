"""A rectangle or parallelogram under a radiance field, as a camera sees it (L 5.3.2, 6.4).

Places are (u, v) = (0, 0) at the corner and (1, 1) at the opposite one.  The frame of directions
has +X along u and +Z along u x v, the side that is lit and seen; +Y completes it.  Directions are
places on Nusselt's square (``geometry.embeddings``), those of the radiance, of the BRDF and of the
camera in this one frame.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import Camera, Orthographic
from jaxrender.reflection.wavelet_shading.shading import reflected_radiance
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int
from jaxrender.wavelets.tree import CoefficientTree

# Sides whose sine of the angle between them is smaller make no plane.
_PARALLEL = 1e-6


class PlaneView(NamedTuple):
    """What is behind the pixels of an image."""

    seen: Bool[np.ndarray, "row column"]
    places: Float[np.ndarray, "pixel 2"]
    """(u, v) of the pixels that see the plane, row by row."""
    directions: Float[np.ndarray, "direction 2"]
    """(k_r, l_r) from there to the camera; a single row if all pixels share one."""


class Plane(eqx.Module):
    """A corner and the two sides that start there, in world units.

    Raises ``ValueError`` for sides that are not finite or parallel.
    """

    corner: Float[np.ndarray, "3"]
    along_u: Float[np.ndarray, "3"]
    along_v: Float[np.ndarray, "3"]

    def __init__(
        self,
        corner: Float[AnyArray, "3"],
        along_u: Float[AnyArray, "3"],
        along_v: Float[AnyArray, "3"],
    ):
        self.corner = np.asarray(corner, float)
        self.along_u, self.along_v = np.asarray(along_u, float), np.asarray(along_v, float)
        lengths = np.linalg.norm(self.along_u) * np.linalg.norm(self.along_v)
        area = np.linalg.norm(np.cross(self.along_u, self.along_v))
        if not (np.isfinite(self.corner).all() and area > _PARALLEL * lengths):
            raise ValueError(
                f"a corner {self.corner} and sides {self.along_u} and {self.along_v}: give finite "
                "sides that are not parallel"
            )

    @property
    def world_from_local(self) -> Float[np.ndarray, "3 3"]:
        """The frame of directions, its axes as columns."""
        x = self.along_u / np.linalg.norm(self.along_u)
        z = np.cross(self.along_u, self.along_v)
        z /= np.linalg.norm(z)
        return np.stack([x, np.cross(z, x), z], axis=1)

    def points(self, places: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the world points of places (u, v)."""
        return self.corner + places @ np.stack([self.along_u, self.along_v])

    def seen_by(self, camera: Camera) -> PlaneView:
        """Find the place behind each pixel, and the direction back to the camera."""
        rays = camera.rays()
        local = self.world_from_local
        towards = -rays.directions @ local
        height = (rays.origins - self.corner) @ local[:, 2]
        facing = towards[..., 2] > 0
        distance = height / np.where(facing, towards[..., 2], 1)
        offset = rays.origins + distance[..., None] * rays.directions - self.corner
        places = offset @ np.linalg.pinv(np.stack([self.along_u, self.along_v]))
        inside = np.all((places >= 0) & (places <= 1), axis=-1)
        seen = facing & (height > 0) & inside
        directions = (towards[..., :2] + 1) / 2
        shared = isinstance(camera, Orthographic)
        return PlaneView(seen, places[seen], directions[0, :1] if shared else directions[seen])


def shade_plane(
    light: CoefficientTree,
    brdfs: Sequence[CoefficientTree],
    view: PlaneView,
    texture: Int[AnyArray, "texel_u texel_v"] | None = None,
) -> Float[Array, "row column channel"]:
    """Render a plane under a radiance field, 0 where the camera does not see it.

    ``texture`` says for each texel, [u, v], which BRDF is there; without one there is one BRDF.
    Raises ``ValueError`` for several BRDFs without a texture or none, a texture that asks for one
    that is not there, and what ``reflected_radiance`` refuses.
    """
    which = _texels(view.places, texture, len(brdfs))
    channels = max(tree.channels for tree in (light, *brdfs))
    row, column = np.nonzero(view.seen)
    dtype = np.result_type(*(part.dtype for t in (light, *brdfs) for part in (t.root, t.values)))
    image = jnp.zeros((*view.seen.shape, channels), dtype)
    for index in np.unique(which):
        here = np.flatnonzero(which == index)
        shared = len(view.directions) == 1
        directions = view.directions if shared else view.directions[here]
        found = reflected_radiance(light, brdfs[index], view.places[here], directions)
        found = jnp.broadcast_to(found.astype(dtype), (len(here), channels))
        image = image.at[row[here], column[here]].set(found)
    return image


def _texels(
    places: Float[np.ndarray, "pixel 2"], texture: AnyArray | None, brdfs: int
) -> Int[np.ndarray, "pixel"]:
    if texture is None:
        if brdfs != 1:
            raise ValueError(f"{brdfs} BRDFs and no texture; give one BRDF, or say which is where")
        return np.zeros(len(places), np.int64)
    texture = np.asarray(texture)
    wrong = (texture < 0) | (texture >= brdfs)
    if wrong.any():
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise ValueError(
            f"texel {place} has BRDF {texture[place]}, and there are {brdfs}; number them from 0"
        )
    size = np.array(texture.shape)
    texel = np.clip(np.floor(places * size), 0, size - 1).astype(np.int64)
    return texture[texel[:, 0], texel[:, 1]].astype(np.int64)
