"""Responses.

Pinned down: linearise and encode are inverse, below 0 and above 1 too; sRGB is the standard's
curve at known codes, not gamma 2.2, and increases; curves interpolate, saturate and refuse what
they do not cover; names are listed when one is wrong.
"""

import numpy as np
import pytest

from jaxrender.imaging import SRGB, Curve, Linear, response_named

# The standard's rounded breakpoints overlap by this much in value.
SRGB_STEP = 1e-7
ROUNDING = 1e-12

CURVE = Curve(np.array([0.0, 0.2, 0.6, 1.0]), np.array([0.0, 0.05, 0.4, 1.0]))


@pytest.mark.parametrize("response", [Linear(), SRGB()])
def test_round_trip_beyond_the_ends(response):
    values = np.linspace(-0.2, 2, 4001)
    away = np.abs(values - 0.04045) > 1e-3
    found = response.encode(response.linearise(values))
    np.testing.assert_allclose(found[away], values[away], rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_allclose(found, values, atol=SRGB_STEP)


def test_linear_values_are_radiance():
    values = np.array([[-1.0, 0.5, 7.0]])
    np.testing.assert_array_equal(Linear().linearise(values), values)


def test_srgb_at_known_codes():
    # 8-bit codes and their linear values as tabulated for IEC 61966-2-1.
    codes = np.array([0, 1, 10, 11, 128, 255])
    linear = [0, 0.000303527, 0.003035270, 0.003346536, 0.215860500, 1]
    np.testing.assert_allclose(SRGB().linearise(codes / 255), linear, rtol=1e-6)


def test_srgb_increases_and_meets_at_its_breakpoint():
    values = np.linspace(0.0404, 0.0405, 1001)
    radiance = SRGB().linearise(values)
    assert np.all(np.diff(radiance) > 0)
    np.testing.assert_allclose(np.diff(radiance), np.diff(values) / 12.92, atol=5e-9)


def test_a_curve_is_inverted_and_interpolated():
    values = np.array([[0.0, 0.1, 0.2], [0.5, 0.9, 1.0]])
    np.testing.assert_allclose(CURVE.encode(CURVE.linearise(values)), values, atol=ROUNDING)
    np.testing.assert_allclose(CURVE.linearise(np.array([0.4])), [0.225])


def test_a_curve_saturates_but_does_not_invent_radiance():
    np.testing.assert_array_equal(CURVE.encode(np.array([-1.0, 5.0])), [0, 1])
    with pytest.raises(ValueError, match=r"value 1.01 lies outside .* 0.0 to 1.0"):
        CURVE.linearise(np.array([0.5, 1.01]))
    with pytest.raises(ValueError, match="value nan"):
        CURVE.linearise(np.array([np.nan]))


@pytest.mark.parametrize(
    ("values", "radiance", "message"),
    [
        ([0, 0.5, 0.5], [0, 1, 2], "values must increase strictly, but entry 2 is 0.5 after 0.5"),
        ([0, 0.5, 1], [0, 2, 1], "radiance must increase strictly, but entry 2 is 1.0 after 2.0"),
        ([0, np.nan, 1], [0, 1, 2], "at least two finite"),
        ([0.5], [0.5], "at least two finite"),
    ],
)
def test_bad_curves_are_refused(values, radiance, message):
    with pytest.raises(ValueError, match=message):
        Curve(np.array(values, float), np.array(radiance, float))


def test_names():
    assert isinstance(response_named("linear"), Linear)
    assert isinstance(response_named("srgb"), SRGB)
    with pytest.raises(ValueError, match="unknown response 'sRGB': choose one of linear, srgb"):
        response_named("sRGB")
