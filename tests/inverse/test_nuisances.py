"""What may be wrong with a capture: corrections are what a capture that is really wrong would be.

- Corrections of nothing change nothing; pixels and radiance undo each other; steps add up, and
  rotations follow upon each other.
- Samples whose camera turns, or whose object moves or grows, are those that are seen when a camera
  or a sphere is really moved; rays that miss stand for no pixel.
- A turned environment is its turned image; sources turn and brighten group by group; near ones are
  E cos t (D / r)^2 from where they stand.
- Bumps are the gradients of harmonics.
- Every nuisance has one name in the fit, in configs, in recipes and in the diagnosis.
"""

from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxrender.geometry import (
    Orthographic,
    Pinhole,
    Sphere,
    SurfacePlaces,
    SurfaceSamples,
    fibonacci_sphere,
    look_at,
    observe,
)
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.diagnosis.causes import CAUSES
from jaxrender.inverse.known_light import exact_nodes
from jaxrender.inverse.near_light import Nearness
from jaxrender.inverse.nuisances import (
    BUMPS,
    NUISANCES,
    Corrections,
    Softening,
    Told,
    bumps,
    rotation,
    source_groups,
)
from jaxrender.lighting import DirectionalSources, Environment, LightNodes
from jaxrender.pipelines.config.nuisances import FaultsConfig, NuisanceName

# Neither about the origin nor of size one: lengths are relative to the object.
CENTER, RADIUS = np.array([0.3, -0.2, 0.1]), 0.7
BALL = Sphere(CENTER, RADIUS)
SIZE, VIEWS = 12, 3
# Cameras do not look at the middle of the object.
AIM = np.array([0.05, 0.02, 0.1])
LEAST = 0.3
EXACT = 1e-9


def camera(number, kind=Pinhole, turn=((1, 0, 0), (0, 1, 0), (0, 0, 1))):
    azimuth = 2 * np.pi * number / VIEWS + 0.2
    towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.4 - 0.3 * number])
    pose = look_at(CENTER + 3 * towards, CENTER + AIM, np.array([0.0, 0, 1]))
    pose[:3, :3] = np.array(turn, float) @ pose[:3, :3]
    if kind is Orthographic:
        return Orthographic(SIZE, SIZE, pose, scale=2.2 * RADIUS / SIZE)
    return Pinhole(SIZE, SIZE, pose, fl_x=1.9 * SIZE)


def observed(kind=Pinhole):
    """List what the cameras see of the ball; radiance is any."""
    cameras = [camera(number, kind) for number in range(VIEWS)]
    views = [observe(one, BALL) for one in cameras]
    usable = [view.exit_cosines > LEAST for view in views]

    def gathered(name):
        return np.concatenate([getattr(v, name)[u] for v, u in zip(views, usable)])

    frame = np.repeat(np.arange(VIEWS), [np.count_nonzero(u) for u in usable])
    return Observations(
        SurfaceSamples(gathered("normals"), gathered("outgoing")),
        np.random.default_rng(0).uniform(0.1, 2, (len(frame), 3)),
        frame,
        SurfacePlaces(gathered("points"), gathered("geometric_normals")),
        stands_for=np.full(len(frame), 2.0),
        pixel=np.concatenate([np.argwhere(u) for u in usable]),
        eyes=np.stack([one.position for one in cameras]),
    )


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def environment(rows=32):
    """Make a few smooth lobes, none about an axis of the image."""
    directions = Environment(np.ones((rows, 2 * rows, 1))).grid.directions()
    axes = unit(np.array([[0.8, 0.3, 0.5], [-0.5, 0.6, -0.6], [0.1, -0.9, 0.4]]))
    return Environment(np.exp(3 * (directions @ axes.T - 1)) @ np.diag([1.0, 2.0, 3.0]) + 0.1)


