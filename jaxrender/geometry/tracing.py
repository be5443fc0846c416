"""First triangle along a ray: Embree, and the brute-force twin it is tested against.

Both answer with face numbers (-1 for a miss) and barycentric coordinates in float64.  Embree works
in float32 and finds only the face; the meeting point is then computed again in float64 on that
face, from the ray as it was given.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float, Int

# Rays traced at once: enough to amortise a call, small enough for the cache.
_CHUNK = 16384
# Even Embree's robust mode leaks rays aimed exactly at a vertex, one in 300.  Moving the origins by
# this part of the mesh's size (sixteen float32 roundings) leaves one in 50,000, and _repair catches
# those.
_JITTER = 1e-6
# Slack of the brute-force test at a triangle's edges, so that neighbours leave no gap.
_EDGE_SLACK = 1e-12


class FaceHits(NamedTuple):
    """Which face each ray meets first, -1 for none, and the weights of its three corners there."""

    face: Int[np.ndarray, "ray"]
    barycentric: Float[np.ndarray, "ray 3"]


class EmbreeTracer:
    """A triangle mesh prepared for Embree: centred, scaled to a unit box, cast to float32.

    Ray origins are advanced in float64 to the sphere around that box before they are cast, so that
    neither a distant camera nor a mesh far from the origin costs accuracy.  Pickling keeps the
    arrays and builds Embree's tree again.
    """

    def __init__(self, vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]):
        self._arrays = vertices, faces
        lower, upper = vertices[faces].min(axis=(0, 1)), vertices[faces].max(axis=(0, 1))
        self._center = (lower + upper) / 2
        self._size = float((upper - lower).max())
        boxed = (vertices - self._center) / self._size
        self._triangles = boxed[faces]
        self._face_normals = np.cross(
            self._triangles[:, 1] - self._triangles[:, 0],
            self._triangles[:, 2] - self._triangles[:, 0],
        )
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, boxed.astype(np.float32), faces.astype(np.int32))
        # The first query builds the tree; it must not happen in two threads at once.
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def __reduce__(self):
        return EmbreeTracer, self._arrays

    def first_faces(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> FaceHits:
        """The first face along each ray of unit direction; chunks run on all processors."""
        face = np.full(len(origins), -1)
        barycentric = np.zeros((len(origins), 3))

        def trace(start: int) -> None:
            chunk = slice(start, start + _CHUNK)
            boxed = (origins[chunk] - self._center) / self._size
            face[chunk], barycentric[chunk] = self._trace(boxed, directions[chunk], start)

        # Embree releases the interpreter's lock, and so do NumPy's loops.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(trace, range(0, len(origins), _CHUNK)))
        return FaceHits(face, barycentric)

    def _trace(self, origins: np.ndarray, directions: np.ndarray, seed: int) -> FaceHits:
        """One chunk, origins in units of the box."""
        face = np.full(len(origins), -1)
        barycentric = np.zeros((len(origins), 3))
        reaches, entries = _advance_to_unit_sphere(origins, directions)
        aimed = np.flatnonzero(reaches)
        entries, towards = entries[aimed], directions[aimed]
        jitter = np.random.default_rng(seed)
        found = self._query(entries, towards, jitter)
        found = self._repair(found, entries, towards, jitter)
        ok = found >= 0
        face[aimed[ok]] = found[ok]
        barycentric[aimed[ok]] = clipped_barycentric(
            entries[ok], towards[ok], self._triangles[found[ok]]
        )
        return FaceHits(face, barycentric)

    def _query(
        self, origins: np.ndarray, directions: np.ndarray, jitter: np.random.Generator
    ) -> np.ndarray:
        moved = origins + _JITTER * jitter.uniform(-1, 1, origins.shape)
        # embreex wants at least one ray.
        if not len(moved):
            return np.zeros(0, np.int32)
        return self._scene.run(moved.astype(np.float32), directions.astype(np.float32))

    def _repair(
        self,
        found: np.ndarray,
        origins: np.ndarray,
        directions: np.ndarray,
        jitter: np.random.Generator,
    ) -> np.ndarray:
        """Ask again for rays that met a face from behind, and keep the nearer answer.

        A ray that leaks into a closed mesh meets its next face from behind.  Rays that really
        start inside, or see through a hole, are merely asked twice.
        """
        ray = np.flatnonzero(found >= 0)
        behind = np.einsum("ri,ri->r", self._face_normals[found[ray]], directions[ray]) > 0
        ray = ray[behind]
        again = self._query(origins[ray], directions[ray], jitter)
        first, second = (
            self._distance(faces, origins[ray], directions[ray]) for faces in (found[ray], again)
        )
        nearer = (again >= 0) & (second < first)
        found[ray[nearer]] = again[nearer]
        return found

    def _distance(self, face: np.ndarray, origins: np.ndarray, directions: np.ndarray):
        triangles = self._triangles[face]
        weights = clipped_barycentric(origins, directions, triangles)
        points = np.einsum("rk,rki->ri", weights, triangles)
        return np.einsum("ri,ri->r", points - origins, directions)


def brute_force_first_faces(
    origins: Float[np.ndarray, "ray 3"],
    directions: Float[np.ndarray, "ray 3"],
    triangles: Float[np.ndarray, "face 3 3"],
) -> FaceHits:
    """Every ray against every triangle in float64: for tests and small meshes only."""
    face = np.full(len(origins), -1)
    barycentric = np.zeros((len(origins), 3))
    for ray, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        weights, distance = _intersect(origin[None], direction[None], triangles)
        inside = (weights >= -_EDGE_SLACK).all(axis=1) & (distance > 0)
        if inside.any():
            nearest = np.where(inside, distance, np.inf).argmin()
            face[ray], barycentric[ray] = nearest, weights[nearest]
    return FaceHits(face, barycentric)


def clipped_barycentric(
    origins: Float[np.ndarray, "ray 3"],
    directions: Float[np.ndarray, "ray 3"],
    triangles: Float[np.ndarray, "ray 3 3"],
) -> Float[np.ndarray, "ray 3"]:
    """Where each ray meets its triangle's plane, clipped to the triangle.

    The clip moves only rays that passed an edge within the jitter; a triangle seen exactly edge-on
    answers with its centre.
    """
    weights, _ = _intersect(origins, directions, triangles)
    weights = np.maximum(np.where(np.isfinite(weights), weights, 1), 0)
    return weights / weights.sum(axis=1, keepdims=True)


def _intersect(
    origins: np.ndarray, directions: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric coordinates and distance of a ray in each triangle's plane (Moeller, Trumbore).

    With edges e1, e2 from corner a, o + t d = a + u e1 + v e2; not finite for a parallel ray.
    """
    a = triangles[:, 0]
    e1, e2 = triangles[:, 1] - a, triangles[:, 2] - a
    from_a = origins - a
    p, q = np.cross(directions, e2), np.cross(from_a, e1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = 1 / np.einsum("ri,ri->r", e1, p)
        u = np.einsum("ri,ri->r", from_a, p) * inverse
        v = np.einsum("ri,ri->r", np.broadcast_to(directions, q.shape), q) * inverse
        distance = np.einsum("ri,ri->r", e2, q) * inverse
        return np.stack([1 - u - v, u, v], axis=-1), distance


def _advance_to_unit_sphere(
    origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether rays reach the unit sphere, which holds the unit box, and where they enter it."""
    along = -np.einsum("ri,ri->r", origins, directions)
    closest = origins + along[:, None] * directions
    half_chord = np.sqrt(np.maximum(1 - np.einsum("ri,ri->r", closest, closest), 0))
    reaches = (half_chord > 0) & (along + half_chord > 0)
    entry = np.maximum(along - half_chord, 0)
    return reaches, origins + entry[:, None] * directions
