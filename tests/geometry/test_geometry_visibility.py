"""What a surface sees.

Pinned down: Embree's any-hit query equals the brute-force twin on 20,000 random rays from
outside, inside and afar, and the first hits; spheres answer exactly; pairs are their rays;
``visible`` is the brute-force loop over pairs; its laws on a bowl and in a notch whose visibility
is known; convex shapes are not traced; no ray is blocked by the face it starts on; places of
views, vertices and faces agree; the directions are even, the rotations uniform.
"""

import numpy as np
import pytest
import trimesh

from jaxrender.geometry import (
    Mesh,
    Orthographic,
    Sphere,
    SurfacePlaces,
    fibonacci_sphere,
    look_at,
    observe,
    packets,
    random_rotations,
    visibility,
    visible,
    visible_along,
)

ROUNDING = 1e-12
UP = np.array([0.0, 0, 1])


def unit_vectors(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def torus(sections=20):
    body = trimesh.creation.torus(1.0, 0.4, major_sections=sections, minor_sections=12)
    return Mesh(body.vertices, body.faces)


TORUS = torus()


def notch():
    """Two square faces that meet at a right angle along the y axis, facing +z and +x."""
    vertices = np.array(
        [[0.0, -50, 0], [1, -50, 0], [1, 50, 0], [0, 50, 0], [0, -50, 1], [0, 50, 1]]
    )
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]]))


def rays_all_about(mesh, count, seed):
    """From everywhere, far ones aimed near the mesh, the others anywhere."""
    rng = np.random.default_rng(seed)
    center, size = mesh.bounds().mean(axis=0), mesh.diagonal()
    origins = center + size * rng.uniform(0, 2, (count, 1)) * unit_vectors(count, seed + 1)
    targets = center + size * rng.uniform(-0.5, 0.5, (count, 3))
    aimed = np.arange(count) % 2 == 0
    return origins, np.where(aimed[:, None], targets - origins, unit_vectors(count, seed + 2))


def test_embree_is_the_brute_force_twin_on_twenty_thousand_rays():
    rays = rays_all_about(TORUS, 20_000, seed=0)
    found = TORUS.occluded(*rays)
    assert 0.2 < found.mean() < 0.8
    np.testing.assert_array_equal(found, TORUS.occluded_brute_force(*rays))


def test_a_ray_is_occluded_where_it_has_a_first_hit():
    origins, directions = rays_all_about(TORUS, 20_000, seed=3)
    hits = TORUS.first_hits(origins, directions)
    np.testing.assert_array_equal(TORUS.occluded(origins, directions), hits.hit)
    some = slice(0, 300)
    twin = TORUS.first_hits_brute_force(origins[some], directions[some])
    np.testing.assert_array_equal(
        TORUS.occluded_brute_force(origins[some], directions[some]), twin.hit
    )
    np.testing.assert_array_equal(hits.face >= 0, hits.hit)
    corners = TORUS.vertices[TORUS.faces[hits.face[hits.hit]]]
    points = np.einsum("rk,rki->ri", hits.barycentric[hits.hit], corners)
    np.testing.assert_allclose(points, hits.points[hits.hit], atol=ROUNDING)


@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (1e4, 0.0), (1.0, 1e3)])
def test_scale_and_place_do_not_matter(scale, offset):
    shift = offset * np.array([1.0, -0.7, 0.3])
    moved = Mesh(scale * TORUS.vertices + shift, TORUS.faces)
    origins, directions = rays_all_about(TORUS, 4000, seed=6)
    expected = TORUS.occluded(origins, directions)
    np.testing.assert_array_equal(moved.occluded(scale * origins + shift, directions), expected)


def test_rays_aimed_at_vertices_and_edges_are_occluded():
    mesh = Mesh.icosphere(4)
    middles = mesh.vertices[mesh.faces[:, :2]].mean(axis=1)
    for targets in (mesh.vertices, middles):
        for place in 3 * unit_vectors(12, seed=7):
            towards = targets - place
            distance = np.linalg.norm(towards, axis=1)
            facing = np.einsum("ri,ri->r", towards, targets) < -0.1 * distance
            origins = np.broadcast_to(place, towards.shape)
            assert mesh.occluded(origins[facing], towards[facing]).all()


def test_a_sphere_answers_exactly():
    ball = Sphere(np.array([1.0, 2, 3]), 0.5)
    origins = ball.center + np.array([[0.0, 0, 2], [0, 0, 2], [0.5000001, 0, 2], [0.4999999, 0, 2]])
    directions = np.array([[0.0, 0, -1], [0, 0, 1], [0, 0, -1], [0, 0, -1]])
    np.testing.assert_array_equal(ball.occluded(origins, directions), [True, False, False, True])