# The second is dark, and so in no group.
LAMPS = DirectionalSources(
    unit(np.array([[0.5, 0.6, 0.6], [0.0, 1.0, 0.2], [-0.3, 0.1, 0.9]])),
    np.array([[2.0, 1.8, 1.6], [0.0, 0.0, 0.0], [0.5, 0.6, 0.7]]),
)
# As many as there are photographs, one with two sources.
OWN = (
    DirectionalSources(unit(np.array([[0.9, -0.1, 0.3]])), np.full((1, 3), 1.1)),
    DirectionalSources(
        unit(np.array([[0.1, 0.9, 0.3], [0.4, 0.4, 0.8]])), np.array([[0.4] * 3, [0.9] * 3])
    ),
    DirectionalSources(unit(np.array([[-0.9, -0.1, 0.5]])), np.full((1, 3), 0.7)),
)
LIGHT = KnownLight(environment(), LAMPS, OWN)
TOLD = Told(observed(), LIGHT, BALL)
NOTHING = Corrections.none(TOLD)
GROUPS = 3


def some(**given):
    """Make corrections, from numbers of any layout."""
    now = NOTHING
    for name, numbers in given.items():
        now = now.moved(name, np.asarray(numbers, float).ravel())
    return now


def matrix(vector):
    return Rotation.from_rotvec(np.asarray(vector, float)).as_matrix()


# ---------------------------------------------------------------- pixels


def test_nothing_wrong_changes_nothing():
    found, light = NOTHING.observations(TOLD), NOTHING.light(TOLD)
    np.testing.assert_array_equal(found.radiance, TOLD.observations.radiance)
    for name in ("normals", "outgoing"):
        np.testing.assert_array_equal(
            getattr(found.samples, name), getattr(TOLD.observations.samples, name)
        )
    np.testing.assert_array_equal(found.stands_for, TOLD.observations.stands_for)
    assert light.turn is None
    assert light.near is None
    assert light.environment is LIGHT.environment
    for mended, told in zip((light.directional, *light.per_frame), (LAMPS, *OWN)):
        np.testing.assert_allclose(mended.directions, told.directions, atol=1e-15)
        np.testing.assert_allclose(mended.irradiance, told.irradiance)
    pose = NOTHING.camera_of(camera(1), 1, BALL).world_from_camera
    np.testing.assert_allclose(pose, camera(1).world_from_camera, atol=1e-15)
    radiance = TOLD.observations.radiance
    np.testing.assert_allclose(NOTHING.photographed(radiance, 1), radiance)
    assert NOTHING.level == pytest.approx(np.sqrt(np.mean(radiance**2)))
    for name in NUISANCES:
        numbers = NOTHING.of(name)
        assert not numbers.any()
        np.testing.assert_array_equal(NOTHING.moved(name, numbers).of(name), numbers)


@pytest.mark.parametrize("kind", [Pinhole, Orthographic])
def test_tracing_again_finds_the_same(kind):
    """Too small a change to be seen, but the rays are made and traced."""
    told = TOLD._replace(observations=observed(kind))
    found = some(object=[1e-14, 0, 0]).observations(told)
    for part in ("samples", "places"):
        for mended, before in zip(getattr(found, part), getattr(told.observations, part)):
            np.testing.assert_allclose(mended, before, atol=EXACT)
    np.testing.assert_array_equal(found.stands_for, 2.0)


WRONG_PIXELS = {"exposure": [0.1, -0.2, 0.05], "black": [0.02, -0.01, 0.1], "response": [-0.2]}


@pytest.mark.parametrize("names", [("exposure",), ("black",), ("response",), tuple(WRONG_PIXELS)])
def test_pixels_are_gain_and_black_to_a_power_and_are_undone(names):
    corrections = some(**{name: WRONG_PIXELS[name] for name in names})
    told = TOLD.observations
    zero = {name: 0 * np.array(numbers) for name, numbers in WRONG_PIXELS.items()}
    wrong = zero | {name: np.array(WRONG_PIXELS[name]) for name in names}
    gains = np.exp(wrong["exposure"])[told.frame][:, None]
    level = np.sqrt(np.mean(told.radiance**2))
    pixels = (told.radiance * gains + level * wrong["black"]) ** np.exp(wrong["response"])
    for number in range(VIEWS):
        mine = told.frame == number
        made = corrections.photographed(told.radiance[mine], number)
        np.testing.assert_allclose(made, pixels[mine])
    mended = corrections.observations(TOLD._replace(observations=told._replace(radiance=pixels)))
    np.testing.assert_allclose(mended.radiance, told.radiance)


