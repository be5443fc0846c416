"""A procedural sculpture: smooth, closed and concave, to try out what convex theory leaves open.

The surface is p(w) = r(w) w for directions w from its centre, with the smooth radius

    r(w) = 1 + sum_k a_k exp((w.c_k - 1) / s_k^2)

a few deep dents (a_k < 0) and bumps (a_k > 0) evenly spread, of angular width s_k.  Its normal is
known in closed form: along r w - grad r, the gradient taken on the unit sphere.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxrender.geometry.mesh import Mesh
from jaxrender.geometry.tessellation import icosphere
from jaxrender.geometry.visibility import fibonacci_sphere, random_rotations
from jaxrender.shapes import checked

# Dents and bumps take turns over the centres.
_FEATURES = 16
_DENT_DEPTHS = (0.35, 0.5)
_BUMP_HEIGHTS = (0.35, 0.55)
_WIDTHS = (0.26, 0.34)


class Features(NamedTuple):
    """Dents and bumps of a unit sphere: centres, signed heights, angular widths in radians."""

    centers: Float[np.ndarray, "feature 3"]
    heights: Float[np.ndarray, "feature"]
    widths: Float[np.ndarray, "feature"]

    @classmethod
    def drawn(cls, seed: int) -> "Features":
        """Dents and bumps in turn, evenly spread, of random depth and width."""
        rng = np.random.default_rng(seed)
        centers = fibonacci_sphere(_FEATURES) @ random_rotations(1, seed)[0].T
        dents = -rng.uniform(*_DENT_DEPTHS, _FEATURES)
        heights = np.where(np.arange(_FEATURES) % 2, rng.uniform(*_BUMP_HEIGHTS, _FEATURES), dents)
        return cls(centers, heights, rng.uniform(*_WIDTHS, _FEATURES))

    def radius(self, directions: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point"]:
        """Evaluate r(w)."""
        return 1 + self._lobes(directions).sum(axis=1)

    def normals(self, directions: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 3"]:
        """Outward unit normals at the surface points in those directions."""
        lobes = self._lobes(directions)
        gradient = lobes / self.widths**2 @ self.centers
        radial = np.einsum("pi,pi->p", gradient, directions)
        tangential = gradient - radial[:, None] * directions
        normals = (1 + lobes.sum(axis=1))[:, None] * directions - tangential
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def _lobes(self, directions: np.ndarray) -> Float[np.ndarray, "point feature"]:
        return self.heights * np.exp((directions @ self.centers.T - 1) / self.widths**2)


@checked
def sculpture(
    subdivisions: int = 5,
    seed: int = 0,
    radius: float = 1.0,
    center: Float[np.ndarray, "3"] | None = None,
) -> Mesh:
    """Make a sculpture of 20 * 4^subdivisions triangles, with latitude-longitude texture.

    ``radius`` is that of the sphere under the dents and bumps.  Texture coordinates are
    u = azimuth / 2 pi and v = 1 - polar angle / pi about the centre; faces across the seam run on
    beyond u = 1, where a texture repeats, so the vertices there are split.
    """
    directions, faces, texture_coordinates = unwrapped(*icosphere(subdivisions))
    features = Features.drawn(seed)
    points = radius * features.radius(directions)[:, None] * directions
    if center is not None:
        points = points + center
    return Mesh(points, faces, features.normals(directions), texture_coordinates[faces])


class UnwrappedSphere(NamedTuple):
    """A tessellated unit sphere whose vertices have texture coordinates (u, v)."""

    directions: Float[np.ndarray, "split_vertex 3"]
    faces: Int[np.ndarray, "face 3"]
    texture_coordinates: Float[np.ndarray, "split_vertex 2"]


def unwrapped(
    directions: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> UnwrappedSphere:
    """Give a tessellated unit sphere latitude-longitude texture coordinates (u, v).

    A vertex that faces on both sides of the seam share is split; one at a pole, where there is no
    azimuth, once for each of its faces, each with the mean azimuth of the face's other corners.
    """
    x, y, z = directions[faces].transpose(2, 0, 1)
    u = np.arctan2(y, x) / (2 * np.pi) % 1
    pole = np.hypot(x, y) < 1e-9
    u = np.where(pole, np.nan, u)
    # On a face that spans more than half of the circle, small azimuths lie beyond the seam.
    wide = np.nanmax(u, axis=1) - np.nanmin(u, axis=1) > 0.5
    u += (wide[:, None]) & (u < 0.5)
    u = np.where(pole, np.nanmean(u, axis=1)[:, None], u)
    v = 1 - np.arccos(np.clip(z, -1, 1)) / np.pi
    corners = np.stack([faces, u, v], axis=-1).reshape(-1, 3)
    unique, index = np.unique(corners, axis=0, return_inverse=True)
    vertex = unique[:, 0].astype(np.int64)
    return UnwrappedSphere(directions[vertex], index.reshape(faces.shape), unique[:, 1:])
