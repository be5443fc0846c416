"""Tables over two directions: how they are made, and what they promise.

Pinned down: samples stand at the cells' directions; passes of any length make the same table;
grazing light is not darkened; white is white; derivatives are finite differences', finite at the
pole and below the horizon; memory is not that of 256 samples a point; holes are filled and counted;
every refusal.
"""

import equinox as eqx
import jax
import numpy as np
import pytest
from brdf_problems import single_precision, upper_directions
from jax.test_util import check_grads
from tabulated_brdf_problems import ROUNDING, SIZE, VALUES, evaluate

from jaxrender.brdf import Lambertian, Phong, Ward
from jaxrender.brdf.tables import cells
from jaxrender.brdf.tables.cells import cell_weights, masked
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.geometry import EMBEDDINGS, NUSSELT, POLAR, Components

SHINY = Ward(np.array([0.1, 0.05]), np.array([0.3, 0.2]), 0.4, 0.6)


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
@pytest.mark.parametrize("reconstruction", ["constant", "cubic"])
def test_samples_stand_at_the_cells_directions(embedding, reconstruction):
    table = TabulatedBRDF.of(SHINY, (5, 6, 7, 4), embedding, reconstruction)
    incoming = embedding.cell_directions((5, 6)).reshape(-1, 3)
    outgoing = embedding.cell_directions((7, 4)).reshape(-1, 3)
    incoming, outgoing = incoming[incoming[:, 2] > 0], outgoing[outgoing[:, 2] > 0]
    pairs = np.repeat(incoming, len(outgoing), axis=0), np.tile(outgoing, (len(incoming), 1))
    # Places are found again to rounding only, and a nearest sample half a cell away is safe.
    np.testing.assert_allclose(evaluate(table, *pairs), evaluate(SHINY, *pairs), rtol=1e-9)


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_a_table_converges_to_its_model(embedding):
    # Away from the horizon, where cells beyond it play no part.
    a, b = upper_directions(2000, 8, 0.6), upper_directions(2000, 9, 0.6)
    truth = evaluate(SHINY, a, b)

    def error(n):
        table = TabulatedBRDF.of(SHINY, (n, n, n, n), embedding, "linear")
        return np.sqrt(np.mean((evaluate(table, a, b) - truth) ** 2) / np.mean(truth**2))

    assert error(16) < error(8) / 3


def test_any_pass_makes_the_same_table(monkeypatch):
    whole = TabulatedBRDF.of(SHINY, SIZE)
    # 28 outgoing cells: four incoming ones a pass, which do not divide 30.
    monkeypatch.setattr(cells, "_PAIRS_AT_ONCE", 4 * 28)
    np.testing.assert_allclose(TabulatedBRDF.of(SHINY, SIZE).values, whole.values, rtol=ROUNDING)


def test_cells_beyond_the_horizon_are_zero_or_extended():
    zero = TabulatedBRDF.of(SHINY, 6, outside="zero")
    extended = TabulatedBRDF.of(SHINY, 6)
    covered = np.asarray(NUSSELT.covers(NUSSELT.centres((6, 6))))
    assert not covered[0, 0]
    assert not zero.values[0, 0].any()
    assert not zero.values[:, :, 0, 0].any()
    assert np.all(extended.values > 0)
    both = covered[:, :, None, None] & covered
    np.testing.assert_array_equal(zero.values[both], extended.values[both])