def test_a_blur_mixes_what_is_seen_and_is_taken_off_inside():
    rng = np.random.default_rng(5)
    image, seen = rng.uniform(1, 2, (24, 24, 3)), np.zeros((24, 24), bool)
    seen[4:, 6:] = True
    corrections = some(blur=[0.8])
    # What is seen is as bright everywhere: it stays so up to its rim.
    even = corrections.photographed(np.where(seen[..., None], np.ones(3), 9), 0, seen)
    np.testing.assert_allclose(even[seen], 1)
    made = corrections.photographed(image, 0)
    assert np.var(made[8:16, 8:16]) < 0.3 * np.var(image)
    # One photograph, some of whose samples lie beside the rim.
    told, inside = TOLD.observations, np.arange(TOLD.observations.count) % 3 > 0
    added = rng.normal(size=told.radiance.shape)
    soft = told._replace(radiance=told.radiance + 0.8 * added)
    mended = corrections.observations(
        TOLD._replace(observations=soft, softening=Softening(added, inside))
    )
    np.testing.assert_allclose(mended.radiance, told.radiance)
    np.testing.assert_array_equal(mended.pixels, told.pixels * inside)


def test_pixels_below_black_are_of_no_light():
    corrections = some(black=[-0.5, -0.5, -0.5], response=[0.1])
    assert not corrections.photographed(np.full((1, 3), 0.01), 0).any()


# ---------------------------------------------------------------- steps


@pytest.mark.parametrize("name", ["camera", "environment", "lamps"])
def test_rotations_follow_upon_each_other(name):
    rng = np.random.default_rng(3)
    shape = getattr(NOTHING, name).shape
    first, second = 0.6 * rng.normal(size=(2, *shape))
    twice = NOTHING.moved(name, first.ravel()).moved(name, second.ravel())
    rows = zip(*(np.atleast_2d(part) for part in (first, second, getattr(twice, name))))
    for one, other, both in rows:
        expected = matrix(other[:3]) @ matrix(one[:3])
        np.testing.assert_allclose(rotation(both[:3]), expected, atol=1e-12)
        # The brightness of sources adds up.
        np.testing.assert_allclose(both[3:], one[3:] + other[3:])


def test_all_else_adds_up():
    rng = np.random.default_rng(4)
    for name in NUISANCES.keys() - {"camera", "environment", "lamps"}:
        first, second = rng.normal(size=(2, len(NOTHING.of(name))))
        twice = NOTHING.moved(name, first).moved(name, second)
        np.testing.assert_allclose(twice.of(name), first + second)
        others = [other for other in NUISANCES if other != name]
        assert not any(twice.of(other).any() for other in others)


# ---------------------------------------------------------------- cameras and the object


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


# ---------------------------------------------------------------- light


NORMALS = unit(np.random.default_rng(7).normal(size=(20, 3)))
TURN = np.array([0.4, -0.3, 0.5])


def received(nodes, normals, seen_from=None):
    """Sum irradiance times cosine at each normal; of nodes of its own each normal has a frame."""
    if isinstance(nodes, LightNodes):
        cosines = np.maximum(normals @ np.asarray(nodes.directions).T, 0)
        return cosines @ np.asarray(nodes.irradiance)
    frame = np.asarray(nodes.frame_of_sample)
    directions, irradiance = (np.asarray(part)[frame] for part in nodes[:2])
    cosines = np.maximum(np.einsum("si,sni->sn", normals, directions), 0)
    return np.einsum("sn,snc->sc", cosines, irradiance)


