"""Drawing from Haar trees: densities, searches, and the statistics of a million draws.

Pinned down: along one axis a draw is the inverse of the cumulated samples, and L fig. 8.1 with its
two mends (ERRATA 78); whichever axes are fixed, the density is the clamped slice of the tree's
samples, by table and by contraction; chi-squared at 1e6 draws in half cells, at 1 % over all tests
by Sidak's correction, and the same test refuses a density 2 % wider; averages that leave out the
finer levels choose other quadrants (ERRATA 79); negative reconstructions have density 0 (ERRATA
76); where nothing is left the support is uniform; ``levels`` leaves levels out; a draw is never
rounded out of its cell, in float32 either; every refusal.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxrender.wavelets.filters import haar, linear_spline
from jaxrender.wavelets.nodes import Entries
from jaxrender.wavelets.sampling import TabulatedDensities
from jaxrender.wavelets.slices import SlicedDensities
from jaxrender.wavelets.threshold import keep_fraction
from jaxrender.wavelets.transform import analyse_nonstandard
from jaxrender.wavelets.traversal import evaluate
from jaxrender.wavelets.tree import CoefficientTree

ROUNDING = 1e-12
KINDS = (TabulatedDensities, SlicedDensities)
DRAWS = 1_000_000
# Of all chi-squared tests of this file together.
TESTS = 8
LEVEL = 1 - (1 - 0.01) ** (1 / TESTS)


def tree_of(samples, fraction=1.0, wavelet=None):
    wavelet = wavelet or haar()
    coefficients = keep_fraction(analyse_nonstandard(wavelet, samples), fraction).coefficients
    return CoefficientTree.of_coefficients(wavelet, coefficients)


def random_tree(size, axes, fraction=1.0, seed=0, channels=2):
    rng = np.random.default_rng(seed)
    return tree_of(rng.random((size,) * axes + (channels,)) ** 4, fraction)


def bumps(size, axes, width=0.1):
    """A Gaussian at another place along each axis, cell by cell."""
    centres = (np.arange(size) + 0.5) / size
    product = np.ones(())
    for axis in range(axes):
        along = np.exp(-(((centres - 0.3 - 0.1 * axis) / width) ** 2) / 2)
        product = product[..., None] * along
    return product[..., None]


def slice_by_samples(tree, fixed_axes, fixed):
    """The clamped, normalised density of every free cell, from all samples of the tree."""
    values = np.asarray(tree.samples()).mean(axis=-1)
    for axis, place in sorted(zip(fixed_axes, fixed), reverse=True):
        values = np.take(values, int(place * tree.size), axis=axis)
    clamped = np.maximum(values, 0)
    return clamped / clamped.mean()


def p_value(places, density):
    """Chi-squared over half cells, those that few draws are expected in taken together."""
    halves = 2 * density.shape[0]
    expected = density / density.sum()
    for axis in range(density.ndim):
        expected = np.repeat(expected, 2, axis=axis) / 2
    cell = np.minimum((np.asarray(places) * halves).astype(int), halves - 1)
    row = np.ravel_multi_index(tuple(cell.T), expected.shape)
    found = np.bincount(row, minlength=expected.size)
    return p_of_counts(found, expected.ravel() * len(row))


def p_of_counts(found, expected):
    few = expected < 10
    found = np.append(found[~few], found[few].sum())
    expected = np.append(expected[~few], expected[few].sum())
    if expected[-1] < 1:
        assert found[-1] < 10
        found, expected = found[:-1], expected[:-1]
    square = np.sum((found - expected) ** 2 / expected)
    return stats.chi2.sf(square, len(expected) - 1)


def printed_search(y, left, right, total, phi, place, details):
    """L fig. 8.1 as it stands, but for a floor."""
    depth, m = place
    if total == y:
        return right
    if depth == len(details):
        return left + (y - total) / phi
    half, w = (right - left) / 2, details[depth][m]
    if total + half * (phi + w) < y:
        rest = (total + half * (phi + w), phi - w, (depth + 1, 2 * m + 1), details)
        return printed_search(y, left + half, right, *rest)
    rest = (total, phi + w, (depth + 1, 2 * m), details)
    return printed_search(y, left, left + half, *rest)


def mended_search(y, left, right, total, phi, place, details):
    """The same with ``left`` for the first return."""
    if total == y:
        return left
    return printed_search(y, left, right, total, phi, place, details)


def unnormalised_details(samples):
    """Halved differences of neighbours' averages, the coarsest level first."""
    details = []
    while len(samples) > 1:
        details.append((samples[0::2] - samples[1::2]) / 2)
        samples = (samples[0::2] + samples[1::2]) / 2
    return details[::-1]


