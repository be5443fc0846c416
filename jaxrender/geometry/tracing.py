"""First triangle along a ray, or whether there is one, by Embree.

Embree works in float32 and finds only the face; the meeting point is then computed again in float64
on that face, from the ray as it was given.  ``triangles`` has the brute-force twins.
"""

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Complex, Float, Int

from jaxrender.geometry import convexity, packets
from jaxrender.geometry.triangles import FaceHits, clipped_barycentric

# Rays traced at once: enough to amortise a call, small enough for the cache.
_CHUNK = 16384
# Even Embree's robust mode leaks rays aimed exactly at a vertex, one in 300.  Moving the origins by
# this part of the mesh's size (sixteen float32 roundings) leaves one in 50,000, and _repair catches
# those.
_JITTER = 1e-6


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
        boxed = self._boxed()
        self._triangles = boxed[faces]
        self._face_normals = np.cross(
            self._triangles[:, 1] - self._triangles[:, 0],
            self._triangles[:, 2] - self._triangles[:, 0],
        )
        self._scene = _scene(boxed, faces, robust=True)
        # Threads that ask for a scene which is still to be made wait for the first of them.
        self._lock = threading.Lock()

    def __reduce__(self):
        return EmbreeTracer, self._arrays

    @cached_property
    def is_convex(self) -> bool:
        """Whether the mesh is convex: asked for often, and never changing."""
        return convexity.is_convex(*self._arrays)

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

        in_threads(trace, range(0, len(origins), _CHUNK))
        return FaceHits(face, barycentric)

    def occluded(
        self, origins: Float[np.ndarray, "ray 3"], directions: Float[np.ndarray, "ray 3"]
    ) -> Bool[np.ndarray, "ray"]:
        """Whether rays of unit direction meet any face; chunks run on all processors.

        No jitter and no repair: a ray that leaks in at a vertex of a closed mesh meets it again on
        its way out.
        """
        blocked = np.zeros(len(origins), bool)

        def trace(start: int) -> None:
            chunk = slice(start, start + _CHUNK)
            boxed = (origins[chunk] - self._center) / self._size
            towards = directions[chunk]
            if np.einsum("ri,ri->r", boxed, boxed).max() < 1:
                blocked[chunk] = self._any(boxed, towards)
                return
            reaches, entries = _advance_to_unit_sphere(boxed, towards)
            blocked[chunk][reaches] = self._any(entries[reaches], towards[reaches])

        in_threads(trace, range(0, len(origins), _CHUNK))
        return blocked

    def occluded_pairs(
        self,
        origins: Float[np.ndarray, "place 3"],
        directions: Float[np.ndarray, "direction 3"],
        asked: Bool[np.ndarray, "place direction"],
    ) -> Bool[np.ndarray, "place direction"]:
        """The same for pairs of places and unit directions, in this thread.

        Rays from within the mesh's box go to Embree in packets where it takes them, and all rays
        from afar one by one.
        """
        boxed = (origins - self._center) / self._size
        if (np.einsum("pi,pi->p", boxed, boxed) < 1).all():
            with self._lock:
                scene = self._packet_scene
            if scene is None:
                return self._pairs_one_by_one(boxed, directions, asked)
            return scene.occluded_pairs(boxed, directions, asked)
        blocked = np.zeros(asked.shape, bool)
        place, direction = np.nonzero(asked)
        blocked[asked] = self.occluded(origins[place], directions[direction])
        return blocked

    def _pairs_one_by_one(
        self, boxed: np.ndarray, directions: np.ndarray, asked: np.ndarray
    ) -> Bool[np.ndarray, "place direction"]:
        # What Embree is given is half of the work of asking it.  Each line is the quickest of
        # several ways: together they were a fifth of the whole time.
        count = np.count_nonzero(asked, axis=1)
        pair = np.flatnonzero(asked)
        direction = pair - np.repeat(np.arange(len(asked)) * asked.shape[1], count)
        starts = np.repeat(_as_words(boxed), count)
        towards = _as_words(directions).take(direction, mode="clip")
        blocked = np.zeros(asked.shape, bool)
        blocked.reshape(-1)[pair] = self._any(_of_words(starts), _of_words(towards))
        return blocked

    def _any(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        # embreex wants at least one ray; it answers 0 for a ray that is blocked, else -1.
        if not len(origins):
            return np.zeros(0, bool)
        single = (rays.astype(np.float32, copy=False) for rays in (origins, directions))
        with self._lock:
            scene = self._shadow_scene
        return scene.run(*single, query="OCCLUDED") >= 0

    @cached_property
    def _shadow_scene(self) -> EmbreeScene:
        """A tree without Embree's robust mode, a quarter quicker, made when it is first asked for.

        What leaks at an edge of a closed mesh is stopped by the next face.
        """
        return _scene(self._boxed(), self._arrays[1], robust=False)

    @cached_property
    def _packet_scene(self) -> packets.PacketScene | None:
        """The same for rays in packets; None where they are traced one by one."""
        if not packets.available():
            return None
        return packets.PacketScene(self._boxed(), self._arrays[1])

    def _boxed(self) -> Float[np.ndarray, "vertex 3"]:
        return (self._arrays[0] - self._center) / self._size

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


def _scene(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"], robust: bool
) -> EmbreeScene:
    """Give a mesh to Embree and have its tree built."""
    scene = EmbreeScene(robust=robust)
    TriangleMesh(scene, vertices.astype(np.float32), faces.astype(np.int32))
    # The first query builds the tree; it must not happen in two threads at once.
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
    return scene


def _as_words(vectors: Float[np.ndarray, "row 3"]) -> Complex[np.ndarray, "row"]:
    """Pack each vector into sixteen bytes, which NumPy copies as one: four times quicker."""
    padded = np.zeros((len(vectors), 4), np.float32)
    padded[:, :3] = vectors
    return padded.view(np.complex128).reshape(-1)


def _of_words(words: Complex[np.ndarray, "row"]) -> Float[np.ndarray, "row 3"]:
    return words.view(np.float32).reshape(-1, 4)[:, :3]


def in_threads(work: Callable[[int], None], items: Sequence[int]) -> None:
    """Do independent pieces of work, on all processors if there are several.

    Embree releases the interpreter's lock, and so do NumPy's loops.
    """
    if len(items) < 2:
        for item in items:
            work(item)
        return
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(work, items))


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
