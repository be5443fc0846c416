"""Functions on the circle.

Pinned down: T 2.17's basis is orthonormal; samples and coefficients are inverse, odd and even
counts, one sample too; rotation theorem T 2.19; reflection equation T 2.24 against the integral
T 2.2; misuse.
"""

import jax
import numpy as np
import pytest

from jaxrender.harmonics import (
    analyse_circle,
    circle_angles,
    circle_basis,
    reflect_circle,
    rotate_circle,
    synthesise_circle,
)

FLOAT64 = 1e-13


def random_coefficients(band_limit: int, channels: int = 2) -> np.ndarray:
    rng = np.random.default_rng(band_limit)
    shape = (2 * band_limit + 1, channels)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def test_basis_is_orthonormal():
    basis = np.asarray(circle_basis(circle_angles(40), 9))
    gram = basis.conj().T @ basis * (2 * np.pi / 40)
    np.testing.assert_allclose(gram, np.eye(19), atol=FLOAT64)
    expected = np.exp(2j * 0.3) / np.sqrt(2 * np.pi)
    np.testing.assert_allclose(circle_basis(np.array(0.3), 2)[4], expected, atol=FLOAT64)


@pytest.mark.parametrize(("count", "band_limit"), [(1, 0), (2, 0), (3, 1), (16, 7), (17, 8)])
def test_round_trip(count, band_limit):
    light = random_coefficients(band_limit)
    back = analyse_circle(synthesise_circle(light, count), band_limit)
    np.testing.assert_allclose(back, light, atol=FLOAT64)


def test_real_samples_have_conjugate_coefficients():
    samples = np.random.default_rng(0).normal(size=(11, 1)).astype(np.float32)
    light = np.asarray(analyse_circle(samples, 5))
    assert light.dtype == np.complex64
    np.testing.assert_allclose(light[::-1], light.conj(), atol=1e-6)
    np.testing.assert_allclose(synthesise_circle(light, 11).real, samples, atol=1e-5)


def test_rotation_shifts_the_angle():
    light, angles = random_coefficients(4), np.array([0.0, 0.7, -3.0])
    points = np.random.default_rng(1).uniform(0, 6, size=8)
    rotated = np.asarray(rotate_circle(light, angles))
    for angle, turned in zip(angles, rotated):
        expected = np.asarray(circle_basis(points + angle, 4)) @ light
        np.testing.assert_allclose(circle_basis(points, 4) @ turned, expected, atol=FLOAT64)


def test_reflection_equation():
    light, transfer = random_coefficients(5, 1), random_coefficients(5, 3)
    normals = circle_angles(7)
    nodes = np.arange(24) * (2 * np.pi / 24)
    rho = np.conj(np.asarray(circle_basis(nodes, 5))) @ transfer
    seen = np.asarray(circle_basis(normals[:, None] + nodes[None, :], 5)) @ light
    expected = np.einsum("atc,tp->ap", seen, rho) * (2 * np.pi / 24)
    found = np.asarray(circle_basis(normals, 5)) @ np.asarray(reflect_circle(light, transfer))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_differentiable_in_the_angle():
    light = random_coefficients(3)

    def energy(angle):
        return jax.numpy.sum(rotate_circle(light, angle).real ** 2)

    angle, step = np.array(0.4), 1e-5
    ahead, behind = np.array(angle + step), np.array(angle - step)
    slope = (energy(ahead) - energy(behind)) / (2 * step)
    np.testing.assert_allclose(jax.grad(energy)(angle), slope, rtol=1e-7)


def test_misuse_is_refused():
    with pytest.raises(ValueError, match=r"degree 4 cannot be determined from 8 .*3 or less"):
        analyse_circle(np.zeros((8, 1)), 4)
    with pytest.raises(ValueError, match="band_limit is -1"):
        analyse_circle(np.zeros((8, 1)), -1)
    with pytest.raises(ValueError, match="4 coefficients"):
        synthesise_circle(np.zeros((4, 1), complex), 8)
    with pytest.raises(ValueError, match="0 samples"):
        synthesise_circle(np.zeros((3, 1), complex), 0)
    with pytest.raises(ValueError, match="light of 3"):
        reflect_circle(np.zeros((3, 1), complex), np.zeros((5, 1), complex))
