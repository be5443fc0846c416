"""Cameras and their rays.

Pinned down: the convention (x right, y up, looks along -z, pixel centres at half integers, row 0 at
the top) by single known pixels of either camera; rays and projection are inverse, so that a bright
point lands in its own pixel; look_at; what is refused, and that the message names value and remedy.
"""

import numpy as np
import pytest

from jaxrender.geometry import Orthographic, Pinhole, look_at

ROUNDING = 1e-12


def pose(seed=0):
    position = np.random.default_rng(seed).normal(size=3) * 3
    return look_at(position, np.array([0.1, -0.2, 0.3]), np.array([0.0, 0, 1]))


def cameras():
    return [
        Pinhole(30, 20, pose(), fl_x=25.0, fl_y=27.0, cx=14.0, cy=11.5),
        Orthographic(30, 20, pose(1), scale=0.05, cx=13.0, cy=9.0),
    ]


def test_pinhole_rays_of_known_pixels():
    camera = Pinhole(4, 2, np.eye(4), fl_x=2.0, fl_y=1.0, cx=2.0, cy=1.0)
    origins, directions = camera.rays()
    assert directions.shape == (2, 4, 3)
    np.testing.assert_array_equal(origins, 0)
    # Top left: 1.5 pixels left, half a pixel up. Bottom right: the opposite.
    top_left = np.array([-0.75, 0.5, -1])
    bottom_right = np.array([0.75, -0.5, -1])
    np.testing.assert_allclose(directions[0, 0], top_left / np.linalg.norm(top_left))
    np.testing.assert_allclose(directions[1, 3], bottom_right / np.linalg.norm(bottom_right))


def test_orthographic_rays_of_known_pixels():
    world_from_camera = np.eye(4)
    world_from_camera[:3, 3] = [10, 20, 30]
    origins, directions = Orthographic(4, 2, world_from_camera, scale=0.5).rays()
    np.testing.assert_array_equal(directions, np.broadcast_to([0.0, 0, -1], (2, 4, 3)))
    np.testing.assert_allclose(origins[0, 0], [10 - 0.75, 20 + 0.25, 30])
    np.testing.assert_allclose(origins[1, 3], [10 + 0.75, 20 - 0.25, 30])


def test_defaults_put_the_axis_in_the_image_centre():
    camera = Pinhole(6, 4, np.eye(4), fl_x=5.0)
    assert (camera.fl_y, camera.cx, camera.cy) == (5, 3, 2)
    orthographic = Orthographic(6, 4, np.eye(4), scale=1.0)
    assert (orthographic.cx, orthographic.cy) == (3, 2)


@pytest.mark.parametrize("camera", cameras())
def test_points_along_a_pixels_ray_project_to_its_centre(camera):
    origins, directions = camera.rays()
    points = (origins + 2.5 * directions).reshape(-1, 3)
    rows, columns = np.mgrid[: camera.height, : camera.width]
    expected = np.stack([columns + 0.5, rows + 0.5], axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(camera.project(points), expected, atol=ROUNDING)


@pytest.mark.parametrize("camera", cameras())
def test_a_single_bright_point_lies_on_the_ray_of_its_pixel(camera):
    origins, directions = camera.rays()
    bright = origins[4, 21] + 1.7 * directions[4, 21]
    distance = np.linalg.norm(np.cross(bright - origins, directions), axis=-1)
    assert np.unravel_index(distance.argmin(), distance.shape) == (4, 21)
    assert tuple(np.floor(camera.project(bright[None])[0])) == (21, 4)


@pytest.mark.parametrize("camera", cameras())
def test_points_behind_the_camera_have_no_pixel(camera):
    origins, directions = camera.rays()
    assert np.isnan(camera.project(origins[3] - directions[3])).all()


@pytest.mark.parametrize("camera", cameras())
def test_directions_are_unit(camera):
    np.testing.assert_allclose(np.linalg.norm(camera.rays().directions, axis=-1), 1, atol=ROUNDING)


def test_look_at_sees_the_target_in_the_middle_and_up_upwards():
    position, target = np.array([3.0, -2, 1]), np.array([0.0, 0.5, 0])
    world_from_camera = look_at(position, target, np.array([0.0, 0, 1]))
    camera = Pinhole(9, 9, world_from_camera, fl_x=10.0)
    above = target + np.array([0, 0, 0.3])
    image = camera.project(np.stack([target, above]))
    np.testing.assert_allclose(image[0], [4.5, 4.5], atol=ROUNDING)
    assert image[1, 1] < 4.5  # rows count downwards
    np.testing.assert_allclose(image[1, 0], 4.5, atol=ROUNDING)


def test_look_at_refuses_an_undefined_upright():
    with pytest.raises(ValueError, match="up not along the line of sight"):
        look_at(np.array([0.0, 0, 2]), np.zeros(3), np.array([0.0, 0, 1]))
    with pytest.raises(ValueError, match="target other than the position"):
        look_at(np.ones(3), np.ones(3), np.array([0.0, 0, 1]))


def test_a_scaled_pose_is_refused_with_its_deviation():
    scaled = np.diag([1.01, 1.01, 1.01, 1])
    with pytest.raises(ValueError, match=r"deviates from a rotation by 0\.02 .*take scale"):
        Pinhole(4, 4, scaled, fl_x=1.0)


def test_a_pose_rounded_to_six_digits_is_accepted():
    Pinhole(4, 4, np.round(pose(), 6), fl_x=1.0)


def test_a_reflected_pose_is_refused():
    with pytest.raises(ValueError, match=r"reflection .*negate one column"):
        Orthographic(4, 4, np.diag([1.0, 1, -1, 1]), scale=1.0)


def test_a_transposed_pose_is_refused():
    with pytest.raises(ValueError, match="transposed"):
        Orthographic(4, 4, pose().T, scale=1.0)


def test_a_non_finite_pose_is_refused():
    broken = np.eye(4)
    broken[0, 3] = np.nan
    with pytest.raises(ValueError, match="finite 4 x 4"):
        Pinhole(4, 4, broken, fl_x=1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fl_x": 0.0}, "fl_x is 0"),
        ({"fl_y": -3.0}, "fl_y is -3"),
        ({"cx": np.inf}, "cx is inf"),
        ({"width": 0}, "image size 0 x 4"),
    ],
)
def test_bad_intrinsics_are_refused_by_name(changes, message):
    good = {"width": 4, "height": 4, "world_from_camera": np.eye(4), "fl_x": 1.0}
    with pytest.raises(ValueError, match=message):
        Pinhole(**(good | changes))


def test_a_bad_orthographic_scale_is_refused():
    with pytest.raises(ValueError, match="scale is nan"):
        Orthographic(4, 4, np.eye(4), scale=float("nan"))
