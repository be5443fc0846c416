"""The rim of a mesh: points of edges between a face that a camera sees and one that it does not.

The outline of a polyhedron consists of such edges.  When the mesh moves a little, its outline moves
as these points do, to first order: others take their place, but along the outline.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from jaxrender.geometry import Camera, Mesh, Orthographic, Placement
from jaxrender.inverse.conventions.silhouettes import covered
from jaxrender.shapes import Bool, Float, Int

# Rim points farther than this many pixels from the traced outline are inside it.
_ON_OUTLINE = 1.2
# So many points of a camera's rim are kept.
_MOST = 250


class Rim(NamedTuple):
    """Points of a mesh's file on its outline, and how far inside the traced outline they are."""

    points: Float[np.ndarray, "point 3"]
    inside: Float[np.ndarray, "point"]


class Edges(NamedTuple):
    """The edges of a mesh with two faces each; vertices at one place are one."""

    vertices: Float[np.ndarray, "vertex 3"]
    ends: Int[np.ndarray, "edge 2"]
    faces: Int[np.ndarray, "edge 2"]
    normals: Float[np.ndarray, "face 3"]
    corners: Float[np.ndarray, "face 3"]

    @classmethod
    def of(cls, mesh: Mesh) -> "Edges":
        """Find the edges that two faces share; those of holes are left out."""
        vertices, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
        faces = place.reshape(-1)[mesh.faces]
        sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]))
        owner = np.tile(np.arange(len(faces)), 3)
        order = np.lexsort(sides.T)
        sides, owner = sides[order], owner[order]
        pair = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1))
        both = np.stack([owner[pair], owner[pair + 1]], axis=1)
        return cls(vertices, sides[pair], both, mesh.face_normals(), vertices[faces[:, 0]])

    def rim(
        self, camera: Camera, placement: Placement, outline: Float[np.ndarray, "row column"]
    ) -> Rim:
        """List points of the file that make the outline; ``outline`` is its signed distance."""
        back = placement.inverse
        towards = back.points(camera.position[None])[0] - self.corners
        if isinstance(camera, Orthographic):
            towards = np.broadcast_to(
                camera.world_from_camera[:3, 2] @ placement.rotation, towards.shape
            )
        front = np.einsum("fi,fi->f", towards, self.normals) > 0
        edges = np.flatnonzero(front[self.faces[:, 0]] != front[self.faces[:, 1]])
        points = self.vertices[self.ends[edges]].mean(axis=1)
        inside = looked_up(outline, camera.project(placement.points(points)))
        kept = np.flatnonzero(np.abs(inside) < _ON_OUTLINE)
        kept = kept[:: max(1, -(-len(kept) // _MOST))]
        return Rim(points[kept], inside[kept])


def signed_distance(mask: Bool[np.ndarray, "row column"]) -> Float[np.ndarray, "row column"]:
    """How far each pixel's centre is inside the outline of a mask, in pixels; negative outside.

    Beyond the picture nothing is known: a mask that its border cuts has no outline there.
    """
    inside = np.asarray(distance_transform_edt(mask))
    outside = np.asarray(distance_transform_edt(~mask))
    return np.where(mask, inside - 0.5, 0.5 - outside)


def looked_up(
    image: Float[np.ndarray, "row column"], places: Float[np.ndarray, "point 2"]
) -> Float[np.ndarray, "point"]:
    """Interpolate an image at places (x, y) in pixels; beyond it, at its border and farther.

    Places that are not in front of the camera are as far as the picture is wide.
    """
    rows, columns = image.shape
    ahead = np.asarray(np.isfinite(places).all(axis=1))
    at = np.where(ahead[:, None], places, 0) - 0.5
    inside = np.clip(at, 0, [columns - 1, rows - 1])
    values = map_coordinates(image, inside[:, ::-1].T, order=1)
    beyond = np.minimum(np.linalg.norm(at - inside, axis=1), columns)
    return np.where(ahead, values - beyond, -float(columns))


def traced_outline(camera: Camera, mesh: Mesh, placement: Placement) -> np.ndarray:
    """Trace a placed mesh, and give the signed distance from its outline."""
    return signed_distance(covered(camera, mesh, placement))
