"""Functions on the rotation group.

Pinned down: weights sum to 8 pi^2; orthogonality T 2.41; samples and coefficients are inverse;
transform T 2.45 of a function of known coefficients; correlation T 2.16 against its integral, with
the dagger that T 2.46 lacks (ERRATA 8), and convolution; T 2.43's left factor; misuse.
"""

import numpy as np
import pytest

from jaxrender.geometry import rotation
from jaxrender.harmonics import (
    RotationGrid,
    analyse_rotations,
    complex_basis,
    complex_from_real,
    convolve_rotations,
    correlate_rotations,
    evaluate,
    representation,
    synthesise_rotations,
)

LAW = 1e-10


def mask(band_limit: int) -> np.ndarray:
    order = np.arange(-band_limit, band_limit + 1)
    inside = np.abs(order)[None, :] <= np.arange(band_limit + 1)[:, None]
    return inside[:, :, None] * inside[:, None, :]


def random_coefficients(band_limit: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    inside = mask(band_limit)
    return (rng.normal(size=inside.shape) + 1j * rng.normal(size=inside.shape)) * inside


def angles_of(grid: RotationGrid) -> tuple[np.ndarray, ...]:
    return tuple(np.meshgrid(grid.alphas(), grid.betas(), grid.betas(), indexing="ij"))


def at(coefficients: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """The function itself at rotation matrices, by the sum as written."""
    band_limit = coefficients.shape[0] - 1
    sine = np.hypot(matrices[..., 0, 2], matrices[..., 1, 2])
    alpha = np.arctan2(sine, matrices[..., 2, 2])
    beta = np.arctan2(matrices[..., 1, 2], matrices[..., 0, 2])
    gamma = np.arctan2(matrices[..., 2, 1], -matrices[..., 2, 0])
    table = np.asarray(representation(alpha, beta, gamma, band_limit))
    share = (2 * np.arange(band_limit + 1) + 1) / (8 * np.pi**2)
    return np.einsum("l,...lmn,lmn->...", share, table.conj(), coefficients)


def test_weights_and_orthogonality():
    grid = RotationGrid(3)
    angles = angles_of(grid)
    weights = np.broadcast_to(grid.weights()[:, None, None], grid.shape)
    np.testing.assert_allclose(weights.sum(), 8 * np.pi**2, rtol=1e-14)
    inside = mask(3)
    basis = np.asarray(representation(*angles, 3))[..., inside]
    gram = np.einsum("abg,abgi,abgj->ij", weights, basis.conj(), basis)
    degree = np.nonzero(inside)[0]
    np.testing.assert_allclose(gram, np.diag(8 * np.pi**2 / (2 * degree + 1)), atol=LAW)


@pytest.mark.parametrize("band_limit", [0, 1, 8])
def test_round_trip(band_limit):
    grid, function = RotationGrid(band_limit), random_coefficients(band_limit)
    samples = synthesise_rotations(grid, function)
    np.testing.assert_allclose(
        analyse_rotations(grid, samples, band_limit), function, atol=LAW, rtol=0
    )


def test_synthesis_is_the_sum_as_written():
    function, grid = random_coefficients(3), RotationGrid(4)
    expected = at(function, np.asarray(rotation(*angles_of(grid))))
    np.testing.assert_allclose(synthesise_rotations(grid, function), expected, atol=LAW)


def test_transform_of_light_seen_from_every_frame():
    # f(R) = L(R w) = sum L_m D_mn Y_n(w) (T 2.37) conjugated has f_l = 8 pi^2 / (2l+1) (L Y)^*.
    rng, grid = np.random.default_rng(1), RotationGrid(4)
    light, direction = rng.normal(size=(25, 1)), np.array([0.48, -0.6, 0.64])
    directions = np.asarray(rotation(*angles_of(grid))) @ direction
    samples = np.asarray(evaluate(light, directions.reshape(-1, 3))).reshape(grid.shape)
    found = np.asarray(analyse_rotations(grid, samples, 4))
    of_light = np.asarray(complex_from_real(light))[:, 0]
    of_direction = np.asarray(complex_basis(direction, 4))
    for degree in range(5):
        own, inner = slice(degree**2, (degree + 1) ** 2), slice(4 - degree, 5 + degree)
        expected = np.conj(np.outer(of_light[own], of_direction[own]))
        expected *= 8 * np.pi**2 / (2 * degree + 1)
        np.testing.assert_allclose(found[degree, inner, inner], expected, atol=LAW)


@pytest.mark.parametrize(
    ("combine", "inverted"), [(correlate_rotations, False), (convolve_rotations, True)]
)
def test_convolution_theorem(combine, inverted):
    f, g = random_coefficients(2, seed=2), random_coefficients(2, seed=3)
    grid = RotationGrid(2)
    integrand = np.asarray(rotation(*angles_of(grid)))
    weights = np.broadcast_to(grid.weights()[:, None, None], grid.shape)
    of_g = np.asarray(synthesise_rotations(grid, g))
    points = np.asarray(rotation(*np.random.default_rng(4).uniform(0.3, 2.5, size=(3, 5))))
    combined = at(np.asarray(combine(f, g)), points)
    for point, found in zip(points, combined):
        turned = np.swapaxes(integrand, -1, -2) if inverted else integrand
        factor = of_g if inverted else of_g.conj()
        expected = np.sum(weights * at(f, point @ turned) * factor)
        np.testing.assert_allclose(found, expected, atol=LAW)


def test_precision_follows_the_input():
    grid = RotationGrid(3)
    samples = np.random.default_rng(5).normal(size=grid.shape).astype(np.float32)
    assert analyse_rotations(grid, samples, 3).dtype == np.complex64


def test_misuse_is_refused():
    grid = RotationGrid(2)
    with pytest.raises(ValueError, match=r"degree 3 .*2 or less"):
        analyse_rotations(grid, np.zeros(grid.shape), 3)
    with pytest.raises(ValueError, match=r"on a grid of \(3, 5, 5\)"):
        analyse_rotations(grid, np.zeros((2, 5, 5)), 2)
    with pytest.raises(ValueError, match="band_limit is -1"):
        RotationGrid(-1)