@pytest.mark.parametrize("reconstruction", ["linear", "b-spline"])
@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_a_diffuse_table_is_diffuse_to_the_horizon(embedding, reconstruction):
    table = TabulatedBRDF.of(Lambertian(np.array([0.2, 0.1])), 7, embedding, reconstruction)
    a, b = upper_directions(200, 10, 1e-4), upper_directions(200, 11, 1e-4)
    np.testing.assert_allclose(evaluate(table, a, b), np.tile([0.2, 0.1], (200, 1)), rtol=1e-12)
    down = a * [1, 1, -1]
    assert not np.any(evaluate(table, down, b))
    assert not np.any(evaluate(table, b, down))


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_white_is_white(embedding):
    weights = cell_weights(embedding, (8, 6))
    assert weights.sum() == pytest.approx(np.pi, rel=ROUNDING)
    if embedding is POLAR:
        # A ring has pi (sin^2 b - sin^2 a), here to the midpoint rule.
        edges = np.sin(np.pi / 2 * np.arange(9) / 8) ** 2
        np.testing.assert_allclose(weights.sum(axis=1), np.pi * np.diff(edges), rtol=1e-2)
    white = TabulatedBRDF.of(Lambertian(np.array([1 / np.pi])), 6, embedding)
    covered = np.asarray(embedding.covers(embedding.centres((6, 6))))
    np.testing.assert_allclose(white.albedo()[..., 0], covered, rtol=ROUNDING)
    assert white.conserves_energy
    assert white.reciprocal
    assert not eqx.tree_at(lambda t: t.values, white, white.values * 1.001).conserves_energy


def test_the_albedo_is_the_integral():
    """Of a smooth lobe from Nusselt cells, against quadrature in its own angles."""
    phong = Phong(np.array([0.1]), np.array([0.3]), 6.0)
    table = TabulatedBRDF.of(phong, (1, 1, 96, 96))
    # From the normal: kd pi + ks (s + 1) / (2 pi) int cos^s cos dw = kd pi + ks (s + 1) / (s + 2).
    assert table.albedo()[0, 0, 0] == pytest.approx(0.1 * np.pi + 0.3 * 7 / 8, rel=2e-3)


def test_reciprocity_is_seen_in_the_samples():
    assert TabulatedBRDF.of(SHINY, 5).reciprocal
    assert not TabulatedBRDF.of(Phong(np.ones(1) * 0.1, np.ones(1), 9.0), 5).reciprocal
    assert not TabulatedBRDF(VALUES).reciprocal


@pytest.mark.parametrize(
    ("embedding", "reconstruction"), [(NUSSELT, "cubic"), (POLAR, "linear"), (POLAR, "b-spline")]
)
def test_derivatives_are_those_of_finite_differences(embedding, reconstruction):
    a, b = upper_directions(1, 12, 0.4)[0], upper_directions(1, 13, 0.4)[0]

    @jax.jit
    def value(values, incoming, outgoing):
        return TabulatedBRDF(values, embedding, reconstruction).evaluate(incoming, outgoing)[1]

    check_grads(value, (VALUES, a, b), 1, ("fwd", "rev"), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=lambda e: e.name)
def test_derivatives_are_finite_at_the_pole_and_below_the_horizon(embedding):
    table = TabulatedBRDF(VALUES, embedding, "cubic")
    up, side, down = np.eye(3)[2], np.array([1.0, 0, 0]), np.array([0.6, 0, -0.8])
    slopes = jax.jit(jax.grad(lambda a, b: table.evaluate(a, b).sum(), (0, 1)))
    for a in (up, side, down):
        for b in (up, side, down):
            assert np.all(np.isfinite(slopes(a, b)))


def test_directions_broadcast_and_their_precision_is_kept():
    table = TabulatedBRDF(VALUES, POLAR, "cubic")
    a, b = upper_directions(3, 14), upper_directions(4, 15)
    pairs = Components.of(a[:, None]), Components.of(b[None])
    crossed = eqx.filter_jit(TabulatedBRDF.transfer)(table, *pairs)
    each = evaluate(table, np.repeat(a, 4, axis=0), np.tile(b, (3, 1)))
    found = np.stack(crossed, axis=-1) / a[:, None, 2:]
    np.testing.assert_allclose(found.reshape(12, 2), each, rtol=1e-10)
    single = evaluate(table, single_precision(a), single_precision(a))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, evaluate(table, a, a), rtol=1e-4, atol=1e-5)


def test_memory_is_not_that_of_all_samples():
    points, channels = 10_000, 3
    values = np.zeros((8, 8, 8, 8, channels))
    a = upper_directions(points, 16)
    whole = 256 * points * channels * 8

    def total(incoming):
        return TabulatedBRDF(values, NUSSELT, "cubic").evaluate(incoming, a).sum()

    for function in (total, jax.grad(total)):
        needed = jax.jit(function).lower(a).compile().memory_analysis().temp_size_in_bytes
        assert needed < whole / 3


