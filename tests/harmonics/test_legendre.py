"""Legendre polynomials and associated functions.

Pinned down: both against SciPy on both hemispheres and at the poles, any batch shape, float32 stays
float32, the derivative at x = 1 is l (l + 1) / 2, and the recurrence's factors are those
of the textbook three-term form.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import eval_legendre, sph_harm_y

from jaxrender.harmonics import associated, legendre
from jaxrender.harmonics.legendre import recurrence

# SciPy loses this much near -1 at degree 128.
FLOAT64 = 1e-12
FLOAT32 = 1e-5
# SciPy's own recurrence loses this much near the poles.
SCIPY_ASSOCIATED = 3e-12

COSINES = np.concatenate([np.linspace(-1.0, 1.0, 41), [0.999999, -0.9999]])


@pytest.mark.parametrize("band_limit", [0, 1, 2, 33, 128])
def test_legendre_agrees_with_scipy(band_limit):
    expected = eval_legendre(np.arange(band_limit + 1), COSINES[:, None])
    np.testing.assert_allclose(legendre(COSINES, band_limit), expected, rtol=0, atol=FLOAT64)
    single = COSINES.astype(np.float32)
    expected = eval_legendre(np.arange(band_limit + 1), single.astype(float)[:, None])
    computed = legendre(single, band_limit)
    assert computed.dtype == jnp.float32
    np.testing.assert_allclose(computed, expected, rtol=0, atol=FLOAT32)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3), (0,)])
def test_legendre_keeps_the_batch_shape(shape):
    assert legendre(np.full(shape, 0.3), 4).shape == (*shape, 5)


def test_legendre_derivative_at_the_end_of_the_interval():
    degree = np.arange(41)
    slope = jax.jacfwd(lambda x: legendre(x, 40))(jnp.array([1.0, -1.0]))
    expected = degree * (degree + 1) / 2
    np.testing.assert_allclose(slope[0, :, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(slope[1, :, 1], -expected * (-1.0) ** degree, rtol=1e-12)


@pytest.mark.parametrize("band_limit", [0, 1, 5, 64])
def test_associated_agrees_with_scipy(band_limit):
    polar = np.concatenate([np.linspace(0.0, np.pi, 33), [1e-3, np.pi - 1e-3]])
    table = associated(np.cos(polar), np.abs(np.sin(polar)), band_limit)
    degree, order = np.indices((band_limit + 1, band_limit + 1))[..., None]
    sign = (-1.0) ** order * np.where(order == 0, 1.0, np.sqrt(2.0))
    expected = np.where(order <= degree, sign * sph_harm_y(degree, order, polar, 0.0).real, 0.0)
    np.testing.assert_allclose(table, expected, rtol=0, atol=SCIPY_ASSOCIATED)


def test_recurrence_factors_are_those_of_the_three_term_form():
    decay, bend, ratio = recurrence(20)
    for degree in range(2, 21):
        for order in range(degree - 1):
            three_term = np.sqrt(
                (2 * degree + 1)
                * ((degree - 1) ** 2 - order**2)
                / ((2 * degree - 3) * (degree**2 - order**2))
            )
            here = decay[degree, order] + ratio[degree, order]
            np.testing.assert_allclose(here, bend[degree, order], rtol=1e-14)
            product = decay[degree, order] * ratio[degree - 1, order]
            np.testing.assert_allclose(product, three_term, rtol=1e-13)


def test_negative_band_limit_is_refused():
    with pytest.raises(ValueError, match="band_limit"):
        legendre(np.zeros(2), -1)


@pytest.mark.parametrize("angle", [0.4, 1.1])
def test_high_degrees_oscillate_with_a_falling_amplitude(angle):
    """ERRATA 26: T 3.46 and 3.50 have lost the factor sqrt(2 / (pi l sin t))."""
    degree = 200
    computed = float(legendre(np.array(math.cos(angle)), degree)[degree])
    wave = math.cos((degree + 0.5) * angle - math.pi / 4)
    amplitude = math.sqrt(2 / (math.pi * degree * math.sin(angle)))
    assert computed == pytest.approx(amplitude * wave, abs=0.02 * amplitude)
    assert abs(computed - wave) > 0.5 * abs(wave)
