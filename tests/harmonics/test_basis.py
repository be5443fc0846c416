"""Real spherical harmonics and functions given by coefficients.

Pinned down: agreement with SciPy to degree 128 in both precisions, at and near the poles too, with
mpmath where SciPy itself is not good enough; the signs of T 4.5 (ERRATA 2 and 3); orthonormality,
Parseval, addition theorem, parity; tangential derivatives against finite differences, at the pole
and at the equator too; the degree table and evaluation against the basis, across chunks; dtype,
batch shape, vmap, jit, reverse mode.
"""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scipy.special import sph_harm_y

from jaxrender.harmonics import (
    LatLongGrid,
    degree_table,
    degrees,
    evaluate,
    explicit_basis,
    flat_index,
    legendre,
    orders,
    real_basis,
)

FLOAT64 = 1e-12
# Measured 7e-6 at degree 128: the recurrence does not see that cos t rounds near the pole.
FLOAT32 = 2e-5
# SciPy takes cos t, which at 1e-8 from the pole rounds to 1: an error of 2e-12 at degree 128.
SCIPY_AT_POLE = 3e-12
# Central differences with a step of 1e-5 at degree 9: truncation (step^2 l^3 / 6) 1e-8.
DIFFERENCES = 1e-7


def random_directions(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def polar_directions() -> np.ndarray:
    """Rings around both poles, from the pole itself to ten degrees off."""
    polar = np.array([0.0, 1e-12, 1e-8, 1e-5, 1e-3, 1e-2, 0.17])[:, None]
    azimuth = np.array([0.0, 0.4, 2.0, 4.5])[None, :]
    x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
    north = np.stack([x, y, np.cos(polar) + 0.0 * azimuth], axis=-1).reshape(-1, 3)
    return np.concatenate([north, north * [1.0, 1.0, -1.0], np.eye(3), -np.eye(3)])


def scipy_basis(directions: np.ndarray, band_limit: int) -> np.ndarray:
    x, y, z = directions.T
    polar, azimuth = np.arctan2(np.hypot(x, y), z)[:, None], np.arctan2(y, x)[:, None]
    degree, order = degrees(band_limit)[None], orders(band_limit)[None]
    # SciPy's sign is Condon and Shortley's; here there is none.
    values = sph_harm_y(degree, np.abs(order), polar, azimuth) * (-1.0) ** order
    scale = np.where(order == 0, 1.0, np.sqrt(2.0))
    return scale * np.where(order >= 0, values.real, values.imag)


@pytest.mark.parametrize("band_limit", [0, 1, 32, 128])
def test_agrees_with_scipy_in_float64(band_limit):
    everywhere = random_directions(40)
    computed = real_basis(everywhere, band_limit)
    np.testing.assert_allclose(computed, scipy_basis(everywhere, band_limit), atol=FLOAT64, rtol=0)
    poles = polar_directions()
    expected = scipy_basis(poles, band_limit)
    np.testing.assert_allclose(real_basis(poles, band_limit), expected, atol=SCIPY_AT_POLE, rtol=0)


@pytest.mark.parametrize("band_limit", [8, 128])
def test_agrees_with_scipy_in_float32(band_limit):
    directions = np.concatenate([random_directions(40), polar_directions()])
    computed = real_basis(directions.astype(np.float32), band_limit)
    assert computed.dtype == jnp.float32
    np.testing.assert_allclose(computed, scipy_basis(directions, band_limit), atol=FLOAT32, rtol=0)


@pytest.mark.parametrize(("degree", "order"), [(128, 0), (127, 1), (128, 3)])
@pytest.mark.parametrize("polar", [1e-8, 1e-3, 0.7, 1.5])
def test_agrees_with_mpmath_where_cosines_round(degree, order, polar):
    with mpmath.workdps(60):
        t = mpmath.mpf(polar)
        norm = mpmath.sqrt(
            (2 * degree + 1) / (4 * mpmath.pi) * mpmath.factorial(degree - order)
        ) / mpmath.sqrt(mpmath.factorial(degree + order))
        plain = mpmath.legenp(degree, order, mpmath.cos(t)) * (-1) ** order
        expected = float(norm * plain.real * (mpmath.sqrt(2) if order else 1))
    direction = np.array([np.sin(polar), 0.0, np.cos(polar)])
    computed = real_basis(direction, 128)[flat_index(degree, order)]
    np.testing.assert_allclose(computed, expected, atol=FLOAT64, rtol=0)


def test_low_degrees_are_the_polynomials_of_the_thesis():
    directions = np.concatenate([random_directions(50), polar_directions()])
    explicit = explicit_basis(directions)
    np.testing.assert_allclose(real_basis(directions, 2), explicit, atol=1e-15, rtol=0)
    x, y, z = directions.T
    # The printed digits of T 4.5, so that a slip shared by both forms cannot hide.
    printed = [
        0.282095 + 0.0 * x,
        0.488603 * y,
        0.488603 * z,
        0.488603 * x,
        1.092548 * x * y,
        1.092548 * y * z,
        0.315392 * (3 * z * z - 1),
        1.092548 * x * z,
        0.546274 * (x * x - y * y),
    ]
    np.testing.assert_allclose(explicit, np.stack(printed, axis=-1), atol=1e-6, rtol=0)


def test_orthonormal_over_the_sphere():
    grid = LatLongGrid(33, 34)
    basis = np.asarray(real_basis(grid.directions(), grid.band_limit))
    gram = np.einsum("hw,hwi,hwj->ij", grid.weights(), basis, basis)
    np.testing.assert_allclose(gram, np.eye(gram.shape[0]), atol=FLOAT64)


def test_parseval():
    grid = LatLongGrid(21, 21)
    coefficients = np.random.default_rng(1).normal(size=(121, 2))
    values = evaluate(coefficients, grid.directions().reshape(-1, 3))
    energy = np.einsum("p,pc->c", grid.weights().ravel(), np.asarray(values) ** 2)
    np.testing.assert_allclose(energy, np.sum(coefficients**2, axis=0), rtol=FLOAT64)


def test_addition_theorem():
    first, second = random_directions(20, 2), random_directions(20, 3)
    product = real_basis(first, 60) * real_basis(second, 60)
    per_degree = np.zeros((20, 61))
    np.add.at(per_degree.T, degrees(60), np.asarray(product).T)
    cosines = np.sum(first * second, axis=-1)
    expected = (2 * np.arange(61) + 1) / (4 * np.pi) * np.asarray(legendre(cosines, 60))
    np.testing.assert_allclose(per_degree, expected, atol=FLOAT64)


def test_parity():
    directions = np.concatenate([random_directions(20), polar_directions()])
    sign = (-1.0) ** degrees(30)[None, :]
    opposite = real_basis(-directions, 30)
    np.testing.assert_allclose(opposite, sign * real_basis(directions, 30), atol=1e-13)


@pytest.mark.parametrize(
    "direction",
    [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.48, -0.6, -0.64]],
)
def test_tangential_derivatives(direction):
    direction = np.asarray(direction)
    step = 1e-5
    tangents = np.linalg.svd(direction[None, :])[2][1:]
    for tangent in tangents:
        ends = [np.cos(step) * direction + s * np.sin(step) * tangent for s in (1.0, -1.0)]
        forward, backward = (np.asarray(real_basis(end, 9)) for end in ends)
        _, derivative = jax.jvp(
            lambda d: real_basis(d, 9), (jnp.asarray(direction),), (jnp.asarray(tangent),)
        )
        expected = (forward - backward) / (2.0 * step)
        np.testing.assert_allclose(derivative, expected, atol=DIFFERENCES)


