"""Triangle meshes with smooth normals.  Host side, NumPy float64.

Faces are wound counter-clockwise seen from outside.  Shading normals are interpolated between
vertices; where none are given they are the mean of the adjoining faces' normals weighted by the
faces' angles, which on a 32 x 32 sphere errs by 0.1 degree where area weights err by 1.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from trimesh.grouping import unique_rows

from jaxrender.geometry import convexity
from jaxrender.geometry.hits import Hits, Shape, no_hits, unit_rays
from jaxrender.geometry.tessellation import icosphere
from jaxrender.geometry.tracing import EmbreeTracer
from jaxrender.geometry.triangles import FaceHits, brute_force_first_faces, brute_force_occluded
from jaxrender.shapes import AnyArray, checked

# Twice a face's area, as part of its longest edge squared, below which it has no normal.
_FLAT = 1e-14


class Mesh(Shape):
    """Triangles over shared vertices; ``dropped_faces`` counts those left out.

    They are faces of zero area, and repetitions of earlier faces (in either winding): of two
    coincident faces a ray would meet one or the other by chance.
    """

    vertices: Float[np.ndarray, "vertex 3"]
    faces: Int[np.ndarray, "face 3"]
    normals: Float[np.ndarray, "vertex 3"]
    texture_coordinates: Float[np.ndarray, "face 3 2"] | None
    dropped_faces: int
    _tracer: EmbreeTracer

    def __init__(
        self,
        vertices: Float[AnyArray, "vertex 3"],
        faces: Int[AnyArray, "face 3"],
        normals: Float[AnyArray, "vertex 3"] | None = None,
        texture_coordinates: Float[AnyArray, "face 3 2"] | None = None,
    ):
        """Texture coordinates are u to the right and v upwards in the unit square.

        Every corner of a face has its own pair: along a seam of the texture one vertex has several.
        Raises ValueError for non-finite values, missing faces, indices out of range.
        """
        self.vertices = np.array(vertices, np.float64)
        _check_finite("vertex", self.vertices)
        faces = _checked_faces(np.array(faces, np.int64), len(self.vertices))
        flat = _is_flat(self.vertices[faces])
        if flat.all():
            raise ValueError(f"all {len(faces)} faces have zero area: the mesh has no surface")
        kept = np.flatnonzero(~flat)
        # The first of each set of three vertices.
        kept = kept[np.sort(unique_rows(np.sort(faces[kept], axis=1))[0])]
        self.faces = faces[kept]
        self.dropped_faces = len(faces) - len(self.faces)
        if normals is None:
            self.normals = angle_weighted_normals(self.vertices, self.faces)
        else:
            _check_finite("normal", np.asarray(normals))
            self.normals = _unit_or_zero(np.array(normals, np.float64))
        self.texture_coordinates = None
        if texture_coordinates is not None:
            self.texture_coordinates = np.array(texture_coordinates, np.float64)[kept]
            _check_finite("texture coordinate", self.texture_coordinates.reshape(-1, 2))
        self._tracer = EmbreeTracer(self.vertices, self.faces)

    @classmethod
    @checked
    def icosphere(
        cls, subdivisions: int, radius: float = 1.0, center: Float[AnyArray, "3"] | None = None
    ) -> "Mesh":
        """A sphere of 20 * 4^subdivisions triangles with the sphere's own normals."""
        return cls.ellipsoid(np.full(3, float(radius)), subdivisions, center)

    @classmethod
    @checked
    def ellipsoid(
        cls,
        semi_axes: Float[AnyArray, "3"],
        subdivisions: int,
        center: Float[AnyArray, "3"] | None = None,
    ) -> "Mesh":
        """x^2/a^2 + y^2/b^2 + z^2/c^2 = 1: vertices on it, normals its gradient there."""
        semi_axes = np.asarray(semi_axes, np.float64)
        if not (np.isfinite(semi_axes).all() and (semi_axes > 0).all()):
            raise ValueError(f"semi-axes {semi_axes} must be positive, finite lengths")
        directions, faces = icosphere(subdivisions)
        center = np.zeros(3) if center is None else np.asarray(center, np.float64)
        return cls(center + directions * semi_axes, faces, directions / semi_axes)

    @checked
    def first_hits(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Hits:
        """By Embree, two-sided; accurate to float64 once the face is found."""
        origins, directions = unit_rays(origins, directions)
        return self._hits(origins, directions, self._tracer.first_faces(origins, directions))

    @checked
    def first_hits_brute_force(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Hits:
        """The same by testing every triangle: slow, and the standard for ``first_hits``."""
        origins, directions = unit_rays(origins, directions)
        triangles = self.vertices[self.faces]
        found = brute_force_first_faces(origins, directions, triangles)
        return self._hits(origins, directions, found)

    @checked
    def occluded(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Bool[np.ndarray, "ray"]:
        """By Embree's any-hit query, two-sided, on all processors."""
        return self._tracer.occluded(*unit_rays(origins, directions))

    @checked
    def occluded_pairs(
        self,
        origins: Float[np.ndarray, "place 3"],
        directions: Float[np.ndarray, "direction 3"],
        asked: Bool[np.ndarray, "place direction"],
    ) -> Bool[np.ndarray, "place direction"]:
        """By Embree, the rays put together in single precision."""
        return self._tracer.occluded_pairs(origins, directions, asked)

    @checked
    def occluded_brute_force(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Bool[np.ndarray, "ray"]:
        """The same by testing every triangle: slow, and the standard for ``occluded``."""
        origins, directions = unit_rays(origins, directions)
        return brute_force_occluded(origins, directions, self.vertices[self.faces])

    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Of the vertices that faces use."""
        used = np.zeros(len(self.vertices), bool)
        used[self.faces] = True
        corners = self.vertices[used]
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    def face_normals(self) -> Float[np.ndarray, "face 3"]:
        """Unit normals of the faces themselves, outwards."""
        return _unit_or_zero(_doubled_area(self.vertices[self.faces]))

    def is_closed(self) -> bool:
        """Whether every edge is used once in either direction (vertices at one place are one)."""
        return convexity.is_closed(self.vertices, self.faces)

    def is_convex(self) -> bool:
        """Whether no part hides another from its front; found out once."""
        return self._tracer.is_convex

    def _hits(self, origins: np.ndarray, directions: np.ndarray, found: FaceHits) -> Hits:
        hits = no_hits(len(origins))
        hit = found.face >= 0
        hits.hit[:] = hit
        corner = self.faces[found.face[hit]]
        weights = found.barycentric[hit]
        triangles = self.vertices[corner]
        # From one corner, so that a mesh far from the origin keeps its digits.
        offsets = np.einsum("rk,rki->ri", weights[:, 1:], triangles[:, 1:] - triangles[:, :1])
        points = triangles[:, 0] + offsets
        geometric = _unit_or_zero(_doubled_area(triangles))
        smooth = _unit_or_zero(np.einsum("rk,rki->ri", weights, self.normals[corner]))
        # Opposite vertex normals can cancel; the face always has a normal.
        missing = ~smooth.any(axis=1)
        smooth[missing] = geometric[missing]
        hits.points[hit] = points
        hits.distance[hit] = np.einsum("ri,ri->r", points - origins[hit], directions[hit])
        hits.normals[hit] = smooth
        hits.geometric_normals[hit] = geometric
        hits.face[hit] = found.face[hit]
        hits.barycentric[hit] = weights
        return hits


def angle_weighted_normals(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Float[np.ndarray, "vertex 3"]:
    """Unit vertex normals, each face weighted by its angle at the vertex; zero where no face is.

    Vertices at exactly one place share a normal, so that texture seams do not show.
    """
    triangles = vertices[faces]
    face_normals = _unit_or_zero(_doubled_area(triangles))
    to_next = _unit_or_zero(np.roll(triangles, -1, axis=1) - triangles)
    to_previous = _unit_or_zero(np.roll(triangles, 1, axis=1) - triangles)
    # The arc tangent is accurate for slivers, where an arc cosine is not.
    sine = np.linalg.norm(np.cross(to_next, to_previous), axis=-1)
    angles = np.arctan2(sine, np.einsum("fki,fki->fk", to_next, to_previous))
    weighted = (angles[..., None] * face_normals[:, None, :]).reshape(-1, 3)
    places, place_of = np.unique(vertices, axis=0, return_inverse=True)
    corner = place_of[faces].ravel()
    sums = [np.bincount(corner, weighted[:, axis], len(places)) for axis in range(3)]
    return _unit_or_zero(np.stack(sums, axis=-1))[place_of]


def _doubled_area(triangles: np.ndarray) -> np.ndarray:
    """The cross product of two edges: along the outward normal, twice the area long."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _is_flat(triangles: np.ndarray) -> np.ndarray:
    edges = np.roll(triangles, -1, axis=1) - triangles
    longest = np.einsum("fki,fki->fk", edges, edges).max(axis=1)
    return np.linalg.norm(_doubled_area(triangles), axis=1) <= _FLAT * longest


def _unit_or_zero(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1)


def _check_finite(name: str, rows: np.ndarray) -> None:
    bad = ~np.isfinite(rows).all(axis=1)
    if bad.any():
        index = int(np.argmax(bad))
        raise ValueError(
            f"{name} {index} is {rows[index]} ({int(bad.sum())} such): remove or mend the "
            "non-finite values"
        )


def _checked_faces(faces: np.ndarray, vertices: int) -> np.ndarray:
    if len(faces) == 0:
        raise ValueError("the mesh has no faces: a point cloud must be triangulated first")
    bad = ((faces < 0) | (faces >= vertices)).any(axis=1)
    if bad.any():
        index = int(np.argmax(bad))
        raise ValueError(
            f"face {index} names vertices {faces[index].tolist()}, but vertices are numbered 0 to "
            f"{vertices - 1}: check the file's index base"
        )
    return faces
