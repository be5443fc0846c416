"""Clipped values that nobody declared.

- Those that pile up at the top are found, each photograph and channel by itself.  Quantised and
  clean ones are not, nor are a smooth maximum without noise and a photograph of one value.
- It is said in words, with the share of the pixels and the key to set.
"""

import numpy as np
import pytest
from inverse_problems import ball_samples

from jaxrender.inverse import Observations
from jaxrender.inverse.saturation import clipped_share, clipped_values, saturation_sentence


@pytest.fixture
def plain():
    samples, _ = ball_samples(600, 0.15, seed=3)
    values = np.random.default_rng(8).uniform(size=(600, 3))
    return Observations(samples, values, np.arange(600) % 3)


def test_clipped_values_are_found_and_quantised_ones_are_not(plain):
    assert not clipped_values(plain, plain).any()
    clipped = plain._replace(radiance=np.minimum(plain.radiance, 0.8))
    np.testing.assert_array_equal(clipped_values(clipped, clipped), plain.radiance >= 0.8)
    quantised = plain._replace(radiance=np.round(plain.radiance * 100) / 100)
    assert not clipped_values(quantised, quantised).any()


def test_a_smooth_maximum_without_noise_is_not_clipped(plain):
    """Many pixels about it are within any tolerance of the highest value; so are the next ones."""
    samples, _ = ball_samples(60_000, 0.15, seed=3)
    level = 1 + 0.01 * np.asarray(samples.normals) @ np.array([0.48, 0.6, 0.64])
    smooth = Observations(samples, np.tile(level[:, None], 3), np.zeros(len(level), int))
    assert np.sum(level >= level.max() * (1 - 1e-5)) > 8
    assert not clipped_values(smooth, smooth).any()
    even = smooth._replace(radiance=np.full((len(level), 3), 0.7))
    assert not clipped_values(even, even).any()


def test_each_photograph_is_clipped_at_a_value_of_its_own(plain):
    level = np.array([0.7, 0.8, 5.0])[plain.frame, None] * np.array([1.0, 0.9, 1.0])
    clipped = plain._replace(radiance=np.minimum(plain.radiance, level))
    np.testing.assert_array_equal(clipped_values(clipped, clipped), plain.radiance >= level)


def test_the_share_of_clipped_values_is_all_where_there_is_one_value(plain):
    level = np.array([0.7, 0.8, 0.9])[plain.frame, None]
    clipped = plain._replace(radiance=np.minimum(plain.radiance, level))
    assert clipped_share(clipped) == pytest.approx(np.mean(plain.radiance >= level))
    assert clipped_share(plain) == clipped_share(plain.take(np.arange(0))) == 0
    assert clipped_share(plain._replace(radiance=np.full((600, 3), 0.7))) == 1
    coloured = np.tile([0.7, 0.6, 0.5], (600, 1))
    assert clipped_share(plain._replace(radiance=coloured)) == 0


def test_it_is_said_with_the_key_to_set(plain):
    assert saturation_sentence(plain) is None
    assert saturation_sentence(plain.take(np.arange(0))) is None
    top = np.arange(600)[:, None] < 150
    clipped = plain._replace(radiance=np.where(top, 0.999, 0.9 * plain.radiance))
    sentence = saturation_sentence(clipped)
    assert sentence.startswith("25 % of the pixels stand at the highest value")
    assert "capture.saturation" in sentence
