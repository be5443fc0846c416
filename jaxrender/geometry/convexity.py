"""Whether a mesh is closed, and whether it casts no shadow on itself.  Host side, float64."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull, QhullError
from trimesh.geometry import faces_to_edges
from trimesh.graph import is_watertight

# Volume that the convex hull may add to a convex mesh: rounding only.
_HULL_SLACK = 1e-9
# Faces that every corner must lie behind before the hull is built at all, and by how much (volume
# of the tetrahedron in front of the face, mesh in a unit box) it may fail to.
_WITNESSES = 64
# How far corners of a flat sheet may lie from its plane, in a unit box.
_SHEET_SLACK = 1e-9
_WITNESS_SLACK = 1e-6


def is_closed(vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]) -> bool:
    """Whether every edge is used once in either direction (vertices at one place are one)."""
    _, merged = np.unique(vertices, axis=0, return_inverse=True)
    return all(is_watertight(faces_to_edges(merged[faces])))


def is_convex(vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]) -> bool:
    """Whether no part of the mesh hides another from its front.

    A closed mesh is convex if it fills its convex hull, and so is a flat sheet with one front.
    """
    triangles = vertices[faces]
    lower, upper = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    boxed = (triangles - (lower + upper) / 2) / (upper - lower).max()
    if _is_sheet(boxed):
        return True
    # The cheap question first.
    if not _behind_largest_faces(boxed) or not is_closed(vertices, faces):
        return False
    volume = np.linalg.det(boxed).sum() / 6
    try:
        hull = ConvexHull(boxed.reshape(-1, 3)).volume
    except QhullError:  # closed and flat: a sheet with two sides
        return False
    return bool(volume >= (1 - _HULL_SLACK) * hull)


def _is_sheet(triangles: Float[np.ndarray, "face 3 3"]) -> bool:
    """Whether all faces lie in one plane and have their fronts on the same side."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    up = normals[np.argmax(areas)] / max(areas.max(), np.finfo(float).tiny)
    heights = triangles.reshape(-1, 3) @ up
    return bool(np.ptp(heights) < _SHEET_SLACK and np.all(normals @ up >= -_SHEET_SLACK))


def _behind_largest_faces(triangles: Float[np.ndarray, "face 3 3"]) -> bool:
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    largest = np.argsort(np.einsum("fi,fi->f", normals, normals))[-_WITNESSES:]
    normals = normals[largest]
    offsets = np.einsum("fi,fi->f", normals, triangles[largest, 0])
    height = (triangles.reshape(-1, 3) @ normals.T).max(axis=0) - offsets
    return bool((height < 6 * _WITNESS_SLACK).all())
