"""Triangle meshes: construction, normals, constructors.

Pinned down: angle-weighted normals (0.1 degree on a 32 x 32 sphere, independent of how a quad is
cut, shared across seams); icospheres are closed, outward and of the right volume; ellipsoids have
their analytic normals; convexity and closedness; zero-area and repeated faces are
dropped and counted; what is refused; pickling.
"""

import pickle

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from jaxrender.geometry import Mesh

ROUNDING = 1e-12
# Measured in ECOSYSTEM for angle weights on a 32 x 32 sphere; area weights err by 1 degree.
DEGREES = 0.1

CUBE = trimesh.creation.box((1, 1, 1))


def degrees_between(a, b):
    return np.degrees(2 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=-1) / 2, 1)))


def test_normals_are_angle_weighted():
    sphere = trimesh.creation.uv_sphere(count=[32, 32])
    mesh = Mesh(sphere.vertices, sphere.faces)
    assert degrees_between(mesh.normals, sphere.vertices).max() < DEGREES


def test_a_cubes_corner_normals_do_not_depend_on_its_diagonals():
    mesh = Mesh(CUBE.vertices, CUBE.faces)
    expected = CUBE.vertices / np.linalg.norm(CUBE.vertices, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals, expected, atol=ROUNDING)


def test_seams_do_not_show():
    corners = CUBE.vertices[CUBE.faces].reshape(-1, 3)
    split = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    expected = Mesh(CUBE.vertices, CUBE.faces).normals[CUBE.faces].reshape(-1, 3)
    np.testing.assert_allclose(split.normals, expected, atol=ROUNDING)
    assert split.is_closed()


def test_given_normals_are_kept_at_unit_length():
    triangle = np.eye(3)
    mesh = Mesh(triangle, np.array([[0, 1, 2]]), 5 * np.eye(3))
    np.testing.assert_allclose(mesh.normals, np.eye(3))


@pytest.mark.parametrize("subdivisions", [0, 1, 3])
def test_icospheres_are_closed_convex_and_outward(subdivisions):
    mesh = Mesh.icosphere(subdivisions, radius=2.0, center=np.array([1.0, 0, 0]))
    oracle = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert len(mesh.faces) == 20 * 4**subdivisions
    assert oracle.is_watertight
    assert oracle.is_winding_consistent
    assert oracle.volume > 0
    assert mesh.is_closed()
    assert mesh.is_convex()
    outward = (mesh.vertices - [1, 0, 0]) / 2
    np.testing.assert_allclose(mesh.normals, outward, atol=ROUNDING)


def test_a_fine_icosphere_has_the_volume_of_the_ball():
    mesh = Mesh.icosphere(5)
    volume = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume
    np.testing.assert_allclose(volume, 4 / 3 * np.pi, rtol=2e-3)


def test_ellipsoids_lie_on_their_quadric_with_its_gradient_as_normal():
    axes, center = np.array([1.0, 2.0, 0.5]), np.array([0.0, 3.0, 0.0])
    mesh = Mesh.ellipsoid(axes, 2, center)
    scaled = (mesh.vertices - center) / axes
    np.testing.assert_allclose((scaled**2).sum(axis=1), 1, atol=ROUNDING)
    gradient = (mesh.vertices - center) / axes**2
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals, gradient, atol=ROUNDING)
    np.testing.assert_allclose(mesh.bounds(), [center - axes, center + axes], atol=0.1)
    assert mesh.is_convex()


def test_a_dented_and_an_open_mesh_are_not_convex():
    mesh = Mesh.icosphere(2)
    dented = mesh.vertices.copy()
    dented[7] *= 0.8
    assert not Mesh(dented, mesh.faces).is_convex()
    opened = Mesh(mesh.vertices, mesh.faces[1:])
    assert not opened.is_closed()
    assert not opened.is_convex()


@pytest.mark.parametrize("turn", [np.eye(3), Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()])
def test_a_flat_sheet_hides_nothing_from_its_front(turn):
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [-1, 2, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4]])
    moved = corners @ turn.T + [3.0, 2.0, 1.0]
    assert Mesh(moved, faces).is_convex()
    assert not Mesh(moved, faces).is_closed()
    # With a front on either side, or bent, it may.
    twisted = np.array([*faces[:2], faces[2, ::-1]])
    assert not Mesh(moved, twisted).is_convex()
    bent = moved.copy()
    bent[4] += 0.1 * turn[:, 2]
    assert not Mesh(bent, faces).is_convex()


def test_inconsistent_winding_is_not_closed():
    faces = CUBE.faces.copy()
    faces[0] = faces[0, ::-1]
    assert not Mesh(CUBE.vertices, faces).is_closed()


def test_zero_area_faces_are_dropped_and_counted():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 1, 2]])
    mesh = Mesh(vertices, faces)
    assert mesh.dropped_faces == 2
    np.testing.assert_array_equal(mesh.faces, faces[:1])


def test_repeated_faces_are_dropped_whatever_their_winding():
    faces = np.concatenate([CUBE.faces, CUBE.faces[:5, ::-1], np.roll(CUBE.faces[3:4], 1, axis=1)])
    mesh = Mesh(CUBE.vertices, faces)
    assert mesh.dropped_faces == 6
    np.testing.assert_array_equal(mesh.faces, CUBE.faces)


def test_tiny_faces_are_not_flat():
    assert Mesh(1e-9 * CUBE.vertices, CUBE.faces).dropped_faces == 0


def test_the_callers_arrays_are_not_shared():
    vertices, faces = np.array(CUBE.vertices), np.array(CUBE.faces)
    mesh = Mesh(vertices, faces)
    vertices[0] = 100
    np.testing.assert_array_equal(mesh.vertices, CUBE.vertices)


def test_pickled_meshes_still_trace():
    mesh = pickle.loads(pickle.dumps(Mesh.icosphere(2)))
    hits = mesh.first_hits(np.array([[0.1, 0.2, 3.0]]), np.array([[0.0, 0, -1]]))
    assert hits.hit.all()


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.eye(3), np.zeros((0, 3), int), "no faces: a point cloud"),
        (np.eye(3), np.array([[0, 1, 3]]), r"face 0 names vertices \[0, 1, 3\].*index base"),
        (np.eye(3), np.array([[0, 1, 2], [0, -1, 2]]), "face 1 names vertices"),
        (np.eye(3) * [1, np.nan, 1], np.array([[0, 1, 2]]), "vertex 0 is .*non-finite"),
        (np.zeros((3, 3)), np.array([[0, 1, 2]]), "zero area"),
    ],
)
def test_bad_meshes_are_refused_by_name(vertices, faces, message):
    with pytest.raises(ValueError, match=message):
        Mesh(vertices, faces)


def test_non_finite_normals_are_refused():
    with pytest.raises(ValueError, match="normal 1 is"):
        Mesh(np.eye(3), np.array([[0, 1, 2]]), np.array([[1.0, 0, 0], [np.inf, 0, 0], [0, 0, 1]]))


def test_bad_constructor_arguments_are_refused():
    with pytest.raises(ValueError, match="semi-axes"):
        Mesh.icosphere(1, radius=-1.0)
    with pytest.raises(ValueError, match="subdivisions is -1"):
        Mesh.icosphere(-1)
