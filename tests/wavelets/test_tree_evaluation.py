"""A tree at points: by traversal, by cells, by the hash table of L 4.3.1.

- At sample centres every wavelet's tree is the dense reconstruction, 1e-12, full or thresholded.
- Between them Haar's is that of the cell, the others' is SciPy's linear interpolation of samples.
- Cells and hash table are twins of the traversal; a forest asks the tree that each point names.
- Stopping after k levels: the averages over cells of that level, for Haar.
- The printed h_2 = k mod (m - 1) (ERRATA 62) is 0 for multiples of m - 1; ours visits every slot.
- Thresholding to a count or by levels: measured rms equals the predicted one for Haar; the bound
  holds at every sample, for every wavelet.
- Differentiable in values and points; float32 stays float32.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from tree_problems import tree_of

from jaxrender.wavelets import (
    WAVELETS,
    CellForest,
    CoefficientHash,
    Traversal,
    evaluate,
    haar,
    importance,
    linear_spline,
    most_important,
)
from jaxrender.wavelets.hashing import look_up, slots_of, smallest_prime

EVERY = pytest.mark.parametrize("wavelet", WAVELETS.values(), ids=list(WAVELETS))


HASHED = pytest.mark.parametrize("wavelet", ["haar", "cdf-2-2", "daubechies-4"])


@pytest.fixture(scope="module")
def thresholded():
    """Of every wavelet a tree, points between its samples, and their values by traversal."""
    size, points = 8, np.random.default_rng(2).uniform(0, 1, (200, 3))
    centres = (np.indices((size,) * 3).reshape(3, -1).T + 0.5) / size
    found = {}
    for name, wavelet in WAVELETS.items():
        tree = tree_of(wavelet, size, 3, 0.1)
        values = np.asarray(evaluate(tree, np.concatenate([centres, points])))
        found[name] = tree, values[: len(centres)], points, values[len(centres) :]
    return found


@EVERY
def test_samples_are_those_of_the_dense_reconstruction(wavelet, thresholded):
    tree, at_centres, _, _ = thresholded[wavelet.name]
    samples = np.asarray(tree.samples()).reshape(at_centres.shape)
    np.testing.assert_allclose(at_centres, samples, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "size"),
    [("haar", 8), ("daubechies-4", 8), *((name, 2) for name in WAVELETS if name != "haar")],
)
def test_full_trees_of_four_axes_are_the_dense_reconstruction(name, size):
    tree = tree_of(WAVELETS[name], size, 4)
    cells = np.random.default_rng(1).integers(0, size, (400, 4))
    found = evaluate(tree, (cells + 0.5) / size)
    np.testing.assert_allclose(found, np.asarray(tree.samples())[tuple(cells.T)], atol=1e-12)


@EVERY
def test_between_samples(wavelet, thresholded):
    tree, _, points, found = thresholded[wavelet.name]
    size, samples = tree.size, np.asarray(tree.samples())
    centres = (np.arange(size) + 0.5) / size
    if wavelet.name == "haar":
        expected = samples[tuple((points * size).astype(int).T)]
    else:
        inside = np.clip(points, centres[0], centres[-1])
        expected = RegularGridInterpolator((centres,) * 3, samples)(inside)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_points_outside_count_as_the_nearest():
    for wavelet in (haar(), linear_spline()):
        tree = tree_of(wavelet, 8, 2)
        outside, edge = np.array([[-0.5, 1.7], [1.0, 0.0]]), np.array([[0.0, 0.9999], [0.9999, 0]])
        np.testing.assert_allclose(evaluate(tree, outside), evaluate(tree, edge), atol=1e-2)
        assert np.isfinite(evaluate(tree, outside)).all()


@pytest.mark.slow
def test_forest_is_the_twin_of_traversals():
    rng = np.random.default_rng(3)
    trees = [tree_of(haar(), 8, 4, f, seed) for seed, f in enumerate((1.0, 0.05, 0.003))]
    points, number = rng.uniform(0, 1, (500, 4)), rng.integers(0, 3, 500)
    forest, rows = CellForest.of(trees), np.arange(500)
    expected = np.stack([evaluate(tree, points) for tree in trees])[number, rows]
    np.testing.assert_allclose(forest.evaluate(points, number), expected, atol=1e-13)
    samples = np.stack([tree.samples() for tree in trees])
    for levels in (0, 1, 2, 3):
        size, block = 1 << levels, 8 >> levels
        averages = samples.reshape(3, *(size, block) * 4, 3).mean(axis=(2, 4, 6, 8))
        cells = (points * size).astype(int)
        found = forest.evaluate(points, number, levels)
        np.testing.assert_allclose(found, averages[number, *cells.T], atol=1e-13)


def test_a_small_directory_goes_the_same_way(monkeypatch):
    from jaxrender.wavelets import cells

    tree = tree_of(haar(), 16, 2, 0.3)
    points = np.random.default_rng(4).uniform(0, 1, (300, 2))
    expected = CellForest.of([tree]).evaluate(points)
    monkeypatch.setattr(cells, "_LARGEST_DIRECTORY", 4)
    forest = CellForest.of([tree])
    assert forest.directory_levels == 1
    np.testing.assert_array_equal(forest.evaluate(points), expected)


def test_fewer_levels_are_averages():
    tree = tree_of(haar(), 16, 2)
    averages = np.asarray(tree.samples()).reshape(4, 4, 4, 4, 3).mean(axis=(1, 3))
    cells = np.array([[0, 0], [3, 1], [2, 3]])
    found = evaluate(tree, (cells + 0.3) / 4, levels=2)
    np.testing.assert_allclose(found, averages[tuple(cells.T)], atol=1e-13)
    np.testing.assert_allclose(evaluate(tree, cells / 4, levels=0)[1], tree.root)


@HASHED
def test_hash_table_is_the_twin(wavelet, thresholded):
    tree, _, points, expected = thresholded[wavelet]
    found = CoefficientHash.of(tree).evaluate(points)
    np.testing.assert_allclose(found, expected, atol=1e-13)


def test_every_probe_visits_every_slot():
    slots = smallest_prime(50)
    assert slots == 53
    for key in (0, slots - 1, 2 * (slots - 1), 77):
        visited = {int(slots_of(np.array([key]), probe, slots)[0]) for probe in range(slots)}
        assert len(visited) == slots


def test_what_is_not_there_is_not_found():
    table = CoefficientHash.of(tree_of(haar(), 8, 2, 0.4))
    held = table.keys[table.keys >= 0]
    missing = np.setdiff1d(np.arange(64), held)
    slots = len(table.keys)
    assert slots >= 2 * len(held)
    assert (np.asarray(look_up(table.keys, missing)) == slots).all()
    np.testing.assert_array_equal(table.keys[np.asarray(look_up(table.keys, held))], held)


@EVERY
def test_stopping_early_keeps_its_promise(wavelet):
    tree = tree_of(wavelet, 8, 3)
    ranked = importance(tree)
    full = np.asarray(tree.samples())
    for count in (0, 1, 40, 300, len(tree.values)):
        error = np.linalg.norm(np.asarray(most_important(tree, count).samples()) - full, axis=-1)
        assert error.max() <= ranked.bound[count] + 1e-12
        if wavelet.orthonormal:
            np.testing.assert_allclose(np.sqrt(np.mean(error**2)), ranked.rms[count], atol=1e-13)
    assert ranked.bound[ranked.within(0.5)] <= 0.5 < ranked.bound[ranked.within(0.5) - 1]
    assert ranked.within(0.0) == len(tree.values)


def test_the_bound_is_met():
    """One coefficient left out: the largest error is its function's largest value."""
    tree = most_important(tree_of(haar(), 8, 2), 1)
    error = np.linalg.norm(np.asarray(tree.samples()) - np.asarray(tree.root), axis=-1)
    np.testing.assert_allclose(importance(tree).bound[0], error.max(), rtol=1e-12)


