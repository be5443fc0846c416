"""A light given by coefficients.

- Its radiance is the series; its nodes give the coefficients back, to degree 3 F + 3 by default.
- It may be negative: the nodes keep the sign, an image refuses it.
- An image has the same coefficients, also one too coarse for the transform's own grid.
- A count that is no square, and too few rows, are refused.
"""

import numpy as np
import pytest

from jaxrender.harmonics import real_basis, synthesise
from jaxrender.lighting import HarmonicLight
from jaxrender.spectra import light_coefficients

ROUNDING = 1e-12
COEFFICIENTS = np.random.default_rng(0).normal(size=(16, 3))


def test_nodes_give_the_coefficients_back():
    light = HarmonicLight(COEFFICIENTS)
    directions, irradiance = light.nodes()
    found = np.asarray(real_basis(directions, 12)).T @ np.asarray(irradiance)
    expected = np.concatenate([COEFFICIENTS, np.zeros((169 - 16, 3))])
    np.testing.assert_allclose(found, expected, atol=ROUNDING)
    assert np.any(np.asarray(irradiance) < 0)


@pytest.mark.parametrize("height", [7, 8, 31])
def test_any_height_that_suffices_does(height):
    directions, irradiance = HarmonicLight(COEFFICIENTS, height).nodes()
    found = np.asarray(real_basis(directions, 3)).T @ np.asarray(irradiance)
    np.testing.assert_allclose(found, COEFFICIENTS, atol=ROUNDING)


def test_radiance_is_the_series():
    light = HarmonicLight(COEFFICIENTS)
    directions = light.grid.directions().reshape(-1, 3)
    image = synthesise(light.grid, COEFFICIENTS).reshape(-1, 3)
    np.testing.assert_allclose(light.radiance(directions), image, atol=ROUNDING)


def test_cut_and_filled_up():
    light = HarmonicLight(COEFFICIENTS)
    np.testing.assert_array_equal(light_coefficients(light, 1), COEFFICIENTS[:4])
    filled = np.asarray(light_coefficients(light, 5))
    np.testing.assert_array_equal(filled[:16], COEFFICIENTS)
    np.testing.assert_array_equal(filled[16:], np.zeros((20, 3)))


def test_images():
    positive = np.array(COEFFICIENTS)
    positive[0] = 100.0
    image = HarmonicLight(positive).to_environment(16)
    np.testing.assert_allclose(light_coefficients(image, 3), positive, atol=1e-10)
    coarse = HarmonicLight(positive).to_environment(4)
    expected = HarmonicLight(positive).radiance(coarse.grid.directions().reshape(-1, 3))
    np.testing.assert_allclose(coarse.radiance.reshape(-1, 3), expected, atol=1e-10)
    with pytest.raises(ValueError, match="must be finite and not negative"):
        HarmonicLight(COEFFICIENTS).to_environment(16)


def test_refusals():
    with pytest.raises(ValueError, match="5 coefficients fit no band limit"):
        HarmonicLight(np.ones((5, 1)))
    with pytest.raises(ValueError, match="height=6: light of degree 3 needs 7 rows or more"):
        HarmonicLight(COEFFICIENTS, 6)
