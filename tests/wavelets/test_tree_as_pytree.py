"""A coefficient tree goes through JAX as its numbers; which coefficients there are is static.

- Leaves are the root and the values; equal masks are one structure, and one program.
- ``samples``, sums, multiples, other resolutions and sampling densities under ``jit`` are those
  outside it, and linear ones have the derivative of differences.
- ``vmap`` over stacked trees is the trees one by one.
- An optimiser brings a tree to samples that it can represent.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest
from tree_problems import tree_of

from jaxrender.wavelets import (
    CoefficientTree,
    SlicedDensities,
    Structure,
    TabulatedDensities,
    evaluate,
    haar,
    linear_spline,
    resampled,
    scaled,
    weighted_sum,
)

BOTH = pytest.mark.parametrize("wavelet", [haar(), linear_spline()], ids=lambda w: w.name)


def on_the_device(tree):
    return jax.tree.map(jnp.asarray, tree)


def test_leaves_are_numbers_and_the_rest_is_one_structure():
    tree = tree_of(haar(), 8, 2, 0.5)
    assert [np.shape(leaf) for leaf in jax.tree.leaves(tree)] == [(3,), (len(tree.values), 3)]
    masks = tree.structure.child_masks, tree.structure.value_masks
    again = Structure(masks[0].copy(), masks[1].copy(), 2)
    assert again == tree.structure
    assert hash(again) == hash(tree.structure)
    assert again != tree_of(haar(), 8, 2, 0.4).structure
    assert again != Structure(*masks, 3)
    with pytest.raises(ValueError, match="read-only"):
        again.child_masks[0] = 0
    traced = []

    @jax.jit
    def mean(held):
        traced.append(held.count)
        return held.root

    mean(tree)
    mean(dataclasses.replace(tree, structure=again, values=2 * tree.values))
    assert traced == [tree.count]


@BOTH
def test_algebra_under_jit_is_that_outside(wavelet):
    trees = [tree_of(wavelet, 8, 2, 0.1 * k, seed=k) for k in (1, 2)]
    factors = np.array([2.0, 0.5, -1.0])

    def everything(trees, weight, factors):
        total = weighted_sum(trees, [weight, -2.0])
        coarse = resampled(scaled(total, factors), 4)
        return total.samples(), coarse, scaled(total, weight).coefficients()

    outside = everything(trees, 0.3, factors)
    inside = jax.jit(everything)(trees, 0.3, factors)
    assert inside[1].structure == outside[1].structure
    for found, expected in zip(jax.tree.leaves(inside), jax.tree.leaves(outside), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-13)


@BOTH
def test_gradients_are_those_of_differences(wavelet):
    tree = on_the_device(tree_of(wavelet, 8, 2, 0.3))
    points = np.random.default_rng(1).uniform(0, 1, (40, 2))

    @jax.jit
    def loss(tree):
        both = weighted_sum([tree, scaled(tree, 0.3)], [1.0, 0.5])
        return jnp.sum(jnp.sin(evaluate(both, points))) + jnp.sum(tree.samples() ** 3) / 64

    slopes = jax.grad(loss)(tree)
    assert slopes.structure == tree.structure
    for part, at in (("root", (1,)), ("values", (0, 0)), ("values", (9, 2))):
        held = getattr(tree, part)
        moved = [
            loss(dataclasses.replace(tree, **{part: held.at[at].add(step)}))
            for step in (1e-5, -1e-5)
        ]
        slope = float(moved[0] - moved[1]) / 2e-5
        assert getattr(slopes, part)[at] == pytest.approx(slope, rel=1e-6)


def test_trees_of_one_structure_go_through_vmap():
    tree = on_the_device(tree_of(haar(), 8, 2, 0.3))
    trees = [scaled(tree, k) for k in (1.0, 2.0, -0.5)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)
    found = jax.vmap(CoefficientTree.samples)(stacked)
    for one, samples in zip(trees, found, strict=True):
        np.testing.assert_allclose(samples, one.samples(), atol=1e-14)


def test_an_optimiser_trains_a_tree():
    wanted = on_the_device(tree_of(haar(), 8, 2, 0.4))
    target = wanted.samples()
    found = optimistix.minimise(
        lambda tree, _: jnp.mean((tree.samples() - target) ** 2),
        optimistix.BFGS(1e-12, 1e-12),
        scaled(wanted, 0.0),
    ).value
    assert isinstance(found, CoefficientTree)
    np.testing.assert_allclose(found.samples(), target, atol=1e-4)


@pytest.mark.parametrize("kind", [TabulatedDensities, SlicedDensities])
def test_densities_of_traced_values_are_those_of_known_ones(kind):
    tree = tree_of(haar(), 8, 3, 0.2)
    rng = np.random.default_rng(0)
    uniforms, fixed = rng.random((50, 2)), rng.random((50, 1))

    def drawn(tree, weights):
        return kind.of(tree, (1,), weights=weights).draw(uniforms, fixed)

    weights = np.array([0.2, 0.3, 0.5])
    expected, found = drawn(tree, weights), jax.jit(drawn)(tree, weights)
    np.testing.assert_allclose(found.places, expected.places, atol=1e-12)
    np.testing.assert_allclose(found.density, expected.density, rtol=1e-9)

    @jax.jit
    def log_likelihood(tree):
        return jnp.sum(jnp.log(kind.of(tree, (1,)).density(expected.places, fixed)))

    bumps = dataclasses.replace(on_the_device(tree), root=jnp.full(3, 9.0))
    slopes = jax.grad(log_likelihood)(bumps)
    step = jnp.zeros_like(bumps.values).at[3, 1].set(1e-5)
    moved = [
        log_likelihood(dataclasses.replace(bumps, values=bumps.values + sign * step))
        for sign in (1, -1)
    ]
    assert slopes.values[3, 1] == pytest.approx(float(moved[0] - moved[1]) / 2e-5, rel=1e-5)
