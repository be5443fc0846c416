"""Analysis and synthesis of latitude-longitude images.

Pinned down: round trip at the grid's band limit in both precisions, odd and even sides, wide and
narrow images, by folded and plain matrix product and by FFT, over one block of orders and several;
the separable transforms equal their dense twins, also above the grid's band limit; a bright texel
gives the basis in its direction (which fixes axes and orientation); adjointness; differentiable
under jit and vmap.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.harmonics import (
    LatLongGrid,
    analyse,
    analyse_dense,
    evaluate,
    real_basis,
    synthesise,
    synthesise_dense,
)

FLOAT64 = 1e-12
FLOAT32 = 1e-5

# Odd and even heights, widths other than twice the height, one block of orders and several; the
# last is large enough for the FFT.
SHAPES = [(1, 1), (2, 3), (17, 40), (40, 21), (70, 140), (135, 270)]


def random_coefficients(band_limit: int, channels: int = 3) -> np.ndarray:
    rng = np.random.default_rng(band_limit)
    return rng.normal(size=((band_limit + 1) ** 2, channels))


@pytest.mark.parametrize("shape", SHAPES)
def test_round_trip_at_the_band_limit(shape):
    grid = LatLongGrid(*shape)
    light = random_coefficients(grid.band_limit)
    back = analyse(grid, synthesise(grid, light), grid.band_limit)
    np.testing.assert_allclose(back, light, atol=FLOAT64, rtol=0)


@pytest.mark.parametrize("shape", [(17, 40), (135, 270)])
def test_round_trip_in_float32(shape):
    grid = LatLongGrid(*shape)
    light = random_coefficients(grid.band_limit)
    single = light.astype(np.float32)
    back = analyse(grid, synthesise(grid, single), grid.band_limit)
    assert back.dtype == jnp.float32
    np.testing.assert_allclose(back, single, atol=FLOAT32, rtol=0)


@pytest.mark.parametrize(
    ("shape", "band_limit"),
    [((1, 1), 0), ((17, 40), 5), ((40, 21), 10), ((71, 70), 34)],
)
def test_separable_equals_dense(shape, band_limit):
    grid = LatLongGrid(*shape)
    image = np.random.default_rng(0).normal(size=(*shape, 2))
    dense = analyse_dense(grid, image, band_limit)
    np.testing.assert_allclose(analyse(grid, image, band_limit), dense, atol=FLOAT64)
    light = random_coefficients(band_limit)
    dense = synthesise_dense(grid, light)
    np.testing.assert_allclose(synthesise(grid, light), dense, atol=FLOAT64)


@pytest.mark.parametrize(("shape", "band_limit"), [((5, 8), 12), ((6, 9), 70), ((140, 20), 66)])
def test_synthesis_above_the_band_limit(shape, band_limit):
    grid = LatLongGrid(*shape)
    light = random_coefficients(band_limit)
    expected = evaluate(light, grid.directions().reshape(-1, 3)).reshape(*shape, 3)
    np.testing.assert_allclose(synthesise(grid, light), expected, atol=1e-11)
    np.testing.assert_allclose(synthesise_dense(grid, light), expected, atol=1e-11)


@pytest.mark.parametrize(("width", "highest"), [(270, 63), (388, 95)])
def test_matrix_products_and_fourier_transform_agree(width, highest):
    # A width that is no multiple of four is not folded into quarters.
    grid = LatLongGrid(194, width)
    image = np.random.default_rng(1).normal(size=(*grid.shape, 2))
    by_fft = analyse(grid, image, highest + 1)
    by_product = analyse(grid, image, highest)
    np.testing.assert_allclose(by_fft[: (highest + 1) ** 2], by_product, atol=FLOAT64)
    light = np.zeros(by_fft.shape)
    light[: (highest + 1) ** 2] = by_product
    np.testing.assert_allclose(synthesise(grid, light), synthesise(grid, by_product), atol=FLOAT64)


def test_a_bright_texel_gives_the_basis_in_its_direction():
    grid = LatLongGrid(12, 24)
    for row, column in ((0, 0), (3, 7), (11, 23)):
        image = np.zeros((12, 24, 1))
        image[row, column] = 1.0
        expected = grid.row_weights()[row] * real_basis(grid.directions()[row, column], 5)
        np.testing.assert_allclose(analyse(grid, image, 5)[:, 0], expected, atol=1e-14)


def test_constant_image():
    grid = LatLongGrid(9, 5)
    light = np.asarray(analyse(grid, np.ones((9, 5, 1)), 2))
    np.testing.assert_allclose(light[0], np.sqrt(4 * np.pi), rtol=FLOAT64)
    np.testing.assert_allclose(light[1:], 0.0, atol=FLOAT64)


def test_analysis_is_the_weighted_adjoint_of_synthesis():
    grid = LatLongGrid(11, 25)
    light = random_coefficients(5)
    image = np.random.default_rng(2).normal(size=(11, 25, 3))
    left = np.einsum("hw,hwc,hwc->", grid.weights(), image, np.asarray(synthesise(grid, light)))
    right = np.sum(np.asarray(analyse(grid, image, 5)) * light)
    np.testing.assert_allclose(left, right, rtol=1e-12)


# Degree 70 takes the FFT, whose complex numbers must not leak into derivatives.
@pytest.mark.parametrize(("shape", "band_limit"), [((8, 16), 3), ((142, 142), 70)])
def test_differentiable_under_jit_and_vmap(shape, band_limit):
    grid = LatLongGrid(*shape)
    images = jnp.asarray(np.random.default_rng(3).normal(size=(2, *shape, 1)))

    @jax.jit
    def energy(image):
        return 0.5 * jnp.sum(analyse(grid, image, band_limit) ** 2)

    gradient = jax.vmap(jax.grad(energy))(images)
    coefficients = analyse(grid, images[1], band_limit)
    expected = grid.weights()[:, :, None] * np.asarray(synthesise(grid, coefficients))
    np.testing.assert_allclose(gradient[1], expected, atol=FLOAT64)


def test_misuse_is_refused():
    grid = LatLongGrid(8, 16)
    image = np.zeros((8, 16, 3))
    for transform in (analyse, analyse_dense):
        with pytest.raises(ValueError, match=r"degree 4 cannot be determined.*3 or less"):
            transform(grid, image, 4)
        with pytest.raises(ValueError, match="8 x 15 texels"):
            transform(grid, image[:, :15], 2)
        with pytest.raises(ValueError, match="band_limit is -1"):
            transform(grid, image, -1)
    for transform in (synthesise, synthesise_dense):
        with pytest.raises(ValueError, match="5 coefficients"):
            transform(grid, np.zeros((5, 3)))
