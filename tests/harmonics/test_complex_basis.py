"""Complex harmonics and their coefficients.

Pinned down: agreement with SciPy, Condon-Shortley sign included, to degree 80; the polynomials of
T 2.27; a function evaluated from either kind of coefficients is the same; conversions are inverse,
keep the norm, keep the dtype, and take the real part of a complex function; misuse.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import sph_harm_y

from jaxrender.harmonics import (
    complex_basis,
    complex_from_real,
    degrees,
    evaluate,
    flat_index,
    orders,
    real_from_complex,
)

FLOAT64 = 1e-12


def random_directions(count: int) -> np.ndarray:
    vectors = np.random.default_rng(count).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def random_coefficients(band_limit: int) -> np.ndarray:
    return np.random.default_rng(band_limit).normal(size=((band_limit + 1) ** 2, 3))


def test_equals_scipy():
    directions, band_limit = random_directions(40), 80
    x, y, z = directions.T
    polar, azimuth = np.arctan2(np.hypot(x, y), z)[:, None], np.arctan2(y, x)[:, None]
    expected = sph_harm_y(degrees(band_limit)[None], orders(band_limit)[None], polar, azimuth)
    np.testing.assert_allclose(complex_basis(directions, band_limit), expected, atol=FLOAT64)


def test_equals_the_polynomials_of_the_thesis():
    directions = random_directions(7)
    x, y, z = directions.T
    basis = np.asarray(complex_basis(directions, 2))
    expected = {
        (1, 1): -np.sqrt(3 / (8 * np.pi)) * (x + 1j * y),
        (1, -1): np.sqrt(3 / (8 * np.pi)) * (x - 1j * y),
        (2, 0): 0.5 * np.sqrt(5 / (4 * np.pi)) * (3 * z**2 - 1),
        (2, 1): -np.sqrt(15 / (8 * np.pi)) * z * (x + 1j * y),
        (2, 2): 0.5 * np.sqrt(15 / (8 * np.pi)) * (x + 1j * y) ** 2,
    }
    for (degree, order), values in expected.items():
        np.testing.assert_allclose(basis[:, flat_index(degree, order)], values, atol=1e-14)


@pytest.mark.parametrize("band_limit", [0, 6])
def test_both_expansions_give_the_same_function(band_limit):
    directions, light = random_directions(9), random_coefficients(band_limit)
    values = complex_basis(directions, band_limit) @ complex_from_real(light)
    np.testing.assert_allclose(values.imag, 0.0, atol=FLOAT64)
    np.testing.assert_allclose(values.real, evaluate(light, directions), atol=FLOAT64)


def test_conversions_are_inverse_and_keep_the_norm():
    light = random_coefficients(12)
    converted = complex_from_real(light)
    np.testing.assert_allclose(real_from_complex(converted), light, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(converted), np.linalg.norm(light), rtol=1e-14)


def test_of_a_complex_function_the_real_part_is_taken():
    directions, rng = random_directions(9), np.random.default_rng(0)
    mixed = rng.normal(size=(16, 2)) + 1j * rng.normal(size=(16, 2))
    expected = np.asarray(complex_basis(directions, 3) @ mixed).real
    found = evaluate(real_from_complex(mixed), directions)
    np.testing.assert_allclose(found, expected, atol=FLOAT64)


def test_precision_follows_the_input():
    directions = random_directions(3).astype(np.float32)
    light = random_coefficients(2).astype(np.float32)
    assert complex_basis(directions, 2).dtype == jnp.complex64
    assert complex_from_real(light).dtype == jnp.complex64
    assert real_from_complex(complex_from_real(light)).dtype == jnp.float32


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="band_limit is -1"):
        complex_basis(random_directions(2), -1)
    with pytest.raises(ValueError, match="5 coefficients"):
        complex_from_real(np.zeros((5, 1)))
    with pytest.raises(ValueError, match="5 coefficients"):
        real_from_complex(np.zeros((5, 1), complex))
