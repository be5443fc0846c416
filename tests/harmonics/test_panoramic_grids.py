"""Grids other than latitude-longitude, and images taken from one grid to another.

Pinned down: Gauss-Legendre weights exact to degree 2 H - 1 and round trip at its band limit; cube
and ball map: solid angles, axes, the stated errors of their weights and of a round trip; adjoint
and gradient of the direct transforms; interpolation of every grid: shares, its own texels, seams,
poles and edges, second order, single rows and columns; change of grid through harmonics; misuse.
"""

import jax
import numpy as np
import pytest

from jaxrender.harmonics import (
    AngularMapGrid,
    CubeGrid,
    GaussLegendreGrid,
    LatLongGrid,
    analyse,
    analyse_dense,
    change_grid,
    evaluate,
    resample,
    synthesise,
    synthesise_dense,
)

FLOAT64 = 1e-12
GRIDS = [LatLongGrid(16, 32), GaussLegendreGrid(9, 19), CubeGrid(8), AngularMapGrid(16)]
TINY = [
    *(
        kind(*shape)
        for kind in (LatLongGrid, GaussLegendreGrid)
        for shape in ((1, 1), (1, 6), (5, 1))
    ),
    *(kind(side) for kind in (CubeGrid, AngularMapGrid) for side in (1, 2)),
]


def random_coefficients(band_limit: int, channels: int = 2) -> np.ndarray:
    rng = np.random.default_rng(band_limit)
    values = rng.normal(size=((band_limit + 1) ** 2, channels))
    return values / np.linalg.norm(values, axis=0)


def random_directions(count: int) -> np.ndarray:
    vectors = np.random.default_rng(count).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def smooth(directions: np.ndarray) -> np.ndarray:
    """A function of three channels without symmetry."""
    return np.exp(directions @ np.array([[0.3, -0.5, 0.2], [0.1, 0.4, -0.3], [0.4, 0.2, 0.6]]))


def interpolated(grid, image: np.ndarray, directions: np.ndarray) -> np.ndarray:
    index, share = grid.neighbours(directions)
    return np.einsum("pk,pkc->pc", share, image.reshape(-1, image.shape[-1])[index])


@pytest.mark.parametrize("height", [1, 2, 7, 32])
def test_gauss_weights_integrate_polynomials_to_twice_the_degree(height):
    grid = GaussLegendreGrid(height, 3)
    cosines = grid.directions()[..., 2]
    for power in range(2 * height):
        integral = np.sum(grid.weights() * cosines**power)
        expected = 0.0 if power % 2 else 4 * np.pi / (power + 1)
        np.testing.assert_allclose(integral, expected, atol=1e-12)
    assert np.all(np.diff(grid.directions()[:, 0, 2]) < 0.0)