def test_reverse_mode_is_the_adjoint_of_forward_mode_across_chunks():
    directions = jnp.asarray(np.concatenate([random_directions(300), polar_directions()]))
    coefficients = jnp.asarray(np.random.default_rng(4).normal(size=(36, 3)))
    moves = jnp.asarray(random_directions(directions.shape[0], 5))
    _, forward = jax.jvp(lambda d: degree_table(coefficients, d), (directions,), (moves,))
    weights = jnp.asarray(np.random.default_rng(6).normal(size=forward.shape))
    gradient = jax.grad(lambda d: jnp.sum(weights * degree_table(coefficients, d)))(directions)
    assert np.all(np.isfinite(gradient))
    np.testing.assert_allclose(jnp.sum(gradient * moves), jnp.sum(weights * forward), rtol=1e-11)


# One chunk, exactly one, one more, several: the padding must not show.
@pytest.mark.parametrize(
    ("count", "band_limit"), [(0, 3), (256, 12), (257, 0), (257, 1), (700, 12)]
)
def test_degree_table_and_evaluation_agree_with_the_basis(count, band_limit):
    directions = random_directions(max(count, 1), 7)[:count]
    coefficients = np.random.default_rng(8).normal(size=((band_limit + 1) ** 2, 3))
    terms = scipy_basis(directions, band_limit)[:, :, None] * coefficients[None]
    expected = np.stack(
        [terms[:, degrees(band_limit) == deg].sum(axis=1) for deg in range(band_limit + 1)], axis=1
    )
    table = degree_table(coefficients, directions)
    np.testing.assert_allclose(table, expected, atol=FLOAT64)
    values = evaluate(coefficients, directions)
    np.testing.assert_allclose(values, terms.sum(axis=1), atol=FLOAT64)
    basis = real_basis(directions, band_limit)
    np.testing.assert_allclose(basis, scipy_basis(directions, band_limit), atol=FLOAT64)


def test_degree_table_in_float32_and_linear_in_the_coefficients():
    directions = np.concatenate([random_directions(300), polar_directions()])
    coefficients = np.random.default_rng(9).normal(size=(65**2, 3))
    exact = degree_table(coefficients, directions)
    single = degree_table(coefficients.astype(np.float32), directions.astype(np.float32))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, exact, atol=1e-4)
    weights = np.random.default_rng(10).normal(size=exact.shape)
    gradient = jax.grad(lambda c: jnp.sum(weights * degree_table(c, directions)))(
        jnp.asarray(coefficients)
    )
    np.testing.assert_allclose(jnp.sum(gradient * coefficients), jnp.sum(weights * exact))


def test_batch_shapes_and_transformations():
    directions = random_directions(24).reshape(2, 3, 4, 3)
    coefficients = np.random.default_rng(11).normal(size=(2, 16, 3))
    whole = real_basis(directions, 3)
    assert whole.shape == (2, 3, 4, 16)
    np.testing.assert_allclose(whole[1, 2, 3], real_basis(directions[1, 2, 3], 3), atol=1e-15)
    assert explicit_basis(directions).shape == (2, 3, 4, 9)
    points = directions.reshape(2, 12, 3)
    mapped = jax.jit(jax.vmap(degree_table))(coefficients, points)
    np.testing.assert_allclose(mapped[1], degree_table(coefficients[1], points[1]), atol=1e-14)


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="band_limit is -2"):
        real_basis(np.eye(3), -2)
    with pytest.raises(ValueError, match="8 coefficients"):
        evaluate(np.ones((8, 3)), np.eye(3))
    with pytest.raises(ValueError, match="8 coefficients"):
        degree_table(np.ones((8, 3)), np.eye(3))
