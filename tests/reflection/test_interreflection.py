"""Bounced light against the closed form of a cavity: the inside of a sphere, whole or in part.

- Any point of a sphere's inside sees any other equally: of a bowl that is the part f of a sphere,
  the bounced irradiance is albedo f mean(E_total) everywhere, mean E_total = mean E_0 /
  (1 - albedo f), whatever E_0 looks like.
- Every channel has its own albedo; black reflects nothing; the outside of a ball sees none of it.
- Surfaces seen from behind bring nothing; an albedo above one is refused.
"""

import numpy as np
import pytest

from jaxrender.geometry import Mesh, SurfacePlaces
from jaxrender.reflection.interreflection import Interreflection, gathering

ALBEDO = np.array([0.8, 0.4, 0.0])
# On average; at a single vertex, above all at a rim, 1280 flat facets are no sphere.
ON_AVERAGE, AT_EACH = 0.01, 0.06


def bowl(lowest: float) -> Mesh:
    """The inside of the unit sphere below z = -lowest; all of it for -1."""
    ball = Mesh.icosphere(3)
    below = ball.vertices[ball.faces].mean(axis=1)[:, 2] < -lowest
    faces = ball.faces[below][:, ::-1]
    used, renamed = np.unique(faces, return_inverse=True)
    return Mesh(ball.vertices[used], renamed.reshape(-1, 3))


def area_weights(mesh: Mesh) -> np.ndarray:
    """A third of each face's area for each of its corners, as parts of the whole sphere."""
    corners = np.repeat(areas(mesh) / 3, 3) / areas(Mesh.icosphere(3)).sum()
    return np.bincount(mesh.faces.ravel(), corners, len(mesh.vertices))


def areas(mesh: Mesh) -> np.ndarray:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


@pytest.mark.parametrize("lowest", [0.0, 0.5, -1.0])
def test_a_cavity_has_the_closed_form(lowest):
    mesh = bowl(lowest)
    weights = area_weights(mesh)
    part = weights.sum()
    direct = (1 + 0.7 * mesh.vertices[:, 0] + mesh.vertices[:, 2] ** 2)[:, None] * [1.0, 2.0, 3.0]
    total = Interreflection.of(mesh).total(direct, ALBEDO)
    mean = weights @ direct / part
    bounced = ALBEDO * part * mean / (1 - ALBEDO * part)
    found = total - direct
    np.testing.assert_allclose(weights @ found / part, bounced, rtol=ON_AVERAGE)
    assert np.all(np.sqrt(np.mean((found - bounced) ** 2, axis=0)) <= AT_EACH * bounced)
    np.testing.assert_array_equal(total[:, 2], direct[:, 2])


def test_places_within_see_the_mean():
    mesh = bowl(0.0)
    part = area_weights(mesh).sum()
    face = np.arange(0, len(mesh.faces), 7)
    places = SurfacePlaces.on_faces(mesh, face, np.full((len(face), 3), 1 / 3))
    seen = gathering(mesh, places, places.geometric_normals, 256, 1) @ np.ones(len(mesh.vertices))
    np.testing.assert_allclose(seen, part, rtol=0.05)
    assert np.mean(seen) == pytest.approx(part, rel=0.01)


def test_the_outside_of_a_ball_gets_nothing():
    ball = Mesh.icosphere(2)
    direct = np.ones((len(ball.vertices), 3))
    np.testing.assert_array_equal(Interreflection.of(ball, 32).total(direct, ALBEDO), direct)


def test_a_surface_brings_nothing_from_behind():
    # A lid whose front faces away, over a floor.
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    floor, lid = [[0, 1, 2], [0, 2, 3]], [[4, 5, 6], [4, 6, 7]]
    vertices = np.concatenate([square, square + np.array([0, 0, 0.2])])
    away = Mesh(vertices, np.array(floor + lid))
    toward = Mesh(vertices, np.array(floor + [f[::-1] for f in lid]))
    middle = SurfacePlaces(np.zeros((1, 3)), np.array([[0.0, 0, 1]]))
    glow = np.repeat([0.0, 1.0], 4)
    seen = [
        float((gathering(mesh, middle, middle.geometric_normals, 256, 0) @ glow)[0])
        for mesh in (away, toward)
    ]
    assert seen[0] == 0
    # What the middle sees of a parallel square of half side 1 at distance .2 (form factors).
    x = 1 / np.hypot(1, 0.2)
    assert seen[1] == pytest.approx(4 / np.pi * x * np.arctan(x), rel=0.01)


def test_light_that_grows_is_refused():
    exchange = Interreflection.of(bowl(0.5), 8)
    with pytest.raises(ValueError, match="light grows with every bounce"):
        exchange.total(np.ones((len(exchange.mesh.vertices), 3)), np.array([0.5, 1.2, 0.1]))
    with pytest.raises(ValueError, match="at least one"):
        Interreflection.of(exchange.mesh, 0)
