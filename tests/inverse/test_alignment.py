"""Where an object lies is found by its silhouettes alone.

- A mesh in another unit, turn and place is found, within what is stated and within .3 %.
- A mesh that looks the same when it is turned is not found, and the axis is said; a wrong mesh is
  not found either.
- A ball is found by the silhouettes of perspective and of parallel rays; of one photograph its
  radius must be known.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from wrongly_framed import cameras, silhouettes

from jaxrender.geometry import Mesh, Orthographic, Placement, Sphere, axis_turns, sculpture
from jaxrender.inverse.alignment import align, sphere_of_silhouettes
from jaxrender.inverse.conventions import Silhouettes
from jaxrender.inverse.conventions.silhouettes import covered

OBJECT = sculpture(3)


@pytest.mark.parametrize(
    ("scale", "turn"), [(10.0, 5), pytest.param(0.1, 17, marks=pytest.mark.slow)]
)
def test_a_mesh_in_another_unit_turn_and_place_is_found(scale, turn):
    true = Placement(scale, axis_turns()[turn], np.array([0.8, -0.5, 0.4]))
    found = align(true.inverse.mesh(OBJECT), silhouettes(OBJECT))
    assert found.found
    between = Rotation.from_matrix(found.placement.rotation @ true.rotation.T)
    turn_off = float(np.degrees(between.magnitude()))
    scale_off = abs(found.placement.scale / true.scale - 1)
    assert turn_off < min(0.3, 3.5 * found.turn_error)
    assert scale_off < min(0.003, 3.5 * found.scale_error)
    assert found.overlap > 0.97
    assert found.sentence().startswith("the mesh lies at scale")


def test_a_mesh_that_looks_the_same_when_turned_is_not_found():
    # Half a turn about any of its axes changes nothing.
    brick = Mesh.ellipsoid(np.array([0.5, 0.8, 1.2]), 2)
    found = align(brick, silhouettes(brick))
    assert not found.found
    assert "as well when it is turned by 180 degrees about" in found.sentence()


@pytest.mark.slow
def test_a_wrong_mesh_is_not_found(monkeypatch):
    monkeypatch.setattr("jaxrender.inverse.alignment.pose_search._TURNS", 20)
    stick = Mesh.ellipsoid(np.array([0.1, 0.1, 1.0]), 2)
    assert "overlap by" in align(stick, silhouettes(OBJECT)).why


def test_without_silhouettes_nothing_is_aligned():
    with pytest.raises(ValueError, match="give masks"):
        align(OBJECT, Silhouettes((), (), ()))


BALL = Sphere(np.array([0.3, -0.2, 0.4]), 0.9)


def test_a_ball_is_found_by_photographs_from_near():
    views = cameras(3, 96, 3.5)
    found = sphere_of_silhouettes(views, [covered(camera, BALL) for camera in views])
    np.testing.assert_allclose(found.sphere.center, BALL.center, atol=4 * found.centre_error)
    assert found.sphere.radius == pytest.approx(BALL.radius, abs=4 * found.radius_error)
    assert found.radius_error < 0.005
    assert found.misfit < 0.02


def test_one_photograph_needs_the_radius():
    views = cameras(1, 96, 4.0)
    masks = [covered(camera, BALL) for camera in views]
    with pytest.raises(ValueError, match="or its radius"):
        sphere_of_silhouettes(views, masks)
    found = sphere_of_silhouettes(views, masks, BALL.radius)
    np.testing.assert_allclose(found.sphere.center, BALL.center, atol=0.05)


def test_a_ball_in_parallel_rays():
    views = [
        Orthographic(80, 80, camera.world_from_camera, scale=0.05) for camera in cameras(2, 80)
    ]
    found = sphere_of_silhouettes(views, [covered(camera, BALL) for camera in views])
    np.testing.assert_allclose(found.sphere.center, BALL.center, atol=0.01)
    assert found.sphere.radius == pytest.approx(BALL.radius, abs=0.01)


def test_what_is_no_ball_is_refused():
    views = cameras(3, 64)
    masks = [covered(camera, OBJECT) for camera in views]
    with pytest.raises(ValueError, match="miss a ball by"):
        sphere_of_silhouettes(views, masks)
    with pytest.raises(ValueError, match="outlines have 0 points"):
        sphere_of_silhouettes(views, [np.zeros_like(mask) for mask in masks])