@pytest.mark.parametrize("shape", [(1, 1), (9, 17), (24, 48), (101, 204)])
def test_gauss_round_trip_at_the_band_limit(shape):
    grid = GaussLegendreGrid(*shape)
    assert grid.band_limit == min(shape[0] - 1, (shape[1] - 1) // 2)
    light = random_coefficients(grid.band_limit)
    back = analyse(grid, synthesise(grid, light), grid.band_limit)
    np.testing.assert_allclose(back, light, atol=FLOAT64)


@pytest.mark.parametrize("grid", [*GRIDS, *TINY])
def test_directions_and_weights_match_the_shape(grid):
    assert grid.directions().shape == (*grid.shape, 3)
    np.testing.assert_allclose(np.linalg.norm(grid.directions(), axis=-1), 1.0, rtol=1e-14)
    assert grid.weights().shape == grid.shape
    assert np.all(grid.weights() >= 0.0)
    assert hash(grid) == hash(type(grid)(*vars(grid).values()))


def test_cube_faces():
    directions = CubeGrid(3).directions().reshape(6, 3, 3, 3)
    centres = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    np.testing.assert_allclose(directions[:, 1, 1], centres, atol=1e-15)
    # Side faces: upper row up, columns along the azimuth; the lids join +X.
    sides = directions[:4]
    assert np.all(sides[:, 0, :, 2] > 0.0)
    azimuths = np.unwrap(np.arctan2(sides[:, 1, :, 1], sides[:, 1, :, 0]).ravel())
    assert np.all(np.diff(azimuths) > 0.0)
    assert np.all(directions[4, 2, :, 0] > 0.0)
    assert np.all(directions[5, 0, :, 0] > 0.0)
    np.testing.assert_array_less(0.0, np.diff(directions[4:, 1, :, 1], axis=-1))


@pytest.mark.parametrize("side", [1, 2, 5, 32])
def test_cube_solid_angles_are_exact(side):
    grid = CubeGrid(side)
    np.testing.assert_allclose(grid.weights().sum(), 4 * np.pi, rtol=1e-13)
    # A texel's solid angle is to fourth order area x cos^3 of its centre.
    if side == 32:
        ahead = np.max(np.abs(grid.directions()), axis=-1)
        np.testing.assert_allclose(grid.weights(), (2 / side) ** 2 * ahead**3, rtol=2e-3)


def test_angular_map_axes_and_weights():
    grid = AngularMapGrid(64)
    directions, inside = grid.directions(), grid.inside()
    assert directions[31, 31, 2] > 0.99
    assert directions[31, 1, 2] < -0.9
    assert directions[31, 48, 0] > 0.9
    assert directions[16, 31, 1] > 0.9
    row, column = 20, 40
    radius = np.hypot(column - 31.5, 31.5 - row) / 32
    np.testing.assert_allclose(np.arccos(directions[row, column, 2]), np.pi * radius, rtol=1e-12)
    assert np.all(grid.weights()[~inside] == 0.0)
    assert np.all(grid.weights()[inside] > 0.0)


# The errors that the classes state, rounded up.
@pytest.mark.parametrize(("side", "error"), [(8, 7e-3), (16, 6e-4), (32, 2e-4), (64, 3e-6)])
def test_angular_map_covers_the_sphere(side, error):
    np.testing.assert_allclose(AngularMapGrid(side).weights().sum(), 4 * np.pi, rtol=error)


@pytest.mark.parametrize(
    ("grid", "band_limit", "error"),
    [
        (CubeGrid(8), 7, 2.1e-2),
        (CubeGrid(16), 8, 6e-3),
        (AngularMapGrid(8), 2, 6.1e-2),
        (AngularMapGrid(32), 8, 1.5e-2),
    ],
)
def test_round_trip_to_the_stated_error(grid, band_limit, error):
    assert band_limit <= grid.band_limit
    unit = np.eye((band_limit + 1) ** 2)
    back = np.asarray(analyse(grid, synthesise(grid, unit), band_limit))
    assert error / 2 < np.linalg.norm(back - unit, 2) < error


@pytest.mark.parametrize("grid", [AngularMapGrid(20), GaussLegendreGrid(6, 12)])
def test_transforms_equal_their_dense_twins(grid):
    light = random_coefficients(5)
    image = np.random.default_rng(1).normal(size=(*grid.shape, 2))
    dense = analyse_dense(grid, image, 5)
    np.testing.assert_allclose(analyse(grid, image, 5), dense, atol=FLOAT64)
    np.testing.assert_allclose(synthesise(grid, light), synthesise_dense(grid, light), atol=FLOAT64)


def test_direct_transforms_under_jit_grad_and_in_float32():
    grid = CubeGrid(6)
    image = np.random.default_rng(2).normal(size=(*grid.shape, 1))

    @jax.jit
    def energy(values):
        return 0.5 * jax.numpy.sum(analyse(grid, values, 3) ** 2)

    expected = grid.weights()[:, :, None] * synthesise(grid, analyse(grid, image, 3))
    np.testing.assert_allclose(jax.grad(energy)(image), expected, atol=FLOAT64)
    single = analyse(grid, image.astype(np.float32), 3)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, analyse(grid, image, 3), atol=2e-6)


@pytest.mark.parametrize("grid", [*GRIDS, *TINY])
def test_shares_are_those_of_a_mean(grid):
    directions = np.concatenate([random_directions(200), np.eye(3), -np.eye(3)])
    index, share = grid.neighbours(directions)
    assert np.all((share >= 0.0) & (share <= 1.0 + 1e-12))
    np.testing.assert_allclose(share.sum(axis=1), 1.0, rtol=1e-12)
    shown = grid.weights().ravel() > 0.0
    assert np.all(shown[index] | (share == 0.0))