def test_a_spectrum_has_many_channels():
    spectrum = np.random.default_rng(19).uniform(size=31) / np.pi
    table = TabulatedBRDF.of(Lambertian(spectrum), (2, 3, 4, 5), POLAR)
    assert table.values.shape == (2, 3, 4, 5, 31)
    found = evaluate(table, upper_directions(2, 17), upper_directions(2, 18))
    np.testing.assert_allclose(found, np.tile(spectrum, (2, 1)), rtol=ROUNDING)


def test_resampling_to_the_same_cells_changes_nothing():
    for embedding in EMBEDDINGS.values():
        table = TabulatedBRDF(VALUES, embedding, "cubic")
        np.testing.assert_allclose(table.resampled(SIZE).values, VALUES, rtol=1e-10)


@pytest.mark.slow
def test_resampling_gives_what_the_table_says_there():
    table = TabulatedBRDF.of(SHINY, 11, NUSSELT, "cubic")
    other = table.resampled((8, 6, 9, 7), POLAR)
    assert other.embedding is POLAR
    a = POLAR.cell_directions((8, 6))[2, 4]
    b = POLAR.cell_directions((9, 7))[3, 1]
    np.testing.assert_allclose(other.values[2, 4, 3, 1], evaluate(table, a, b), rtol=1e-9)
    finer = table.resampled(16)
    a, b = NUSSELT.cell_directions((16, 16))[[4, 9], [7, 3]]
    np.testing.assert_allclose(finer.values[4, 7, 9, 3], evaluate(table, a, b), rtol=1e-9)


def test_holes_are_filled_and_counted():
    values = VALUES.copy()
    values[2, 3, 3, 2, 1] = -0.1
    values[0, 0, 0, 0, 0] = np.nan
    values[0, 1, 0, 0, 0] = np.inf
    filled = masked(values)
    assert filled.replaced == 3
    neighbours = [VALUES[2, 3, 3, 2 + s, 1] for s in (-1, 1)]
    neighbours += [VALUES[2, 3, 3 + s, 2, 1] for s in (-1, 1)]
    neighbours += [VALUES[2, 3 + s, 3, 2, 1] for s in (-1, 1)]
    neighbours += [VALUES[2 + s, 3, 3, 2, 1] for s in (-1, 1)]
    assert filled.values[2, 3, 3, 2, 1] in neighbours
    kept = np.isfinite(values) & (values >= 0)
    np.testing.assert_array_equal(filled.values[kept], values[kept])
    assert np.all(masked(values, "zero").values[~kept] == 0)
    empty = masked(np.full((2, 2, 2, 2, 1), np.nan))
    assert empty.replaced == 16
    assert not empty.values.any()


def test_what_is_refused():
    with pytest.raises(ValueError, match="none of them 0"):
        TabulatedBRDF(np.ones((2, 0, 2, 2, 1)))
    broken = VALUES.copy()
    broken[1, 2, 3, 1, 0] = np.nan
    with pytest.raises(ValueError, match=r"values\[1, 2, 3, 1, 0\] is nan \(1 such\).*masked"):
        TabulatedBRDF(broken)
    assert TabulatedBRDF(VALUES - 0.5).size == SIZE
    with pytest.raises(ValueError, match="choose one of constant, linear, cubic, b-spline"):
        TabulatedBRDF(VALUES, NUSSELT, "quintic")
    with pytest.raises(ValueError, match="choose one of extended, zero"):
        TabulatedBRDF.of(SHINY, 4, outside="black")
    with pytest.raises(ValueError, match="four"):
        TabulatedBRDF.of(SHINY, (4, 4, 0, 4))
    with pytest.raises(ValueError, match="pairs of directions"):
        TabulatedBRDF.of(SHINY, 1000)
    with pytest.raises(ValueError, match="nearest, zero"):
        masked(VALUES, "mean")
