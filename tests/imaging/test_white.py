"""Pinned down: white balance and colour from a card or a chart in the photograph.

- A grey card under coloured light is grey again, to the stated error, a hair on it notwithstanding.
- The published colours agree with the 8-bit numbers that are published beside them.
- A chart that a camera sees aslant is read at the right places, and its colours become the
  published ones: exactly by the matrix that undoes the camera's, by a diagonal as far as one can.
"""

import numpy as np
import pytest

from jaxrender.geometry import Pinhole, look_at
from jaxrender.imaging import (
    PATCHES,
    SRGB,
    Rectangle,
    chart_colours,
    chart_patches,
    fit_colours,
    white_balance,
)

# 8-bit sRGB of the patches, as published for the earlier edition of the chart.
EIGHT_BITS = np.array(
    [
        (115, 82, 68),
        (194, 150, 130),
        (98, 122, 157),
        (87, 108, 67),
        (133, 128, 177),
        (103, 189, 170),
        (214, 126, 44),
        (80, 91, 166),
        (193, 90, 99),
        (94, 60, 108),
        (157, 188, 64),
        (224, 163, 46),
        (56, 61, 150),
        (70, 148, 73),
        (175, 54, 60),
        (231, 199, 31),
        (187, 86, 149),
        (8, 133, 161),
        (243, 243, 242),
        (200, 200, 200),
        (160, 160, 160),
        (122, 122, 121),
        (85, 85, 85),
        (52, 52, 52),
    ]
)
CAMERA = np.array([[0.7, 0.2, 0.05], [0.15, 0.8, 0.1], [0.02, 0.2, 0.6]])


def test_a_grey_card():
    rng = np.random.default_rng(0)
    light = np.array([1.3, 1.0, 0.6])
    shade = np.linspace(0.9, 1.1, 50)[:, None, None]
    picture = 0.3 * light * shade * (1 + 0.02 * rng.normal(size=(50, 40, 3)))
    picture[:, 20] = [0.9, 0.1, 0.1]
    mask = Rectangle(5, 4, 45, 36).mask(50, 40)
    found = white_balance(picture, mask)
    expected = light.mean() / light
    assert np.abs(found.gains - expected).max() < 4 * found.standard_error.max() < 0.01
    grey = found.applied(picture)[mask]
    np.testing.assert_allclose(np.median(grey, axis=0), np.median(grey), rtol=0.01)
    assert found.unevenness == pytest.approx(0.06, abs=0.03)


def test_a_card_that_is_none():
    picture = np.ones((4, 4, 3))
    with pytest.raises(ValueError, match="no pixels"):
        white_balance(picture, np.zeros((4, 4), bool))
    with pytest.raises(ValueError, match="black in one of the channels"):
        white_balance(picture * [1, 0, 1], np.ones((4, 4), bool))
    with pytest.raises(ValueError, match="rows 0 to 5 and columns 0 to 4 is no part"):
        Rectangle(0, 0, 5, 4).mask(4, 4)


def test_the_published_colours_are_those_of_eight_bits():
    found = 255 * SRGB().encode(chart_colours())
    # Cyan lies outside of what eight bits hold, and the chart's paints have changed a little.
    inside = np.array(PATCHES) != "cyan"
    assert np.sqrt(np.mean((found - EIGHT_BITS)[inside] ** 2)) < 7
    assert np.abs(found - EIGHT_BITS)[19:].max() < 4


def aslant():
    """A picture of a chart 6 x 4 on the plane z = 0, and the corners of the chart in it."""
    pose = look_at(np.array([5.0, -3.0, 7.0]), np.array([3.0, 2.0, 0.0]), np.array([0.0, 1, 0]))
    camera = Pinhole(240, 200, pose, fl_x=260.0)
    rays = camera.rays()
    hits = rays.origins - rays.directions * (rays.origins / rays.directions)[..., 2:]
    column, row = np.floor(hits[..., 0]).astype(int), np.floor(4 - hits[..., 1]).astype(int)
    on = (column >= 0) & (column < 6) & (row >= 0) & (row < 4)
    # Patches with a black frame.
    middle = (np.abs(hits[..., :2] % 1 - 0.5) < 0.4).all(axis=-1)
    seen = chart_colours() @ np.linalg.inv(CAMERA).T * 0.4
    picture = np.where((on & middle)[..., None], seen[(6 * row + column).clip(0, 23)], 0.02)
    corners = camera.project(np.array([[0, 4.0, 0], [6, 4, 0], [6, 0, 0], [0, 0, 0]]))
    return picture, corners[:, ::-1]


def test_a_chart_seen_aslant():
    picture, corners = aslant()
    picture = picture * (1 + 0.01 * np.random.default_rng(0).normal(size=picture.shape))
    seen = chart_patches(picture, corners)
    found = fit_colours(seen)
    np.testing.assert_allclose(found.matrix * 0.4, CAMERA, atol=0.02)
    assert found.rms < 0.01
    np.testing.assert_allclose(found.applied(seen), chart_colours(), atol=0.02)
    diagonal = fit_colours(seen, "diagonal")
    assert diagonal.rms > 5 * found.rms
    assert diagonal.worst in PATCHES


def test_a_diagonal_is_enough_for_coloured_light():
    light = np.array([2.0, 1.0, 0.5])
    seen = chart_colours() * light
    seen[17] = np.nan
    found = fit_colours(seen, "diagonal")
    np.testing.assert_allclose(np.diag(found.matrix), 1 / light)
    assert found.rms < 1e-12


def test_a_patch_that_is_wrong_is_named():
    seen = chart_colours()
    seen[14] *= 0.5
    assert fit_colours(seen).worst == "red"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fit_colours(np.ones((20, 3))), "20 patches: a chart has 24"),
        (lambda: fit_colours(np.full((24, 3), np.nan)), "0 usable patches"),
        (lambda: fit_colours(chart_colours(), "curve"), "kind='curve'"),
        (
            lambda: chart_patches(np.ones((50, 50, 3)), [[0, 0], [49, 0], [49, 49], [0, 49]]),
            "no quadrangle in clockwise order",
        ),
        (
            lambda: chart_patches(np.ones((50, 50, 3)), [[0, 0], [0, 80], [49, 80], [49, 0]]),
            "patch 'blue flower' leaves the picture",
        ),
        (
            lambda: chart_patches(np.ones((8, 8, 3)), [[0, 0], [0, 7], [7, 7], [7, 0]]),
            "smaller than four pixels",
        ),
    ],
)
def test_what_is_no_chart(call, message):
    with pytest.raises(ValueError, match=message):
        call()
