"""The procedural sculpture.

Pinned down: closed, concave, star-shaped about its centre; its normals are those of finite
differences of its radius and of its own faces; at a third of its vertices and more a tenth of the
hemisphere is hidden; texture coordinates are latitude and longitude on every face, seam and poles
included; seeds, size and place.
"""

import numpy as np
import pytest

from jaxrender.geometry import Mesh, SurfacePlaces, fibonacci_sphere, sculpture, visible
from jaxrender.geometry.sculpture import Features, unwrapped
from jaxrender.geometry.tessellation import icosphere

FINE = sculpture(4)


def test_it_is_closed_concave_and_star_shaped():
    assert FINE.is_closed()
    assert not FINE.is_convex()
    assert FINE.dropped_faces == 0
    corners = FINE.vertices[FINE.faces]
    # Every face is seen from the centre, from behind.
    assert np.all(np.linalg.det(corners) > 0)
    radius = np.linalg.norm(FINE.vertices, axis=1)
    assert 0.3 < radius.min() < 0.65
    assert 1.3 < radius.max() < 1.8


def test_normals_are_those_of_the_surface():
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    features = Features.drawn(3)

    def points(moved):
        unit = moved / np.linalg.norm(moved, axis=1, keepdims=True)
        return features.radius(unit)[:, None] * unit

    # Truncation 1e-10 / .3^2, rounding 1e-11.
    step = 1e-5
    first = np.cross(directions, rng.normal(size=3))
    second = np.cross(directions, first)
    tangents = [
        points(directions + step * t) - points(directions - step * t) for t in (first, second)
    ]
    expected = np.cross(*tangents)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(features.normals(directions), expected, atol=1e-8)


def test_shading_normals_follow_the_faces():
    fine = sculpture(5)
    about = SurfacePlaces.of_vertices(fine).geometric_normals
    cosines = np.einsum("vi,vi->v", about, fine.normals)
    assert np.degrees(np.arccos(np.minimum(cosines, 1))).max() < 2.5


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_shadows_itself(seed):
    places = SurfacePlaces.of_vertices(sculpture(3, seed))
    directions = fibonacci_sphere(500)
    above = places.geometric_normals @ directions.T > 0
    hidden = 1 - visible(sculpture(3, seed), places, directions).sum(axis=1) / above.sum(axis=1)
    assert np.mean(hidden > 0.1) > 1 / 3
    assert hidden.max() > 0.4


def test_texture_coordinates_are_latitude_and_longitude():
    assert FINE.texture_coordinates is not None
    u, v = FINE.texture_coordinates.reshape(-1, 2).T
    corners = FINE.vertices[FINE.faces].reshape(-1, 3)
    directions = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    np.testing.assert_allclose(np.cos(np.pi * (1 - v)), directions[:, 2], atol=1e-12)
    off_pole = np.abs(directions[:, 2]) < 1 - 1e-9
    around = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u)], axis=-1)
    equator = directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1, keepdims=True).clip(
        1e-9
    )
    np.testing.assert_allclose(around[off_pole], equator[off_pole], atol=1e-9)
    on_faces = FINE.texture_coordinates
    # No face is smeared over the texture; those at the poles span a fifth of it.
    assert np.ptp(on_faces[..., 0], axis=1).max() < 0.25
    assert on_faces.min() >= 0
    assert on_faces[..., 1].max() <= 1
    assert 1 < on_faces[..., 0].max() < 1.25


def test_only_seam_and_poles_are_split():
    directions, faces = icosphere(3)
    split, split_faces, _ = unwrapped(directions, faces)
    np.testing.assert_array_equal(split[split_faces], directions[faces])
    extra = len(split) - len(directions)
    assert 0 < extra < 8 * 2**3


def test_seed_size_and_place():
    np.testing.assert_array_equal(sculpture(2, 5).vertices, sculpture(2, 5).vertices)
    assert np.abs(sculpture(2, 5).vertices - sculpture(2, 6).vertices).max() > 0.1
    center = np.array([1.0, 2, 3])
    moved = sculpture(2, 5, radius=2.0, center=center)
    np.testing.assert_allclose((moved.vertices - center) / 2, sculpture(2, 5).vertices, atol=1e-12)
    np.testing.assert_array_equal(moved.normals, sculpture(2, 5).normals)


def test_meshes_refuse_bad_texture_coordinates():
    with pytest.raises(ValueError, match="texture coordinate 1 is"):
        Mesh(np.eye(3), np.array([[0, 1, 2]]), None, np.array([[[0.0, 0], [np.nan, 0], [0, 1]]]))
