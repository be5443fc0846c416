"""The size of pixels on surfaces:

- a plane that faces a parallel camera: a circle of one pixel; oblique by t: 1 / cos t as long
- against the neighbouring pixels' own points on a plane, to first order, pinhole and parallel
- a pinhole's footprint grows with the distance, and as 1 / cos t along the slope
- steps of texture coordinates: a plane's are its own scale; a sphere's are differences of
  ``texels.sphere_coordinates``
- sizes are in texels of the longer axis, whichever side of the image is longer
- pixels that miss are zero; cameras and shapes without a rule are refused
"""

import numpy as np
import pytest

from jaxrender.geometry.cameras import Camera, Orthographic, Pinhole, look_at
from jaxrender.geometry.footprints import axis_lengths, pixel_steps, size_in_texels, texture_steps
from jaxrender.geometry.mesh import Mesh
from jaxrender.geometry.sphere import Sphere
from jaxrender.geometry.surface import observe
from jaxrender.geometry.texels import sphere_coordinates, view_coordinates

UP = np.array([0.0, 1.0, 0.0])
CORNERS = np.array([[-3.0, -1, 0], [3, -1, 0], [3, 1, 0], [-3, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
TEXTURE = (CORNERS[:, :2] + [3, 1]) / [6, 2]
PLANE = Mesh(CORNERS, FACES, None, TEXTURE[FACES])


def parallel(angle: float, scale: float = 0.05) -> Orthographic:
    position = 5 * np.array([0, -np.sin(angle), np.cos(angle)])
    return Orthographic(9, 7, look_at(position, np.zeros(3), UP), scale=scale)


def pinhole(position=(0.6, -4.0, 3.0)) -> Pinhole:
    return Pinhole(40, 30, look_at(np.array(position), np.zeros(3), UP), fl_x=600.0, fl_y=450.0)


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.2])
def test_parallel_rays_on_a_plane(angle):
    camera = parallel(angle)
    view = observe(camera, PLANE)
    lengths = axis_lengths(pixel_steps(camera, view))[view.hit]
    assert view.hit.sum() > 20
    np.testing.assert_allclose(lengths[:, 0], 0.05 / np.cos(angle), rtol=1e-12)
    np.testing.assert_allclose(lengths[:, 1], 0.05, rtol=1e-12)


@pytest.mark.parametrize("camera", [pinhole(), parallel(0.7)])
def test_steps_lead_to_the_neighbours(camera):
    view = observe(camera, PLANE)
    assert view.hit.all()
    steps = pixel_steps(camera, view)
    right = (view.points[1:-1, 2:] - view.points[1:-1, :-2]) / 2
    down = (view.points[2:, 1:-1] - view.points[:-2, 1:-1]) / 2
    np.testing.assert_allclose(steps[1:-1, 1:-1, 0], right, atol=1e-5)
    np.testing.assert_allclose(steps[1:-1, 1:-1, 1], down, atol=1e-5)


def test_a_pinhole_measures_distance_and_slope():
    for distance, slant in ((2.0, 0.0), (4.0, 0.0), (4.0, 1.0)):
        position = distance * np.array([0, -np.sin(slant), np.cos(slant)])
        camera = Pinhole(3, 3, look_at(position, np.zeros(3), UP), fl_x=100.0)
        view = observe(camera, PLANE)
        found = axis_lengths(pixel_steps(camera, view))[1, 1]
        expected = [distance / 100 / np.cos(slant), distance / 100]
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_texture_steps_of_a_plane():
    camera = parallel(0.0)
    view = observe(camera, PLANE)
    steps = texture_steps(PLANE, view, pixel_steps(camera, view))
    np.testing.assert_allclose(steps[3, 4], [[0.05 / 6, 0], [0, -0.05 / 2]], atol=1e-12)
    # 12 x 64 texels: .1 of a column, 1.6 of a row.
    np.testing.assert_allclose(size_in_texels(steps, (64, 12))[3, 4], 1.6, rtol=1e-12)
    np.testing.assert_allclose(size_in_texels(steps, (4, 12))[3, 4], 0.1, rtol=1e-12)


def test_texture_steps_of_a_sphere():
    ball = Sphere(np.array([0.1, 0.2, 0.3]), 1.5)
    camera = Pinhole(
        40, 40, look_at(np.array([4.0, 3, 2]), ball.center, np.array([0.0, 0, 1])), fl_x=60.0
    )
    view = observe(camera, ball)
    steps = texture_steps(ball, view, pixel_steps(camera, view))[view.hit]
    on, small = view.points[view.hit] - ball.center, 1e-5
    for k in range(2):
        moved = on + small * pixel_steps(camera, view)[view.hit][:, k]
        back = on - small * pixel_steps(camera, view)[view.hit][:, k]
        ends = [sphere_coordinates(p / np.linalg.norm(p, axis=1)[:, None]) for p in (moved, back)]
        expected = (ends[0] - ends[1]) / (2 * small)
        near = np.abs(expected).max(axis=1) < 0.5
        assert near.mean() > 0.95
        np.testing.assert_allclose(steps[near, k], expected[near], atol=1e-5)
    assert view_coordinates(ball, view).shape == (view.hit.sum(), 2)


def test_misses_and_refusals():
    camera = Orthographic(9, 9, look_at(np.array([0.0, 0, 5]), np.zeros(3), UP), scale=1.0)
    view = observe(camera, PLANE)
    assert not view.hit.all()
    steps = pixel_steps(camera, view)
    assert np.isfinite(steps).all()
    assert not steps[~view.hit].any()
    bare = Mesh(CORNERS, FACES)
    with pytest.raises(ValueError, match="texture coordinates"):
        texture_steps(bare, view, steps)

    class Fisheye(Camera):
        width: int
        height: int
        world_from_camera: np.ndarray

        def rays(self):
            return camera.rays()

        def project(self, points):
            return camera.project(points)

    with pytest.raises(ValueError, match="Fisheye"):
        pixel_steps(Fisheye(9, 9, np.eye(4)), view)