@pytest.mark.slow
def test_visible_is_the_loop_over_pairs():
    rng = np.random.default_rng(8)
    face = rng.integers(0, len(TORUS.faces), 30)
    places = SurfacePlaces.on_faces(TORUS, face, rng.dirichlet(np.ones(3), 30))
    directions = unit_vectors(40, seed=9)
    found = visible(TORUS, places, directions)
    offset = 1e-4 * TORUS.diagonal()
    for place, (point, normal) in enumerate(zip(*places)):
        origins = np.broadcast_to(point + offset * normal, directions.shape)
        free = ~TORUS.occluded_brute_force(origins, directions)
        np.testing.assert_array_equal(found[place], free & (directions @ normal > 0))
    horizon = places.geometric_normals @ directions.T > 0
    assert np.sum(horizon & ~found) > 40  # a torus does shadow itself
    own = directions[np.arange(30)]
    np.testing.assert_array_equal(
        visible_along(TORUS, places, own), found[np.arange(30), np.arange(30)]
    )


@pytest.mark.parametrize(
    ("make_shape", "distance", "in_packets"),
    [(torus, 0.3, True), (torus, 0.3, False), (torus, 4.0, True), (Sphere, 2.0, True)],
    ids=["within", "within, one by one", "from afar", "a sphere"],
)
def test_pairs_are_their_rays(make_shape, distance, in_packets, monkeypatch):
    """From within the box and from afar, and of a shape that has no way of its own."""
    if not in_packets:
        monkeypatch.setattr(packets, "available", lambda: False)
    shape = make_shape()
    origins, directions = distance * unit_vectors(60, 11), unit_vectors(50, 12)
    asked = np.random.default_rng(13).random((60, 50)) < 0.6
    asked[7] = False
    found = shape.occluded_pairs(origins, directions, asked)
    place, direction = np.nonzero(asked)
    expected = np.zeros_like(asked)
    expected[asked] = shape.occluded(origins[place], directions[direction])
    assert 20 < expected.sum() < asked.sum()
    np.testing.assert_array_equal(found, expected)


def test_chunks_do_not_show(monkeypatch):
    places, directions = SurfacePlaces.of_vertices(TORUS), unit_vectors(50, seed=10)
    whole = visible(TORUS, places, directions)
    monkeypatch.setattr(visibility, "_PAIRS_AT_ONCE", 170)
    np.testing.assert_array_equal(visible(TORUS, places, directions), whole)
    assert visible(TORUS, places, np.zeros((0, 3))).shape == (len(TORUS.vertices), 0)
    none = SurfacePlaces(np.zeros((0, 3)), np.zeros((0, 3)))
    assert visible(TORUS, none, directions).shape == (0, 50)


def test_the_wall_of_a_notch_hides_what_is_below_its_edge():
    """From (x, 0, 0) the wall of height 1 at x = 0 hides elevations under arctan(1 / x)."""
    mesh = notch()
    x = np.linspace(0.05, 0.95, 19)
    places = SurfacePlaces(np.stack([x, np.zeros(19), np.zeros(19)], axis=-1), np.tile(UP, (19, 1)))
    angle = np.radians(np.linspace(0.5, 179.5, 180))
    directions = np.stack([np.cos(angle), np.zeros(180), np.sin(angle)], axis=-1)
    lowest = np.pi - np.arctan2(1, x)  # angle from +x of the wall's upper edge
    # The offset, 1e-4 of a diagonal of 100, lowers the edge by 1 % of its height.
    clear = np.abs(angle[None, :] - lowest[:, None]) > 0.011
    expected = angle[None, :] < lowest[:, None]
    found = visible(mesh, places, directions)
    np.testing.assert_array_equal(found[clear], expected[clear])


def test_convex_shapes_are_not_traced(monkeypatch):
    mesh, directions = Mesh.icosphere(3), unit_vectors(60, seed=11)
    expected = visible(mesh, SurfacePlaces.of_vertices(mesh), directions)
    monkeypatch.setattr(Mesh, "occluded", None)
    monkeypatch.setattr(Sphere, "occluded", None)
    places = SurfacePlaces.of_vertices(mesh)
    np.testing.assert_array_equal(visible(mesh, places, directions), expected)
    on_ball = SurfacePlaces(mesh.vertices, mesh.vertices)
    above = mesh.vertices @ directions.T > 0
    np.testing.assert_array_equal(visible(Sphere(), on_ball, directions), above)
    along = unit_vectors(len(mesh.vertices), seed=12)
    np.testing.assert_array_equal(
        visible_along(Sphere(), on_ball, along), np.einsum("pi,pi->p", along, mesh.vertices) > 0
    )


