"""Pinned down: the light that chrome balls show, from cameras near them.

The photographs are traced ray by ray, with noise of 1 %.

- The ball is found by its outline to a thousandth of its radius, though that is an ellipse.
- Three views merged give the light to degree 10 within 2 %, better than any of them, and a lamp
  within 0.3 degrees; their errors are of the size that is stated.
- A distant camera is the limit of a near one, and one that takes a near one for distant is wrong.
- What is straight behind the ball is not shown, and nor is what the camera covers.
- A wrong pose shows itself: the views disagree.
- Filling solves Laplace's equation, over a pole too.
"""

import numpy as np
import pytest
from ball_photographs import CENTRE, RADIUS, cameras, photographed

from jaxrender.geometry import Orthographic, Pinhole, look_at
from jaxrender.harmonics import LatLongGrid
from jaxrender.imaging import Circle, circle_of
from jaxrender.lighting import (
    Ball,
    Environment,
    Evidence,
    SmoothLobes,
    ball_of_circle,
    ball_of_mask,
    fill_smoothly,
    light_of_ball,
    merge_views,
    view_of_ball,
)
from jaxrender.lighting.ball_views import _Sight
from jaxrender.spectra import light_coefficients

RANDOM = np.random.default_rng(0)
MIDDLES = RANDOM.normal(size=(20, 3))
MIDDLES /= np.linalg.norm(MIDDLES, axis=1, keepdims=True)
LAMP = np.array([0.36, 0.48, 0.8])
LIGHT = SmoothLobes(
    np.concatenate([MIDDLES, LAMP[None]]),
    np.append(np.radians(RANDOM.uniform(12, 60, 20)), np.radians(2.5)),
    np.concatenate([RANDOM.uniform(0.1, 1, (20, 3)), [[30.0, 30.0, 30.0]]]),
)
ROWS = 64


def radiance_of(directions):
    found = np.asarray(LIGHT.radiance(directions.reshape(-1, 3)))
    return found.reshape(*directions.shape[:-1], 3)


@pytest.fixture(scope="module")
def photographs():
    rng = np.random.default_rng(1)
    taken = []
    for camera in cameras():
        clean, coverage = photographed(camera, radiance_of)
        noise = 0.01 * clean * rng.normal(size=clean.shape)
        taken.append((camera, clean + noise, 0.01 * clean, coverage))
    return taken


@pytest.fixture(scope="module")
def views(photographs):
    return [
        view_of_ball(picture, camera, Ball(CENTRE, RADIUS), ROWS, Evidence(deviation))
        for camera, picture, deviation, _ in photographs
    ]


@pytest.fixture(scope="module")
def truth():
    fine = radiance_of(LatLongGrid(4 * ROWS, 8 * ROWS).directions())
    return Environment(fine)


def texels(truth):
    return np.asarray(truth.radiance).reshape(ROWS, 4, 2 * ROWS, 4, 3).mean(axis=(1, 3))


def test_the_ball_by_its_outline(photographs):
    for camera, _, _, coverage in photographs:
        found = ball_of_mask(coverage, camera, RADIUS)
        assert np.linalg.norm(found.centre - CENTRE) < 1e-3 * RADIUS
        # The middle of the outline is not the middle of the ball.
        circle = circle_of(coverage)
        rough = ball_of_circle(circle, camera, RADIUS)
        assert np.linalg.norm(rough.centre - CENTRE) < 0.1 * RADIUS


def error(found, truth):
    own, other = (np.asarray(light_coefficients(light, 10)) for light in (found, truth))
    return np.linalg.norm(own - other) / np.linalg.norm(other)


def test_three_views_merged(views, truth):
    merged = merge_views(views)
    assert merged.confidence.min() > 0.2
    assert merged.disagreement < 0.05
    # The quadrature of few rows takes the lamp for as wide as its texels: that is not the light's.
    rough = Environment(texels(truth))
    assert error(Environment(merged.radiance), rough) < 0.02
    alone = [
        error(Environment(fill_smoothly(one.radiance, one.confidence > 0.15)), rough)
        for one in views
    ]
    assert error(Environment(merged.radiance), rough) < 0.5 * min(alone)


