"""A texture of vertices as one of texels: what other programs and pages take.

The mesh gets texture coordinates (``geometry.unwrapping``), and every texel what its place has:
the values of the nearest corner of its face.  Texels outside of charts continue the nearest face,
so that lookups between texels do not mix charts.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.geometry.texels import (
    covering_faces,
    mesh_coordinates,
    splat,
    texel_sites,
    vertex_sites,
    weights_in_faces,
)
from jaxrender.geometry.unwrapping import unwrapped
from jaxrender.io.exports.contents import MaterialMaps, MetallicMaps
from jaxrender.shapes import Float, Int

# The most rows or columns of an image for other programs.
MOST_TEXELS = 2048
_PLACES, _SEED = 40_000, 0


class Atlas(NamedTuple):
    """A mesh with texture coordinates, and the vertex whose values each texel has.

    ``density`` is the number of texels to the mean edge of a face, ``charts`` how many there are.
    """

    mesh: Mesh
    vertex: Int[np.ndarray, "row column"]
    density: float
    charts: int

    @classmethod
    def of(cls, mesh: Mesh, most: int = MOST_TEXELS) -> "Atlas":
        """Lay a mesh out in an image of at most so many rows or columns.

        Raises ``InputError`` for a mesh of too many pieces.
        """
        try:
            laid = unwrapped(mesh, most)
        except ValueError as error:
            raise InputError(
                f"the texture of vertices cannot be laid out in an image: {error}; simplify the "
                "mesh and fit again"
            ) from None
        face = _face_of_texel(laid.mesh, laid.image)
        weights = np.nan_to_num(weights_in_faces(laid.mesh, laid.image, face))
        nearest = np.argmax(weights, axis=-1)
        return cls(laid.mesh, mesh.faces[face, nearest], laid.density, laid.charts)

    def baked(
        self, values: Float[np.ndarray, "vertex *quantity"]
    ) -> Float[np.ndarray, "row column *quantity"]:
        """Give every texel what its vertex has."""
        return values[self.vertex]

    def baked_maps(self, maps: MaterialMaps | MetallicMaps) -> MaterialMaps | MetallicMaps:
        """Make a texture of vertices one of texels; the mean stays that of the vertices."""
        of_vertices = {
            name: values
            for name, values in maps._asdict().items()
            if name != "mean" and values is not None
        }
        return maps._replace(**{name: self.baked(one) for name, one in of_vertices.items()})

    def apart(self, values: Float[np.ndarray, "vertex channel"]) -> float:
        """How far a lookup between four texels is from the value of the nearest vertex.

        The mean absolute difference at random places of the surface, over the mean.
        """
        mesh, random = self.mesh, np.random.default_rng(_SEED)
        first, second = (
            mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)
        )
        area = np.linalg.norm(np.cross(first, second), axis=1)
        face = random.choice(len(area), _PLACES, p=area / area.sum())
        weights = random.dirichlet(np.ones(3), _PLACES)
        exact = values[vertex_sites(mesh, face, weights)]
        about = splat(mesh_coordinates(mesh, face, weights), self.vertex.shape)
        corners = values[self.vertex.ravel()[about.site]]
        found = np.einsum("sk,skc->sc", about.share, corners)
        return float(np.abs(found - exact).mean() / max(np.abs(exact).mean(), np.finfo(float).tiny))


def _face_of_texel(mesh: Mesh, image: tuple[int, int]) -> Int[np.ndarray, "row column"]:
    """Find the face of every texel: that over its centre, one that has no other, or the nearest."""
    found = np.full(image, -1)
    covering = covering_faces(mesh, image)
    found.flat[covering.texel] = covering.face
    assert mesh.texture_coordinates is not None
    uncovered = np.setdiff1d(np.arange(len(mesh.faces)), covering.face)
    texel = texel_sites(mesh.texture_coordinates[uncovered].mean(axis=1), image)
    free = found.flat[texel] < 0
    found.flat[texel[free]] = uncovered[free]
    nearest = distance_transform_edt(found < 0, return_distances=False, return_indices=True)
    row, column = np.asarray(nearest)
    return found[row, column]
