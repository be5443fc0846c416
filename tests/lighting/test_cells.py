"""Cells of the sphere and the light in them.

Pinned down: every texel is in one cell, no wider than asked for; cells of half the angle lie within
those of the angle, and texels of a finer image within the same cells; energy is kept per channel
to rounding, the first moment to second order in the angle; empty cells have no node; a wrong
angle is refused; the dtype is the image's.
"""

import numpy as np
import pytest

from jaxrender.lighting import Environment, condensed, partition
from jaxrender.lighting.cells import gather

ROUNDING = 1e-13
RNG = np.random.default_rng(0)


def random_environment(rows, channels=3, seed=0):
    values = np.random.default_rng(seed).lognormal(0, 1.5, (rows, 2 * rows, channels))
    return Environment(values)


def grey_environment(rows):
    """A smooth light, grey, the same at every resolution."""
    environment = Environment(np.ones((rows, 2 * rows, 1)))
    x, y, z = np.moveaxis(environment.grid.directions(), -1, 0)
    return Environment(np.exp(2 * (0.6 * x - 0.64 * y + 0.48 * z))[..., None])


def moment(nodes):
    return np.asarray(nodes.irradiance)[:, 0] @ np.asarray(nodes.directions)


@pytest.mark.parametrize("rows", [1, 2, 16, 50, 64])
@pytest.mark.parametrize("angle", [0.05, 0.3, 4.0])
def test_energy_is_kept_per_channel(rows, angle):
    environment = random_environment(rows)
    nodes = condensed(environment, angle)
    given = np.asarray(environment.nodes().irradiance).sum(axis=0)
    np.testing.assert_allclose(nodes.irradiance.sum(axis=0), given, rtol=ROUNDING)
    np.testing.assert_allclose(np.linalg.norm(nodes.directions, axis=1), 1, rtol=ROUNDING)


@pytest.mark.parametrize("angle", [0.06, 0.2, 0.5])
def test_no_texel_is_further_than_the_angle_from_its_cells_mean(angle):
    """A square of that side reaches .7 of it from its middle, the cells at the poles a bit more."""
    environment = Environment(np.ones((128, 256, 1)))
    cells = partition(environment, angle)
    nodes, cell = gather(environment, cells, np.ones((128, 256)))
    centre = np.zeros((2 * cells.rows**2, 3))
    centre[cell] = nodes.directions
    cosines = np.einsum("rcx,rcx->rc", centre[cells.index], environment.grid.directions())
    distance = np.arccos(np.clip(cosines, -1, 1))
    assert distance.max() < angle
    # And no finer than asked: rows are a power of two, so a cell may be half as wide.
    area = 4 * np.pi / len(cell)
    assert angle**2 / 5 < area < angle**2


def test_cells_are_nested():
    """All texels of a fine cell are in one coarse cell."""
    environment = Environment(np.ones((64, 128, 1)))
    fine, coarse = partition(environment, 0.1), partition(environment, 0.2)
    assert fine.rows == 2 * coarse.rows
    pairs = np.unique(np.stack([fine.index.ravel(), coarse.index.ravel()]), axis=1)
    assert len(np.unique(pairs[0])) == pairs.shape[1]


def test_cells_do_not_know_the_resolution():
    """Each texel of a fine image lies in the cell of the coarse texel that it is a quarter of."""
    coarse = partition(Environment(np.ones((32, 64, 1))), 0.2)
    fine = partition(Environment(np.ones((128, 256, 1))), 0.2)
    np.testing.assert_array_equal(fine.index, np.kron(coarse.index, np.ones((4, 4), int)))


def test_an_image_coarser_than_the_cells_keeps_its_texels_at_the_equator():
    cells = partition(Environment(np.ones((8, 16, 1))), 0.01)
    assert cells.rows == 8
    assert len(np.unique(cells.index[4])) == 16
    assert len(np.unique(cells.index)) < 8 * 16


def test_the_first_moment_is_kept_to_second_order():
    """Halving the cells' angle quarters the error; the direction of one cell is exact."""
    environment = grey_environment(128)
    exact = moment(environment.nodes())
    errors = [
        np.linalg.norm(moment(condensed(environment, angle)) - exact) / np.linalg.norm(exact)
        for angle in (0.2, 0.1, 0.05)
    ]
    assert errors[0] < 0.2**2
    assert 3 < errors[0] / errors[1] < 5
    assert 3 < errors[1] / errors[2] < 5


def test_a_node_points_at_the_energy_weighted_mean():
    """Two texels of one cell, 3 to 1."""
    radiance = np.zeros((64, 128, 1))
    radiance[32, 0], radiance[33, 0] = 3, 1
    environment = Environment(radiance)
    weights, directions = environment.grid.weights(), environment.grid.directions()
    mean = 3 * weights[32, 0] * directions[32, 0] + weights[33, 0] * directions[33, 0]
    nodes = condensed(environment, 0.2)
    assert nodes.irradiance.shape == (1, 1)
    expected = mean / np.linalg.norm(mean)
    np.testing.assert_allclose(nodes.directions, expected[None], atol=ROUNDING)


def test_a_fraction_is_gathered_texel_by_texel():
    environment = random_environment(16)
    fraction = RNG.uniform(0, 1, (16, 32))
    cells = partition(environment, 0.4)
    part, _ = gather(environment, cells, fraction)
    dimmed = Environment(environment.radiance * fraction[..., None])
    expected, _ = gather(dimmed, cells, np.ones((16, 32)))
    np.testing.assert_allclose(part.irradiance, expected.irradiance, rtol=ROUNDING)
    np.testing.assert_allclose(part.directions, expected.directions, atol=ROUNDING)


def test_black_light_has_no_node():
    nodes = condensed(Environment(np.zeros((8, 16, 3))), 0.3)
    assert nodes.directions.shape == nodes.irradiance.shape == (0, 3)


def test_single_precision_stays_single():
    environment = Environment(np.ones((16, 32, 3), np.float32))
    nodes = condensed(environment, 0.3)
    assert nodes.directions.dtype == nodes.irradiance.dtype == np.float32


@pytest.mark.parametrize("angle", [0.0, -0.1, float("nan")])
def test_a_wrong_angle_is_refused(angle):
    with pytest.raises(ValueError, match=r"angle=.*must be above 0 radians"):
        partition(random_environment(8), angle)