def test_a_lamp_is_where_it_is(views):
    radiance = merge_views(views).radiance.mean(axis=-1)
    directions = LatLongGrid(ROWS, 2 * ROWS).directions()
    near = directions @ LAMP > np.cos(np.radians(9))
    energy = (radiance - np.median(radiance[near])) * LatLongGrid(ROWS, 2 * ROWS).weights()
    centre = energy[near] @ directions[near]
    assert centre @ LAMP / np.linalg.norm(centre) > np.cos(np.radians(0.3))


def test_errors_are_of_the_stated_size(views, truth):
    merged = merge_views(views)
    # Away from the lamp, whose edge is sharper than a texel.
    calm = LatLongGrid(ROWS, 2 * ROWS).directions() @ LAMP < np.cos(np.radians(15))
    calm &= merged.confidence > 0.5
    scaled = np.abs(merged.radiance - texels(truth))[calm] / merged.deviation[calm]
    assert 0.3 < np.median(scaled) / 0.6745 < 1.2


def test_views_of_one_kind_halve_the_variance(views):
    one = views[0]
    both = merge_views([one, one])
    seen = one.confidence > 0.01
    np.testing.assert_allclose(both.radiance[seen], one.radiance[seen])
    np.testing.assert_allclose(both.deviation[seen], one.deviation[seen] / np.sqrt(2))


def test_places_and_cosines_are_those_of_rays():
    """Rays to random points of the ball, mirrored there, show where the eye sees them."""
    rng, camera = np.random.default_rng(3), cameras()[0]
    sight = _Sight.of(camera, Ball(CENTRE, RADIUS))
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = CENTRE + RADIUS * normals
    towards = camera.position - points
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    cosines = np.sum(towards * normals, axis=1)
    seen = cosines > 0.05
    mirrored = 2 * cosines[:, None] * normals - towards
    found = sight.of_directions(mirrored[seen])
    np.testing.assert_allclose(found.cosines, cosines[seen], atol=1e-9)
    np.testing.assert_allclose(found.places[::-1].T, camera.project(points[seen]), atol=1e-6)
    assert found.visible.all()


def test_a_near_camera_is_not_a_distant_one(photographs, views, truth):
    camera, picture, _, coverage = photographs[0]
    as_distant = light_of_ball(picture, circle_of(coverage), camera.world_from_camera, ROWS)
    both = (views[0].confidence > 0.5) & (as_distant.confidence > 0.5)
    wrong = np.asarray(as_distant.environment.radiance)[both] - texels(truth)[both]
    right = views[0].radiance[both] - texels(truth)[both]
    assert np.median(np.abs(wrong)) > 4 * np.median(np.abs(right))


def test_a_distant_camera_is_the_limit_of_a_near_one():
    pose = look_at(CENTRE + np.array([0, -4000.0, 0]), CENTRE, np.array([0.0, 0, 1]))
    near = Pinhole(90, 90, pose, fl_x=35.0 / RADIUS * 4000)
    distant = Orthographic(90, 90, pose, scale=RADIUS / 35)
    picture, _ = photographed(near, radiance_of)
    ball = Ball(CENTRE, RADIUS)
    one, other = (view_of_ball(picture, camera, ball, 24) for camera in (near, distant))
    np.testing.assert_allclose(one.radiance, other.radiance, rtol=0.02, atol=0.01)
    np.testing.assert_allclose(one.confidence, other.confidence, atol=0.01)
    # The distant ball of a circle is the same ball.
    found = ball_of_circle(Circle(45.0, 45.0, 35.0, 0.0, 1.0), distant)
    assert found.radius == pytest.approx(RADIUS)
    np.testing.assert_allclose(view_of_ball(picture, distant, found, 24).radiance, other.radiance)
    aside = ball_of_circle(Circle(40.0, 50.0, 9.0, 0.0, 1.0), distant)
    np.testing.assert_allclose(distant.project(aside.centre[None]), [[50, 40]])


