"""The three-sphere protocol.

- A uniform light makes a white diffuse sphere and a mirror of one value; a single bright texel is
  mirrored where the law of reflection says.
- Differences are those of the definitions: a brighter light, a turned one, a tinted one.
"""

import numpy as np
import pytest

from jaxrender.lighting import Environment
from jaxrender.reflection import compare_lights, three_spheres

SIDE = 64
ACROSS, DOWN = (np.mgrid[:SIDE, :SIDE][::-1] + 0.5) / (SIDE / 2) - 1
INSIDE = ACROSS**2 + DOWN**2 < 1


def cloudy(seed=0, rows=32):
    rng = np.random.default_rng(seed)
    return Environment(0.2 + rng.uniform(size=(rows, 2 * rows, 3)))


@pytest.fixture(scope="module")
def lights():
    return cloudy(0), cloudy(1)


def test_a_uniform_light_is_white_and_mirrored():
    spheres = three_spheres(Environment(np.full((32, 64, 3), 2.0)))
    assert set(spheres) == {"diffuse", "matte silver", "mirror"}
    np.testing.assert_allclose(spheres["diffuse"][INSIDE], 2, rtol=2e-2)
    np.testing.assert_allclose(spheres["mirror"][INSIDE], 2, rtol=1e-12)
    silver = spheres["matte silver"][INSIDE]
    assert 1 < silver.min() < silver.max() < 2


@pytest.mark.parametrize("towards", [[0.6, 0.0, 0.8], [0.3, 0.9, -0.2], [-0.5, -0.6, 0.6]])
def test_the_mirror_shows_a_source_where_it_reflects(towards):
    rows = 64
    polar, azimuth = np.arccos(towards[2] / np.linalg.norm(towards)), np.arctan2(*towards[1::-1])
    at = int(polar * rows / np.pi), int(azimuth % (2 * np.pi) * rows / np.pi)
    radiance = np.zeros((rows, 2 * rows, 3))
    nearby = np.arange(-2, 3)
    radiance[np.ix_(at[0] + nearby, (at[1] + nearby) % (2 * rows))] = 1
    shown = three_spheres(Environment(radiance))["mirror"].sum(axis=-1)
    # The camera looks along -x with z up: its picture has y to the right.
    places = np.stack([ACROSS, -DOWN], axis=-1)
    place = np.average(places[INSIDE], axis=0, weights=shown[INSIDE])
    polar, azimuth = ((index + 0.5) * np.pi / rows for index in at)
    sine = np.sin(polar)
    half = np.array([sine * np.cos(azimuth) + 1, sine * np.sin(azimuth), np.cos(polar)])
    np.testing.assert_allclose(place, half[1:] / np.linalg.norm(half), atol=0.006)


def test_brightness_and_colour(lights):
    one, _ = lights
    spheres = three_spheres(one)
    for name, difference in compare_lights(one.scaled(3.0), one).items():
        values = spheres[name][INSIDE]
        assert difference.rms == pytest.approx(2 * np.sqrt(np.mean(values**2)) / values.mean())
        assert difference.scaled_rms == pytest.approx(0, abs=1e-9)
        assert difference.angle == pytest.approx(0, abs=1e-4)
    red = Environment(np.asarray(one.radiance) * np.array([2.0, 1.0, 1.0]))
    tinted = compare_lights(red, one)
    # From (1, 1, 1) to (2, 1, 1) are 19.5 degrees; the light is nearly grey.
    assert tinted["diffuse"].angle == pytest.approx(19.47, abs=0.5)
    for difference in compare_lights(red, one, scale_channels=True).values():
        assert difference.angle == pytest.approx(0, abs=1e-4)
        assert difference.rms == pytest.approx(0, abs=1e-9)


def test_sharper_spheres_tell_lights_apart_better(lights):
    found = compare_lights(*lights)
    ordered = [found[name].scaled_rms for name in ("diffuse", "matte silver", "mirror")]
    assert ordered[0] < ordered[1] < ordered[2]


def test_a_large_panorama_is_that_of_its_means(lights):
    one, _ = lights
    fine = Environment(np.asarray(one.radiance).repeat(8, axis=0).repeat(8, axis=1))
    for difference in compare_lights(fine, one).values():
        assert difference.rms < 0.1


def test_a_lamp_of_one_texel_is_as_bright_in_any_panorama():
    radiance = np.full((32, 64, 3), 0.2)
    radiance[9, 20] = 50.0
    fine = np.full((64, 128, 3), 0.2)
    fine[18:20, 40:42] = 50.0
    for difference in compare_lights(Environment(fine), Environment(radiance)).values():
        assert difference.rms < 0.05


def test_darkness_is_refused(lights):
    with pytest.raises(ValueError, match="the true light is dark"):
        compare_lights(lights[0], Environment(np.zeros((4, 8, 3))))