@pytest.mark.parametrize("kind", KINDS)
def test_one_axis_inverts_the_cumulated_samples(kind):
    tree = random_tree(16, 1, channels=1)
    samples = np.asarray(tree.samples())[:, 0]
    samples = samples / samples.mean()
    y = np.concatenate([[0.0], np.random.default_rng(1).random(200)])
    drawn = kind.of(tree).draw(y[:, None])
    ends = np.arange(17) / 16
    expected = np.interp(y, np.append(0, np.cumsum(samples) / 16), ends)
    np.testing.assert_allclose(drawn.places[:, 0], expected, atol=ROUNDING)
    density = samples[np.minimum((expected * 16).astype(int), 15)]
    np.testing.assert_allclose(drawn.density, density, rtol=ROUNDING)
    details = unnormalised_details(samples)
    searched = [mended_search(v, 0.0, 1.0, 0.0, 1.0, (0, 0), details) for v in y]
    np.testing.assert_allclose(drawn.places[:, 0], searched, atol=ROUNDING)


def test_zero_is_drawn_for_zero_where_the_figure_prints_one():
    tree = random_tree(16, 1, channels=1)
    details = unnormalised_details(np.asarray(tree.samples())[:, 0] / float(tree.root[0]))
    assert printed_search(0.0, 0.0, 1.0, 0.0, 1.0, (0, 0), details) == 1
    assert TabulatedDensities.of(tree).draw(np.zeros((1, 1))).places[0, 0] == 0


FIXED = {1: [()], 3: [(), (0, 2)], 4: [(2, 3), (1,)]}


@pytest.mark.parametrize("axes", FIXED)
def test_any_axes_may_be_fixed(axes):
    tree = random_tree(4, axes, fraction=0.4, seed=axes)
    assert np.asarray(tree.samples()).mean(axis=-1).min() < 0
    rng = np.random.default_rng(2)
    for fixed_axes in FIXED[axes]:
        count, free = len(fixed_axes), axes - len(fixed_axes)
        fixed = np.repeat(rng.random((1, count)), 4**free, axis=0)
        centres = (np.indices((4,) * free).reshape(free, -1).T + 0.5) / 4
        expected = slice_by_samples(tree, fixed_axes, fixed[0]).ravel()
        table, sliced = (kind.of(tree, fixed_axes) for kind in KINDS)
        uniforms, places = rng.random((64, free)), rng.random((64, count))
        one, other = (d.draw(uniforms, places) for d in (table, sliced))
        np.testing.assert_allclose(one.places, other.places, atol=1e3 * ROUNDING)
        np.testing.assert_allclose(one.density, other.density, rtol=1e3 * ROUNDING)
        both = np.concatenate([centres, one.places]), np.concatenate([fixed, places])
        for densities in (table, sliced):
            found = np.asarray(densities.density(*both))
            np.testing.assert_allclose(found[: 4**free], expected, atol=1e3 * ROUNDING)
            np.testing.assert_allclose(found[4**free :], one.density, rtol=1e3 * ROUNDING)


