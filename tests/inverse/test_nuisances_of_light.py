"""What may be wrong with light: corrections are what light that is really another would be.

- A turned environment is its turned image; sources turn and brighten group by group; near ones are
  E cos t (D / r)^2 from where they stand.
"""

import numpy as np
import pytest
from nuisance_problems import (
    CENTER,
    LAMPS,
    LIGHT,
    NORMALS,
    NOTHING,
    OWN,
    RADIUS,
    TOLD,
    VIEWS,
    environment,
    matrix,
    some,
)

from jaxrender.geometry import fibonacci_sphere
from jaxrender.inverse import KnownLight
from jaxrender.inverse.light_nodes import exact_nodes, own_sources
from jaxrender.inverse.near_light import Nearness
from jaxrender.inverse.nuisances import Corrections, source_groups
from jaxrender.lighting import DirectionalSources, LightNodes

TURN = np.array([0.4, -0.3, 0.5])
GROUPS = 3


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
    parts = exact_nodes(light, told, 0.2)
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
        mine_alone = told.take(mine)._replace(frame=0 * mine)
        both = own_sources(alone, mine_alone)
        np.testing.assert_allclose(
            received(both, normals[mine]), (expected + own)[mine], atol=1e-12
        )
    with pytest.raises(ValueError, match="give places"):
        exact_nodes(light, told.frame, 0.2)


def test_sources_far_away_are_those_without_a_place():
    told, light = TOLD.observations, some(nearness=np.full(GROUPS, 1e-9)).light(TOLD)
    normals = told.samples.normals
    near = exact_nodes(light, told, 0.2)
    for far in (TOLD.light, light.far):
        parts = exact_nodes(far, told.frame, 0.2)
        whole = sum(received(part, normals) for part in parts)
        np.testing.assert_allclose(sum(received(part, normals) for part in near), whole, rtol=1e-7)


@pytest.mark.parametrize("given", [([1.0], 0.0), ([-0.1], 0.0), ([0.1], 1.2)])
def test_sources_inside_the_object_or_behind_infinity_are_refused(given):
    of_sources, of_frames = given
    with pytest.raises(ValueError, match=r"a source of nearness .* less than 1"):
        Nearness(np.array(of_sources), np.full((1, 1), of_frames), np.zeros(3), 1.0)


def test_a_few_sources_are_groups_of_their_own_and_dark_ones_are_in_none():
    groups = source_groups(LIGHT)
    assert len(groups) == GROUPS == len(NOTHING.nearness)
    assert [None if g.index is None else g.index.tolist() for g in groups] == [[0], [2], None]
    shared, _ = groups[1].nodes(LIGHT, TOLD.observations.frame)
    np.testing.assert_array_equal(shared.directions, LAMPS.directions[2:])
    own, near = groups[2].nodes(LIGHT, TOLD.observations.frame)
    np.testing.assert_array_equal(own.frame_of_sample, TOLD.observations.frame)
    assert not near.any()
    close = some(nearness=[0.3, 0.1, 0.2]).light(TOLD)
    found = [g.nodes(close, TOLD.observations.frame)[1] for g in source_groups(close)]
    assert [np.unique(near).tolist() for near in found] == [[0.3], [0.1], [0.2]]
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
