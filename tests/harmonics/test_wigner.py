"""Wigner's small d and the representation matrices of the thesis.

Pinned down: the explicit d^1 and d^2 of T 2.34, whose rows and columns run from m = -l (ERRATA 4);
the sum of factorials in 40 digits at degree 32; orthogonality and composition to degree 128;
D(R1) D(R2) = D(R1 R2); T 2.29 in complex harmonics and T 2.35; orthogonality T 2.41 is tested with
``so3``; derivatives at alpha = 0 and pi.
"""

import jax
import mpmath
import numpy as np
import pytest

from jaxrender.geometry import rotation
from jaxrender.harmonics import complex_basis, flat_index, quarter_turn, representation, small_d

FLOAT64 = 1e-12


def block(table, degree: int) -> np.ndarray:
    band_limit = table.shape[-3] - 1
    own = slice(band_limit - degree, band_limit + degree + 1)
    return np.asarray(table[..., degree, own, own])


def sum_of_factorials(degree: int, m: int, n: int, angle: float) -> float:
    """Wigner's formula for the standard d^l_mn, in 40 digits."""
    with mpmath.workdps(40):
        cosine, sine = mpmath.cos(mpmath.mpf(angle) / 2), mpmath.sin(mpmath.mpf(angle) / 2)
        f = mpmath.factorial
        total = mpmath.mpf(0)
        for s in range(max(0, n - m), min(degree + n, degree - m) + 1):
            power = 2 * degree + n - m - 2 * s
            bottom = f(degree + n - s) * f(s) * f(m - n + s) * f(degree - m - s)
            total += (-1) ** (m - n + s) * cosine**power * sine ** (m - n + 2 * s) / bottom
        root = mpmath.sqrt(f(degree + m) * f(degree - m) * f(degree + n) * f(degree - n))
        return float(root * total)


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 2, 2.9, np.pi, -1.1])
def test_equals_the_matrices_of_the_thesis(angle):
    table = small_d(np.array(angle), 2)
    c, s = np.cos(angle), np.sin(angle)
    hc, hs = np.cos(angle / 2), np.sin(angle / 2)
    r = s / np.sqrt(2)
    first = [[hc**2, r, hs**2], [-r, c, r], [hs**2, -r, hc**2]]
    np.testing.assert_allclose(block(table, 1), first, atol=1e-14)
    second = block(table, 2)
    np.testing.assert_allclose(second[0, 0], hc**4, atol=1e-14)
    np.testing.assert_allclose(second[1, 0], -2 * hc**3 * hs, atol=1e-14)
    np.testing.assert_allclose(second[1, 1], hc**2 * (2 * c - 1), atol=1e-14)
    np.testing.assert_allclose(second[1, 3], (1 + 2 * c) * hs**2, atol=1e-14)
    np.testing.assert_allclose(second[2, 1], -np.sqrt(1.5) * c * s, atol=1e-14)


@pytest.mark.parametrize("angle", [0.05, 1.3, 2.7])
def test_equals_the_sum_of_factorials(angle):
    table = small_d(np.array(angle), 32)
    rng = np.random.default_rng(0)
    for degree in (5, 17, 32):
        own = block(table, degree)
        for m, n in rng.integers(-degree, degree + 1, size=(30, 2)).tolist():
            expected = sum_of_factorials(degree, m, n, angle)
            np.testing.assert_allclose(own[m + degree, n + degree], expected, atol=FLOAT64)


# One table of 68 MB at a time.
@pytest.mark.parametrize("angle", [0.3, 0.8, np.pi / 2])
def test_orthogonal_to_degree_128(angle):
    table = quarter_turn(128) if angle == np.pi / 2 else small_d(np.array(angle), 128)
    for degree in (1, 64, 127, 128):
        own = block(table, degree)
        np.testing.assert_allclose(own @ own.T, np.eye(2 * degree + 1), atol=FLOAT64)


def test_each_angle_has_its_table():
    angles = np.array([0.3, 0.8])
    for angle, own in zip(angles, small_d(angles, 64)):
        np.testing.assert_allclose(own, small_d(np.array(angle), 64), atol=FLOAT64)


def test_entries_beyond_the_degree_are_zero():
    table = np.asarray(small_d(np.array(0.7), 3))
    assert table.shape == (4, 7, 7)
    assert np.count_nonzero(np.abs(table) > 1e-15) == 1 + 9 + 25 + 49


def test_homomorphism():
    rng = np.random.default_rng(1)
    one, two = rng.uniform(0.2, 2.8, size=(2, 3))
    both = np.asarray(rotation(*one)) @ np.asarray(rotation(*two))
    alpha = np.arccos(both[2, 2])
    beta, gamma = np.arctan2(both[1, 2], both[0, 2]), np.arctan2(both[2, 1], -both[2, 0])
    first, second, product = (
        np.asarray(representation(*map(np.asarray, angles), 40))
        for angles in (one, two, (alpha, beta, gamma))
    )
    np.testing.assert_allclose(first @ second, product, atol=FLOAT64)


def test_rotates_the_complex_harmonics():
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(10, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    angles = rng.uniform(-3, 3, size=3)
    matrix = np.asarray(rotation(*angles))
    turned = np.asarray(complex_basis(directions @ matrix.T, 16))
    plain = np.asarray(complex_basis(directions, 16))
    table = representation(*map(np.asarray, angles), 16)
    for degree in (0, 1, 2, 9, 16):
        own = slice(flat_index(degree, -degree), flat_index(degree, degree) + 1)
        expected = plain[:, own] @ block(table, degree).T
        np.testing.assert_allclose(turned[:, own], expected, atol=FLOAT64)


def test_central_column_and_row_are_harmonics():
    alpha, beta, gamma = 0.9, 2.2, -0.4
    table = representation(np.array(alpha), np.array(beta), np.array(gamma), 5)

    def harmonics(polar, azimuth):
        x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
        return np.asarray(complex_basis(np.array([x, y, np.cos(polar)]), 5))

    for degree in range(6):
        own = slice(degree**2, (degree + 1) ** 2)
        scale = np.sqrt(4 * np.pi / (2 * degree + 1))
        column = scale * harmonics(alpha, beta)[own]
        np.testing.assert_allclose(block(table, degree)[:, degree], column, atol=FLOAT64)
        # T 2.35 line 1 holds for gamma = 0 only (ERRATA 5).
        phases = np.exp(1j * np.arange(-degree, degree + 1) * gamma)
        row = scale * np.conj(harmonics(alpha, np.pi)[own]) * phases
        np.testing.assert_allclose(block(table, degree)[degree], row, atol=FLOAT64)


@pytest.mark.parametrize("angle", [0.0, 1.0, np.pi])
def test_derivative_exists_at_every_angle(angle):
    def table(alpha):
        return small_d(alpha, 4)

    slope = jax.jacfwd(table)(np.array(angle))
    step = 1e-5
    expected = (table(np.array(angle + step)) - table(np.array(angle - step))) / (2 * step)
    np.testing.assert_allclose(slope, expected, atol=1e-8)


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="band_limit is -2"):
        small_d(np.array(0.1), -2)
