"""Subsets of the measurements.

- A stratified subset has the number asked for, each sample once, with its own radiance and frame.
- It is spread evenly over exit cosines, and holds more highlights than their share.
- It is chosen by the prediction, never by the noise: the noise of what is chosen has mean zero,
  where choosing by the measurement would favour the bright side.
- The same seed draws the same samples; fewer samples than asked for are all kept.
"""

import numpy as np
import pytest
from inverse_problems import ball_samples

from jaxrender.inverse import Observations
from jaxrender.inverse.observations import random_subset, stratified_subset

COUNT, KEPT = 4000, 400


def scene(seed=0):
    """A few bright samples among many dark, ten per cent noise."""
    samples, frame = ball_samples(COUNT, 0.15, seed)
    rng = np.random.default_rng(seed + 1)
    predicted = 1 + 20 * (rng.uniform(size=(COUNT, 1)) ** 30) * np.ones(3)
    radiance = predicted * (1 + 0.1 * rng.normal(size=predicted.shape))
    return Observations(samples, radiance, frame), predicted


def matches(some, every):
    normals = np.asarray(every.samples.normals)
    return np.array(
        [np.flatnonzero((normals == normal).all(axis=1))[0] for normal in some.samples.normals]
    )


def test_a_subset_holds_each_sample_once_with_its_own_radiance():
    observations, predicted = scene()
    some, kept = stratified_subset(observations, predicted, KEPT, 3)
    assert some.count == KEPT
    index = matches(some, observations)
    assert len(np.unique(index)) == KEPT
    np.testing.assert_array_equal(some.radiance, observations.radiance[index])
    np.testing.assert_array_equal(some.frame, observations.frame[index])
    np.testing.assert_array_equal(some.samples.outgoing, observations.samples.outgoing[index])
    np.testing.assert_array_equal(kept, predicted[index])


def test_a_subset_is_spread_over_exit_cosines():
    observations, predicted = scene()
    edges = np.quantile(np.asarray(observations.samples.exit_cosines), np.linspace(0, 1, 11))
    some, _ = stratified_subset(observations, predicted, KEPT, 3)
    counts, _ = np.histogram(np.asarray(some.samples.exit_cosines), edges)
    # Strata are visited in turn until there are enough: brightness empties some sooner than others.
    assert np.all(np.abs(counts - KEPT / 10) <= 0.3 * KEPT / 10)


def test_highlights_are_drawn_more_often_than_their_share():
    observations, predicted = scene()
    _, kept = stratified_subset(observations, predicted, KEPT, 3)
    bright = predicted.mean(axis=1) > 11
    assert np.mean(kept.mean(axis=1) > 11) > 2 * np.mean(bright)


def mean_noise(some):
    """Of samples that should all be 1, in standard errors of noise of standard deviation .3."""
    return float((some.radiance.mean() - 1) * np.sqrt(some.count) / 0.3)


def test_the_noise_of_the_chosen_has_mean_zero():
    observations, _ = scene()
    predicted = 1 + 1e-3 * np.random.default_rng(1).uniform(size=(COUNT, 1))
    scores, wrong = [], []
    for seed in range(12):
        # Skewed noise, the same in all channels: its bright tail would make a stratum of its own.
        noise = 0.3 * (np.random.default_rng(seed).exponential(size=(COUNT, 1)) - 1)
        noisy = observations._replace(radiance=1 + noise)
        scores.append(mean_noise(stratified_subset(noisy, predicted, KEPT, seed)[0]))
        wrong.append(mean_noise(stratified_subset(noisy, noisy.radiance, KEPT, seed)[0]))
    # Twelve standard normals: their mean within 3.5 standard errors.
    assert abs(np.mean(scores)) < 3.5 / np.sqrt(12)
    # Chosen by the measurement it is not so: the test would notice.
    assert np.mean(wrong) > 3.5


@pytest.mark.parametrize(
    "draw",
    [
        lambda observations, predicted, seed: stratified_subset(
            observations, predicted, KEPT, seed
        )[0],
        lambda observations, predicted, seed: random_subset(observations, KEPT, seed),
    ],
)
def test_the_seed_decides(draw):
    observations, predicted = scene()
    one, again, other = (draw(observations, predicted, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.radiance, again.radiance)
    assert one.count == other.count == KEPT
    assert not np.array_equal(one.radiance, other.radiance)


def test_too_few_to_choose_from_are_all_kept():
    observations, predicted = scene()
    some, kept = stratified_subset(observations, predicted, COUNT, 0)
    np.testing.assert_array_equal(some.radiance, observations.radiance)
    np.testing.assert_array_equal(kept, predicted)
    assert random_subset(observations, COUNT + 1, 0) is observations


def test_uniform_brightness_is_one_stratum():
    observations, _ = scene()
    some, _ = stratified_subset(observations, np.ones((COUNT, 3)), KEPT, 0)
    assert some.count == KEPT
