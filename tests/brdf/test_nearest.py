"""The nearest table with a property: it has the property, and none with it is nearer.

Pinned down, in the measure of projected solid angles (the polar map's cells differ in it): what is
left of the table stands at a right angle to every reciprocal and every isotropic one; the product
is that of the weighted singular decomposition, nearer than the unweighted one's; the conditions of
Karush, Kuhn and Tucker with albedo and positivity, and SciPy's minimiser on one row; random tables
with the property are farther; a table that has it is left alone; what is interpolated has it too;
the change is the distance; precision is kept; every refusal.
"""

import equinox as eqx
import numpy as np
import pytest
from brdf_problems import upper_directions
from scipy.optimize import minimize

from jaxrender.brdf import BRDF, reciprocity_error
from jaxrender.brdf.tables.cells import cell_weights, exchanged
from jaxrender.brdf.tables.nearest import (
    nearest_energy_conserving,
    nearest_isotropic,
    nearest_reciprocal,
    nearest_separable,
    relative_change,
)
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.geometry import EMBEDDINGS, NUSSELT, POLAR

ROUNDING = 1e-12
SIZE = (4, 6, 4, 6)
ALL = (nearest_reciprocal, nearest_isotropic, nearest_separable, nearest_energy_conserving)

evaluate = eqx.filter_jit(BRDF.evaluate)


def random_table(seed, embedding=POLAR, scale=1.0):
    values = np.random.default_rng(seed).exponential(scale, (*SIZE, 2))
    return TabulatedBRDF(values, embedding, "linear")


def inner(table, a, b):
    weights = cell_weights(table.embedding, SIZE[:2])
    return np.einsum("ijklc,ijklc,ij,kl->", a, b, weights, weights)


def moved(table, values):
    return eqx.tree_at(lambda t: t.values, table, values)


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_reciprocal(embedding):
    table = random_table(0, embedding)
    found = nearest_reciprocal(table)
    assert found.table.reciprocal
    assert reciprocity_error(found.table) < 1e-10
    assert reciprocity_error(table) > 0.1
    left = table.values - found.table.values
    any_values = random_table(1).values
    any_reciprocal = any_values + exchanged(any_values)
    assert abs(inner(table, left, any_reciprocal)) < 1e-10


def test_isotropic():
    table = random_table(2)
    found = nearest_isotropic(table).table
    turned = np.roll(found.values, (2, 2), axis=(1, 3))
    np.testing.assert_allclose(turned, found.values, rtol=ROUNDING)
    a, b = upper_directions(50, 3), upper_directions(50, 4)
    sixth = np.array([[0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), 0.5, 0], [0, 0, 1]])
    there = evaluate(found, a @ sixth.T, b @ sixth.T)
    np.testing.assert_allclose(there, evaluate(found, a, b), rtol=1e-9)
    left = table.values - found.values
    differences = np.random.default_rng(5).uniform(size=(4, 4, 6, 2))
    azimuth = (np.arange(6)[None] - np.arange(6)[:, None]) % 6
    # Any table of the azimuths' difference, [t_i, p_i, t_r, p_r].
    any_isotropic = np.moveaxis(differences[:, :, azimuth], 1, 2)
    np.testing.assert_array_equal(np.roll(any_isotropic, (1, 1), axis=(1, 3)), any_isotropic)
    assert abs(inner(table, left, any_isotropic)) < 1e-10


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_separable(embedding):
    table = random_table(6, embedding)
    found = nearest_separable(table)
    weights = np.sqrt(cell_weights(embedding, SIZE[:2]).ravel())
    whole = missed = 0.0
    for c in range(2):
        matrix = table.values[..., c].reshape(24, 24)
        assert np.linalg.matrix_rank(found.table.values[..., c].reshape(24, 24)) == 1
        strengths = np.linalg.svd(weights[:, None] * matrix * weights, compute_uv=False) ** 2
        whole, missed = whole + strengths.sum(), missed + strengths[1:].sum()
    assert found.change**2 == pytest.approx(missed / whole, rel=1e-9)
    assert np.all(found.table.values >= 0)


