"""Charts of a mesh without texture coordinates.

- Nothing of the mesh changes but its coordinates, which lie inside the image; no two faces share a
  texel's centre, and charts keep their distance, whatever lies over itself.
- Areas in the image are those of the surface, within what one axis foreshortens.
- One face, vertices that are not joined, and flat faces are laid out; too many pieces are not.
"""

import numpy as np
import pytest

from jaxrender.geometry import Mesh
from jaxrender.geometry.texels import covering_faces
from jaxrender.geometry.unwrapping import unwrapped


def spiral():
    """A ramp that winds twice about the z axis: one patch that lies over itself."""
    turn = np.linspace(0, 4 * np.pi, 61)
    inner, outer = (
        np.stack([r * np.cos(turn), r * np.sin(turn), 0.1 * turn], axis=1) for r in (1.0, 2.0)
    )
    k = np.arange(60)
    faces = np.stack([k, k + 61, k + 1], axis=1), np.stack([k + 1, k + 61, k + 62], axis=1)
    return Mesh(np.concatenate([inner, outer]), np.concatenate(faces))


def scattered():
    """Triangles that share no vertex, though they touch, and one of no area."""
    ball = Mesh.icosphere(2)
    vertices = ball.vertices[ball.faces].reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return Mesh(vertices, np.concatenate([faces, [[0, 0, 1]]]))


def crumpled():
    """Faces that look another way than their neighbours."""
    ball = Mesh.icosphere(2)
    radii = np.random.default_rng(0).uniform(0.3, 1, (len(ball.vertices), 1))
    return Mesh(radii * ball.vertices, ball.faces)


def one_face():
    return Mesh(np.array([[0.0, 0, 0], [3e-4, 0, 0], [0, 3e-4, 0]]), np.array([[0, 1, 2]]))


MESHES = {
    "ball": Mesh.icosphere(3),
    "spiral": spiral(),
    "pieces": scattered(),
    "crumpled": crumpled(),
    "one face": one_face(),
}


@pytest.mark.parametrize("name", MESHES)
def test_faces_lie_side_by_side(name):
    mesh = MESHES[name]
    laid = unwrapped(mesh, 300)
    for part in ("vertices", "faces"):
        np.testing.assert_array_equal(getattr(laid.mesh, part), getattr(mesh, part))
    np.testing.assert_allclose(laid.mesh.normals, mesh.normals, atol=1e-15)
    assert max(laid.image) <= 300
    rows, columns = laid.image
    margin = np.array([2 / columns, 2 / rows]) - 1e-9
    coordinates = laid.mesh.texture_coordinates
    assert (coordinates >= margin).all()
    assert (coordinates <= 1 - margin).all()
    covering = covering_faces(laid.mesh, laid.image)
    inside = covering.weights.min(axis=1) > 1e-6
    assert len(np.unique(covering.texel[inside])) == inside.sum() > 20


@pytest.mark.parametrize("name", MESHES)
def test_areas_are_those_of_the_surface(name):
    laid = unwrapped(MESHES[name], 300)
    mesh, (rows, columns) = laid.mesh, laid.image
    corner, flat = mesh.vertices[mesh.faces], mesh.texture_coordinates * [columns, rows]
    edges = corner - np.roll(corner, 1, axis=1)
    scale = (laid.density / np.linalg.norm(edges, axis=-1).mean()) ** 2
    own = scale * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)
    drawn = np.linalg.det(np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=1))
    # Not mirrored, and never less than a fifth.
    assert (drawn / own > 0.2 - 1e-9).all()
    assert (drawn / own < 1 + 1e-9).all()


def test_what_lies_over_itself_is_taken_apart():
    assert unwrapped(MESHES["spiral"], 300).charts >= 2
    assert unwrapped(MESHES["ball"], 300).charts == 6
    # Vertices at one place are one.
    assert unwrapped(MESHES["pieces"], 300).charts == 6


def test_too_many_pieces_have_no_room():
    at = 3.0 * np.arange(100)[:, None, None] + np.eye(3)
    apart = Mesh(at.reshape(-1, 3), np.arange(300).reshape(-1, 3))
    assert unwrapped(apart, 100).charts == 100
    with pytest.raises(ValueError, match="100 charts have no room in 40 x 40 texels"):
        unwrapped(apart, 40)
