"""Masking and shadowing.

Pinned down: Smith's term is 1 / (1 + L(t_i) + L(t_o)) with L his integral over Gaussian slopes,
done here by SciPy; it is 1 head-on, symmetric, falls to 0 towards grazing; ``none`` is 1; the
derivative at normal incidence is finite in single precision too, where 1 - 1e-12 rounds to 1.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from jaxrender.brdf import MASKINGS, smith_masking

QUADRATURE = 1e-9  # SciPy's adaptive rule, asked for 1e-12


def smiths_integral(sigma, cosine):
    """L = (1 / m) int_m^inf (q - m) p(q) dq, m = cot t, p(q) = exp(-(q / s)^2) / (s sqrt(pi))."""
    slope = cosine / np.sqrt(1 - cosine**2)

    def integrand(q):
        return (q - slope) * np.exp(-((q / sigma) ** 2)) / (sigma * np.sqrt(np.pi))

    reach = slope + 12 * sigma  # the integrand is below exp(-144) of its peak beyond
    return quad(integrand, slope, reach, epsabs=1e-14, epsrel=1e-12, limit=200)[0] / slope


@pytest.mark.parametrize("sigma", [0.1, 0.3, 0.7])
@pytest.mark.parametrize("cosines", [(0.05, 0.9), (0.2, 0.2), (0.5, 0.1), (0.8, 0.3)])
def test_smith_masking_is_smiths_integral(sigma, cosines):
    expected = 1 / (1 + sum(smiths_integral(sigma, c) for c in cosines))
    found = smith_masking(sigma, *(np.full(1, c) for c in cosines))[0]
    assert found == pytest.approx(expected, rel=QUADRATURE)


def test_no_masking_head_on_and_all_of_it_at_grazing():
    cosines = np.array([1.0, 0.6, 0.2, 0.05, 1e-3])
    masked = np.asarray(smith_masking(0.3, cosines, np.ones(5)))
    assert masked[0] == 1
    assert np.all(np.diff(masked) < 0)
    assert masked[-1] < 0.02


def test_smith_masking_is_symmetric():
    a, b = np.random.default_rng(0).uniform(0.01, 1, (2, 50))
    np.testing.assert_array_equal(smith_masking(0.4, a, b), smith_masking(0.4, b, a))


def test_none_is_one_in_the_broadcast_shape():
    ones = MASKINGS["none"](0.3, np.full((4, 5), 0.2), np.full((4, 1), 0.1))
    np.testing.assert_array_equal(ones, np.ones((4, 5)))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_derivative_is_finite_head_on_and_at_grazing(dtype):
    cosines = np.array([0, 1e-6, 0.5, 1], dtype)

    def total(sigma, a, b):
        return smith_masking(sigma, a, b).sum()

    slopes = jax.grad(total, (0, 1, 2))(jnp.asarray(0.2, dtype), cosines, cosines[::-1])
    assert all(np.all(np.isfinite(slope)) for slope in slopes)
