"""Environments: a latitude-longitude image as nodes with Fejer's weights.

Pinned down: the direction of every node, row by row; energy of uniform light; exact integrals of
harmonics, which the solid angles of the texels would miss; scaling; jit; and each refusal.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.harmonics.grids import LatLongGrid
from jaxrender.lighting.environment import Environment

ROUNDING = 1e-13


def test_uniform_light_carries_four_pi():
    nodes = Environment(np.full((8, 16, 3), 2.0)).nodes()
    np.testing.assert_allclose(nodes.irradiance.sum(axis=0), np.full(3, 8 * np.pi), rtol=ROUNDING)


def test_nodes_are_the_texels_row_by_row():
    """Texel (1, 3) of 4 x 8: polar angle 3 pi / 8, azimuth 7 pi / 8."""
    radiance = np.zeros((4, 8, 1))
    radiance[1, 3] = 5
    nodes = Environment(radiance).nodes()
    assert np.flatnonzero(nodes.irradiance[:, 0]).tolist() == [11]
    polar, azimuth = 3 * np.pi / 8, 7 * np.pi / 8
    wanted = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    np.testing.assert_allclose(nodes.directions[11], wanted, atol=ROUNDING)


def test_moments_are_exact():
    """The integral of z^2 over the sphere is 4 pi / 3; a texel's solid angle errs by a percent."""
    grid = LatLongGrid(8, 16)
    nodes = Environment(grid.directions()[..., 2:] ** 2).nodes()
    assert nodes.irradiance.sum() == pytest.approx(4 * np.pi / 3, rel=ROUNDING)


def test_scaled():
    environment = Environment(np.ones((2, 4, 3), np.float32)).scaled(2.5)
    np.testing.assert_array_equal(environment.radiance, np.full((2, 4, 3), 2.5))
    assert environment.radiance.dtype == jnp.float32


def test_grid_is_that_of_the_image():
    assert Environment(np.ones((3, 6, 1))).grid.shape == (3, 6)


def test_made_inside_a_differentiated_function():
    """d/ds of the energy of s times uniform light is 4 pi; negative light is not looked at."""

    @jax.jit
    @jax.grad
    def slope(s):
        return Environment(s * jnp.ones((4, 8, 1))).scaled(s).nodes().irradiance.sum()

    assert slope(-1.0) == pytest.approx(-8 * np.pi, rel=ROUNDING)


@pytest.mark.parametrize(
    ("radiance", "message"),
    [
        (np.ones((4, 4, 3)), r"is 4 x 4 \(width x height\): .*twice as wide as high"),
        (np.ones((0, 0, 3)), r"is 0 x 0"),
        (-np.ones((2, 4, 3)), r"texel \(row 0, column 0\), channel 0 is -1: .*not negative"),
        (np.full((2, 4, 3), np.nan), r"channel 0 is nan: .*finite"),
    ],
)
def test_misuse_is_refused(radiance, message):
    with pytest.raises(ValueError, match=message):
        Environment(radiance)


def test_scaling_by_a_negative_number_is_refused():
    with pytest.raises(ValueError, match="finite and not negative"):
        Environment(np.ones((2, 4, 3))).scaled(-1.0)
