"""A BRDF from photographs with one source each, its table, and the fit to the table.

- Half-angle coordinates: invertible up to a turn about the normal; exchanging the directions adds
  pi to phi_d; the highlight is at t_h = 0.
- Samples are the BRDF: exactly, in every channel, whatever the source's colour; none at grazing.
- A table keeps means, counts and standard errors (chi-squared); empty cells are NaN; a reciprocal
  grid pools both orders of a pair.
- The model averaged over a cell is exact to second order: at the middle it is not.
- The fit finds the material within its stated errors, and the errors are small.
- Refusals: no source, two sources, an almost empty table, a reciprocal table of a model that is
  not.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import microfacet_unknowns, parameter_vector, unit
from scipy.stats import chi2

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.brdf_table.moving_source import brdf_samples, fit_table, table_error
from jaxrender.inverse.brdf_table.table import (
    BRDFSamples,
    HalfAngleGrid,
    directions_from_half_angles,
    half_angle_coordinates,
    tabulate,
)
from jaxrender.inverse.intervals import Uncertain
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import integral_columns, radiance

ROUNDING = 1e-12
STATED_ERRORS = 3.5
VIEW = np.array([1.0, 0, 0])
TRUTH = Microfacet(np.array([0.26, 0.2, 0.12]), np.full(3, 0.03), 0.12, 1.78)
NOISE = NoiseModel(0.01, 0.0005)
GRID = HalfAngleGrid(40, 12, 6)


def upper_directions(count, seed):
    directions = unit(np.random.default_rng(seed).normal(size=(count, 3)))
    directions[:, 2] = np.abs(directions[:, 2])
    return directions


def source_at(degrees, colour=(1.0, 1.0, 1.0)):
    angle = np.radians(degrees)
    towards = np.array([[np.cos(angle), 0.3 * np.sin(angle), 0.954 * np.sin(angle)]])
    return DirectionalSources(towards, np.array([colour]))


SOURCES = [source_at(degrees, (1.0, 0.8, 1.3)) for degrees in np.arange(6.0, 150, 9)]


def photographs(sources, count=1500, seed=0):
    """Random pixels of a sphere from one side, under each source in turn: no noise."""
    rng = np.random.default_rng(seed)
    normals = unit(VIEW + 1.2 * unit(rng.normal(size=(count, 3))))
    normals = normals[normals @ VIEW > 0.05]
    samples = SurfaceSamples(normals, np.tile(VIEW, (len(normals), 1)))
    arrays = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    shots = [radiance(TRUTH, integral_columns(TRUTH, arrays, source.nodes())) for source in sources]
    every = SurfaceSamples(*(np.tile(a, (len(sources), 1)) for a in samples))
    frame = np.repeat(np.arange(len(sources)), len(normals))
    return Observations(every, np.concatenate([np.asarray(s) for s in shots]), frame)


@pytest.fixture(scope="module")
def exact():
    return photographs(SOURCES)


def measured(exact, seed=0):
    noisy = NOISE.add(exact.radiance, np.random.default_rng(seed))
    return brdf_samples(exact._replace(radiance=noisy), SOURCES, NOISE)


def test_half_angle_coordinates():
    incoming, outgoing = upper_directions(200, 0), upper_directions(200, 1)
    found = half_angle_coordinates(incoming, outgoing)
    back = directions_from_half_angles(found)
    # Up to a turn about the normal: the polar angles, and the angle between the two.
    for directions, again in zip((incoming, outgoing), back):
        np.testing.assert_allclose(again[:, 2], directions[:, 2], atol=ROUNDING)
    between = np.sum(incoming * outgoing, axis=1)
    np.testing.assert_allclose(np.sum(back[0] * back[1], axis=1), between, atol=ROUNDING)
    handed = np.sum(np.cross(incoming, outgoing) * [0, 0, 1], axis=1)
    turned = np.sum(np.cross(*back) * [0, 0, 1], axis=1)
    np.testing.assert_allclose(turned, handed, atol=ROUNDING)
    exchanged = half_angle_coordinates(outgoing, incoming)
    np.testing.assert_allclose(exchanged[:, :2], found[:, :2], atol=ROUNDING)
    turn = np.exp(1j * (exchanged[:, 2] - found[:, 2]))
    np.testing.assert_allclose(turn, -1, atol=1e-9)


def test_the_mirror_direction_has_no_half_angle():
    angle = 0.7
    incoming = np.array([[np.sin(angle), 0, np.cos(angle)]])
    found = half_angle_coordinates(incoming, incoming * [-1, 1, 1])
    np.testing.assert_allclose(found[0, :2], [0, angle], atol=ROUNDING)


@pytest.mark.slow
def test_samples_are_the_brdf(exact):
    samples = brdf_samples(exact, SOURCES, NOISE, min_cosine=0.2)
    assert np.minimum(samples.incoming[:, 2], samples.outgoing[:, 2]).min() >= 0.2
    expected = np.asarray(TRUTH.evaluate(samples.incoming, samples.outgoing))
    np.testing.assert_allclose(samples.values, expected, rtol=1e-10)
    # Every pixel that the source reaches and that is not at the rim.
    towards = np.concatenate([np.asarray(source.directions) for source in SOURCES])[exact.frame]
    cosines = np.sum(towards * exact.samples.normals, axis=1)
    count = np.sum((cosines >= 0.2) & (np.asarray(exact.samples.exit_cosines) >= 0.2))
    assert len(samples.values) == count


def test_a_table_holds_means_counts_and_errors():
    """Noise alone: the means of cells off by what their errors say, over all cells."""
    rng = np.random.default_rng(3)
    incoming, outgoing = upper_directions(20000, 4), upper_directions(20000, 5)
    deviation = rng.uniform(0.01, 0.05, (20000, 1))
    values = 0.2 + deviation * rng.normal(size=(20000, 1))
    grid = HalfAngleGrid(6, 5, 4)
    for from_scatter, allowed in ((False, 1e-4), (True, 1e-4)):
        table = tabulate(BRDFSamples(incoming, outgoing, values, deviation), grid, from_scatter)
        assert table.count.sum() == 20000
        full = table.count > 30
        scores = (table.mean[full] - 0.2) / table.standard_error[full]
        low, high = chi2.interval(1 - allowed, full.sum())
        # Errors from scatter have one of their own: a t distribution of 30 or more.
        assert low < np.sum(scores**2) < high * (1.1 if from_scatter else 1)
    cell = tuple(index[:1] for index in grid.cells(grid.coordinates(incoming, outgoing)))
    found = table.lookup(incoming[:1], outgoing[:1])
    np.testing.assert_array_equal(found, table.mean[cell])


def test_what_was_not_measured_is_not_a_number():
    incoming = upper_directions(1, 0)
    samples = BRDFSamples(incoming, incoming, np.ones((1, 2)), np.full((1, 2), 0.1))
    table = tabulate(samples, GRID)
    assert np.count_nonzero(table.filled) == 1
    assert np.all(np.isnan(table.mean[~table.filled]))
    np.testing.assert_array_equal(table.lookup(incoming, incoming), np.ones((1, 2)))
    assert np.all(np.isnan(table.lookup(upper_directions(1, 9), upper_directions(1, 8))))


def test_a_reciprocal_grid_pools_both_orders():
    incoming, outgoing = upper_directions(50, 0), upper_directions(50, 1)
    grid = HalfAngleGrid(8, 8, 8, reciprocal=True)
    one = grid.cells(grid.coordinates(incoming, outgoing))
    other = grid.cells(grid.coordinates(outgoing, incoming))
    np.testing.assert_array_equal(one, other)
    apart = HalfAngleGrid(8, 8, 8)
    one = apart.cells(apart.coordinates(incoming, outgoing))
    assert np.any(one[2] != apart.cells(apart.coordinates(outgoing, incoming))[2])


@pytest.mark.slow
def test_a_model_is_averaged_over_the_cell():
    """Cells of t_h as wide as the lobe: the mean over the cell, not the value in its middle."""
    samples = brdf_samples(photographs(SOURCES), SOURCES, NOISE)
    table = tabulate(samples, HalfAngleGrid(18, 12, 6))
    averaged = table_error(table, TRUTH)
    cells = table.mean[table.filled]
    middle = directions_from_half_angles(table.coordinates[table.filled])
    off = np.asarray(TRUTH.evaluate(*middle)) - cells
    assert averaged < 0.3 * np.sqrt(np.sum(off**2) / np.sum(cells**2))
    assert averaged < 0.01


@pytest.mark.slow
def test_the_fit_finds_the_material(exact):
    table = tabulate(measured(exact), GRID)
    fit = fit_table(table, microfacet_unknowns(), TRUTH)
    assert fit.converged
    found: Uncertain = fit.parameters
    truth = np.array([0.26, 0.2, 0.12, 0.03, 0.12, 1.78])
    scores = (parameter_vector(found.value) - truth) / parameter_vector(found.standard_error)
    assert np.all(np.abs(scores) < STATED_ERRORS)
    assert np.all(parameter_vector(found.standard_error) < 0.01 * truth)
    assert fit.relative_rms == pytest.approx(table_error(table, TRUTH), rel=0.05)
    assert fit.relative_rms < 0.03


def test_refusals(exact):
    with pytest.raises(ValueError, match="photograph 15 has no source"):
        brdf_samples(exact, SOURCES[:-1], NOISE)
    two = DirectionalSources(np.eye(3)[:2], np.ones((2, 3)))
    with pytest.raises(ValueError, match="photograph 0 has 2 sources"):
        brdf_samples(exact, [two, *SOURCES[1:]], NOISE)
    with pytest.raises(ValueError, match="cells: give one or more"):
        HalfAngleGrid(0, 1, 1)
    few = BRDFSamples(*(a[:2] for a in measured(exact)))
    with pytest.raises(ValueError, match="cannot determine a material"):
        fit_table(tabulate(few, GRID), microfacet_unknowns(), TRUTH)
    pooled = tabulate(measured(exact), HalfAngleGrid(8, 8, 4, reciprocal=True))
    with pytest.raises(ValueError, match="the model is not reciprocal"):
        fit_table(pooled, microfacet_unknowns(), TRUTH)
