"""The Lambertian transfer.

Pinned down: the digits of T 4.12; every degree to 64 against 2 pi int x P_l(x) dx in exact
fractions, and some to 500 against the Gamma functions of mpmath; that the printed T 3.32 and 4.11
(ERRATA 18, 19) are not what is implemented.
"""

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from jaxrender.spectra import lambertian_transfer

ROUNDING = 1e-14  # of a product of up to 32 factors


def exact(degree):
    """int_0^1 x P_l(x) dx, term by term of P_l's own sum, exactly."""
    terms = (
        Fraction(
            (-1) ** k * math.comb(degree, k) * math.comb(2 * degree - 2 * k, degree),
            (degree - 2 * k + 2) * 2**degree,
        )
        for k in range(degree // 2 + 1)
    )
    return 2 * np.pi * float(sum(terms))


def test_digits_of_the_thesis():
    """T 4.12; the printed T 4.11 gives 4 pi and -.0036 for A_0 and A_4, T 3.32 4.443 for A_0."""
    expected = [3.141593, 2.094395, 0.785398, 0, -0.130900, 0, 0.049087]
    np.testing.assert_allclose(lambertian_transfer(6), expected, atol=6e-7)


def test_every_degree_is_the_integral_of_the_clamped_cosine():
    transfer = lambertian_transfer(64)
    expected = [exact(degree) for degree in range(65)]
    np.testing.assert_allclose(transfer, expected, rtol=ROUNDING, atol=1e-16)


def test_high_degrees_against_gamma_functions():
    """int_0^1 x P_l dx = sqrt(pi) / 4 / (G((3 - l) / 2) G((l + 4) / 2)) (Gradshteyn 7.126)."""
    transfer = lambertian_transfer(500)
    assert transfer.shape == (501,)
    for degree in (2, 33, 66, 98, 254, 498, 499, 500):
        half = mpmath.mpf(degree) / 2
        poles = mpmath.rgamma(1.5 - half) * mpmath.rgamma(half + 2)
        expected = float(2 * mpmath.pi * mpmath.sqrt(mpmath.pi) / 4 * poles)
        assert transfer[degree] == pytest.approx(expected, rel=1e-13, abs=0)


@pytest.mark.parametrize("band_limit", [0, 1, 2, 7])
def test_a_lower_band_limit_is_a_cut(band_limit):
    cut = lambertian_transfer(band_limit)
    np.testing.assert_array_equal(cut, lambertian_transfer(20)[: band_limit + 1])


def test_negative_band_limit_is_refused():
    with pytest.raises(ValueError, match="band_limit=-1: the band limit must not be negative"):
        lambertian_transfer(-1)
