"""Spectra to colour: the standard observer's fit, and linear Rec. 709 RGB of a reflectance.

Pinned down: values of the CIE 1931 tables at their peaks and crossings; their equal integrals; the
illuminant's chromaticity (.3127, .3290); the published matrix; a perfect white is (1, 1, 1) under
every illuminant and for any wavelengths; grey is grey; the weights are those of integrating finely;
primaries of the spectrum have the colour that one sees; every refusal.
"""

import numpy as np
import pytest

from jaxrender.imaging import ILLUMINANTS, colour_matching, rgb_of_reflectance, rgb_weights
from jaxrender.imaging.colour import _D65, rgb_from_xyz

ROUNDING = 1e-12
WAVELENGTHS = np.arange(400.0, 701.0, 10.0)

# CIE 1931: wavelength, x, y, z.
TABLE = np.array(
    [
        [440, 0.3483, 0.0230, 1.7471],
        [450, 0.3362, 0.0380, 1.7721],
        [500, 0.0049, 0.3230, 0.2720],
        [520, 0.0633, 0.7100, 0.0782],
        [555, 0.5121, 1.0000, 0.0057],
        [600, 1.0622, 0.6310, 0.0008],
        [650, 0.2835, 0.1070, 0.0000],
    ]
)
# What the fit leaves of a function whose peaks are 1 to 1.8.
FIT = 0.03


def test_observer_is_the_tables():
    np.testing.assert_allclose(colour_matching(TABLE[:, 0]), TABLE[:, 1:], atol=FIT)


def test_integrals_are_equal():
    """The observer is defined so that equal energy is x = y = 1/3; CIE: 106.86 each."""
    integrals = np.trapezoid(colour_matching(np.arange(360.0, 831.0)), dx=1.0, axis=0)
    np.testing.assert_allclose(integrals, 106.86, rtol=0.01)


def test_illuminant_has_its_chromaticity():
    nodes = np.linspace(380, 780, len(_D65))
    xyz = np.array(_D65) @ colour_matching(nodes)
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), [0.3127, 0.3290], atol=2e-3)


def test_matrix_is_the_published_one():
    published = [
        [3.2406, -1.5372, -0.4986],
        [-0.9689, 1.8758, 0.0415],
        [0.0557, -0.2040, 1.0570],
    ]
    np.testing.assert_allclose(rgb_from_xyz(), published, atol=5e-4)


@pytest.mark.parametrize("illuminant", ILLUMINANTS)
@pytest.mark.parametrize("wavelengths", [WAVELENGTHS, np.array([450.0, 520.0, 640.0])])
def test_white_is_white_and_grey_is_grey(illuminant, wavelengths):
    for grey in (1.0, 0.18):
        found = rgb_of_reflectance(wavelengths, np.full((2, len(wavelengths)), grey), illuminant)
        np.testing.assert_allclose(found, grey, rtol=ROUNDING)


@pytest.mark.parametrize("illuminant", ILLUMINANTS)
def test_weights_are_those_of_a_fine_integral(illuminant):
    """By quadrature of the definition at a tenth of a nanometre."""
    fine = np.linspace(380, 780, 4001)
    power = np.ones_like(fine)
    if illuminant == "d65":
        power = np.interp(fine, np.linspace(380, 780, len(_D65)), _D65)

    reflectance = 0.4 + 0.3 * np.sin((WAVELENGTHS - 400) / 60)
    between = np.interp(fine, WAVELENGTHS, reflectance)
    seen, white = (
        rgb_from_xyz() @ ((r * power) @ colour_matching(fine)) for r in (between, np.ones(4001))
    )
    found = rgb_of_reflectance(WAVELENGTHS, reflectance, illuminant)
    np.testing.assert_allclose(found, seen / white, rtol=1e-4)


def test_bands_have_the_colour_that_one_sees():
    bands = [(600, 700), (500, 580), (400, 490)]
    spectra = np.array([(low <= WAVELENGTHS) & (high >= WAVELENGTHS) for low, high in bands], float)
    assert np.array_equal(np.argmax(rgb_of_reflectance(WAVELENGTHS, spectra), axis=1), [0, 1, 2])


def test_colours_beyond_the_primaries():
    cyan = np.exp(-(((WAVELENGTHS - 500) / 10) ** 2))
    assert rgb_of_reflectance(WAVELENGTHS, cyan, clip=False)[0] < -0.01
    assert rgb_of_reflectance(WAVELENGTHS, cyan)[0] == 0


REFUSED = {
    "descending": (np.array([700.0, 400.0]), "d65", "give them ascending"),
    "none": (np.array([]), "d65", "give them ascending"),
    "metres": (np.array([4e-7, 7e-7]), "d65", "none is visible.*give nanometres"),
    "unlisted": (WAVELENGTHS, "a", "choose one of d65, equal-energy"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_misuse_is_refused(case):
    wavelengths, illuminant, expected = REFUSED[case]
    with pytest.raises(ValueError, match=expected):
        rgb_weights(wavelengths, illuminant)
