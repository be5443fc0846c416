"""The grids of rows at equal height.

Pinned down: row 0 at the top (+Z), azimuth increasing with the column from +X to +Y, texel centres;
weights integrate every polynomial in cos t up to degree H - 1 (Fejer's first rule) and sum to 4 pi;
band limit; grids are hashable values.  Gauss-Legendre rows have the angles, sines and weights that
mpmath finds with 40 digits, at both poles too, and so has the rotation group's grid.
"""

import equinox as eqx
import jax
import mpmath
import numpy as np
import pytest

from jaxrender.harmonics import GaussLegendreGrid, LatLongGrid, RotationGrid

ROUNDING = 1e-13


def test_texel_centres():
    grid = LatLongGrid(4, 8)
    directions = grid.directions()
    assert directions.shape == (4, 8, 3)
    assert directions.dtype == np.float64
    t, p = np.pi / 8, np.pi / 8
    expected = [np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)]
    np.testing.assert_allclose(directions[0, 0], expected, atol=ROUNDING)
    t, p = 5 * np.pi / 8, 5 * np.pi / 8
    expected = [np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)]
    np.testing.assert_allclose(directions[2, 2], expected, atol=ROUNDING)


@pytest.mark.parametrize("height", [1, 2, 3, 8, 33, 64])
def test_weights_integrate_polynomials_exactly(height):
    grid = LatLongGrid(height, 5)
    cosines = grid.directions()[..., 2]
    for power in range(height):
        integral = np.sum(grid.weights() * cosines**power)
        expected = 0.0 if power % 2 else 4 * np.pi / (power + 1)
        np.testing.assert_allclose(integral, expected, atol=ROUNDING * 4 * np.pi)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 2), (64, 128), (63, 126), (10, 3)])
def test_weights_are_positive_solid_angles_of_the_whole_sphere(shape):
    grid = LatLongGrid(*shape)
    assert grid.weights().shape == grid.shape == shape
    assert np.all(grid.row_weights() > 0.0)
    np.testing.assert_allclose(grid.weights().sum(), 4 * np.pi, rtol=ROUNDING)
    np.testing.assert_allclose(grid.row_weights().sum() * grid.width, 4 * np.pi, rtol=ROUNDING)


def exact_node(count, row):
    """Angle of a node in the north and its weight, by Newton's method with 40 digits."""
    with mpmath.workdps(40):
        angle = (row + mpmath.mpf(3) / 4) * mpmath.pi / (count + mpmath.mpf(1) / 2)
        for _ in range(6):
            before, value = mpmath.mpf(1), mpmath.cos(angle)
            for k in range(2, count + 1):
                before, value = (
                    value,
                    ((2 * k - 1) * mpmath.cos(angle) * value - (k - 1) * before) / k,
                )
            slope = count * (mpmath.cos(angle) * value - before) / mpmath.sin(angle)
            angle -= value / slope
        return float(angle), float(mpmath.sin(angle)), float(2 / slope**2)


@pytest.mark.parametrize(("height", "rows"), [(9, (0, 4)), (192, (0, 1, 95))])
def test_gauss_rows_have_all_digits_at_both_poles(height, rows):
    grid = GaussLegendreGrid(height, 4)
    sines = np.hypot(*np.moveaxis(grid.directions()[:, 0, :2], -1, 0))
    for row in rows:
        angle, sine, weight = exact_node(height, row)
        few = {"rtol": 100 * np.finfo(float).eps}
        np.testing.assert_allclose(grid.polar_angles()[row], angle, **few)
        for mirrored in (row, height - 1 - row):
            np.testing.assert_allclose(sines[mirrored], sine, **few)
            np.testing.assert_allclose(grid.row_weights()[mirrored], weight * np.pi / 2, **few)
        np.testing.assert_allclose(RotationGrid(height - 1).alphas()[row], angle, **few)
    np.testing.assert_allclose(grid.weights().sum(), 4 * np.pi, **few)


@pytest.mark.parametrize("height", [1, 2, 3, 8, 33])
def test_gauss_weights_integrate_twice_as_high_powers(height):
    grid = GaussLegendreGrid(height, 1)
    cosines = grid.directions()[:, 0, 2]
    for power in range(2 * height):
        expected = 0.0 if power % 2 else 4 * np.pi / (power + 1)
        found = grid.row_weights() @ cosines**power
        np.testing.assert_allclose(found, expected, atol=ROUNDING * 4 * np.pi)


@pytest.mark.parametrize(
    ("shape", "band_limit"), [((64, 128), 31), ((65, 130), 32), ((65, 8), 3), ((1, 2), 0)]
)
def test_band_limit(shape, band_limit):
    assert LatLongGrid(*shape).band_limit == band_limit


def test_grids_are_values():
    assert LatLongGrid(4, 8) == LatLongGrid(4, 8)
    assert LatLongGrid(4, 8) != LatLongGrid(8, 4)
    assert len({LatLongGrid(4, 8), LatLongGrid(4, 8), LatLongGrid(8, 4)}) == 2
    assert jax.tree.leaves(LatLongGrid(4, 8)) == []
    assert eqx.filter_jit(lambda grid: grid.weights().sum())(LatLongGrid(4, 8)) > 12.0


@pytest.mark.parametrize("shape", [(0, 4), (4, 0), (-2, 4)])
def test_empty_grid_is_refused(shape):
    with pytest.raises(ValueError, match="1 or more"):
        LatLongGrid(*shape)
