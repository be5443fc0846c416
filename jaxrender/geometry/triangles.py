"""A ray and a triangle in float64, and the brute-force twins that try every pair of them.

Faces are answered by number, -1 for a miss, with barycentric coordinates.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

# Slack of the brute-force test at a triangle's edges, so that neighbours leave no gap.
_EDGE_SLACK = 1e-12


class FaceHits(NamedTuple):
    """Which face each ray meets first, -1 for none, and the weights of its three corners there."""

    face: Int[np.ndarray, "ray"]
    barycentric: Float[np.ndarray, "ray 3"]


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


def brute_force_occluded(
    origins: Float[np.ndarray, "ray 3"],
    directions: Float[np.ndarray, "ray 3"],
    triangles: Float[np.ndarray, "face 3 3"],
) -> Bool[np.ndarray, "ray"]:
    """Whether each ray meets any triangle, in float64: for tests and small meshes only.

    Triangle by triangle: a ray crosses one if it passes its three edges on the same side, and meets
    its plane in front.
    """
    blocked = np.zeros(len(origins), bool)
    for a, b, c in triangles:
        normal = np.cross(b - a, c - a)
        slack = _EDGE_SLACK * np.sqrt(normal @ normal)
        corners = a - origins, b - origins, c - origins
        sides = [
            np.einsum("ri,ri->r", directions, np.cross(corners[k], corners[(k + 1) % 3]))
            for k in range(3)
        ]
        same = (np.min(sides, axis=0) >= -slack) | (np.max(sides, axis=0) <= slack)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = corners[0] @ normal / (directions @ normal)
        blocked |= same & (distance > 0) & np.isfinite(distance)
    return blocked


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