@pytest.mark.parametrize("grid", GRIDS)
def test_at_its_own_texels_the_image_is_returned(grid):
    image = np.random.default_rng(3).normal(size=(*grid.shape, 2))
    shown = grid.weights() > 0.0
    found = interpolated(grid, image, grid.directions()[shown])
    np.testing.assert_allclose(found, image[shown], atol=1e-10)


@pytest.mark.parametrize(
    ("coarse", "fine"),
    [
        (LatLongGrid(16, 32), LatLongGrid(32, 64)),
        (LatLongGrid(16, 31), LatLongGrid(32, 62)),
        (GaussLegendreGrid(16, 32), GaussLegendreGrid(32, 64)),
    ],
)
def test_interpolation_is_second_order_over_seam_and_poles(coarse, fine):
    directions = np.concatenate([random_directions(500), np.eye(3), -np.eye(3)])
    errors = [
        np.abs(interpolated(grid, smooth(grid.directions()), directions) - smooth(directions)).max()
        for grid in (coarse, fine)
    ]
    assert errors[0] < 0.05
    assert errors[1] < errors[0] / 3.0


# First order at the edges of a face and at the rim, second order inside.
@pytest.mark.parametrize("kind", [CubeGrid, AngularMapGrid])
def test_interpolation_converges_on_cube_and_ball(kind):
    directions = np.concatenate([random_directions(500), np.eye(3), -np.eye(3)])
    errors = []
    for side in (16, 64):
        grid = kind(side)
        found = interpolated(grid, smooth(grid.directions()), directions)
        errors.append(np.abs(found - smooth(directions)).max())
    assert errors[0] < 0.15
    assert errors[1] < errors[0] / 3.0


@pytest.mark.parametrize(
    ("source", "target"),
    list(zip(GRIDS, [CubeGrid(4), AngularMapGrid(6), LatLongGrid(7, 9), GaussLegendreGrid(4, 8)])),
)
def test_change_of_grid(source, target):
    light = random_coefficients(2)
    image = synthesise(source, light)
    through = change_grid(source, image, target, 2)
    expected = evaluate(light, target.directions().reshape(-1, 3)).reshape(*target.shape, 2)
    # Cube and ball map find coefficients to 2 %.
    exact = isinstance(source, (LatLongGrid, GaussLegendreGrid))
    np.testing.assert_allclose(through, expected, atol=FLOAT64 if exact else 0.02)
    between = resample(source, image, target)
    assert between.shape == (*target.shape, 2)
    np.testing.assert_allclose(between, expected, atol=0.15)
    assert np.max(between) <= np.max(image) + FLOAT64


@pytest.mark.parametrize("source", TINY)
def test_smallest_images(source):
    image = np.full((*source.shape, 1), 3.0, np.float32)
    for target in (LatLongGrid(4, 8), CubeGrid(1)):
        between = resample(source, image, target)
        assert between.dtype == np.float32
        np.testing.assert_allclose(between, 3.0, rtol=1e-6)
    light = analyse(source, image, 0)
    expected = 3.0 * source.weights().sum() / np.sqrt(4 * np.pi)
    np.testing.assert_allclose(light[0, 0], expected, rtol=1e-6)


def test_misuse_is_refused():
    for grid, limit in ((GaussLegendreGrid(5, 20), 4), (CubeGrid(4), 3), (AngularMapGrid(9), 2)):
        image = np.zeros((*grid.shape, 1))
        with pytest.raises(ValueError, match=rf"degree {limit + 1} cannot.*{limit} or less"):
            analyse(grid, image, limit + 1)
        with pytest.raises(ValueError, match="texels on a grid"):
            resample(grid, image[:-1], CubeGrid(2))
    with pytest.raises(ValueError, match="0 texels"):
        CubeGrid(0)
    with pytest.raises(ValueError, match="0 texels"):
        AngularMapGrid(0)
    with pytest.raises(ValueError, match="1 or more"):
        GaussLegendreGrid(3, 0)