def test_the_product_is_nearest_in_the_weighted_measure():
    table = random_table(7)
    found = nearest_separable(table)
    plain = np.empty_like(table.values)
    for c in range(2):
        u, s, v = np.linalg.svd(table.values[..., c].reshape(24, 24))
        plain[..., c] = (s[0] * np.outer(u[:, 0], v[0])).reshape(SIZE)
    assert relative_change(table, plain) > found.change * 1.001


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_energy_conserving(embedding):
    table = random_table(8, embedding, 0.33)
    table = moved(table, table.values - 0.02)
    found = nearest_energy_conserving(table).table
    assert not table.conserves_energy
    assert found.conserves_energy
    assert np.all(found.values >= 0)
    old = table.values.reshape(24, 24, 2)
    new = found.values.reshape(24, 24, 2)
    weights = cell_weights(embedding, SIZE[2:]).ravel()
    albedo = np.einsum("irc,r->ic", new, weights)
    taken = np.where(new > 0, old - new, 0).max(axis=1)
    # Stationary: the same multiplier wherever something is left; not negative; where nothing is
    # left the old value was no more than it; and it is 0 unless the albedo is 1.
    np.testing.assert_allclose(np.maximum(old - taken[:, None], 0), new, atol=ROUNDING)
    assert np.all(taken >= 0)
    bound = taken > 1e-9
    np.testing.assert_allclose(albedo[bound], 1, rtol=1e-10)
    assert np.all(albedo[~bound] <= 1)
    assert 0 < bound.sum() < bound.size


def test_energy_agrees_with_a_minimiser_and_is_no_scaling():
    table = random_table(9, scale=0.6)
    found = nearest_energy_conserving(table)
    weights = cell_weights(POLAR, SIZE[2:]).ravel()
    row = table.values[1, 2, ..., 0].ravel()
    solved = minimize(
        lambda x: weights @ (x - row) ** 2,
        row / (weights @ row),
        jac=lambda x: 2 * weights * (x - row),
        bounds=[(0, None)] * 24,
        constraints={"type": "ineq", "fun": lambda x: 1 - weights @ x, "jac": lambda x: -weights},
        options={"ftol": 1e-14, "maxiter": 500},
    )
    np.testing.assert_allclose(found.table.values[1, 2, ..., 0].ravel(), solved.x, atol=1e-5)
    scaled = table.values / np.maximum(table.albedo(), 1)[:, :, None, None]
    assert moved(table, scaled).conserves_energy
    assert relative_change(table, scaled) > found.change * 1.05


@pytest.mark.parametrize("nearest", ALL, ids=lambda f: f.__name__)
def test_others_with_the_property_are_farther(nearest):
    table = random_table(10, scale=0.4)
    found = nearest(table)
    assert found.change == pytest.approx(relative_change(table, found.table.values), rel=1e-9)
    for seed in range(20):
        noise = random_table(100 + seed).values
        other = nearest(moved(table, table.values * (1 + 0.1 * (noise - 1)))).table
        assert relative_change(table, other.values) > found.change


@pytest.mark.parametrize("nearest", ALL, ids=lambda f: f.__name__)
def test_what_has_the_property_is_left_alone(nearest):
    once = nearest(random_table(11)).table
    again = nearest(once)
    assert again.change < 1e-9
    np.testing.assert_allclose(again.table.values, once.values, atol=1e-9)


@pytest.mark.parametrize("nearest", ALL, ids=lambda f: f.__name__)
def test_precision_and_reconstruction_are_kept(nearest):
    table = random_table(12)
    single = TabulatedBRDF(table.values.astype(np.float32), POLAR, "cubic")
    found = nearest(single)
    assert found.table.values.dtype == np.float32
    assert found.table.reconstruction == "cubic"
    assert found.change == pytest.approx(nearest(table).change, rel=1e-4)


def test_black_and_tiny_tables():
    black = TabulatedBRDF(np.zeros((*SIZE, 1)), POLAR)
    single = TabulatedBRDF(np.full((1, 1, 1, 1, 3), 0.1), POLAR)
    for nearest in ALL:
        assert nearest(black).change == 0
        assert nearest(single).change < ROUNDING


def test_what_is_refused():
    with pytest.raises(ValueError, match=r"nusselt.*resampled\(size, POLAR\)"):
        nearest_isotropic(random_table(13, NUSSELT))
    uneven = TabulatedBRDF(np.ones((3, 4, 3, 6, 1)), POLAR)
    with pytest.raises(ValueError, match="4 incident and 6 reflected"):
        nearest_isotropic(uneven)
    with pytest.raises(ValueError, match="resampled"):
        nearest_reciprocal(uneven)
