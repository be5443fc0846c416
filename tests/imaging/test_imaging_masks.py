"""Masks and the account of lost pixels.

Pinned down: erosion and dilation equal their definition by distances (Chebyshev for 8 neighbours,
Manhattan for 4), with the border outside; thresholds look at any channel; every considered pixel is
either usable or counted by exactly one rule.
"""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_cdt

from jaxrender.imaging import below_black, dilate, erode, saturated, usable_pixels

METRIC = {4: "taxicab", 8: "chessboard"}


def blobs(seed=0):
    noise = np.random.default_rng(seed).random((20, 30))
    mask = noise > 0.05
    mask[:, 0] = True  # touches the border
    return mask


@pytest.mark.parametrize("neighbours", [4, 8])
@pytest.mark.parametrize("pixels", [0, 1, 2, 3])
def test_erosion_keeps_what_is_further_than_its_radius_from_outside(pixels, neighbours):
    mask = blobs()
    inside = np.pad(mask, 1)  # beyond the border counts as outside
    distance = distance_transform_cdt(inside, METRIC[neighbours])[1:-1, 1:-1]
    np.testing.assert_array_equal(erode(mask, pixels, neighbours), distance > pixels)


@pytest.mark.parametrize("neighbours", [4, 8])
@pytest.mark.parametrize("pixels", [0, 1, 2])
def test_dilation_takes_what_is_within_its_radius(pixels, neighbours):
    mask = ~blobs(1)
    distance = distance_transform_cdt(~mask, METRIC[neighbours])
    np.testing.assert_array_equal(dilate(mask, pixels, neighbours), distance <= pixels)


def test_erosion_by_nothing_is_a_copy():
    mask = blobs()
    erode(mask, 0)[:] = False
    assert mask.any()


@pytest.mark.parametrize("function", [erode, dilate])
def test_bad_radii_and_neighbourhoods_are_refused(function):
    with pytest.raises(ValueError, match="by -1 pixels"):
        function(blobs(), -1)
    with pytest.raises(ValueError, match=r"6 neighbours: choose one of \[4, 8\]"):
        function(blobs(), 1, 6)


def test_any_saturated_channel_saturates_the_pixel_and_its_neighbours_on_request():
    values = np.zeros((5, 6, 3))
    values[2, 3, 1] = 1.0
    values[0, 0] = 0.999
    alone = np.zeros((5, 6), bool)
    alone[2, 3] = True
    grown = np.zeros((5, 6), bool)
    grown[1:4, 2:5] = True
    np.testing.assert_array_equal(saturated(values, 1.0), alone)
    np.testing.assert_array_equal(saturated(values, 1.0, grow=1), grown)


def test_any_channel_below_black_counts():
    values = np.full((2, 2, 3), 0.5)
    values[1, 0, 2] = 0.01
    values[0, 1, 0] = 0.02
    expected = np.array([[False, False], [True, False]])
    np.testing.assert_array_equal(below_black(values, 0.02), expected)


def test_every_pixel_is_accounted_for_once():
    rng = np.random.default_rng(2)
    covered, bright, dark = rng.random((3, 40, 50)) < [[[0.7]], [[0.2]], [[0.3]]]
    selection = usable_pixels(covered, {"saturated": bright, "dark": dark})
    np.testing.assert_array_equal(selection.usable, covered & ~bright & ~dark)
    assert selection.removed == {
        "saturated": np.sum(covered & bright),
        "dark": np.sum(covered & dark & ~bright),
    }
    assert list(selection.removed) == ["saturated", "dark"]
    assert selection.considered == covered.sum()
    assert selection.considered == selection.usable.sum() + sum(selection.removed.values())


def test_masks_of_another_size_are_refused_by_rule():
    with pytest.raises(ValueError, match=r"rule 'dark' is \(2, 3\), the photograph \(3, 2\)"):
        usable_pixels(np.ones((3, 2), bool), {"dark": np.ones((2, 3), bool)})
