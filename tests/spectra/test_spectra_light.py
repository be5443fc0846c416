"""Coefficients of lights.

Pinned down: those of sources obey the addition theorem, degree by degree, against SciPy's Legendre
polynomials; an environment's are the sums over its own nodes; uniform light has L_00 =
sqrt(4 pi) and nothing else; linearity over lights; degrees that the image cannot tell are refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import eval_legendre

from jaxrender.harmonics import degree_table
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.spectra import light_coefficients

ROUNDING = 1e-12
RNG = np.random.default_rng(0)
SOURCES = DirectionalSources(RNG.normal(size=(5, 3)), RNG.uniform(0.5, 2, (5, 3)))


def test_sources_obey_the_addition_theorem():
    """sum_m L_lm Y_lm(w) = sum_j E_j (2 l + 1) / (4 pi) P_l(w . w_j)."""
    band_limit = 24
    directions = np.asarray(DirectionalSources(RNG.normal(size=(7, 3)), np.ones((7, 1))).directions)
    table = degree_table(light_coefficients(SOURCES, band_limit), directions)
    cosines = directions @ np.asarray(SOURCES.directions).T
    for degree in range(band_limit + 1):
        zonal = (2 * degree + 1) / (4 * np.pi) * eval_legendre(degree, cosines)
        np.testing.assert_allclose(table[:, degree], zonal @ SOURCES.irradiance, atol=ROUNDING * 10)


def test_no_source_has_no_light():
    found = light_coefficients(DirectionalSources.none(), 2)
    np.testing.assert_array_equal(found, np.zeros((9, 3)))


def test_uniform_light():
    found = np.asarray(light_coefficients(Environment(np.full((16, 32, 2), 3.0)), 7))
    expected = np.zeros((64, 2))
    expected[0] = 3 * np.sqrt(4 * np.pi)
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_an_environment_is_the_sum_of_its_nodes():
    environment = Environment(RNG.uniform(0, 1, (12, 24, 3)))
    nodes = environment.nodes()
    points = light_coefficients(DirectionalSources(nodes.directions, nodes.irradiance), 5)
    np.testing.assert_allclose(light_coefficients(environment, 5), points, atol=ROUNDING)


def test_degrees_beyond_the_image_are_refused():
    with pytest.raises(ValueError, match=r"degree 6 cannot be determined from 12 x 24 texels"):
        light_coefficients(Environment(np.ones((12, 24, 3))), 6)


def test_single_precision_stays_single():
    singles = DirectionalSources(
        np.asarray(SOURCES.directions, np.float32), np.asarray(SOURCES.irradiance, np.float32)
    )
    found = light_coefficients(singles, 16)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, light_coefficients(SOURCES, 16), atol=1e-4)
