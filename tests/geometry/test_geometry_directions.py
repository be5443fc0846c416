"""Unit vectors and angles.

Pinned down: the squared angle against mpmath in either precision, its derivatives at cosine 1, and
that no derivative is NaN; angles and directions are inverse to each other and in range; reflection
keeps the angle and the plane; half vectors halve the angle; dtypes survive.
"""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jaxrender.geometry import (
    angles_from_direction,
    direction_from_angles,
    dot,
    half_vectors,
    normalise,
    reflect,
    squared_acute_angle,
    squared_angle,
)

ROUNDING = 1e-14  # a few float64 roundings
ANGLE = 1e-13  # promised relative accuracy for angles up to pi/2
SINGLE = 1e-6  # float32: polynomial of degree 8 and Horner rounding

FIRST = jax.jit(jax.vmap(jax.grad(squared_angle)))
SECOND = jax.jit(jax.vmap(jax.grad(jax.grad(squared_angle))))


def exact_squared_angles(cosines):
    with mpmath.workdps(40):
        return np.array([float(mpmath.acos(mpmath.mpf(float(c))) ** 2) for c in cosines])


def unit_vectors(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_squared_angle_equals_mpmath_relatively_even_for_tiny_angles():
    cosines = np.concatenate([np.linspace(0, 1, 300)[:-1], 1 - np.logspace(-15, -1, 60)])
    np.testing.assert_allclose(squared_angle(cosines), exact_squared_angles(cosines), rtol=ANGLE)


def test_squared_angle_equals_mpmath_beyond_a_right_angle():
    cosines = np.cos(np.linspace(np.pi / 2 + 1e-6, np.pi - 1e-3, 300))
    np.testing.assert_allclose(squared_angle(cosines), exact_squared_angles(cosines), rtol=1e-9)


def test_the_acute_branch_is_the_same_function():
    cosines = np.linspace(0, 1, 100)
    np.testing.assert_array_equal(squared_acute_angle(cosines), squared_angle(cosines))


def test_squared_angle_in_single_precision():
    cosines = np.linspace(-0.999, 0.999, 500, dtype=np.float32)
    found = squared_angle(jnp.asarray(cosines))
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, exact_squared_angles(cosines), rtol=SINGLE)


def test_squared_angle_is_analytic_at_cosine_one():
    # arccos(1 - u)^2 = 2 u + u^2/3 + ...
    one = np.ones(1)
    found = np.concatenate([squared_angle(one), FIRST(one), SECOND(one)])
    np.testing.assert_allclose(found, [0, -2, 2 / 3], atol=1e-9)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_squared_angle_has_finite_derivatives_everywhere(dtype):
    cosines = jnp.array([1 + 1e-7, 1, 1 - 1e-7, 0.5, 0, -0.5, -1, -1 - 1e-7], dtype)
    first = FIRST(cosines)
    second = SECOND(cosines)
    assert np.isfinite(squared_angle(cosines)).all()
    assert np.isfinite(first).all()
    assert np.isfinite(second).all()


def test_squared_angle_derivative_is_that_of_the_angle():
    angles = np.linspace(0.1, 3.0, 50)
    found = FIRST(jnp.cos(angles))
    np.testing.assert_allclose(found, -2 * angles / np.sin(angles), rtol=1e-10)


def test_directions_of_known_angles():
    directions = direction_from_angles(
        np.array([0, np.pi / 2, np.pi / 2]), np.array([0, 0, np.pi / 2])
    )
    np.testing.assert_allclose(directions, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=ROUNDING)


def test_angles_and_directions_are_inverse():
    directions = unit_vectors(500, seed=0)
    polar, azimuth = angles_from_direction(directions)
    np.testing.assert_allclose(direction_from_angles(polar, azimuth), directions, atol=ROUNDING)
    assert np.all((azimuth >= 0) & (azimuth < 2 * np.pi))


def test_azimuth_stays_in_range_at_the_seam_and_the_poles():
    seam = np.array([[1, -1e-18, 0], [0, 0, 1], [-0.0, 0, 1], [-0.0, -0.0, -1]])
    polar, azimuth = angles_from_direction(seam)
    np.testing.assert_array_equal(azimuth, 0)
    np.testing.assert_allclose(polar, [np.pi / 2, 0, 0, np.pi], atol=ROUNDING)


def test_small_polar_angles_keep_their_digits():
    polar, _ = angles_from_direction(np.array([[1e-9, 0.0, 1.0]]))
    np.testing.assert_allclose(polar, [1e-9], rtol=ROUNDING)


def test_reflection_keeps_the_angle_and_the_plane():
    outgoing, normals = unit_vectors(100, seed=1), unit_vectors(100, seed=2)
    mirrored = reflect(outgoing, normals)
    np.testing.assert_allclose(dot(mirrored, normals), dot(outgoing, normals), atol=ROUNDING)
    np.testing.assert_allclose(dot(mirrored, mirrored), 1, atol=ROUNDING)
    np.testing.assert_allclose(reflect(mirrored, normals), outgoing, atol=ROUNDING)
    np.testing.assert_allclose(np.cross(mirrored + outgoing, normals), 0, atol=ROUNDING)


def test_half_vector_of_a_mirror_pair_is_the_normal():
    normals = unit_vectors(100, seed=3)
    outgoing = normalise(normals + 0.5 * unit_vectors(100, seed=4))
    found = half_vectors(reflect(outgoing, normals), outgoing)
    np.testing.assert_allclose(found, normals, atol=ROUNDING)


def test_normalise_scales_only():
    vectors = 7 * unit_vectors(50, seed=5)
    np.testing.assert_allclose(normalise(vectors), vectors / 7, atol=ROUNDING)


def test_tables_of_directions_broadcast():
    nodes, samples = unit_vectors(5, seed=6)[None], unit_vectors(4, seed=7)[:, None]
    assert dot(nodes, samples).shape == (4, 5)
    np.testing.assert_allclose(
        half_vectors(nodes, samples)[2, 3], half_vectors(nodes[0, 3], samples[2, 0]), atol=ROUNDING
    )


@pytest.mark.parametrize("function", [normalise, lambda v: reflect(v, v), lambda v: dot(v, v)])
def test_single_precision_stays_single(function):
    assert function(jnp.ones((4, 3), jnp.float32)).dtype == jnp.float32
