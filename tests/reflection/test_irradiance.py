"""Irradiance as a sum of harmonics.

Pinned down: it is the hemispherical integral of band-limited light; uniform light gives pi L;
linear light gives 2 pi / 3 of its gradient (ERRATA 42: A_l, not rho_l); under a source it is the
clamped cosine to no more than is left out, in both precisions.  The matrix and the polynomial of
T 4.14 to 4.16 are the degrees up to 2; the constants are those of T 4.15 with ERRATA 29; the
polynomial's own derivative rule agrees with finite differences in the normal and in the light; the
bounds of T 4.3.1 hold and are reached by a directional source.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reflection_problems import random_samples, unit_vectors

from jaxrender.brdf import Lambertian
from jaxrender.harmonics import evaluate, real_basis
from jaxrender.reflection import (
    irradiance,
    irradiance_error,
    irradiance_matrix,
    matrix_irradiance,
    polar_columns,
    quadratic_constants,
    quadratic_irradiance,
)
from jaxrender.spectra import lambertian_transfer

ROUNDING = 1e-12


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


@pytest.mark.parametrize(("dtype", "rounding"), [(np.float64, 1e-11), (np.float32, 1e-5)])
def test_all_degrees_of_a_source_count(dtype, rounding):
    """A source at +Z to degree 128: E is the cosine but for degrees above, not above 32."""
    band_limit = 128
    source = np.asarray(real_basis(np.array([0, 0, 1.0]), band_limit), dtype)[:, None]
    cosines = np.concatenate([np.linspace(-1, 1, 41), [1e-3, -1e-3]])
    normals = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=1).astype(dtype)
    found = irradiance(source, normals)
    assert found.dtype == dtype
    off = np.abs(np.asarray(found)[:, 0] - np.maximum(cosines, 0))
    bound = irradiance_error(band_limit).worst
    assert bound < 0.26 * irradiance_error(32).worst
    assert off.max() < bound + rounding
    series = lambertian_transfer(band_limit) * (2 * np.arange(band_limit + 1) + 1) / (4 * np.pi)
    expected = np.polynomial.legendre.legval(cosines, series)
    np.testing.assert_allclose(found[:, 0], expected, atol=rounding)


def random_matrix(seed=0, coefficients=9):
    light = np.random.default_rng(seed).normal(size=(coefficients, 3))
    return light, irradiance_matrix(light)


def test_constants_are_those_printed():
    """ERRATA 29: c2 and c3 end in 3 and 4 where 4 and 5 are printed."""
    expected = (0.429043, 0.511663, 0.743124, 0.886227, 0.247708)
    np.testing.assert_allclose(quadratic_constants(), expected, atol=5e-7)


@pytest.mark.parametrize("form", [quadratic_irradiance, matrix_irradiance])
def test_the_quadratic_forms_are_the_sum_to_degree_two(form):
    light, matrix = random_matrix()
    normals = jnp.asarray(unit_vectors(50, 3))
    np.testing.assert_allclose(form(matrix, normals), irradiance(light, normals), atol=1e-12)


def test_light_of_other_degrees():
    """Of more coefficients nine count; of fewer the rest is dark."""
    light, matrix = random_matrix(coefficients=25)
    np.testing.assert_allclose(matrix, irradiance_matrix(light[:9]), rtol=ROUNDING)
    normals = jnp.asarray(unit_vectors(5, 3))
    flat = quadratic_irradiance(irradiance_matrix(light[:4]), normals)
    np.testing.assert_allclose(flat, irradiance(light[:4], normals), atol=ROUNDING)


@pytest.mark.parametrize("which", [0, 1])
def test_the_derivative_rule(which):
    _, matrix = random_matrix(1)
    point = [matrix, jnp.asarray(unit_vectors(20, 4))]
    rng = np.random.default_rng(2)
    step = jnp.asarray(rng.normal(size=point[which].shape))
    if which == 0:
        # The rule holds for the symmetric matrices that lights make.
        step = step + jnp.swapaxes(step, 1, 2)
    weights = jnp.asarray(rng.normal(size=(20, 3)))

    def value(size):
        moved = [*point]
        moved[which] = point[which] + size * step
        return jnp.sum(weights * quadratic_irradiance(*moved))

    slope = jax.grad(value)(0.0)
    # Quadratic in the normal, so central differences are exact but for rounding.
    np.testing.assert_allclose(slope, (value(1e-2) - value(-1e-2)) / 2e-2, rtol=1e-9)


def test_error_bounds_are_those_of_a_directional_source():
    light = np.asarray(real_basis(jnp.asarray([[0, 0, 1.0]]), 2)).T
    cosines = np.linspace(-1, 1, 4001)
    normals = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=1)
    off = np.abs(np.asarray(irradiance(light, normals))[:, 0] - np.maximum(cosines, 0))
    bound = irradiance_error(2)
    assert bound.worst == pytest.approx(off.max(), rel=1e-9)
    # Over all normals the cosine is uniformly distributed.
    assert bound.mean == pytest.approx(np.trapezoid(off, cosines) / 2, rel=1e-5)
    assert bound.worst == pytest.approx(0.09375)
    assert irradiance_error(4).worst < bound.worst
