"""Irradiance as a sum of harmonics.

Pinned down: it is the hemispherical integral of band-limited light; uniform light gives pi L;
linear light gives 2 pi / 3 of its gradient (ERRATA 42: A_l, not rho_l); degrees beyond 32 are cut
and worth less than the module says.
"""

import jax.numpy as jnp
import numpy as np
from reflection_problems import random_samples, unit_vectors

from jaxrender.brdf import Lambertian
from jaxrender.harmonics import evaluate
from jaxrender.reflection import irradiance, polar_columns

ROUNDING = 1e-12
# What A_34 = 7e-4 and its successors let through of light of size 1 in one harmonic.
BEYOND_BAND_LIMIT = 1e-3


def test_it_is_the_integral_of_the_light_above_the_surface():
    coefficients = np.random.default_rng(0).normal(size=(13**2, 2))
    samples = random_samples(15)
    columns = polar_columns(
        Lambertian(np.ones(2)), samples, lambda d: evaluate(jnp.asarray(coefficients), d), 96
    )
    found = irradiance(coefficients, samples.normals)
    np.testing.assert_allclose(found, columns[:, 0], atol=1e-9)


def test_uniform_light_gives_pi():
    found = irradiance(np.full((1, 3), 2 * np.sqrt(4 * np.pi)), unit_vectors(5, 0))
    np.testing.assert_allclose(found, np.full((5, 3), 2 * np.pi), rtol=ROUNDING)


def test_linear_light_gives_two_thirds_pi():
    """L = 1 + z: E = pi + (2 pi / 3) n_z."""
    coefficients = np.zeros((4, 1))
    coefficients[0], coefficients[2] = np.sqrt(4 * np.pi), np.sqrt(4 * np.pi / 3)
    normals = unit_vectors(5, 1)
    expected = np.pi + 2 * np.pi / 3 * normals[:, 2:]
    np.testing.assert_allclose(irradiance(coefficients, normals), expected, rtol=ROUNDING)


def test_degrees_beyond_the_diffuse_band_limit():
    """One zonal harmonic of degree 34, at its peak: A_34 Y_34,0 is left out, no more."""
    coefficients = np.zeros((35**2, 1))
    coefficients[34 * 35] = 1
    up = np.array([[0, 0, 1.0]])
    left_out = 7.2e-4 * np.sqrt(69 / (4 * np.pi))
    peak = np.asarray(evaluate(jnp.asarray(coefficients), jnp.asarray(up)))[0, 0]
    assert irradiance(coefficients, up)[0, 0] == 0
    assert left_out < BEYOND_BAND_LIMIT * peak
    kept = coefficients[: 33**2].copy()
    kept[32 * 33] = 1
    assert abs(irradiance(kept, up)[0, 0]) > 7e-4
