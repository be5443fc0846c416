"""Texel sites: which place of a texture each pixel shows.

- Texels are numbered from the top left; v points upwards; beyond the unit square images repeat,
  and its own far edges belong to the last texel.
- The centre of a texel falls into it, and has all of its own bilinear splat.
- A splat is a partition of unity whose mean place is the point itself, and goes round if asked.
- A sphere's texels are those of the latitude-longitude grid of the harmonics.
- A mesh's coordinates are interpolated; without any, sites are the nearest vertices.
- Neighbours share an edge, each pair once; unused sites have none.
"""

import numpy as np
import pytest

from jaxrender.geometry import Mesh, Orthographic, Sphere, look_at, observe
from jaxrender.geometry.texels import (
    mesh_coordinates,
    neighbouring_texels,
    neighbouring_vertices,
    sphere_coordinates,
    splat,
    surface_sites,
    texel_coordinates,
    texel_sites,
    vertex_sites,
)
from jaxrender.harmonics import LatLongGrid

IMAGE = (5, 8)


def test_texels_are_numbered_from_the_top_left():
    corners = np.array([[0.01, 0.99], [0.99, 0.99], [0.01, 0.01], [0.99, 0.01]])
    assert texel_sites(corners, IMAGE).tolist() == [0, 7, 32, 39]


def test_beyond_the_square_the_image_repeats_but_its_far_edges_are_its_own():
    inside = np.array([[0.3, 0.4]])
    for shift in ([1, 0], [0, -1], [-3, 2]):
        assert texel_sites(inside + np.array(shift), IMAGE) == texel_sites(inside, IMAGE)
    edges = np.array([[1.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    assert texel_sites(edges, IMAGE).tolist() == [7, 32, 39]


def test_a_texel_holds_its_own_centre():
    centres = texel_coordinates(IMAGE)
    sites = np.arange(len(centres))
    np.testing.assert_array_equal(texel_sites(centres, IMAGE), sites)
    found = splat(centres, IMAGE)
    whole = np.take_along_axis(found.site, np.argmax(found.share, axis=1)[:, None], axis=1)
    np.testing.assert_array_equal(whole[:, 0], sites)
    np.testing.assert_allclose(found.share.max(axis=1), 1, atol=1e-12)


def test_a_splat_is_a_partition_of_unity_about_its_point():
    points = np.random.default_rng(0).uniform(0.15, 0.85, (50, 2))
    found = splat(points, IMAGE)
    np.testing.assert_allclose(found.share.sum(axis=1), 1, atol=1e-12)
    assert found.share.min() >= 0
    mean = np.einsum("sk,ski->si", found.share, texel_coordinates(IMAGE)[found.site])
    np.testing.assert_allclose(mean, points, atol=1e-12)


def test_a_splat_goes_round_the_seam_if_asked():
    at_seam = np.array([[0.0, 0.5]])
    around = splat(at_seam, IMAGE, wrap=True)
    assert set((around.site % 8).ravel()) == {7, 0}
    assert set((splat(at_seam, IMAGE).site % 8).ravel()) == {0}


def test_a_sphere_has_the_texels_of_the_latitude_longitude_grid():
    grid = LatLongGrid(*IMAGE)
    coordinates = sphere_coordinates(grid.directions().reshape(-1, 3))
    np.testing.assert_allclose(coordinates, texel_coordinates(IMAGE), atol=1e-12)


def test_the_sites_of_a_moved_sphere_follow_its_own_directions():
    sphere = Sphere(np.array([3.0, -1.0, 2.0]), 0.5)
    pose = look_at(sphere.center + np.array([2.0, 1.0, 1.0]), sphere.center, np.array([0, 0, 1.0]))
    view = observe(Orthographic(20, 20, pose, scale=0.06), sphere)
    sites = surface_sites(sphere, view, IMAGE)
    assert (sites.of_pixel == -1).sum() == (~view.hit).sum() > 0
    expected = texel_sites(sphere_coordinates(view.normals[view.hit]), IMAGE)
    np.testing.assert_array_equal(sites.of_pixel[view.hit], expected)
    assert sites.count == 40
    assert "8 x 5" in sites.sentence


def square(textured=True):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(vertices, faces, None, vertices[faces][..., :2] if textured else None)


def test_coordinates_of_a_mesh_are_interpolated():
    mesh = square()
    pose = look_at(np.array([0.5, 0.5, 2.0]), np.array([0.5, 0.5, 0.0]), np.array([0, 1.0, 0]))
    view = observe(Orthographic(16, 10, pose, scale=0.0625), mesh)
    face, weights = view.face[view.hit], view.barycentric[view.hit]
    np.testing.assert_allclose(
        mesh_coordinates(mesh, face, weights), view.points[view.hit][:, :2], atol=1e-9
    )
    # The camera looks straight at it, image up is v up: sites go as pixels do.
    sites = surface_sites(mesh, view, (10, 16))
    np.testing.assert_array_equal(sites.of_pixel.ravel(), texel_sites(_pixels(view), (10, 16)))


def _pixels(view):
    return view.points.reshape(-1, 3)[:, :2]


def test_without_coordinates_sites_are_the_nearest_vertices_and_it_says_so():
    mesh = square(textured=False)
    weights = np.array([[0.6, 0.3, 0.1], [0.1, 0.2, 0.7]])
    assert vertex_sites(mesh, np.array([0, 1]), weights).tolist() == [0, 3]
    pose = look_at(np.array([0.5, 0.5, 2.0]), np.array([0.5, 0.5, 0.0]), np.array([0, 1.0, 0]))
    sites = surface_sites(mesh, observe(Orthographic(8, 8, pose, scale=0.1), mesh), IMAGE)
    assert sites.count == 4
    assert sites.image is None
    assert "no texture coordinates" in sites.sentence


def test_neighbours_share_an_edge():
    used = np.ones(6, bool)
    assert len(neighbouring_texels((2, 3), used)) == 2 * 2 + 3
    assert len(neighbouring_texels((2, 3), used, wrap=True)) == 2 * 3 + 3
    used[1] = False
    pairs = neighbouring_texels((2, 3), used)
    assert sorted(map(tuple, pairs)) == [(0, 3), (2, 5), (3, 4), (4, 5)]
    mesh = square()
    edges = neighbouring_vertices(mesh, np.ones(4, bool))
    assert sorted(map(tuple, edges)) == [(0, 1), (0, 2), (0, 3), (1, 2), (2, 3)]
    assert 0 not in neighbouring_vertices(mesh, np.array([False, True, True, True]))


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="no texture coordinates"):
        mesh_coordinates(square(textured=False), np.array([0]), np.ones((1, 3)) / 3)
    with pytest.raises(ValueError, match="no face"):
        vertex_sites(square(), np.array([-1]), np.ones((1, 3)) / 3)
    with pytest.raises(ValueError, match="0 x 3 texels"):
        texel_coordinates((3, 0))
