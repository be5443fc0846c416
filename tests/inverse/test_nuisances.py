"""What may be wrong with a capture: corrections are what a capture that is really wrong would be.

- Corrections of nothing change nothing; steps add up, and rotations follow upon each other.
- Every nuisance has one name in the fit, in configs, in recipes and in the diagnosis.
"""

from typing import get_args

import numpy as np
import pytest
from nuisance_problems import BALL, LAMPS, LIGHT, NOTHING, OWN, TOLD, camera, matrix

from jaxrender.inverse.diagnosis.causes import CAUSES
from jaxrender.inverse.nuisances import NUISANCES, Corrections, rotation
from jaxrender.pipelines.config.nuisances import FaultsConfig, NuisanceName


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
