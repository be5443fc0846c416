"""Fresnel reflectance and the ratio that T 6.2 multiplies by.

Pinned down: the reflectance is that of Snell's law and the two polarisations' amplitudes, computed
here with complex numbers; the ratio is 1 at normal exitance although F(1.5, 0) = .04 (ERRATA 44),
and grows to 9.7 at 80 degrees (ERRATA 47); metals have none; derivatives, and the dtype.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import fresnel, normalised_fresnel

ROUNDING = 1e-12  # of sums of a few terms of size mu^2
COSINES = np.concatenate([np.linspace(0, 1, 41), [1e-6, 1 - 1e-9]])
INDICES = [1.05, 1.33, 1.5, 2.4, 4.0]


def reflectance_by_snell(mu, cosines):
    """|r_s|^2 and |r_p|^2 from the amplitudes at a boundary, averaged."""
    incident = np.asarray(cosines, complex)
    refracted = np.sqrt(1 - (1 - incident**2) / mu**2)
    senkrecht = (incident - mu * refracted) / (incident + mu * refracted)
    parallel = (mu * incident - refracted) / (mu * incident + refracted)
    return (abs(senkrecht) ** 2 + abs(parallel) ** 2) / 2


@pytest.mark.parametrize("mu", INDICES)
def test_reflectance_is_that_of_snells_law(mu):
    expected = reflectance_by_snell(mu, COSINES)
    np.testing.assert_allclose(fresnel(mu, COSINES), expected, rtol=1e-9, atol=ROUNDING)


def test_glass_reflects_four_per_cent_head_on():
    assert fresnel(1.5, np.ones(1))[0] == pytest.approx(0.04, rel=ROUNDING)


@pytest.mark.parametrize("mu", INDICES)
def test_the_ratio_is_one_head_on(mu):
    """Red when the literal F of T 6.2 is used: 25 times too weak at 1.5 (ERRATA 44)."""
    assert normalised_fresnel(mu, np.ones(1))[0] == pytest.approx(1, rel=1e-9)


def test_the_ratio_at_eighty_degrees():
    """ERRATA 47 quotes 9.7 for mu = 1.5."""
    ratio = normalised_fresnel(1.5, np.cos(np.radians([80.0])))[0]
    assert ratio == pytest.approx(9.7, abs=0.05)


@pytest.mark.parametrize("mu", INDICES)
def test_everything_is_reflected_at_grazing_incidence(mu):
    np.testing.assert_allclose(fresnel(mu, np.zeros(1)), 1, rtol=ROUNDING)
    expected = ((mu + 1) / (mu - 1)) ** 2
    np.testing.assert_allclose(normalised_fresnel(mu, np.zeros(1)), expected, rtol=ROUNDING)


def test_a_metal_has_no_ratio():
    np.testing.assert_array_equal(normalised_fresnel(None, COSINES), np.ones_like(COSINES))


def test_cosines_a_rounding_outside_are_the_ends():
    slightly = np.array([-1e-16, 1 + 1e-15])
    np.testing.assert_array_equal(fresnel(1.5, slightly), fresnel(1.5, np.array([0.0, 1.0])))


@pytest.mark.parametrize("cosine", [0.1, 0.5, 0.99])
def test_derivative_in_the_index(cosine):
    def ratio(mu):
        return normalised_fresnel(mu, jnp.full(1, cosine))[0]

    step = 1e-6  # central differences are then good to 1e-9
    numeric = (ratio(1.5 + step) - ratio(1.5 - step)) / (2 * step)
    assert jax.grad(ratio)(1.5) == pytest.approx(float(numeric), rel=1e-6, abs=1e-8)


def test_single_precision_stays_single():
    found = normalised_fresnel(jnp.float32(1.5), COSINES.astype(np.float32))
    assert found.dtype == jnp.float32
    # (g - c)^2 loses half a digit to cancellation.
    np.testing.assert_allclose(found, normalised_fresnel(1.5, COSINES), rtol=1e-5)
