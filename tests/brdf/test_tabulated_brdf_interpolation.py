"""Tables over two directions: what is between the samples.

Pinned down: linear is SciPy's grid interpolation, B-spline its unfiltered cubic spline, cubic its
Hermite spline through central differences, constant the nearest sample; open axes repeat their
ends, azimuths go round and the pole leads to the other side; which polynomials each reproduces, and
by how much a B-spline misses a square; slopes of cubic join, those of linear don't.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, RegularGridInterpolator
from scipy.ndimage import map_coordinates
from tabulated_brdf_problems import ROUNDING, SIZE, VALUES, evaluate

from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.geometry import EMBEDDINGS, NUSSELT, POLAR

at = eqx.filter_jit(TabulatedBRDF.at_places)


def squares(count, seed, low=0.0, high=1.0):
    rng = np.random.default_rng(seed)
    return rng.uniform(low, high, (count, 2)), rng.uniform(low, high, (count, 2))


def padded(values, embedding, by=3):
    """The table and what lies beyond its borders, written out: by hand, an axis after the other."""
    for row, column in ((0, 1), (2, 3)):
        if embedding is POLAR:
            turned = np.roll(values, values.shape[column] // 2, axis=column)
            beyond = np.flip(turned.take(range(by), axis=row), axis=row)
            values = np.concatenate([beyond, values], axis=row)
            values = np.pad(values, _widths(row, 0, by), mode="edge")
            values = np.pad(values, _widths(column, by, by), mode="wrap")
        else:
            values = np.pad(values, _widths(row, by, by), mode="edge")
            values = np.pad(values, _widths(column, by, by), mode="edge")
    return values


def _widths(axis, before, after):
    return [(before, after) if k == axis else (0, 0) for k in range(5)]


def positions(places, by=3):
    return np.concatenate(places, axis=-1) * SIZE - 0.5 + by


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_linear_is_scipys(embedding):
    places = squares(300, 1)
    table = padded(VALUES, embedding)
    grid = RegularGridInterpolator([np.arange(n) for n in table.shape[:4]], table)
    found = at(TabulatedBRDF(VALUES, embedding, "linear"), *places)
    np.testing.assert_allclose(found, grid(positions(places)), rtol=ROUNDING)


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_b_spline_is_scipys(embedding):
    places = squares(300, 2)
    table = padded(VALUES, embedding)
    expected = [
        map_coordinates(table[..., c], positions(places).T, order=3, prefilter=False)
        for c in range(2)
    ]
    found = at(TabulatedBRDF(VALUES, embedding, "b-spline"), *places)
    np.testing.assert_allclose(found, np.stack(expected, axis=-1), rtol=ROUNDING)


def test_cubic_is_hermites_with_central_differences():
    """A product of four functions of one axis each is interpolated axis by axis."""
    rng = np.random.default_rng(1)
    axes = [rng.uniform(size=n) for n in SIZE]
    places = squares(200, 3)
    expected = 1.0
    for samples, position in zip(axes, positions(places).T, strict=True):
        longer = np.pad(samples, 3, mode="edge")
        slopes = np.gradient(longer)
        expected = expected * CubicHermiteSpline(np.arange(len(longer)), longer, slopes)(position)
    table = np.einsum("i,j,k,l->ijkl", *axes)[..., None]
    found = at(TabulatedBRDF(table, NUSSELT, "cubic"), *places)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_cubic_of_the_polar_map_goes_round_and_over_the_pole():
    places = squares(100, 4)
    table = padded(VALUES, POLAR)
    wide = TabulatedBRDF(table, NUSSELT, "cubic")
    moved = [
        (pair * end + 3) / np.array(whole)
        for pair, end, whole in zip(
            places, (SIZE[:2], SIZE[2:]), (table.shape[:2], table.shape[2:4]), strict=True
        )
    ]
    found = at(TabulatedBRDF(VALUES, POLAR, "cubic"), *places)
    np.testing.assert_allclose(found, at(wide, *moved), rtol=1e-10)


def test_constant_is_the_nearest_sample():
    incoming, outgoing = squares(300, 5)
    k = np.floor(np.concatenate([incoming, outgoing], axis=-1) * SIZE).astype(int)
    for embedding in EMBEDDINGS.values():
        found = at(TabulatedBRDF(VALUES, embedding, "constant"), incoming, outgoing)
        np.testing.assert_array_equal(found, VALUES[tuple(k.T)])


def polynomial_table(function, reconstruction, count=8):
    x = (np.arange(count) + 0.5) / count
    grid = np.meshgrid(x, x, x, x, indexing="ij")
    return TabulatedBRDF(function(*grid)[..., None], NUSSELT, reconstruction)


def linear_function(a, b, c, d):
    return (1 + a) * (2 - b) * (1 + 3 * c) * (4 + d)


def quadratic_function(a, b, c, d):
    return (1 + a - a * a) * (2 - b * b) * (1 + 3 * c * c) * (4 + d - 2 * d * d)


@pytest.mark.parametrize(
    ("reconstruction", "function"),
    [
        ("linear", linear_function),
        ("cubic", linear_function),
        ("b-spline", linear_function),
        ("cubic", quadratic_function),
    ],
)
def test_polynomials_are_reproduced_inside(reconstruction, function):
    # All taps of these places are samples of the table.
    places = squares(200, 6, 1.5 / 8, 6.5 / 8)
    found = at(polynomial_table(function, reconstruction), *places)[:, 0]
    expected = function(*np.concatenate(places, axis=-1).T)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_b_spline_of_squares_is_a_third_of_a_squared_step_too_high():
    places = squares(100, 7, 1.5 / 8, 6.5 / 8)
    found = at(polynomial_table(lambda a, b, c, d: a * a, "b-spline"), *places)[:, 0]
    np.testing.assert_allclose(found - places[0][:, 0] ** 2, 1 / 3 / 64, rtol=1e-10)


@pytest.mark.parametrize(("reconstruction", "joins"), [("cubic", True), ("linear", False)])
def test_slopes_join_at_the_samples(reconstruction, joins):
    table = TabulatedBRDF(VALUES, NUSSELT, reconstruction)
    sample, other = np.array([2.5 / 5, 0.41]), np.array([0.3, 0.77])

    @jax.jit
    @jax.grad
    def slope(step):
        return table.at_places(sample + jnp.array([1.0, 0.0]) * step, other)[0]

    left, right = slope(-1e-9), slope(1e-9)
    assert (abs(left - right) < 1e-6) == joins


@pytest.mark.parametrize("azimuths", [16, 17])
@pytest.mark.parametrize("reconstruction", ["linear", "cubic", "b-spline"])
def test_the_pole_is_no_border(azimuths, reconstruction):
    """A smooth function of x is as smooth over the pole; a repeated ring makes a step of .25."""
    across = np.array([[0.02, 0.0, 1.0], [-0.02, 0.0, 1.0]])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.broadcast_to([0.6, 0.0, 0.8], (2, 3))
    centres = POLAR.cell_directions((6, azimuths))
    values = np.broadcast_to(centres[:, :, None, None, :1] + 2, (6, azimuths, 1, 1, 1))
    table = TabulatedBRDF(np.array(values), POLAR, reconstruction)
    found = evaluate(table, across, other)[:, 0]
    assert float(found[0] - found[1]) == pytest.approx(0.04, rel=0.1)
    assert np.mean(found) == pytest.approx(2, abs=5e-3)
