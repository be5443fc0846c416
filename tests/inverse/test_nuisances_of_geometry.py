"""What may be wrong with cameras and the object: corrections are what really moved ones would be.

- Samples whose camera turns, or whose object moves or grows, are those that are seen when a camera
  or a sphere is really moved; rays that miss stand for no pixel.
- Bumps are the gradients of harmonics.
"""

import numpy as np
import pytest
from inverse_problems import unit
from nuisance_problems import (
    BALL,
    CENTER,
    NORMALS,
    RADIUS,
    TOLD,
    VIEWS,
    camera,
    matrix,
    observed,
    some,
)

from jaxrender.geometry import Orthographic, Pinhole, Sphere, fibonacci_sphere, observe
from jaxrender.inverse.nuisances import BUMPS, NUISANCES, bumps

EXACT = 1e-9


@pytest.mark.parametrize("kind", [Pinhole, Orthographic])
def test_tracing_again_finds_the_same(kind):
    """Too small a change to be seen, but the rays are made and traced."""
    told = TOLD._replace(observations=observed(kind))
    found = some(object=[1e-14, 0, 0]).observations(told)
    for part in ("samples", "places"):
        for mended, before in zip(getattr(found, part), getattr(told.observations, part)):
            np.testing.assert_allclose(mended, before, atol=EXACT)
    np.testing.assert_array_equal(found.stands_for, 2.0)


MOVES = {
    "camera": {"camera": 0.004 * np.arange(1, 10).reshape(3, 3) * [1, -1, 1]},
    "object": {"object": [0.03, -0.05, 0.02]},
    "scale": {"scale": [0.04]},
    "all": {"camera": np.full((3, 3), 0.01), "object": [0.02, 0.03, -0.04], "scale": [-0.03]},
}


def really(corrections, kind):
    """See a sphere that was moved, from cameras that were turned, at the pixels of the samples."""
    sphere = Sphere(CENTER + RADIUS * corrections.object, RADIUS * np.exp(corrections.scale[0]))
    found = []
    for number in range(VIEWS):
        turned = camera(number, kind, matrix(corrections.camera[number]))
        found.append(observe(turned, sphere))
    return sphere, found


@pytest.mark.parametrize(
    ("kind", "moves"),
    [*((Pinhole, moves) for moves in MOVES), (Orthographic, "camera"), (Orthographic, "object")],
)
def test_samples_are_those_of_a_camera_or_an_object_that_really_moved(kind, moves):
    told = TOLD._replace(observations=observed(kind))
    corrections = some(**MOVES[moves])
    found = corrections.observations(told)
    sphere, views = really(corrections, kind)
    kept = found.stands_for > 0
    assert np.mean(kept) > 0.9
    row, column = found.pixel[kept].T
    for number, view in enumerate(views):
        mine = found.frame[kept] == number
        at = row[mine], column[mine]
        for name in ("normals", "outgoing"):
            wanted = getattr(view, name)[at]
            np.testing.assert_allclose(getattr(found.samples, name)[kept][mine], wanted, atol=EXACT)
        # The object that was told stands for the one that moved.
        wanted = CENTER + (view.points[at] - sphere.center) * RADIUS / sphere.radius
        np.testing.assert_allclose(found.places.points[kept][mine], wanted, atol=EXACT)
        mended = corrections.camera_of(camera(number, kind), number, BALL)
        np.testing.assert_allclose(found.eyes[number], mended.position, atol=EXACT)
        seen = corrections.view(camera(number, kind), number, BALL)
        np.testing.assert_array_equal(seen.hit, view.hit)
        np.testing.assert_allclose(seen.normals, view.normals, atol=EXACT)
        np.testing.assert_allclose(seen.outgoing, view.outgoing, atol=EXACT)
    np.testing.assert_array_equal(found.radiance, told.observations.radiance)


def test_rays_that_miss_or_graze_stand_for_no_pixel():
    corrections = some(object=[0.0, 0.0, 0.3])
    told, found = TOLD.observations, corrections.observations(TOLD)
    _, views = really(corrections, Pinhole)
    row, column = told.pixel.T
    exits = np.array([views[f].exit_cosines[r, c] for f, r, c in zip(told.frame, row, column)])
    missed = exits <= 0.5 * np.min(told.samples.exit_cosines)
    assert 0.05 < np.mean(missed) < 0.95
    # Some miss the sphere, and some see it, but graze it.
    assert np.any(exits[missed] > 0)
    np.testing.assert_array_equal(found.stands_for, np.where(missed, 0.0, 2.0))
    for part in ("samples", "places"):
        for mended, before in zip(getattr(found, part), getattr(told, part)):
            np.testing.assert_array_equal(mended[missed], before[missed])
    assert np.all(found.samples.exit_cosines > 0)


def test_normals_are_bent_in_samples_and_in_views_alike():
    height = 0.03
    corrections = some(normals=height * (np.arange(BUMPS) == 1))
    found = corrections.observations(TOLD)
    told = np.asarray(TOLD.observations.samples.normals)
    # The displacement is height times Y_10, which is sqrt(3 / 4 pi) z.
    gradient = np.sqrt(3 / (4 * np.pi)) * (np.array([0.0, 0, 1]) - told[:, 2:] * told)
    np.testing.assert_allclose(found.samples.normals, unit(told - height * gradient), atol=1e-8)
    np.testing.assert_array_equal(found.samples.outgoing, TOLD.observations.samples.outgoing)
    for number in range(VIEWS):
        view, mine = corrections.view(camera(number), number, BALL), found.frame == number
        at = tuple(found.pixel[mine].T)
        np.testing.assert_allclose(view.normals[at], found.samples.normals[mine], atol=EXACT)
        exits = np.sum(view.normals * view.outgoing, axis=-1)
        np.testing.assert_allclose(view.exit_cosines, exits, atol=EXACT)
        assert not view.normals[~view.hit].any()


def test_bumps_are_gradients_of_harmonics():
    normals = np.vstack([NORMALS, np.eye(3), -np.eye(3)])
    found = bumps(normals)
    assert found.shape == (BUMPS, len(normals), 3)
    np.testing.assert_allclose(np.einsum("hsi,si->hs", found, normals), 0, atol=1e-8)
    # Y_1-1, Y_10, Y_11 are sqrt(3 / 4 pi) times y, z, x.
    for number, axis in enumerate(np.eye(3)[[1, 2, 0]]):
        gradient = axis - (normals @ axis)[:, None] * normals
        wanted = np.sqrt(3 / (4 * np.pi)) * gradient
        np.testing.assert_allclose(found[number], wanted, atol=1e-8)
    # The squared gradients of all harmonics of one degree l add up to l (l + 1) (2 l + 1) / 4 pi.
    squares = np.sum(found**2, axis=-1)
    for degree in range(1, 5):
        whole = squares[degree**2 - 1 : (degree + 1) ** 2 - 1].sum(axis=0)
        wanted = degree * (degree + 1) * (2 * degree + 1) / (4 * np.pi)
        np.testing.assert_allclose(whole, wanted, rtol=1e-6)


def test_bumps_of_the_prior_turn_normals_by_one_degree():
    """Root mean square over the sphere, of bumps drawn at random."""
    normals = np.asarray(fibonacci_sphere(500), float)
    deviations = NUISANCES["normals"].deviations(BUMPS)
    turned = np.mean(np.sum(bumps(normals) ** 2, axis=-1), axis=1) @ deviations**2
    assert np.degrees(np.sqrt(turned)) == pytest.approx(1.0, rel=0.02)
