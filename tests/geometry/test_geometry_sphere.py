"""The exact sphere.

Pinned down: hits lie on the sphere and on the ray, nearest first, with outward unit normals, from
outside, inside, behind, touching, and from very far away; misses are zero with infinite distance; a
fine mesh agrees; what is refused.
"""

import numpy as np
import pytest

from jaxrender.geometry import Mesh, Sphere

ROUNDING = 1e-12
SPHERE = Sphere(np.array([1.0, -2.0, 0.5]), 0.7)


def rays_towards(sphere, count, spread, seed):
    rng = np.random.default_rng(seed)
    origins = sphere.center + 4 * sphere.radius * rng.normal(size=(count, 3))
    origins = origins[np.linalg.norm(origins - sphere.center, axis=1) > 1.1 * sphere.radius]
    targets = sphere.center + spread * sphere.radius * rng.uniform(-1, 1, origins.shape)
    return origins, targets - origins


def test_hits_lie_on_the_ray_and_the_sphere_at_the_nearer_root():
    origins, directions = rays_towards(SPHERE, 500, 0.5, seed=0)
    hits = SPHERE.first_hits(origins, directions)
    assert hits.hit.all()
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(origins + hits.distance[:, None] * unit, hits.points, atol=ROUNDING)
    radius = np.linalg.norm(hits.points - SPHERE.center, axis=1)
    np.testing.assert_allclose(radius, SPHERE.radius, atol=ROUNDING)
    outward = (hits.points - SPHERE.center) / SPHERE.radius
    np.testing.assert_allclose(hits.normals, outward, atol=ROUNDING)
    np.testing.assert_array_equal(hits.normals, hits.geometric_normals)
    assert np.all(np.einsum("ri,ri->r", hits.normals, unit) < 0)


def test_known_distances_from_outside_inside_behind_and_beside():
    sphere = Sphere(radius=2.0)
    origins = np.array([[0.0, 0, 5], [0, 0, 1], [0, 0, 5], [2.5, 0, 5]])
    directions = np.array([[0.0, 0, -3], [0, 0, 1], [0, 0, 1], [0, 0, -1]])
    hits = sphere.first_hits(origins, directions)
    np.testing.assert_array_equal(hits.hit, [True, True, False, False])
    np.testing.assert_allclose(hits.distance, [3, 1, np.inf, np.inf])
    for rows in (hits.points, hits.normals, hits.geometric_normals):
        np.testing.assert_array_equal(rows[2:], 0)


def test_rays_from_the_surface_do_not_hit_it_where_they_start():
    normals = rays_towards(Sphere(), 200, 0, seed=1)[0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert not Sphere().first_hits(normals, normals).hit.any()
    np.testing.assert_allclose(Sphere().first_hits(normals, -normals).distance, 2)


def test_a_distant_origin_costs_no_digits():
    # The textbook discriminant b^2 - c loses all of them at 1e9 radii.
    sphere = Sphere(radius=1e-3)
    origins = np.array([[0.6e-3, 0, 1e6], [0.9999999e-3, 0, 1e6], [1.0000001e-3, 0, 1e6]])
    hits = sphere.first_hits(origins, np.broadcast_to([0.0, 0, -1], (3, 3)))
    np.testing.assert_array_equal(hits.hit, [True, True, False])
    np.testing.assert_allclose(hits.points[0], [0.6e-3, 0, 0.8e-3], rtol=1e-6)


def test_agrees_with_a_fine_mesh():
    mesh = Mesh.icosphere(5, SPHERE.radius, SPHERE.center)
    origins, directions = rays_towards(SPHERE, 500, 0.5, seed=2)
    exact, faceted = SPHERE.first_hits(origins, directions), mesh.first_hits(origins, directions)
    chord = 3e-4  # sagitta of a facet seen under 50 degrees or less
    np.testing.assert_allclose(faceted.distance, exact.distance, atol=chord)
    np.testing.assert_allclose(faceted.normals, exact.normals, atol=1e-3)


def test_bounds_and_convexity():
    np.testing.assert_allclose(SPHERE.bounds(), [[0.3, -2.7, -0.2], [1.7, -1.3, 1.2]])
    np.testing.assert_allclose(SPHERE.diagonal(), 1.4 * np.sqrt(3))
    assert SPHERE.is_convex()


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan])
def test_bad_radii_are_refused(radius):
    with pytest.raises(ValueError, match="positive, finite length"):
        Sphere(radius=radius)


def test_a_bad_centre_is_refused():
    with pytest.raises(ValueError, match="three finite numbers"):
        Sphere(np.array([0, np.inf, 0]))


@pytest.mark.parametrize("bad", [[0.0, 0, 0], [np.nan, 0, 1]])
def test_bad_directions_are_refused_with_their_ray(bad):
    directions = np.array([[0.0, 0, 1], bad])
    with pytest.raises(ValueError, match="ray 1 has origin"):
        Sphere().first_hits(np.zeros((2, 3)), directions)