@pytest.mark.parametrize("kind", [Traversal.of, lambda tree: CellForest.of([tree])])
def test_derivative_in_the_values(kind):
    tree = tree_of(haar(), 4, 2)
    points = np.array([[0.1, 0.8], [0.6, 0.6]])

    @jax.jit
    @jax.value_and_grad
    def total(values: jax.Array) -> jax.Array:
        return jnp.sum(kind(dataclasses.replace(tree, values=values)).evaluate(points))

    values = np.asarray(tree.values)
    value, gradient = total(values)
    for row in (0, 7):
        moved = values.copy()
        moved[row, 1] += 1
        np.testing.assert_allclose(gradient[row, 1], total(moved)[0] - value, atol=1e-12)


def test_derivative_in_the_point():
    traversal, point = Traversal.of(tree_of(linear_spline(), 8, 2)), np.array([[0.37, 0.61]])
    value_and_slope = jax.jit(jax.value_and_grad(lambda p: traversal.evaluate(p)[0, 0]))
    value, slope = value_and_slope(point)
    for axis, step in enumerate(1e-4 * np.eye(2)):
        change = (value_and_slope(point + step)[0] - value) / 1e-4
        np.testing.assert_allclose(slope[0, axis], change, rtol=1e-3)


def test_float32_stays_float32():
    tree = tree_of(haar(), 8, 2)
    single = dataclasses.replace(
        tree, root=np.float32(tree.root), values=np.asarray(tree.values, np.float32)
    )
    points = np.random.default_rng(7).uniform(0, 1, (50, 2)).astype(np.float32)
    expected = np.asarray(tree.samples())[tuple((points * 8).astype(int).T)]
    for reader in (Traversal.of(single), CellForest.of([single])):
        found = reader.evaluate(points)
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_misuse_is_refused():
    tree = tree_of(haar(), 8, 2)
    with pytest.raises(ValueError, match="points of 3 axes"):
        evaluate(tree, np.zeros((1, 3)))
    with pytest.raises(ValueError, match="ask for 0 to that"):
        evaluate(tree, np.zeros((1, 2)), levels=4)
    with pytest.raises(ValueError, match="not constant in cells"):
        CellForest.of([tree_of(linear_spline(), 8, 2)])
    with pytest.raises(ValueError, match="resample them alike"):
        CellForest.of([tree, tree_of(haar(), 4, 2)])
    with pytest.raises(ValueError, match="at least one"):
        CellForest.of([])
    with pytest.raises(ValueError, match="0 or more"):
        most_important(tree, -1)
