"""Rays against meshes.

Pinned down: Embree's first hits equal the brute-force twin and trimesh's ray_triangle (an outside
oracle) on convex, concave and open meshes, of any scale and far from the origin; rays aimed exactly
at vertices and edges of a closed mesh neither miss nor leak through; points lie on the ray and the
face; normals interpolate; real meshes where the folder JAXRENDER_MESHES
holds them.
"""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_triangle import RayMeshIntersector

from jaxrender.geometry import Mesh, Orthographic, look_at, tracing

# Hits are computed again in float64 on the face that Embree found; relative to the mesh's size.
RELATIVE = 1e-9
REAL_MESHES = Path(os.environ.get("JAXRENDER_MESHES", "meshes"))


def concave():
    """A torus: closed, concave, with a hole."""
    torus = trimesh.creation.torus(1.0, 0.4, major_sections=24, minor_sections=12)
    return Mesh(torus.vertices, torus.faces)


def opened():
    mesh = Mesh.icosphere(2)
    return Mesh(mesh.vertices, mesh.faces[:200])


MESHES = {"convex": Mesh.icosphere(2), "concave": concave(), "open": opened()}


def random_rays(mesh, count, seed):
    """From all around, aimed into the bounding box: about half of them hit."""
    rng = np.random.default_rng(seed)
    center, size = mesh.bounds().mean(axis=0), mesh.diagonal()
    around = rng.normal(size=(count, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    origins = center + size * rng.uniform(0.8, 3, (count, 1)) * around
    targets = center + rng.uniform(-0.5, 0.5, (count, 3)) * np.ptp(mesh.bounds(), axis=0)
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def oracle_distances(mesh, origins, directions):
    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, rays, _ = RayMeshIntersector(body).intersects_location(
        origins, directions, multiple_hits=True
    )
    distances = np.full(len(origins), np.inf)
    np.minimum.at(distances, rays, np.einsum("ri,ri->r", points - origins[rays], directions[rays]))
    return distances


def assert_same_hits(found, expected, size):
    np.testing.assert_array_equal(found.hit, expected.hit)
    np.testing.assert_allclose(found.distance, expected.distance, rtol=0, atol=RELATIVE * size)
    np.testing.assert_allclose(found.points, expected.points, rtol=0, atol=RELATIVE * size)
    np.testing.assert_allclose(found.normals, expected.normals, atol=1e-6)
    np.testing.assert_allclose(found.geometric_normals, expected.geometric_normals, atol=1e-6)


@pytest.mark.parametrize("name", MESHES)
def test_first_hits_equal_the_brute_force_twin(name):
    mesh = MESHES[name]
    rays = random_rays(mesh, 400, seed=0)
    found = mesh.first_hits(*rays)
    assert 0.2 < found.hit.mean() < 1
    assert_same_hits(found, mesh.first_hits_brute_force(*rays), mesh.diagonal())


@pytest.mark.parametrize("name", MESHES)
def test_first_hits_equal_trimesh(name):
    mesh = MESHES[name]
    rays = random_rays(mesh, 400, seed=1)
    expected = oracle_distances(mesh, *rays)
    np.testing.assert_allclose(mesh.first_hits(*rays).distance, expected, rtol=1e-9)
    np.testing.assert_allclose(mesh.first_hits_brute_force(*rays).distance, expected, rtol=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_scale_and_place_do_not_matter(scale, offset):
    shift = offset * np.array([1.0, -0.7, 0.3])
    unit = MESHES["concave"]
    mesh = Mesh(scale * unit.vertices + shift, unit.faces)
    origins, directions = random_rays(unit, 400, seed=2)
    found = mesh.first_hits(scale * origins + shift, directions)
    expected = unit.first_hits(origins, directions)
    np.testing.assert_array_equal(found.hit, expected.hit)
    # The mesh's own coordinates are rounded to 1e-13 at 1e3 from the origin.
    tolerance = 1e-9 * scale + 1e-11 * (offset > 0)
    hit = found.hit
    moved = scale * expected.points[hit] + shift
    np.testing.assert_allclose(found.points[hit], moved, rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.normals, expected.normals, atol=1e-6)


def test_a_distant_camera_costs_no_accuracy():
    mesh = MESHES["concave"]
    origins, directions = random_rays(mesh, 400, seed=3)
    found = mesh.first_hits(origins - 1e6 * directions, directions)
    expected = mesh.first_hits(origins, directions)
    np.testing.assert_array_equal(found.hit, expected.hit)
    # A float64 origin at 1e6 has digits to 1e-10; in float32 it would have them to 0.06.
    np.testing.assert_allclose(found.points, expected.points, atol=1e-8)


def rays_aimed_at(targets, count, seed):
    """Rays from ``count`` places outside at those points of the unit sphere that face them."""
    for place in 3 * np.random.default_rng(seed).normal(size=(count, 3)):
        directions = targets - place
        distance = np.linalg.norm(directions, axis=1)
        facing = np.einsum("ri,ri->r", directions, targets) < -0.1 * distance
        yield np.broadcast_to(place, targets.shape)[facing], directions[facing], distance[facing]


@pytest.mark.parametrize("corners", [[0], [0, 1]], ids=["vertices", "edges"])
def test_rays_at_vertices_and_edges_do_not_leak(corners):
    mesh = Mesh.icosphere(4)
    targets = mesh.vertices[mesh.faces[:, corners]].mean(axis=1)
    for origins, directions, distance in rays_aimed_at(targets, 12, seed=4):
        hits = mesh.first_hits(origins, directions)
        assert hits.hit.all()
        # Through the sphere it would be at least 0.2 further.
        np.testing.assert_allclose(hits.distance, distance, atol=1e-4)


def test_leaks_are_repaired(monkeypatch):
    # A tenth of the jitter lets one vertex ray in 1500 through: 30 of these.
    monkeypatch.setattr(tracing, "_JITTER", 1e-7)
    mesh = Mesh.icosphere(4)
    for origins, directions, distance in rays_aimed_at(mesh.vertices, 45, seed=8):
        np.testing.assert_allclose(
            mesh.first_hits(origins, directions).distance, distance, atol=1e-4
        )


def test_a_ray_from_pole_to_pole_stops_at_the_first():
    mesh = Mesh.icosphere(3)
    origins = np.tile([0.0, 0, 5], (2000, 1))
    hits = mesh.first_hits(origins, np.broadcast_to([0.0, 0, -1], origins.shape))
    np.testing.assert_allclose(hits.distance, 4, atol=1e-5)


def test_rays_from_inside_meet_the_far_side_from_behind():
    mesh = Mesh.icosphere(3)
    directions = random_rays(mesh, 200, seed=5)[1]
    hits = mesh.first_hits(np.zeros_like(directions), directions)
    assert hits.hit.all()
    assert np.all(np.einsum("ri,ri->r", hits.geometric_normals, directions) > 0.9)


def test_offset_rays_leave_a_convex_surface():
    mesh = Mesh.icosphere(3)
    hits = mesh.first_hits(*random_rays(mesh, 2000, seed=6))
    points, normals = hits.points[hits.hit], hits.geometric_normals[hits.hit]
    leaving = random_rays(mesh, len(points), seed=7)[1]
    leaving *= np.sign(np.einsum("ri,ri->r", leaving, normals))[:, None]
    assert not mesh.first_hits(points + 1e-4 * mesh.diagonal() * normals, leaving).hit.any()


def test_normals_are_interpolated_between_the_vertices():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    normals = np.array([[0.0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]])
    mesh = Mesh(vertices, np.array([[0, 1, 2]]), normals)
    weights = np.array([0.2, 0.5, 0.3])
    point = weights @ vertices
    hits = mesh.first_hits(point[None] + [0, 0, 2], np.array([[0.0, 0, -1]]))
    expected = weights @ normals
    np.testing.assert_allclose(hits.normals[0], expected / np.linalg.norm(expected), atol=1e-12)
    np.testing.assert_allclose(hits.points[0], point, atol=1e-12)
    np.testing.assert_allclose(hits.geometric_normals[0], [0, 0, 1])


def test_where_vertex_normals_cancel_the_face_decides():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    mesh = Mesh(vertices, np.array([[0, 1, 2]]), np.zeros((3, 3)))
    hits = mesh.first_hits(np.array([[0.2, 0.2, 1]]), np.array([[0.0, 0, -1]]))
    np.testing.assert_allclose(hits.normals[0], [0, 0, 1])


def test_no_rays_give_no_hits():
    assert MESHES["convex"].first_hits(np.zeros((0, 3)), np.zeros((0, 3))).hit.shape == (0,)


@pytest.mark.parametrize("name", ["spot.obj", "bun_zipper_res3.ply"])
def test_real_meshes_equal_trimesh(name):
    path = REAL_MESHES / name
    if not path.exists():
        pytest.skip(f"{path}: no such file; name its folder in JAXRENDER_MESHES")
    body = trimesh.load_scene(path).to_mesh()
    mesh = Mesh(body.vertices, body.faces)
    assert mesh.is_closed() == (name == "spot.obj")
    assert not mesh.is_convex()
    center = mesh.bounds().mean(axis=0)
    pose = look_at(center + mesh.diagonal() * np.array([1.0, 0.7, 0.5]), center, np.eye(3)[1])
    rays = Orthographic(24, 24, pose, scale=mesh.diagonal() / 24).rays()
    origins, directions = (np.array(x).reshape(-1, 3) for x in rays)
    expected = oracle_distances(mesh, origins, directions)
    found = mesh.first_hits(origins, directions)
    np.testing.assert_allclose(found.distance, expected, rtol=1e-8)
    assert_same_hits(found, mesh.first_hits_brute_force(origins, directions), mesh.diagonal())
