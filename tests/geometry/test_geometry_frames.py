"""Rotations and local frames.

Pinned down: T 2.10 as the product Rz(beta) Ry(alpha) Rz(gamma) of SciPy's rotations, and that it
takes +Z to (sin a cos b, sin a sin b, cos a) (ERRATA 1: the printed axes do not); local frames are
rotations with the normal as third column, at and near both poles too, and have finite, correct
derivatives; to_local and to_world are inverse and agree with T 2.10.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.spatial.transform import Rotation

from jaxrender.geometry import (
    direction_from_angles,
    meridian_frames,
    rotation,
    to_local,
    to_world,
    world_from_local,
)

ROUNDING = 1e-14  # a few float64 roundings

POLES = np.array([[0, 0, 1], [0, 0, -1], [-0.0, 0, 1], [1e-9, 0, -1], [1e-200, 1e-200, -1.0]])


def normals(count=200, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate([unit, np.eye(3), -np.eye(3), POLES])


def test_rotation_takes_z_to_the_normal():
    alpha, beta = np.array([0.3, 1.2, 3.0]), np.array([0.4, -2.0, 5.0])
    taken = to_world(rotation(alpha, beta, np.array([0.7, 0.1, -1.0])), np.eye(3)[[2, 2, 2]])
    expected = [np.sin(alpha) * np.cos(beta), np.sin(alpha) * np.sin(beta), np.cos(alpha)]
    np.testing.assert_allclose(taken, np.stack(expected, axis=-1), atol=ROUNDING)


def test_rotation_is_the_product_of_the_thesis():
    alpha, beta, gamma = 0.3, 1.1, -0.8
    expected = Rotation.from_euler("ZYZ", [beta, alpha, gamma]).as_matrix()
    np.testing.assert_allclose(rotation(alpha, beta, gamma), expected, atol=ROUNDING)


def test_rotation_broadcasts_over_angles():
    grid = rotation(np.zeros((4, 1)), np.linspace(0, 1, 5)[None, :], 0.2)
    assert grid.shape == (4, 5, 3, 3)
    np.testing.assert_allclose(grid[2, 3], rotation(0.0, 0.75, 0.2), atol=ROUNDING)


def test_frames_are_rotations_whose_third_column_is_the_normal():
    given = normals()
    frames = np.asarray(world_from_local(given))
    np.testing.assert_array_equal(frames[..., 2], given)
    identity = np.broadcast_to(np.eye(3), frames.shape)
    np.testing.assert_allclose(np.einsum("nij,nik->njk", frames, frames), identity, atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.det(frames), 1, atol=ROUNDING)


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_frames_are_continuous_at_the_poles(pole):
    around = np.array([[np.cos(a) * 1e-6, np.sin(a) * 1e-6, pole] for a in (0, 2, 4)])
    at_pole = world_from_local(np.array([0, 0, pole]))
    frames = world_from_local(around)
    np.testing.assert_allclose(frames, np.broadcast_to(at_pole, frames.shape), atol=3e-6)


@pytest.mark.parametrize("normal", [[0, 0, 1], [0, 0, -1], [0.48, -0.64, -0.6]])
def test_frames_are_differentiable(normal):
    check_grads(world_from_local, (jnp.array(normal, jnp.float64),), order=1, eps=1e-5)


def test_meridian_frames_are_the_thesis_s_rotation_without_a_turn():
    alpha, beta = np.meshgrid([0.3, 1.2, np.pi / 2, 2.0, 3.0], np.linspace(-3, 3, 7))
    found = meridian_frames(direction_from_angles(alpha, beta))
    np.testing.assert_allclose(found, rotation(alpha, beta, 0.0), atol=ROUNDING)
    for pole in (1.0, -1.0):
        normal = jnp.array([0.0, 0.0, pole])
        expected = rotation(np.arccos(pole), 0.0, 0.0)
        np.testing.assert_allclose(meridian_frames(normal), expected, atol=ROUNDING)
        assert np.all(np.isfinite(jax.jacfwd(meridian_frames)(normal)))


@pytest.mark.parametrize("pole", [1.0, -1.0])
@pytest.mark.parametrize(("kind", "tolerance"), [("float64", 1e-6), ("float32", 1e-3)])
def test_derivatives_of_meridian_frames_turn_them_rigidly_at_and_near_the_poles(
    pole, kind, tolerance
):
    """What two directions share across the normal does not know the tangent's azimuth."""
    first, second = np.array([0.4, 0.2, 0.7]), np.array([-0.3, 0.6, -0.2])

    def across(normal):
        frame = meridian_frames(normal)
        pair = [to_local(frame, jnp.asarray(d, kind))[:2] for d in (first, second)]
        return pair[0] @ pair[1]

    sines = [0, 0, 1e-30, 1e-17, 1e-12, 1e-9, 1e-7, 1e-5, 1e-2]
    for sine, azimuth in zip(sines, np.linspace(0, 6, len(sines))):
        n = [sine * np.cos(azimuth), sine * np.sin(azimuth), pole * np.sqrt(1 - sine**2)]
        found = np.asarray(jax.grad(across)(jnp.asarray(n, kind)), float)
        # d1 . d2 - (n . d1) (n . d2), of which the part across n has a meaning.
        expected = -(first * np.dot(n, second) + second * np.dot(n, first))
        moved = (found - expected) - np.dot(found - expected, n) * np.array(n)
        assert np.abs(moved).max() < tolerance, (sine, found, expected)


def test_to_local_and_to_world_are_inverse():
    frames = world_from_local(normals())
    directions = normals(seed=1)
    np.testing.assert_allclose(
        to_local(frames, to_world(frames, directions)), directions, atol=ROUNDING
    )


def test_local_z_is_the_cosine_to_the_normal():
    given, directions = normals(), normals(seed=2)
    local = to_local(world_from_local(given), directions)
    np.testing.assert_allclose(local[:, 2], np.sum(given * directions, axis=1), atol=ROUNDING)


def test_the_thesis_rotation_and_the_frame_differ_by_a_turn_about_the_normal():
    alpha, beta = 0.9, 2.3
    turn = jnp.matmul(
        world_from_local(direction_from_angles(alpha, beta)).T, rotation(alpha, beta, 0.0)
    )
    np.testing.assert_allclose(turn[2], [0, 0, 1], atol=ROUNDING)
    np.testing.assert_allclose(turn[:, 2], [0, 0, 1], atol=ROUNDING)


def test_single_precision_stays_single():
    frames = jax.jit(world_from_local)(jnp.array([[0.6, 0, 0.8]], jnp.float32))
    assert frames.dtype == jnp.float32
    assert rotation(*jnp.ones(3, jnp.float32)).dtype == jnp.float32
