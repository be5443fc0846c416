"""Triangulated spheres: the vertices and faces that ``Mesh``'s constructors start from."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


class Tessellation(NamedTuple):
    """Triangles of the unit sphere: their corners, and three corners for each face."""

    vertices: Float[np.ndarray, "vertex 3"]
    faces: Int[np.ndarray, "face 3"]


def icosphere(subdivisions: int) -> Tessellation:
    """An icosahedron on the unit sphere, each triangle split into four ``subdivisions`` times.

    It has 20 * 4^subdivisions faces, wound so that they face outwards.
    """
    if subdivisions < 0:
        raise ValueError(f"subdivisions is {subdivisions}: give 0 (an icosahedron) or more")
    sphere = _icosahedron()
    for _ in range(subdivisions):
        sphere = _split_in_four(*sphere)
    return sphere


def _icosahedron() -> Tessellation:
    """Poles, two rings of five, and the triangles between them."""
    azimuth = 2 * np.pi * np.arange(5) / 5
    rings = []
    for height, turn in ((1 / np.sqrt(5), 0.0), (-1 / np.sqrt(5), np.pi / 5)):
        radius = np.sqrt(1 - height**2)
        x, y = radius * np.cos(azimuth + turn), radius * np.sin(azimuth + turn)
        rings.append(np.stack([x, y, np.full(5, height)], axis=-1))
    vertices = np.concatenate([[[0, 0, 1]], *rings, [[0, 0, -1]]])

    here, following = np.arange(5), (np.arange(5) + 1) % 5
    north, south = np.zeros(5, int), np.full(5, 11)
    upper, lower = 1 + here, 6 + here
    faces = [
        [north, upper, 1 + following],
        [upper, lower, 1 + following],
        [lower, 6 + following, 1 + following],
        [south, 6 + following, lower],
    ]
    return Tessellation(vertices, np.concatenate([np.stack(corners, axis=-1) for corners in faces]))


def _split_in_four(vertices: np.ndarray, faces: np.ndarray) -> Tessellation:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, edge_of = np.unique(edges, axis=0, return_inverse=True)
    middles = vertices[unique].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    a, b, c = faces.T
    ab, bc, ca = len(vertices) + edge_of.reshape(3, -1)
    quarters = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    split = np.concatenate([np.stack(corners, axis=-1) for corners in quarters])
    return Tessellation(np.concatenate([vertices, middles]), split)
