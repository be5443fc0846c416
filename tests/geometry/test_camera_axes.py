"""Poses of other programs, and where a mesh is put.

- A point ahead, to the right and above projects to the right and above, whatever axes its pose is
  written in; the axes are those that each program documents.
- A smaller camera sees the same directions.
- A placement scales, turns, shifts, in this order; placements compose and are undone.
"""

import numpy as np
import pytest

from jaxrender.geometry import (
    CAMERA_AXES,
    Orthographic,
    Pinhole,
    Placement,
    axis_turns,
    camera_from,
    look_at,
    pose_from,
    random_rotations,
    sculpture,
    shrunk_camera,
)

# Right, up and backwards in each program's own camera axes, from its documentation.
DOCUMENTED = {
    "opengl": ([1, 0, 0], [0, 1, 0], [0, 0, 1]),
    "opencv": ([1, 0, 0], [0, -1, 0], [0, 0, -1]),
    "pytorch3d": ([-1, 0, 0], [0, 1, 0], [0, 0, -1]),
    "llff": ([0, 1, 0], [-1, 0, 0], [0, 0, 1]),
    "ros": ([0, -1, 0], [0, 0, 1], [-1, 0, 0]),
}
OURS = look_at(np.array([3.0, -2, 1]), np.array([0.1, 0.2, 0.3]), np.array([0.0, 0, 1]))


def written(axes: str) -> np.ndarray:
    """Write our pose as another program does."""
    pose = OURS.copy()
    # Columns are the program's axes in the world: sums of right, up and backwards.
    pose[:3, :3] = OURS[:3, :3] @ np.array(DOCUMENTED[axes.removesuffix("_inverted")])
    return np.linalg.inv(pose) if axes.endswith("_inverted") else pose


@pytest.mark.parametrize("axes", CAMERA_AXES)
def test_a_pose_in_any_axes_is_read_as_ours(axes):
    np.testing.assert_allclose(pose_from(written(axes), axes), OURS, atol=1e-12)


def test_opencv_looks_along_z_with_y_down():
    pose = np.eye(4)
    camera = camera_from(Pinhole(100, 100, pose, fl_x=50.0), "opencv")
    x, y = camera.project(np.array([[0.2, 0.4, 2.0]]))[0]
    assert (x, y) == pytest.approx((55, 60))


def test_unknown_axes_are_refused():
    with pytest.raises(ValueError, match="unknown camera axes 'maya'; known are opengl, opencv"):
        pose_from(np.eye(4), "maya")


@pytest.mark.parametrize(
    "camera",
    [
        Pinhole(60, 40, OURS, fl_x=70.0, fl_y=65.0, cx=28.0, cy=22.0),
        Orthographic(60, 40, OURS, scale=0.05, cx=28.0, cy=22.0),
    ],
)
def test_a_smaller_camera_sees_the_same(camera):
    small = shrunk_camera(camera, 4)
    assert (small.width, small.height) == (15, 10)
    points = np.random.default_rng(0).normal(size=(9, 3)) * 0.3
    np.testing.assert_allclose(4 * small.project(points), camera.project(points), rtol=1e-12)


def test_a_placement_scales_then_turns_then_shifts():
    placed = Placement.of_degrees(2.0, np.array([0.0, 0, 90]), np.array([0.0, 0, 5]))
    np.testing.assert_allclose(placed.points(np.array([[1.0, 0, 0]])), [[0, 2, 5]], atol=1e-12)
    np.testing.assert_allclose(placed.degrees, [0, 0, 90], atol=1e-12)


def test_placements_compose_and_are_undone():
    turns, points = random_rotations(2, 0), np.random.default_rng(1).normal(size=(5, 3))
    one, other = (
        Placement(2.0, turns[0], np.array([1.0, 2, 3])),
        Placement(0.3, turns[1], np.array([-1.0, 0, 2])),
    )
    both = one.after(other)
    np.testing.assert_allclose(both.points(points), one.points(other.points(points)))
    np.testing.assert_allclose(both.inverse.points(both.points(points)), points, atol=1e-12)


def test_a_placed_mesh_has_its_normals_turned():
    mesh, turn = sculpture(2), random_rotations(1, 3)[0]
    placed = Placement(3.0, turn, np.array([1.0, 0, 0])).mesh(mesh)
    facing = np.einsum("fi,fi->f", placed.face_normals(), placed.normals[placed.faces[:, 0]])
    assert facing.min() > 0.3
    np.testing.assert_allclose(placed.normals, mesh.normals @ turn.T)


@pytest.mark.parametrize(
    ("scale", "turn", "said"),
    [(0.0, None, "the scale is 0"), (1.0, np.diag([1.0, 1, -1]), "give a rotation")],
)
def test_what_is_no_placement_is_refused(scale, turn, said):
    with pytest.raises(ValueError, match=said):
        Placement(scale, turn)


def test_there_are_24_turns():
    turns = axis_turns()
    assert len({turn.tobytes() for turn in turns}) == 24
    np.testing.assert_array_equal(turns[0], np.eye(3))
    assert all(np.linalg.det(turn) == pytest.approx(1) for turn in turns)
