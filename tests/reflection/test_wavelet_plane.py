"""A plane as cameras see it, shaded from coefficient trees.

Pinned down: a plane is seen where a camera's projection says, from its front, towards the camera; a
camera far away sees what an orthographic one does; a texture chooses the BRDF; where nothing is
seen it is black.
"""

import numpy as np
import pytest
from wavelet_shading_problems import EXACT, random_tree

from jaxrender.geometry import NUSSELT, Orthographic, Pinhole, look_at
from jaxrender.reflection.wavelet_shading.plane import Plane, PlaneView, shade_plane
from jaxrender.reflection.wavelet_shading.shading import reflected_radiance
from jaxrender.wavelets.filters import haar, linear_spline

PLANE = Plane(np.array([1.0, -1, 0]), np.array([2.0, 1, 0]), np.array([0.0, 0.5, 3]))


def camera_at(kind, position):
    centre = PLANE.points(np.array([0.5, 0.5]))
    pose = look_at(centre + position, centre, np.array([0.0, 0, 1]))
    if kind == "orthographic":
        return Orthographic(12, 10, pose, scale=0.3)
    return Pinhole(12, 10, pose, fl_x=12 * np.linalg.norm(position) / 3.6)


@pytest.mark.parametrize("kind", ["orthographic", "pinhole"])
def test_places_and_directions_are_those_that_the_camera_sees(kind):
    normal = PLANE.world_from_local[:, 2]
    position = 5 * normal + PLANE.along_u
    camera = camera_at(kind, position)
    view = PLANE.seen_by(camera)
    assert 20 < view.seen.sum() < view.seen.size
    points = PLANE.points(view.places)
    row, column = np.nonzero(view.seen)
    pixels = np.stack([column, row], axis=1) + 0.5
    np.testing.assert_allclose(camera.project(points), pixels, atol=1e-9)
    if kind == "pinhole":
        towards = camera.position - points
    else:
        assert view.directions.shape == (1, 2)
        towards = position[None]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    directions = np.asarray(NUSSELT.direction_from_square(view.directions))
    np.testing.assert_allclose(directions @ PLANE.world_from_local.T, towards, atol=1e-9)
    assert not PLANE.seen_by(camera_at(kind, -position)).seen.any()
    corners = PLANE.points(np.array([[0.0, 0], [1, 0], [0, 1]]))
    sides = [PLANE.corner, PLANE.corner + PLANE.along_u, PLANE.corner + PLANE.along_v]
    np.testing.assert_allclose(corners, sides)


def test_a_camera_far_away_sees_what_an_orthographic_one_does():
    light, brdf = random_tree(haar(), 4), random_tree(linear_spline(), 4, seed=1)
    normal = PLANE.world_from_local[:, 2]
    near, far = (
        PLANE.seen_by(camera_at(kind, distance * normal + distance * PLANE.along_u / 10))
        for kind, distance in (("orthographic", 10.0), ("pinhole", 1e7))
    )
    assert (near.seen == far.seen).all()
    images = [np.asarray(shade_plane(light, [brdf], view)) for view in (near, far)]
    np.testing.assert_allclose(images[0], images[1], atol=1e-5)
    assert np.abs(images[0][near.seen]).min() > 0
    assert (images[0][~near.seen] == 0).all()


@pytest.mark.parametrize("kind", ["orthographic", "pinhole"])
def test_a_texture_chooses_the_brdf(kind):
    light = random_tree(haar(), 4)
    brdfs = [random_tree(linear_spline(), 4, seed=1), random_tree(haar(), 8, seed=2)]
    view = PLANE.seen_by(camera_at(kind, 5 * PLANE.world_from_local[:, 2]))
    texture = np.array([[0, 1, 0], [1, 1, 0]])
    image = np.asarray(shade_plane(light, brdfs, view, texture))
    alone = [np.asarray(shade_plane(light, [brdf], view)) for brdf in brdfs]
    texel = np.floor(view.places * [2, 3]).astype(int)
    which = texture[tuple(texel.T)]
    assert 0 < which.mean() < 1
    expected = np.where(which[:, None] == 0, alone[0][view.seen], alone[1][view.seen])
    np.testing.assert_allclose(image[view.seen], expected, atol=EXACT)


def test_a_plane_that_is_not_seen_is_black():
    light, brdf = random_tree(haar(), 2), random_tree(haar(), 2, 1, seed=1)
    for directions in (np.zeros((0, 2)), np.zeros((1, 2))):
        nothing = PlaneView(np.zeros((3, 4), bool), np.zeros((0, 2)), directions)
        assert not np.asarray(shade_plane(light, [brdf], nothing)).any()
        assert reflected_radiance(light, brdf, np.zeros((0, 2)), directions).shape == (0, 2)
