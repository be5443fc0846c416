"""The Phong transfer for real exponents.

Pinned down: T 3.37's products, in exact fractions, for every integer exponent to 9; the integral
for real exponents against mpmath; that products and log-gamma are one function (ERRATA 20) and the
printed T 3.38 is another; how far off the Gaussians are (ERRATA 22); which exponent has the wider
spectrum (ERRATA 23); the logarithm's limit (ERRATA 21); derivatives, at integers too; s = 1 is the
clamped cosine; both precisions; refusals.
"""

from fractions import Fraction

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jaxrender.spectra import (
    PHONG_TRANSFERS,
    gaussian_phong_transfer,
    lambertian_transfer,
    matched_phong_transfer,
    phong_transfer,
    phong_transfer_by_gamma,
    power_transfer,
)

ROUNDING = 1e-13


def printed_product(s, degree):
    """T 3.37, odd and even, as it stands."""
    value = Fraction(1)
    if degree % 2:
        above, below = [s + 1, *range(s - 1, s - degree, -2)], range(s + degree + 1, s + 1, -2)
    else:
        above, below = range(s, s - degree, -2), range(s + degree + 1, s + 1, -2)
    for a, b in zip(above, below, strict=True):
        value *= Fraction(a, b)
    return float(value)


@pytest.mark.parametrize("exponent", range(1, 10))
def test_products_of_the_thesis(exponent):
    expected = [printed_product(exponent, degree) for degree in range(31)]
    found = phong_transfer(float(exponent), 30)
    np.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=1e-300)


@pytest.mark.parametrize("exponent", [-0.5, 0.3, 2.5, 17.2, 300.7])
def test_real_exponents_are_the_integral(exponent):
    found = phong_transfer(exponent, 12)
    with mpmath.workdps(30):
        for degree in range(13):
            integral = mpmath.quad(
                lambda u, degree=degree: u**exponent * mpmath.legendre(degree, u), [0, 0.5, 0.9, 1]
            )
            # The integrable pole at 0 of s = -.5 is what limits the quadrature.
            assert float((exponent + 1) * integral) == pytest.approx(float(found[degree]), abs=2e-9)


@pytest.mark.parametrize("exponent", [0.5, 1.0, 7.5, 8.0, 64.0])
def test_the_closed_form_is_the_same_function(exponent):
    np.testing.assert_allclose(
        phong_transfer_by_gamma(exponent, 40), phong_transfer(exponent, 40), atol=1e-12
    )


@pytest.mark.parametrize(("dtype", "rounding"), [(np.float32, 1e-5), (np.float64, 1e-13)])
@pytest.mark.parametrize("exponent", [30.0, 1e3, 1e6])
def test_the_closed_form_keeps_its_digits_at_large_exponents(exponent, dtype, rounding):
    degrees = range(0, 61, 6)
    s = mpmath.mpf(exponent)
    exact = [
        mpmath.gammaprod([s / 2 + 1, s / 2 + 1.5], [(s - n) / 2 + 1, (s + n) / 2 + 1.5])
        for n in degrees
    ]
    found = phong_transfer_by_gamma(np.asarray(exponent, dtype), 60)
    assert found.dtype == dtype
    np.testing.assert_allclose(found[::6], np.array(exact, float), atol=rounding)


@pytest.mark.parametrize(("exponent", "off"), [(1, 1.25), (8, 0.046), (32, 0.031), (512, 0.012)])
def test_the_printed_gamma_form_is_off(exponent, off):
    """T 3.38, [G(s/2)]^2 / (G((s-l)/2) G((s+l)/2)), for l < s or l = 2 (ERRATA 20)."""
    exact = np.asarray(phong_transfer(float(exponent), max(exponent - 1, 2)))
    s = mpmath.mpf(exponent)
    printed = [
        mpmath.gamma(s / 2) ** 2 * mpmath.rgamma((s - n) / 2) * mpmath.rgamma((s + n) / 2)
        for n in range(len(exact))
    ]
    assert np.abs(np.array(printed, float) - exact).max() == pytest.approx(off, abs=6e-4)


@pytest.mark.parametrize(
    ("exponent", "gaussian", "matched"),
    [(8, 0.052, 0.0116), (32, 0.039, 0.0031), (128, 0.023, 0.0008), (512, 0.0125, 0.0002)],
)
def test_how_far_the_gaussians_are_off(exponent, gaussian, matched):
    """ERRATA 22: T 3.40 and exp(-l(l+1) / 2(s+1)), worst over all degrees, to two digits."""
    s = float(exponent)
    exact = np.asarray(phong_transfer(s, 200))
    worst = np.abs(np.asarray(gaussian_phong_transfer(s, 200)) - exact).max()
    better = np.abs(np.asarray(matched_phong_transfer(s, 200)) - exact).max()
    assert worst == pytest.approx(gaussian, rel=0.02)
    assert better == pytest.approx(matched, abs=6e-5)


def test_a_larger_exponent_has_the_wider_spectrum():
    """ERRATA 23: a narrower lobe, not a wider one."""
    wide, narrow = (np.asarray(phong_transfer(s, 20)) for s in (8.0, 128.0))
    assert np.all(narrow[1:] > wide[1:])


def test_the_logarithm_falls_as_l_times_l_plus_1():
    """ERRATA 21: -l(l+1) / 2s to first order; the printed -l^2 (1/2s - 1/2s^2) has no l / 2s."""
    s = 1e6
    degrees = np.arange(1, 20)
    found = np.log(np.asarray(phong_transfer(s, 19))[1:]) * 2 * s
    np.testing.assert_allclose(found, -degrees * (degrees + 1), rtol=1e-3)
    assert np.abs(found + degrees**2 * (1 - 1 / s)).max() > 10


@pytest.mark.parametrize("exponent", [3.0, 4.0, 6.7, 90.0])
def test_derivative_in_the_exponent(exponent):
    slope = jax.jit(jax.jacfwd(lambda s: phong_transfer(s, 30)))(exponent)
    step = 1e-5
    difference = phong_transfer(exponent + step, 30) - phong_transfer(exponent - step, 30)
    np.testing.assert_allclose(slope, difference / (2 * step), atol=1e-9)
    assert np.all(np.isfinite(jax.jacrev(lambda s: phong_transfer(s, 30))(exponent)))


def test_exponent_one_is_the_clamped_cosine():
    np.testing.assert_allclose(power_transfer(1.0, 30), lambertian_transfer(30), atol=ROUNDING)


def test_single_precision():
    found = phong_transfer(jnp.asarray(33.3, jnp.float32), 64)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, phong_transfer(33.3, 64), atol=1e-6)


@pytest.mark.parametrize("name", PHONG_TRANSFERS)
def test_every_name_starts_at_one_and_refuses(name):
    transfer = PHONG_TRANSFERS[name]
    assert float(transfer(20.0, 0)[0]) == pytest.approx(1, abs=ROUNDING)
    with pytest.raises(ValueError, match=r"exponent=-1.0: .* above -1"):
        transfer(-1.0, 4)
    with pytest.raises(ValueError, match="band_limit=-1"):
        transfer(2.0, -1)