def test_a_turned_environment_is_its_image_turned():
    alone = TOLD._replace(light=KnownLight(environment(), DirectionalSources.none()))
    told = alone.light
    light = Corrections.none(alone).moved("environment", TURN).light(alone)
    np.testing.assert_array_equal(light.environment.radiance, told.environment.radiance)
    frame = np.zeros(len(NORMALS), int)
    (before,), (turned,) = (exact_nodes(one, frame, 0.2) for one in (told, light))
    # What a normal received, the turned normal receives, up to rounding.
    expected = received(before, NORMALS)
    np.testing.assert_allclose(received(turned, NORMALS @ matrix(TURN).T), expected, rtol=1e-12)
    assert light.upright.turn is None
    (upright,) = exact_nodes(light.upright, frame, 0.2)
    np.testing.assert_allclose(received(upright, NORMALS @ matrix(TURN).T), expected, rtol=0.01)
    # It is no light that is the same from everywhere.
    assert np.ptp(expected[:, 0]) > 0.5 * np.mean(expected[:, 0])
    (coarse,) = exact_nodes(light, frame, 0.2, 0.5)
    assert len(coarse.directions) < len(turned.directions)
    np.testing.assert_allclose(received(coarse, NORMALS @ matrix(TURN).T), expected, rtol=0.02)


def test_sources_turn_and_brighten_group_by_group():
    lamps = np.array([[0.1, 0.2, -0.3, 0.4], [0.3, -0.1, 0.0, -0.2], [0.0, 0.2, 0.2, 0.1]])
    light = some(lamps=lamps).light(TOLD)
    assert light.turn is None
    assert light.near is None
    found = light.directional
    for group, source in ((0, 0), (1, 2)):
        direction = matrix(lamps[group, :3]) @ LAMPS.directions[source]
        np.testing.assert_allclose(found.directions[source], direction)
        bright = np.exp(lamps[group, 3]) * np.asarray(LAMPS.irradiance[source])
        np.testing.assert_allclose(found.irradiance[source], bright)
    np.testing.assert_array_equal(found.directions[1], LAMPS.directions[1])
    assert not np.any(found.irradiance[1])
    for mended, own in zip(light.per_frame, OWN):
        wanted = np.asarray(own.directions) @ matrix(lamps[2, :3]).T
        np.testing.assert_allclose(mended.directions, wanted)
        np.testing.assert_allclose(mended.irradiance, np.exp(lamps[2, 3]) * own.irradiance)


def standing(points, normals, direction, irradiance, nearness):
    """Irradiance under a source that stands somewhere, as that of the centre over distances.

    The formula again, in world units: E (D / r)^2 cos t, D from the centre and r from the point.
    """
    place = CENTER + RADIUS / nearness * np.asarray(direction)
    offset = place - points
    far = np.linalg.norm(offset, axis=1)
    cosine = np.maximum(np.sum(offset * normals, axis=1) / far, 0)
    return (cosine * (RADIUS / nearness / far) ** 2)[:, None] * np.asarray(irradiance)


def test_near_sources_are_where_they_stand():
    near = np.array([0.3, 0.1, 0.2])
    light = some(nearness=near).light(TOLD)
    told = TOLD.observations
    points, normals = told.places.points, told.samples.normals
    parts = exact_nodes(light, told.frame, 0.2, points=points)
    expected = sum(
        standing(points, normals, LAMPS.directions[k], LAMPS.irradiance[k], near[group])
        for group, k in ((0, 0), (1, 2))
    )
    own = np.zeros_like(expected)
    for number, sources in enumerate(OWN):
        mine = told.frame == number
        for direction, energy in zip(sources.directions, sources.irradiance):
            own[mine] += standing(points[mine], normals[mine], direction, energy, near[2])
    found = [received(part, normals) for part in parts]
    (environment,) = exact_nodes(KnownLight(LIGHT.environment, DirectionalSources.none()),
                                 told.frame, 0.2)  # fmt: skip
    for one, wanted in zip(found, (received(environment, normals), expected, own), strict=True):
        np.testing.assert_allclose(one, wanted, atol=1e-12)
    # A photograph alone has its own sources beside those of all.
    for number in range(VIEWS):
        mine = np.flatnonzero(told.frame == number)
        alone = light.of_frame(number)
        (both,) = alone.near_parts(0 * mine, points[mine])
        np.testing.assert_allclose(
            received(both, normals[mine]), (expected + own)[mine], atol=1e-12
        )
    with pytest.raises(ValueError, match="give points"):
        exact_nodes(light, told.frame, 0.2)


