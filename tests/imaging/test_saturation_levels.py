"""Where sensors saturate, found from the values of photographs.

- Each channel of each photograph has its own level; none is found without a pile at the top.
- Compression spreads the pile: all of it is above the level, and little of the rest.
- A few clipped pixels of one photograph are known by the level of another.
"""

import numpy as np
import pytest

from jaxrender.imaging import clipped_at, saturation_levels

RNG = np.random.default_rng(5)
SCENE = RNG.gamma(2.0, 0.3, (80, 90, 3))


def test_every_channel_and_photograph_has_a_level_of_its_own():
    sensor = np.array([1.9, 1.0, 1.4])
    found = saturation_levels([np.minimum(SCENE, sensor), np.minimum(2 * SCENE, 1.3), SCENE])
    np.testing.assert_allclose(found[0], sensor)
    np.testing.assert_allclose(found[1], 1.3)
    assert np.isinf(found[2]).all()


def test_quantised_values_that_are_not_clipped_have_no_level():
    codes = np.round(255 * SCENE / SCENE.max()) / 255
    assert clipped_at(codes) is None
    assert clipped_at(np.round(255 * np.minimum(1.7 * SCENE / SCENE.max(), 0.9)) / 255) == (
        pytest.approx(230 / 255)
    )


def test_a_spread_pile_is_found_whole():
    """JPEG leaves the clipped part within a few steps of its top."""
    clipped = SCENE > 1.0
    spread = RNG.choice([0, 1, 2], SCENE.shape, p=[0.6, 0.3, 0.1])
    codes = np.where(clipped, 250 - spread, np.round(245 * np.minimum(SCENE, 1)))
    level = clipped_at(codes / 255)
    assert level == pytest.approx(248 / 255, rel=1e-4)
    assert (codes[clipped] / 255 >= level).all()
    assert not (codes[~clipped] / 255 >= level).any()


def test_a_few_clipped_pixels_are_known_by_another_photograph():
    first = np.minimum(SCENE, 1.1)
    few = np.minimum(0.3 * SCENE / SCENE.max(), 1.1)
    few[:2, 0, 1] = 1.1
    found = saturation_levels([first, few])
    np.testing.assert_allclose(found[1], [np.inf, 1.1, np.inf])


def test_one_value_and_nothing_have_no_level():
    assert clipped_at(np.full(100, 0.7)) is None
    assert clipped_at(np.zeros(100)) is None
    assert clipped_at(np.zeros(0)) is None