DRAWN = {
    "one axis": (tree_of(bumps(64, 1)), (), None),
    "one axis, few coefficients": (tree_of(bumps(64, 1), 0.2), (), None),
    "two axes": (random_tree(16, 2), (), None),
    "three axes, one fixed": (random_tree(16, 3, 0.1), (1,), [0.77]),
    "four axes": (random_tree(4, 4, 0.5), (), None),
    "four axes, two fixed": (random_tree(8, 4, 0.05), (2, 3), [0.3, 0.9]),
    "bumps": (tree_of(bumps(16, 4, 0.15)), (0, 1), [0.4, 0.3]),
    "three fixed": (tree_of(bumps(8, 4, 0.2), 0.1), (0, 1, 2), [0.4, 0.3, 0.6]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", DRAWN)
def test_a_million_draws_have_the_density(name):
    assert len(DRAWN) == TESTS
    tree, fixed_axes, fixed = DRAWN[name]
    rng = np.random.default_rng(3)
    uniforms = rng.random((DRAWS, tree.axes - len(fixed_axes)))
    places = np.broadcast_to(np.array(fixed or []), (DRAWS, len(fixed_axes)))
    drawn = TabulatedDensities.of(tree, fixed_axes).draw(uniforms, places)
    assert p_value(drawn.places, slice_by_samples(tree, fixed_axes, fixed or [])) > LEVEL


@pytest.mark.parametrize("axes", [1, 2])
def test_a_density_two_per_cent_wider_is_refused(axes):
    size = 64 // axes
    narrow, wide = (tree_of(bumps(size, axes, 0.1 * k)) for k in (1.0, 1.02))
    uniforms = np.random.default_rng(4).random((DRAWS, axes))
    drawn = TabulatedDensities.of(wide).draw(uniforms)
    assert p_value(drawn.places, slice_by_samples(wide, (), [])) > LEVEL
    assert p_value(drawn.places, slice_by_samples(narrow, (), [])) < 1e-3 * LEVEL


@pytest.mark.parametrize("kind", KINDS)
def test_quadrants_need_the_finer_levels(kind):
    along = np.subtract.outer(np.arange(8), np.arange(8)) / 8
    ridge = np.exp(-((along / 0.2) ** 2) / 2)
    tree = tree_of(np.einsum("ik,jl->ijkl", ridge, ridge)[..., None])
    fixed = np.array([[0.45, 0.45]])
    density = slice_by_samples(tree, (0, 1), fixed[0])
    quadrants = density.reshape(2, 4, 2, 4).mean(axis=(1, 3)) / 4
    rng = np.random.default_rng(5)
    drawn = kind.of(tree, (0, 1)).draw(rng.random((20_000, 2)), np.repeat(fixed, 20_000, axis=0))
    half = np.asarray(drawn.places >= 0.5)
    found = np.array([[np.mean((half == (a, b)).all(axis=1)) for b in (0, 1)] for a in (0, 1)])
    np.testing.assert_allclose(found, quadrants, atol=4 * np.sqrt(0.25 / 20_000))
    corners = np.array([[*fixed[0], a, b] for a in (0.25, 0.75) for b in (0.25, 0.75)])
    coarse = np.asarray(evaluate(tree, corners, levels=1))[:, 0].reshape(2, 2)
    assert np.abs(coarse / coarse.sum() - quadrants).max() > 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_negative_reconstructions_have_no_density(kind):
    tree = tree_of(bumps(16, 2, 0.08), 0.1)
    samples = np.asarray(tree.samples())[..., 0]
    assert samples.min() < -0.01
    centres = (np.indices((16, 16)).reshape(2, -1).T + 0.5) / 16
    found = np.asarray(kind.of(tree).density(centres)).reshape(16, 16)
    assert not found[samples <= 0].any()
    assert found.min() == 0
    assert found.mean() == pytest.approx(1, abs=ROUNDING)
    drawn = kind.of(tree).draw(np.random.default_rng(6).random((5000, 2)))
    assert np.all(drawn.density > 0)


@pytest.mark.parametrize("kind", KINDS)
def test_where_nothing_is_left_the_support_is_uniform(kind):
    samples = -np.ones((4, 4, 1))
    support = np.zeros((4, 4), bool)
    support[1, :] = True
    densities = kind.of(tree_of(samples), support=support)
    drawn = densities.draw(np.random.default_rng(7).random((1000, 2)))
    np.testing.assert_allclose(drawn.density, 4)
    assert set(np.asarray(drawn.places[:, 0] * 4).astype(int)) == {1}
    assert np.ptp(drawn.places[:, 1]) > 0.95
    np.testing.assert_array_equal(densities.density(np.array([[0.1, 0.5], [1.5, 0.3]])), 0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_slice_of_rounding_is_nothing(kind):
    samples = np.zeros((16, 16, 1))
    samples[:8] = 1e3 * np.random.default_rng(15).random((8, 16, 1)) ** 4
    samples[12, :] = 1e-9
    densities, places = kind.of(tree_of(samples), (0,)), (np.arange(16)[:, None] + 0.5) / 16
    assert np.asarray(tree_of(samples).samples())[9].any()
    np.testing.assert_array_equal(densities.density(places, np.full((16, 1), 9.5 / 16)), 1)
    kept = densities.density(places, np.full((16, 1), 12.5 / 16))
    np.testing.assert_allclose(kept, 1, rtol=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_fewer_levels_are_averages_over_coarser_cells(kind):
    tree = random_tree(16, 2, channels=1)
    blocks = np.asarray(tree.samples())[..., 0].reshape(4, 4, 4, 4).mean(axis=(1, 3))
    centres = (np.indices((4, 4)).reshape(2, -1).T + 0.5) / 4
    found = kind.of(tree, levels=2).density(centres)
    np.testing.assert_allclose(found, blocks.ravel() / blocks.mean(), rtol=1e3 * ROUNDING)
    np.testing.assert_allclose(kind.of(tree, levels=0).density(centres), 1, rtol=1e3 * ROUNDING)


def test_weights_choose_the_channels():
    tree = random_tree(8, 1)
    samples = np.asarray(tree.samples()) @ [0.25, 0.75]
    centres = (np.arange(8)[:, None] + 0.5) / 8
    found = TabulatedDensities.of(tree, weights=np.array([0.25, 0.75])).density(centres)
    np.testing.assert_allclose(found, samples / samples.mean(), rtol=1e3 * ROUNDING)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_no_draw_is_rounded_out_of_its_cell(kind, dtype):
    tree = tree_of(np.random.default_rng(8).random((16, 16, 16, 1)).astype(np.float32) ** 8, 0.2)
    densities = kind.of(tree, (2,))
    below = np.nextafter(dtype(1), dtype(0))
    ends = np.array(list(itertools.product([0, 1e-30, 0.5, below, 1], repeat=3)), dtype)
    numbers = np.concatenate([ends, np.random.default_rng(9).random((400, 3)).astype(dtype)])
    drawn = densities.draw(numbers[:, :2], numbers[:, 2:])
    assert drawn.places.dtype == drawn.density.dtype == dtype
    assert np.all((drawn.places >= 0) & (drawn.places < 1))
    assert np.all(drawn.density > 0)
    again = densities.density(np.asarray(drawn.places), numbers[:, 2:])
    np.testing.assert_allclose(again, drawn.density, rtol=1e-6)


def test_it_runs_under_jit():
    densities = TabulatedDensities.of(random_tree(8, 3), (0,))
    uniforms, fixed = jnp.asarray(np.random.default_rng(1).random((2, 50, 2)))
    compiled = jax.jit(lambda u, f: densities.draw(u, f).places)(uniforms, fixed[:, :1])
    np.testing.assert_array_equal(compiled, densities.draw(uniforms, fixed[:, :1]).places)


def test_a_large_tree_is_refused_a_table_and_sliced():
    one = np.array([1])
    entries = Entries(6 * one, 77 * one, 5 * one, np.array([[1e-4]]))
    tree = CoefficientTree.of_entries(haar(), 128, 4, entries, np.ones(1))
    with pytest.raises(ValueError, match="fewer levels, or use SlicedDensities"):
        TabulatedDensities.of(tree, (2, 3))
    drawn = SlicedDensities.of(tree, (2, 3)).draw(np.full((2, 2), 0.7), np.full((2, 2), 0.9))
    np.testing.assert_allclose(drawn.places, 0.7, rtol=1e3 * ROUNDING)


@pytest.mark.parametrize("kind", KINDS)
def test_misuse_is_refused(kind):
    tree = random_tree(4, 3)
    with pytest.raises(ValueError, match="cdf-2-2 is not constant in cells"):
        kind.of(tree_of(np.ones((4, 4, 1)), wavelet=linear_spline()))
    for axes in ((0, 0), (1, 0), (3,), (-1,), (0, 1, 2)):
        with pytest.raises(ValueError, match="give them ascending"):
            kind.of(tree, axes)
    with pytest.raises(ValueError, match="3 levels of a tree that has 2"):
        kind.of(tree, levels=3)
    for weights in (np.ones(3), np.array([1.0, -1.0]), np.array([np.nan, 1.0])):
        with pytest.raises(ValueError, match="give 2, finite and not negative"):
            kind.of(tree, weights=weights)
    for support in (np.ones((4, 4), bool), np.zeros((4, 4, 4), bool)):
        with pytest.raises(ValueError, match="some of them true"):
            kind.of(tree, support=support)
    broken = CoefficientTree.of_coefficients(haar(), np.full((2, 1), np.nan))
    with pytest.raises(ValueError, match="not finite; mend"):
        kind.of(broken)
    with pytest.raises(ValueError, match="give a row of 2 and one of 1"):
        kind.of(tree, (0,)).draw(np.zeros((3, 2)))