def test_sources_far_away_are_those_without_a_place():
    told, light = TOLD.observations, some(nearness=np.full(GROUPS, 1e-9)).light(TOLD)
    normals = told.samples.normals
    near = exact_nodes(light, told.frame, 0.2, points=told.places.points)
    for far in (TOLD.light, light.far):
        parts = exact_nodes(far, told.frame, 0.2)
        whole = sum(received(part, normals) for part in parts)
        np.testing.assert_allclose(sum(received(part, normals) for part in near), whole, rtol=1e-7)


@pytest.mark.parametrize("given", [([1.0], 0.0), ([-0.1], 0.0), ([0.1], 1.2)])
def test_sources_inside_the_object_or_behind_infinity_are_refused(given):
    of_sources, of_frames = given
    with pytest.raises(ValueError, match=r"a source of nearness .* less than 1"):
        Nearness(np.array(of_sources), of_frames, np.zeros(3), 1.0)


# ---------------------------------------------------------------- bumps


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


# ---------------------------------------------------------------- groups and names


def test_a_few_sources_are_groups_of_their_own_and_dark_ones_are_in_none():
    groups = source_groups(LIGHT)
    assert len(groups) == GROUPS == len(NOTHING.nearness)
    assert [None if g.index is None else g.index.tolist() for g in groups] == [[0], [2], None]
    shared, _ = groups[1].nodes(LIGHT, TOLD.observations.frame)
    np.testing.assert_array_equal(shared.directions, LAMPS.directions[2:])
    own, near = groups[2].nodes(LIGHT, TOLD.observations.frame)
    np.testing.assert_array_equal(own.frame_of_sample, TOLD.observations.frame)
    assert near.tolist() == [0.0]
    close = some(nearness=[0.3, 0.1, 0.2]).light(TOLD)
    found = [g.nodes(close, TOLD.observations.frame)[1].tolist() for g in source_groups(close)]
    assert found == [[0.3], [0.1], [0.2]]
    assert source_groups(KnownLight(environment(), DirectionalSources.none())) == ()


@pytest.mark.parametrize(("count", "groups"), [(6, 6), (7, 1)])
def test_many_sources_are_one_group(count, groups):
    directions = np.asarray(fibonacci_sphere(count), float)
    energy = np.ones((count, 3))
    light = KnownLight(None, DirectionalSources(directions, energy))
    found = source_groups(light)
    assert len(found) == groups
    assert np.concatenate([group.index for group in found]).tolist() == list(range(count))
    told = TOLD._replace(light=light)
    lamps = np.tile([0.0, 0, 0.5, 0.1], groups)
    turned = Corrections.none(told).moved("lamps", lamps).moved("nearness", np.full(groups, 0.2))
    mended = turned.light(told)
    np.testing.assert_allclose(mended.directional.directions, directions @ matrix([0, 0, 0.5]).T)
    np.testing.assert_allclose(mended.directional.irradiance, np.exp(0.1) * energy)
    np.testing.assert_allclose(mended.near.of_sources, 0.2)


def test_every_nuisance_has_one_name_everywhere():
    names = list(NUISANCES)
    assert list(get_args(NuisanceName)) == names
    assert list(FaultsConfig.model_fields) == names
    assert {name: NUISANCES[name].name for name in names} == dict(zip(names, names))
    assert list(Corrections._fields) == [*names, "level"]
    assert set(names) <= CAUSES.keys()
    assert all(CAUSES[name].name == name for name in names)


def test_numbers_are_said_in_the_units_of_a_person():
    lamps = NUISANCES["lamps"]
    two = np.array([0.01, 0.02, 0.03, 0.05, 0.0, 0.0, 0.1, -0.1])
    wanted = [*np.degrees(two[:3]), 5.0, *np.degrees(two[4:7]), -10.0]
    np.testing.assert_allclose(lamps.in_units(two), wanted)
    np.testing.assert_allclose(lamps.deviations(8), np.tile([*np.radians([1, 1, 1]), 0.1], 2))
    assert NUISANCES["nearness"].lowest == 0
