"""What is wrong with a mesh: holes, several parts, faces that were left out."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxrender.geometry import Mesh, Shape


def about_mesh(shape: Shape) -> list[str]:
    """Say what is unusual about a shape; nothing about a ball."""
    if not isinstance(shape, Mesh):
        return []
    found = []
    parts = part_count(shape)
    if parts > 1:
        found.append(
            f"the mesh is {parts} parts that do not touch; keep the photographed one if the "
            "others are not in the photographs"
        )
    if not shape.is_closed():
        found.append(
            "the mesh has holes: light that comes in through them is taken for real, and pixels "
            "that see a back are left out"
        )
    if shape.dropped_faces:
        found.append(f"{shape.dropped_faces} faces of the mesh were flat or repeated; left out")
    return found


def part_count(mesh: Mesh) -> int:
    """Count parts whose faces share no vertex; vertices at one place are one."""
    _, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[mesh.faces]
    edges = np.concatenate([corners[:, :2], corners[:, 1:]])
    count = int(place.max()) + 1
    graph = coo_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    return len(np.unique(labels[corners[:, 0]]))
