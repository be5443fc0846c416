"""What can be seen from a surface: V(x, w) of T 6.10 to 6.12.  Host side, NumPy float64.

A direction is visible from a place on a surface if it rises above the geometric horizon, and the
ray towards it meets the surface nowhere else.  Rays start 1e-4 of the shape's diagonal above the
place, along the geometric normal: Embree has no nearest distance, and without the offset half of
them would meet the face that they start on.  A convex shape never blocks a ray, so none is traced.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxrender.geometry.hits import Shape
from jaxrender.geometry.mesh import Mesh, angle_weighted_normals
from jaxrender.geometry.surface import SurfaceView
from jaxrender.geometry.tracing import in_threads
from jaxrender.shapes import AnyArray, checked

# Distance of a ray's origin from the surface, as part of the diagonal of the shape's bounding box.
_OFFSET = 1e-4
# Squared lengths of unit directions may be off by this much: single precision, some roundings.
_UNIT = 1e-5
# Pairs of place and direction worked on at once by each thread: with a quarter of them a call takes
# an eighth longer, with twice as many the memory for them is asked for anew each time.
_PAIRS_AT_ONCE = 2**17


class SurfacePlaces(NamedTuple):
    """Points of a surface and the unit normals of the faces they lie on: where rays start."""

    points: Float[np.ndarray, "place 3"]
    geometric_normals: Float[np.ndarray, "place 3"]

    @classmethod
    def of_views(cls, views: Sequence[SurfaceView]) -> "SurfacePlaces":
        """The pixels that hit the surface, view after view, row by row."""
        points = np.concatenate([view.points[view.hit] for view in views])
        return cls(points, np.concatenate([view.geometric_normals[view.hit] for view in views]))

    @classmethod
    def of_vertices(cls, mesh: Mesh) -> "SurfacePlaces":
        """A mesh's vertices, their normals the angle-weighted means of the faces about them."""
        return cls(mesh.vertices, angle_weighted_normals(mesh.vertices, mesh.faces))

    @classmethod
    @checked
    def on_faces(
        cls, mesh: Mesh, face: Int[np.ndarray, "place"], barycentric: Float[np.ndarray, "place 3"]
    ) -> "SurfacePlaces":
        """Points within faces, given by the weights of the corners: a texture's texels."""
        triangles = mesh.vertices[mesh.faces[face]]
        points = np.einsum("pk,pki->pi", barycentric, triangles)
        return cls(points, mesh.face_normals()[face])


@checked
def visible(
    shape: Shape,
    places: SurfacePlaces,
    directions: Float[AnyArray, "direction 3"],
) -> Bool[np.ndarray, "place direction"]:
    """Tell for every place which of the unit directions it sees: V(x, w).

    Rays run on all processors.  The answer takes one byte a pair: give many places in portions.
    """
    directions = _checked(directions)
    origins, normals = _starts(shape, places)
    seen = np.zeros((len(origins), len(directions)), bool)
    step = max(1, _PAIRS_AT_ONCE // max(len(directions), 1))
    convex, columns = shape.is_convex(), np.ascontiguousarray(directions.T)

    def look(first: int) -> None:
        part = slice(first, first + step)
        above = normals[part] @ columns > 0
        if not convex:
            above &= ~shape.occluded_pairs(origins[part], directions, above)
        seen[part] = above

    in_threads(look, range(0, len(origins), step))
    return seen


@checked
def visible_along(
    shape: Shape, places: SurfacePlaces, directions: Float[AnyArray, "place 3"]
) -> Bool[np.ndarray, "place"]:
    """Tell whether each place sees its own unit direction, a reflected ray's for instance."""
    directions = _checked(directions)
    origins, normals = _starts(shape, places)
    seen = np.einsum("pi,pi->p", normals, directions) > 0
    if not shape.is_convex():
        seen[seen] = ~shape.occluded(origins[seen], directions[seen])
    return seen


def fibonacci_sphere(count: int) -> Float[np.ndarray, "direction 3"]:
    """Spread directions evenly: equal steps in z, azimuths by the golden angle.

    Each stands for the solid angle 4 pi / count.  Integrals of smooth functions, and of those with
    a kink at a horizon, converge faster than with random directions.
    """
    if count < 1:
        raise ValueError(f"count is {count}: give at least one direction")
    index = np.arange(count)
    z = 1 - (2 * index + 1) / count
    azimuth = np.pi * (3 - np.sqrt(5)) * index
    sine = np.sqrt(1 - z**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], axis=-1)


def random_rotations(count: int, seed: int) -> Float[np.ndarray, "rotation 3 3"]:
    """Draw rotations uniformly, as those of unit quaternions uniform on their sphere.

    A rotated set of fixed directions then has every direction uniformly distributed, so sums over
    it are unbiased, and sets of different rotations err independently.
    """
    quaternions = np.random.default_rng(seed).normal(size=(count, 4))
    return Rotation.from_quat(quaternions, scalar_first=True).as_matrix()


def _checked(directions: Float[AnyArray, "ray 3"]) -> Float[np.ndarray, "ray 3"]:
    directions = np.asarray(directions, np.float64)
    lengths = np.einsum("ri,ri->r", directions, directions)
    if not (np.abs(lengths - 1) < _UNIT).all():
        worst = int(np.argmin(np.abs(lengths - 1) < _UNIT))
        raise ValueError(f"direction {worst} is {directions[worst]}: normalise the directions")
    return directions


def _starts(shape: Shape, places: SurfacePlaces) -> tuple[np.ndarray, np.ndarray]:
    normals = np.asarray(places.geometric_normals, np.float64)
    origins = np.asarray(places.points, np.float64) + _OFFSET * shape.diagonal() * normals
    return origins, normals