def test_what_stands_behind_the_ball_is_no_light():
    camera = cameras()[0]
    picture, _ = photographed(camera, radiance_of, background=1e4)
    view = view_of_ball(picture, camera, Ball(CENTRE, RADIUS), ROWS)
    assert view.radiance.max() < 40


def test_what_is_not_shown(photographs):
    camera, picture, _, _ = photographs[0]
    ball = Ball(CENTRE, RADIUS)
    view = view_of_ball(picture, camera, ball, ROWS, camera_angle=np.radians(12))
    towards = camera.position - CENTRE
    nearness = RADIUS / np.linalg.norm(towards)
    along = LatLongGrid(ROWS, 2 * ROWS).directions() @ towards / np.linalg.norm(towards)
    angles = np.degrees(np.arccos(along))
    texel = 180 / ROWS
    assert (view.confidence[angles < 12 - texel] == 0).all()
    assert (view.confidence[(angles > 12 + texel) & (angles < 90)] > 0.6).all()
    behind = 180 - np.degrees(np.arcsin(nearness))
    assert (view.confidence[angles > behind + texel] == 0).all()
    usable = np.zeros(picture.shape[:2], bool)
    with pytest.raises(ValueError, match="no usable pixel lies on the ball"):
        view_of_ball(picture, camera, ball, ROWS, Evidence(None, usable))


def test_a_wrong_pose_shows_itself(photographs, views):
    camera, picture, _, _ = photographs[0]
    pose = camera.world_from_camera.copy()
    turn = np.array([[0.98, -0.199, 0], [0.199, 0.98, 0], [0, 0, 1]])
    pose[:3, :3], pose[:3, 3] = turn @ pose[:3, :3], turn @ (pose[:3, 3] - CENTRE) + CENTRE
    turned = Pinhole(camera.width, camera.height, pose, fl_x=camera.fl_x)
    wrong = view_of_ball(picture, turned, Ball(CENTRE, RADIUS), ROWS)
    assert merge_views([wrong, *views[1:]]).disagreement > 5 * merge_views(views).disagreement


def test_reflectance_divides(photographs):
    camera, picture, deviation, _ = photographs[0]
    ball, evidence = Ball(CENTRE, RADIUS), Evidence(deviation)
    whole = view_of_ball(picture, camera, ball, 16, evidence)
    half = view_of_ball(picture, camera, ball, 16, evidence, reflectance=0.5)
    np.testing.assert_allclose(half.radiance, 2 * whole.radiance)
    np.testing.assert_allclose(half.deviation, 2 * whole.deviation)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c, p: view_of_ball(p[:9], c, Ball(CENTRE, RADIUS)), "a photograph of 140 x 9 pix"),
        (lambda c, p: view_of_ball(p, c, Ball(c.position, RADIUS)), "it must stand outside"),
        (lambda c, p: view_of_ball(p, c, Ball(CENTRE, RADIUS), reflectance=0.0), "reflectance=0"),
        (lambda c, p: ball_of_mask(np.ones((9, 9)), c), "a mask of 9 x 9 pixels and a camera"),
        (lambda c, p: ball_of_circle(Circle(70.0, 70, 9, 0, 1), c, -1.0), "radius=-1"),
        (lambda c, p: merge_views([]), "no views given"),
        (lambda c, p: fill_smoothly(p, np.zeros(p.shape[:2], bool)), "no direction was seen"),
    ],
)
def test_what_is_no_view(photographs, call, message):
    with pytest.raises(ValueError, match=message):
        call(photographs[0][0], photographs[0][1])


def test_filling_solves_laplace():
    directions = LatLongGrid(48, 96).directions()
    # Stereographic coordinates are harmonic on the sphere.  The hole holds a pole.
    hole = directions @ np.array([0.1, 0.0, 0.995]) > np.cos(np.radians(20))
    stereographic = directions[..., :2] / (1 + directions[..., 2:])
    true = 2 + np.where(directions[..., 2:] > 0, stereographic, 0)
    filled = fill_smoothly(np.where(hole[..., None], 100.0, true), ~hole)
    np.testing.assert_array_equal(filled[~hole], true[~hole])
    assert np.abs(filled - true)[hole].max() < 2e-3
