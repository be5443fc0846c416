"""The coefficient tree.

- Dense coefficients and back, exactly; entries in any order, repeated ones added up.
- Norms: the integral of f^2 is the sum of squares for orthonormal wavelets, whatever the size; the
  scaling coefficient is the mean (ERRATA 59: without it a constant is reconstructed as 0).
- Masks: children and coefficients by their bits, 1 << b (ERRATA 63), children at 2 m + b one level
  finer (ERRATA 64), levels counted from the coarsest (ERRATA 56).
- Sums, multiples and resolutions against the same done to samples.
- Masks that disagree with each other, with the values or with the size are refused.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from tree_problems import samples_of, tree_of

from jaxrender.wavelets import (
    WAVELETS,
    CoefficientTree,
    Entries,
    analyse_nonstandard,
    evaluate,
    haar,
    keep_fraction,
    linear_spline,
    resampled,
    scaled,
    synthesise_nonstandard,
    weighted_sum,
)
from jaxrender.wavelets.nodes import Structure, interleaved, separated

EVERY = pytest.mark.parametrize("wavelet", WAVELETS.values(), ids=list(WAVELETS))
CUBES = pytest.mark.parametrize(("size", "axes"), [(8, 4), (16, 2), (16, 1), (4, 3), (1, 2)])


@CUBES
@EVERY
def test_dense_and_back(wavelet, size, axes):
    coefficients = analyse_nonstandard(wavelet, jnp.asarray(samples_of(size, axes)))
    sparse = keep_fraction(coefficients, 0.3).coefficients
    tree = CoefficientTree.of_coefficients(wavelet, sparse)
    np.testing.assert_allclose(tree.coefficients(), sparse, atol=1e-14)
    np.testing.assert_allclose(tree.samples(), synthesise_nonstandard(wavelet, sparse), atol=1e-13)


def test_float32_stays_float32():
    values = samples_of(8, 2).astype(np.float32)
    tree = CoefficientTree.of_coefficients(haar(), analyse_nonstandard(haar(), values))
    assert tree.values.dtype == np.float32
    assert tree.root.dtype == np.float32
    assert tree.samples().dtype == np.float32


def test_order_does_not_matter_and_equal_places_add_up():
    tree = tree_of(haar(), 8, 3, 0.5)
    entries = tree.entries()
    order = np.random.default_rng(3).permutation(len(entries.level))
    shuffled = Entries(*(np.concatenate([part[order], part[order]]) for part in entries))
    twice = CoefficientTree.of_entries(haar(), 8, 3, shuffled, 2 * np.asarray(tree.root))
    np.testing.assert_allclose(twice.samples(), 2 * tree.samples(), atol=1e-14)


@pytest.mark.parametrize("size", [4, 16])
def test_squares_add_up_to_the_integral(size):
    samples = samples_of(size, 2)
    tree = CoefficientTree.of_coefficients(haar(), analyse_nonstandard(haar(), samples))
    total = np.sum(np.asarray(tree.values) ** 2) + np.sum(np.asarray(tree.root) ** 2)
    np.testing.assert_allclose(total, np.mean(np.sum(samples**2, axis=-1)), rtol=1e-13)
    np.testing.assert_allclose(tree.root, samples.mean(axis=(0, 1)), rtol=1e-13)


def test_constant_is_the_root_alone():
    flat = np.full((8, 8, 8, 8, 2), 0.7)
    coefficients = np.round(analyse_nonstandard(haar(), flat), 12)
    tree = CoefficientTree.of_coefficients(haar(), coefficients)
    assert tree.count == 1
    np.testing.assert_allclose(evaluate(tree, np.full((1, 4), 0.3)), 0.7)


def test_one_coefficient_is_one_function():
    """Level 1, place (0, 1), selector 2: a scaling function along axis 0, a wavelet along 1."""
    code = interleaved(np.array([[0, 1]]), 2)
    entries = Entries(np.array([1]), code, np.array([2]), np.ones((1, 1)))
    tree = CoefficientTree.of_entries(haar(), 8, 2, entries, np.zeros(1))
    assert tree.structure.child_masks.tolist() == [1 << 2, 0]
    assert tree.structure.value_masks.tolist() == [0, 1 << 2]
    expected = np.zeros((8, 8))
    expected[:4, 4:6], expected[:4, 6:] = 2.0, -2.0
    np.testing.assert_allclose(tree.samples()[..., 0], expected, atol=1e-15)


def test_codes_interleave_bits():
    places = np.array([[1, 0], [0, 1], [3, 0], [2, 1]])
    assert interleaved(places, 2).tolist() == [1, 2, 5, 6]
    np.testing.assert_array_equal(separated(interleaved(places, 2), 2), places)


@EVERY
def test_weighted_sum_is_that_of_samples(wavelet):
    one, two = tree_of(wavelet, 8, 3, 0.1), tree_of(wavelet, 8, 3, 0.2, seed=1)
    total = weighted_sum([one, two], [0.25, -3.0])
    expected = 0.25 * one.samples() - 3.0 * two.samples()
    np.testing.assert_allclose(total.samples(), expected, atol=1e-13)


def test_each_channel_has_its_factor():
    tree = tree_of(haar(), 8, 2)
    factors = np.array([2.0, 0.0, -1.0])
    np.testing.assert_allclose(
        scaled(tree, factors).samples(), np.asarray(tree.samples()) * factors, atol=1e-14
    )


@pytest.mark.parametrize("wavelet", [haar(), linear_spline()], ids=["haar", "cdf-2-2"])
def test_finer_is_the_same_function(wavelet):
    tree = tree_of(wavelet, 8, 2, 0.5)
    points = np.random.default_rng(5).uniform(0.1, 0.85, (300, 2))
    finer = resampled(tree, 32)
    assert finer.size == 32
    np.testing.assert_allclose(evaluate(finer, points), evaluate(tree, points), atol=1e-13)


def test_coarser_haar_averages():
    tree = tree_of(haar(), 16, 2)
    averages = np.asarray(tree.samples()).reshape(4, 4, 4, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(resampled(tree, 4).samples(), averages, atol=1e-13)


def test_unlike_trees_are_not_added():
    tree = tree_of(haar(), 8, 2)
    for other, what in (
        (tree_of(linear_spline(), 8, 2), "wavelets: haar and cdf-2-2"),
        (tree_of(haar(), 4, 2), "resample"),
        (tree_of(haar(), 8, 3), "axes"),
    ):
        with pytest.raises(ValueError, match=what):
            weighted_sum([tree, other], [1.0, 1.0])
    with pytest.raises(ValueError, match="one for each"):
        weighted_sum([tree], [])


def test_damaged_masks_are_refused():
    tree = tree_of(haar(), 8, 2, 0.5)
    child, value = tree.structure.child_masks.copy(), tree.structure.value_masks.copy()
    value[0] ^= 2
    with pytest.raises(ValueError, match="values, and masks that name"):
        dataclasses.replace(tree, structure=Structure(child, value, 2))
    child[-1] |= 1
    with pytest.raises(ValueError, match="nodes stand below the root"):
        Structure(child, value, 2)
    with pytest.raises(ValueError, match="stray bits"):
        Structure(np.array([1 << 4]), np.array([0]), 2)
    with pytest.raises(ValueError, match="bit 0"):
        Structure(np.array([0]), np.array([1]), 2)
    with pytest.raises(ValueError, match="no parent"):
        Structure(np.array([0, 1]), np.array([0, 0]), 2)
    with pytest.raises(ValueError, match="no power of two"):
        dataclasses.replace(tree, size=12)
    with pytest.raises(ValueError, match="has 1 levels"):
        dataclasses.replace(tree, size=2)


def test_other_arrays_are_refused():
    with pytest.raises(ValueError, match="no cube"):
        CoefficientTree.of_coefficients(haar(), np.zeros((4, 8, 1)))
    with pytest.raises(ValueError, match="1 to 4"):
        CoefficientTree.of_coefficients(haar(), np.zeros((2, 2, 2, 2, 2, 1)))
