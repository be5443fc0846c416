"""A texture of vertices laid out in texels.

- A lookup between four texels gives a constant back, also at the borders of charts.  Of places it
  gives those within a texel, and the nearest vertex wherever its four texels have one.
- What is said to change is what a fine quadrature over the surface finds.
- Maps keep what unseen vertices are; what has no map gets none.
"""

import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.geometry.texels import mesh_coordinates, splat, vertex_sites
from jaxrender.io.exports import Atlas, MaterialMaps

BALL = Mesh.ellipsoid(np.array([1.0, 0.7, 0.5]), 3)
ATLAS = Atlas.of(BALL)


def places(mesh, count=5000):
    random = np.random.default_rng(1)
    corner = mesh.vertices[mesh.faces]
    area = np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    face = random.choice(len(area), count, p=area / area.sum())
    return face, random.dirichlet(np.ones(3), count)


def looked_up(atlas, image, face, weights):
    about = splat(mesh_coordinates(atlas.mesh, face, weights), atlas.vertex.shape)
    return np.einsum("sk,skc->sc", about.share, image.reshape(-1, image.shape[-1])[about.site])


def test_constants_and_places_come_back():
    face, weights = places(BALL)
    constant = ATLAS.baked(np.full((len(BALL.vertices), 2), 0.3))
    np.testing.assert_allclose(looked_up(ATLAS, constant, face, weights), 0.3, rtol=1e-12)
    # Of a linear function the nearest vertex has the value at most two thirds of an edge away.
    found = looked_up(ATLAS, ATLAS.baked(BALL.vertices), face, weights)
    exact = np.einsum("sk,ski->si", weights, BALL.vertices[BALL.faces[face]])
    edges = BALL.vertices[BALL.faces] - BALL.vertices[np.roll(BALL.faces, 1, axis=1)]
    longest = np.linalg.norm(edges, axis=-1).max()
    assert np.linalg.norm(found - exact, axis=1).max() < (2 / 3 + 1 / 4) * longest


def test_a_texel_has_the_nearest_vertex():
    face, weights = places(BALL)
    about = splat(mesh_coordinates(ATLAS.mesh, face, weights), ATLAS.vertex.shape)
    vertices = ATLAS.vertex.ravel()[about.site]
    alike = (vertices == vertices[:, :1]).all(axis=1)
    assert alike.mean() > 0.6
    wrong = vertices[alike, 0] != vertex_sites(BALL, face[alike], weights[alike])
    # Four texels about a narrow corner of another cell.
    assert wrong.mean() < 0.002


def test_what_changes_is_stated():
    # Half of the faces are many times as large as the others, and change less for their size.
    stretched = np.where(BALL.vertices > 0, 5, 1) * BALL.vertices
    mesh, random = Mesh(stretched, BALL.faces), np.random.default_rng(2)
    values = random.uniform(0.1, 1, (len(BALL.vertices), 3))
    atlas = Atlas.of(mesh)
    face, weights = places(mesh, 40_000)
    exact = values[vertex_sites(mesh, face, weights)]
    found = looked_up(atlas, atlas.baked(values), face, weights)
    own = np.abs(found - exact).mean() / exact.mean()
    assert atlas.apart(values) == pytest.approx(own, rel=0.05)
    coarse = Atlas.of(mesh, 100)
    assert coarse.density < atlas.density
    assert coarse.apart(values) > 1.5 * atlas.apart(values) > 0.01
    assert atlas.apart(np.zeros((len(values), 3))) == 0


def test_maps_keep_what_they_are():
    kd = np.ones((len(BALL.vertices), 3))
    kd[:50] = 0
    offset = np.where(kd > 0, BALL.vertices, np.nan)
    maps = MaterialMaps(Microfacet(np.ones(3), np.ones(3), 0.3, 1.5), kd, kd[:, 0], None, offset)
    baked = ATLAS.baked_maps(maps)
    assert not baked.of_vertices
    assert baked.sigma is None
    assert baked.mean is maps.mean
    np.testing.assert_array_equal(baked.seen, ATLAS.vertex >= 50)
    np.testing.assert_array_equal(baked.offset, offset[ATLAS.vertex])


def test_too_many_pieces_are_refused_in_words():
    at = 3.0 * np.arange(100)[:, None, None] + np.eye(3)
    apart = Mesh(at.reshape(-1, 3), np.arange(300).reshape(-1, 3))
    with pytest.raises(InputError, match=r"100 charts have no room.*simplify the mesh"):
        Atlas.of(apart, 40)
