"""Rotation of real coefficients.

Pinned down: the rotated function is the function at rotated directions (T 2.29), at gimbal lock
too; homomorphism, norm, batches, both precisions; angles and matrices agree; real and complex
forms agree; mirrors; what is no rotation is refused; derivatives in the rotation against finite
differences along rotations, at lock too; compile time at degree 30.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxrender.geometry import rotation
from jaxrender.harmonics import (
    complex_from_real,
    degrees,
    evaluate,
    orders,
    reflect,
    representation,
    rotate,
    rotate_by_angles,
    rotation_matrices,
)

FLOAT64 = 1e-12
# Degree 20: phases of angles m beta, each rounded to 20 x 1.2e-7.
FLOAT32 = 2e-5

# Identity, half turns, a rotation that only just locks, and its neighbours.
LOCKED = [
    np.eye(3),
    np.diag([1.0, -1.0, -1.0]),
    np.diag([-1.0, -1.0, 1.0]),
    Rotation.from_rotvec([1e-9, 0.0, 2.0]).as_matrix(),
    Rotation.from_rotvec([0.0, np.pi / 2, 0.0]).as_matrix(),
    Rotation.from_rotvec([0.0, np.pi / 4, 0.0]).as_matrix(),
]


def random_rotations(count: int) -> np.ndarray:
    return Rotation.random(count, rng=np.random.default_rng(count)).as_matrix()


def random_coefficients(band_limit: int, channels: int = 2) -> np.ndarray:
    rng = np.random.default_rng(band_limit)
    values = rng.normal(size=((band_limit + 1) ** 2, channels))
    return values / np.linalg.norm(values, axis=0)


def random_directions(count: int) -> np.ndarray:
    vectors = np.random.default_rng(count).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("band_limit", [0, 1, 20])
def test_rotated_function_is_the_function_at_rotated_directions(band_limit):
    light, directions = random_coefficients(band_limit), random_directions(12)
    matrices = np.concatenate([LOCKED, random_rotations(5)])
    for matrix, turned in zip(matrices, rotate(light, matrices)):
        world = directions @ matrix.T
        np.testing.assert_allclose(
            evaluate(turned, world), evaluate(light, directions), atol=FLOAT64
        )


def test_homomorphism_and_orthogonality():
    one, two = random_rotations(2)
    first, second, both = np.asarray(rotation_matrices(np.stack([one, two, one @ two]), 30))
    np.testing.assert_allclose(first @ second, both, atol=FLOAT64)
    inverse = np.asarray(rotation_matrices(one.T, 30))
    np.testing.assert_allclose(inverse, np.swapaxes(first, -1, -2), atol=FLOAT64)


def test_matrices_are_what_rotate_applies():
    light, matrix = random_coefficients(4), random_rotations(1)[0]
    table = np.asarray(rotation_matrices(matrix, 4))
    place = (degrees(4)[:, None], orders(4)[:, None] + 4, orders(4)[None, :] + 4)
    dense = np.where(degrees(4)[:, None] == degrees(4)[None, :], table[place], 0.0)
    np.testing.assert_allclose(rotate(light, matrix), dense @ light, atol=FLOAT64)


def test_angles_and_matrices_agree():
    light, angles = random_coefficients(9), np.random.default_rng(3).uniform(-3, 3, size=(3, 2, 4))
    by_angles = rotate_by_angles(light, *angles)
    assert by_angles.shape == (2, 4, 100, 2)
    by_matrix = rotate(light, rotation(*angles))
    np.testing.assert_allclose(by_angles, by_matrix, atol=FLOAT64)


def test_complex_form_agrees():
    # f(R^T w) = sum f_m Y_m(R^T w), and D(R^T) is the adjoint of D(R).
    light, angles = random_coefficients(6), np.array([0.8, 2.0, -1.3])
    table = np.asarray(representation(*map(np.asarray, angles), 6))
    before = np.asarray(complex_from_real(light))
    expected = np.zeros_like(before)
    for degree in range(7):
        own, inner = slice(degree**2, (degree + 1) ** 2), slice(6 - degree, 7 + degree)
        expected[own] = table[degree, inner, inner].conj() @ before[own]
    found = complex_from_real(rotate(light, rotation(*angles)))
    np.testing.assert_allclose(found, expected, atol=FLOAT64)


def test_float32():
    light, matrices = random_coefficients(20), np.concatenate([LOCKED, random_rotations(3)])
    turned = rotate(light.astype(np.float32), matrices.astype(np.float32))
    assert turned.dtype == jnp.float32
    np.testing.assert_allclose(turned, rotate(light, matrices), atol=FLOAT32)


def test_batch_shape_and_vmap():
    light, matrices = random_coefficients(3), random_rotations(6).reshape(2, 3, 3, 3)
    turned = rotate(light, matrices)
    assert turned.shape == (2, 3, 16, 2)
    mapped = jax.vmap(jax.vmap(rotate, (None, 0)), (None, 0))(light, matrices)
    np.testing.assert_allclose(mapped, turned, atol=1e-14)


def test_derivative_along_rotations():
    light, weight = random_coefficients(6), random_coefficients(6)[::-1]

    @jax.jit
    def overlap(world_from_local):
        return jnp.sum(weight * rotate(light, world_from_local))

    slope_of, step = jax.jit(jax.grad(overlap)), 1e-5
    for matrix in (*LOCKED, random_rotations(1)[0]):
        gradient = np.asarray(slope_of(matrix))
        assert np.all(np.isfinite(gradient))
        for axis in np.eye(3):
            ahead = Rotation.from_rotvec(step * axis).as_matrix()
            slope = (overlap(ahead @ matrix) - overlap(ahead.T @ matrix)) / (2 * step)
            found = np.sum(gradient * (np.cross(np.eye(3), axis) @ matrix))
            # Differences: step^2 l^3 / 6.
            np.testing.assert_allclose(found, slope, atol=1e-8)


def test_compiles_quickly_and_not_per_degree():
    light, matrices = random_coefficients(30), random_rotations(7)
    start = time.perf_counter()
    jax.block_until_ready(rotate(light, matrices))
    assert time.perf_counter() - start < 2.0


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="5 coefficients"):
        rotate(np.zeros((5, 1)), np.eye(3))
    with pytest.raises(ValueError, match="band_limit is -1"):
        rotation_matrices(np.eye(3), -1)


MIRRORS = [np.diag([1.0, 1.0, -1.0]), -np.eye(3), *(-m for m in random_rotations(3))]


@pytest.mark.parametrize("mirror", MIRRORS)
def test_reflected_function_is_the_function_at_reflected_directions(mirror):
    light, directions = random_coefficients(6), random_directions(12)
    np.testing.assert_allclose(
        evaluate(reflect(light, mirror), directions @ mirror.T),
        evaluate(light, directions),
        atol=FLOAT64,
    )


def test_derivative_of_a_reflection_by_its_matrix():
    light, mirror = jnp.asarray(random_coefficients(4)), MIRRORS[-1]
    step = Rotation.from_rotvec([0.0, 1e-5, 2e-5])
    ahead, behind = (reflect(light, turn.as_matrix() @ mirror) for turn in (step, step.inv()))
    move = np.asarray(step.as_matrix() - step.inv().as_matrix()) / 2 @ mirror
    _, found = jax.jvp(lambda m: reflect(light, m), (jnp.asarray(mirror),), (jnp.asarray(move),))
    np.testing.assert_allclose(found, (ahead - behind) / 2, atol=1e-12)


@pytest.mark.parametrize(
    ("function", "matrix", "message"),
    [
        (rotate, MIRRORS[0], r"world_from_local has determinant -1, wanted 1: reflect takes"),
        (rotate, 2 * np.eye(3), "determinant 8 and is not orthogonal, .* scale and shear"),
        (rotate, np.stack([np.eye(3), MIRRORS[0]]), r"world_from_local\[1\] has determinant -1"),
        (rotate, np.full((3, 3), np.nan), "determinant nan"),
        (reflect, np.eye(3), "has determinant 1, wanted -1: rotate takes rotations"),
        (lambda _, m: rotation_matrices(m, 2), MIRRORS[0], "determinant -1"),
    ],
)
def test_matrices_of_another_kind_are_refused(function, matrix, message):
    with pytest.raises(ValueError, match=message):
        function(random_coefficients(2), matrix)
