"""Pinned down: several exposures of one scene become one radiance.

- Seven noisy exposures of 8 bits: within 1 % rms where any of them is well exposed, and the errors
  are of the size that is stated.
- Saturated pixels do not count, nor does the rest of their pixel; what none shows well is marked.
- Weights are those of least variance: two photographs give what the formula gives.
- The noise of a value: photons, floor, and its rounding through the slope of the response.
"""

import numpy as np
import pytest
from bracket_problems import PHOTON, READ, bracketed, scene

from jaxrender.imaging import (
    SRGB,
    Bracket,
    BracketRules,
    Curve,
    SensorNoise,
    merge_brackets,
    rounding,
)

NOISE = SensorNoise(PHOTON, READ, rounding(8))
EXPOSURES = 2.0 ** np.arange(-5, 2)


def test_seven_exposures_to_one_percent():
    truth = scene()
    merged = merge_brackets(bracketed(truth, EXPOSURES), SRGB(), NOISE)
    well = merged.well_exposed
    assert 0.7 < well.mean() < 0.99
    error = merged.radiance / truth - 1
    assert np.sqrt(np.mean(error[well] ** 2)) < 0.01
    assert abs(error[well].mean()) < 1e-3
    scaled = ((merged.radiance - truth) / merged.standard_deviation)[well]
    # Rounding is no Gaussian: its size is right to some per cent.
    assert np.std(scaled) == pytest.approx(1, abs=0.05)
    # What no exposure shows lies beyond its ends.
    beyond = (truth[..., 0] * EXPOSURES[0] > 1.05) | (truth[..., 2] * EXPOSURES[-1] < 5e-4)
    assert not well[beyond].any()
    assert well[(truth[..., 0] * EXPOSURES[0] < 0.95) & (truth[..., 2] * EXPOSURES[-1] > 0.1)].all()


def grey(value):
    return np.full((1, 1, 1), float(value))


def test_the_weights_are_those_of_least_variance():
    noise = SensorNoise(0.0, 0.01, 0.0)
    merged = merge_brackets([Bracket(grey(0.2), 1.0), Bracket(grey(0.9), 4.0)], None, noise)
    # Variances of x / t are 1 and 1 / 16 of that of x.
    assert merged.radiance.item() == pytest.approx((0.2 + 16 * 0.225) / 17, rel=1e-12)
    assert merged.standard_deviation.item() == pytest.approx(0.01 / np.sqrt(17), rel=1e-12)


def test_one_saturated_channel_spoils_its_pixel():
    long = np.array([[[1.0, 0.5, 0.4]]])
    short = np.array([[[0.3, 0.1, 0.1]]])
    merged = merge_brackets([Bracket(long, 4.0), Bracket(short, 1.0)])
    np.testing.assert_allclose(merged.radiance, short, rtol=1e-12)
    assert merged.well_exposed.all()


def test_black_is_left_out_channel_by_channel():
    long, short = np.array([[[0.0, 0.5, 0.4]]]), np.array([[[0.01, 0.1, 0.1]]])
    merged = merge_brackets([Bracket(long, 4.0), Bracket(short, 1.0)])
    assert merged.radiance[0, 0, 0] == pytest.approx(0.01)
    assert merged.radiance[0, 0, 1] > 0.11
    # A pixel is well exposed in all its channels.
    assert not merged.well_exposed.any()


def test_what_no_photograph_shows_is_a_bound():
    bright = merge_brackets([Bracket(grey(1.0), 4.0), Bracket(grey(1.0), 1.0)])
    assert bright.radiance.item() == 1.0
    assert bright.standard_deviation.item() == np.inf
    dark = merge_brackets([Bracket(grey(0.001), 4.0), Bracket(grey(0.0), 1.0)])
    assert dark.radiance.item() == pytest.approx(0.00025)
    assert 0 < dark.standard_deviation.item() < 1e-3
    assert not (bright.well_exposed.any())
    assert not (dark.well_exposed.any())


def test_a_curve_that_does_not_reach_leaves_out_what_it_does_not_cover():
    curve = Curve(np.array([0.1, 0.9]), np.array([0.05, 1.0]))
    merged = merge_brackets([Bracket(grey(0.95), 4.0), Bracket(grey(0.5), 1.0)], curve)
    assert merged.radiance.item() == pytest.approx(0.525)


def test_saturation_grows_over_neighbours():
    row = np.array([0.2, 0.3, 1.0]).reshape(1, 3, 1)
    pair = [Bracket(row, 4.0), Bracket(row / 2, 1.0)]
    kept = merge_brackets(pair).radiance[0, :, 0]
    grown = merge_brackets(pair, rules=BracketRules(grow=1)).radiance[0, :, 0]
    assert grown[1] == pytest.approx(0.15)
    assert kept[1] < 0.1
    assert grown[0] == kept[0]


def test_the_noise_of_a_value():
    noise = SensorNoise(0.0, 0.0, 1 / 255)
    at = np.array([0.001, 0.5])
    # Radiance by value: the standard's line, and 2.4 / 1.055 ((v + .055) / 1.055)^1.4.
    value = SRGB().encode(at)
    slope = np.array([1 / 12.92, 2.4 / 1.055 * ((value[1] + 0.055) / 1.055) ** 1.4])
    expected = slope**2 / 255**2 / 12
    np.testing.assert_allclose(noise.variance(at, SRGB()), expected, rtol=1e-4)
    np.testing.assert_allclose(SensorNoise(1e-4, 1e-3, 0.0).variance(at), 1e-4 * at + 1e-6)
    table = Curve(np.array([0.0, 1.0]), np.array([[0.0, 0.0], [1.0, 2.0]]))
    by_channel = noise.variance(np.array([[0.0, 0.5], [0.5, 2.0]]), table)
    np.testing.assert_allclose(by_channel * 12 * 255**2, [[1, 4], [1, 4]], rtol=1e-9)


@pytest.mark.parametrize(
    ("brackets", "message"),
    [
        ([], "no photographs"),
        ([Bracket(grey(1), 1.0), Bracket(np.ones((2, 1, 1)), 1.0)], "one shape"),
        ([Bracket(grey(1), 0.0)], "exposure of photograph 0 is 0"),
    ],
)
def test_what_cannot_be_merged(brackets, message):
    with pytest.raises(ValueError, match=message):
        merge_brackets(brackets)


def test_impossible_noise():
    with pytest.raises(ValueError, match="noise read is -1"):
        SensorNoise(read=-1.0)
    with pytest.raises(ValueError, match="without any noise"):
        SensorNoise(0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="bit_depth=0"):
        rounding(0)