def test_no_ray_is_blocked_where_it_starts():
    """A sphere with one stray far-off face is not convex, so rays run; none may come back."""
    ball = Mesh.icosphere(3)
    stray = np.array([[0.0, 0, -40], [0.1, 0, -40], [0, 0.1, -40]])
    mesh = Mesh(
        np.concatenate([ball.vertices, stray / 10]),
        np.concatenate([ball.faces, [len(ball.vertices) + np.arange(3)]]),
    )
    assert not mesh.is_convex()
    rng = np.random.default_rng(13)
    face = rng.integers(0, len(ball.faces), 300)
    places = SurfacePlaces.on_faces(mesh, face, rng.dirichlet(np.ones(3), 300))
    directions = unit_vectors(200, seed=14)
    directions = directions[directions[:, 2] > 0]
    above = places.geometric_normals @ directions.T > 0
    np.testing.assert_array_equal(visible(mesh, places, directions), above)


def test_places_of_views_vertices_and_faces():
    camera = Orthographic(30, 30, look_at(np.array([3.0, 1, 4]), np.zeros(3), UP), scale=0.12)
    view = observe(camera, TORUS)
    seen = SurfacePlaces.of_views([view, view])
    own = SurfacePlaces.on_faces(TORUS, view.face[view.hit], view.barycentric[view.hit])
    np.testing.assert_allclose(seen.points, np.tile(own.points, (2, 1)), atol=ROUNDING)
    np.testing.assert_allclose(
        seen.geometric_normals, np.tile(own.geometric_normals, (2, 1)), atol=ROUNDING
    )
    assert np.all(view.face[~view.hit] == -1)
    np.testing.assert_array_equal(view.barycentric[~view.hit], 0)
    np.testing.assert_allclose(view.barycentric[view.hit].sum(axis=1), 1)
    # The camera sees them, so they see the camera.
    outgoing = view.outgoing[view.hit]
    there = SurfacePlaces(*(rows[: len(outgoing)] for rows in seen))
    assert visible_along(TORUS, there, outgoing).mean() > 0.99
    corners = SurfacePlaces.of_vertices(TORUS)
    np.testing.assert_array_equal(corners.points, TORUS.vertices)
    np.testing.assert_allclose(corners.geometric_normals, TORUS.normals, atol=ROUNDING)
    ball_view = observe(camera, Sphere())
    assert ball_view.hit.any()
    assert np.all(ball_view.face == -1)
    np.testing.assert_array_equal(ball_view.geometric_normals, ball_view.normals)


def test_fibonacci_directions_are_even():
    directions = fibonacci_sphere(1000)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=ROUNDING)
    # Random ones would be off by 1 / sqrt(3 N) = 2e-2 and 3e-2.
    assert np.abs(directions.mean(axis=0)).max() < 1e-3
    moments = directions.T @ directions / 1000
    np.testing.assert_allclose(moments, np.eye(3) / 3, atol=1e-3)
    nearest = np.sort(directions @ directions.T, axis=1)[:, -2]
    spacing = np.arccos(np.minimum(nearest, 1)) / np.sqrt(4 * np.pi / 1000)
    assert spacing.min() > 0.6
    assert spacing.max() < 1.1
    with pytest.raises(ValueError, match="count is 0"):
        fibonacci_sphere(0)


def test_rotations_are_uniform():
    rotations = random_rotations(4000, seed=0)
    identity = np.einsum("rij,rkj->rik", rotations, rotations)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), (4000, 3, 3)), atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.det(rotations), 1)
    # Of uniform rotations every entry has mean 0 and variance 1/3; the trace has variance 1.
    assert np.abs(rotations.mean(axis=0)).max() < 4 / np.sqrt(3 * 4000)
    np.testing.assert_allclose((rotations**2).mean(axis=0), 1 / 3, atol=4 * 0.3 / np.sqrt(4000))
    traces = np.trace(rotations, axis1=1, axis2=2)
    assert np.mean(traces**2) == pytest.approx(1, abs=0.1)
    np.testing.assert_array_equal(rotations, random_rotations(4000, seed=0))
    assert np.abs(rotations - random_rotations(4000, seed=1)).max() > 1


@pytest.mark.parametrize("wrong", [np.array([0.0, 0, 2]), np.array([np.nan, 0, 1]), np.zeros(3)])
def test_directions_must_be_unit_vectors(wrong):
    places, directions = SurfacePlaces.of_vertices(TORUS), unit_vectors(len(TORUS.vertices), 15)
    directions[3] = wrong
    with pytest.raises(ValueError, match=r"direction 3 is .*normalise"):
        visible(TORUS, places, directions)
    with pytest.raises(ValueError, match=r"direction 3 is .*normalise"):
        visible_along(TORUS, places, directions)
