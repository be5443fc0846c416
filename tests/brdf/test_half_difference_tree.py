"""A tree over half and difference angles as a BRDF.

- With all coefficients its values at the samples are the BRDF's, by every transform and wavelet.
- Between samples it is what the tree's own traversal says; nowhere is it negative.
- It is reciprocal and isotropic, and ``tree`` gives back what it was made of.
- It goes through ``jit`` and ``vmap``; its gradient by the values is that of differences, and a few
  steps along it bring it nearer to another BRDF, in the tree that is written as well.
- Misuse is refused.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import BRDF, Microfacet, Ward, isotropy_error, reciprocity_error
from jaxrender.brdf.half_difference_tree import (
    TRANSFORMS,
    HalfDifferenceTree,
    half_difference_samples,
)
from jaxrender.brdf.tables.isotropic import HalfDifference, pair_at
from jaxrender.wavelets import (
    CoefficientTree,
    analyse_nonstandard,
    haar,
    keep_largest,
    linear_spline,
    resampled,
)
from jaxrender.wavelets.traversal import evaluate as by_traversal

evaluate = eqx.filter_jit(BRDF.evaluate)
GLOSSY = Microfacet(np.array([0.05, 0.1]), np.array([0.3, 0.2]), 0.1, 1.5, "half", "smith", "ggx")


def made(wavelet, transform="cube-root", size=16, count=None, brdf=GLOSSY):
    coefficients = analyse_nonstandard(wavelet, half_difference_samples(brdf, size, transform))
    if count is not None:
        coefficients = keep_largest(coefficients, count, joint=True).coefficients
    tree = CoefficientTree.of_coefficients(wavelet, np.asarray(coefficients))
    return HalfDifferenceTree.of(tree, transform)


def some_pairs(count=500):
    pair = np.random.default_rng(1).normal(size=(2, count, 3))
    pair[..., 2] = 0.05 + np.abs(pair[..., 2])
    return pair / np.linalg.norm(pair, axis=-1, keepdims=True)


def angles_at(coordinates):
    return HalfDifference(
        np.pi / 2 * coordinates[:, 0] ** 2, np.pi / 2 * coordinates[:, 1], np.pi * coordinates[:, 2]
    )


@pytest.mark.parametrize("transform", TRANSFORMS)
@pytest.mark.parametrize("wavelet", [haar(), linear_spline()], ids=lambda w: w.name)
def test_samples_are_the_brdf_s_and_the_rest_is_the_tree_s(wavelet, transform):
    size = 16
    brdf = made(wavelet, transform, size)
    rng = np.random.default_rng(0)
    # Half angles and difference angles small enough for both directions to be above the horizon.
    cells = rng.integers(0, [size * 3 // 4, size // 2, size], (200, 3))
    pair = pair_at(angles_at((cells + 0.5) / size))
    above = (pair[0][:, 2] > 0.05) & (pair[1][:, 2] > 0.05)
    assert above.sum() > 60
    pair = [part[above] for part in pair]
    np.testing.assert_allclose(evaluate(brdf, *pair), evaluate(GLOSSY, *pair), rtol=1e-9)
    few = made(wavelet, transform, size, 300)
    places = rng.random((300, 3)) * [0.7, 0.5, 0.9] + [0, 0, 0.05]
    pair = pair_at(angles_at(places))
    above = (pair[0][:, 2] > 0) & (pair[1][:, 2] > 0)
    found = np.asarray(evaluate(few, *(part[above] for part in pair)))
    expected = np.maximum(np.asarray(by_traversal(few.tree, places[above])), 0)
    np.testing.assert_allclose(found, TRANSFORMS[transform].undo(expected), rtol=1e-7, atol=1e-12)
    assert found.min() >= 0


def test_it_is_reciprocal_isotropic_and_gives_its_tree_back():
    brdf = made(linear_spline(), count=200)
    assert brdf.reciprocal
    assert brdf.isotropic
    assert reciprocity_error(brdf) < 1e-6
    assert isotropy_error(brdf) < 1e-6
    again = HalfDifferenceTree.of(brdf.tree, brdf.transform)
    pair = some_pairs()
    np.testing.assert_allclose(evaluate(again, *pair), evaluate(brdf, *pair), rtol=1e-9)
    assert brdf.tree.count <= 201


def test_it_is_a_pytree_whose_values_can_be_trained():
    brdf, pair = made(linear_spline(), count=100), some_pairs(50)
    target = jnp.asarray(evaluate(GLOSSY, *pair))

    @eqx.filter_jit
    def missed(values):
        moved = eqx.tree_at(lambda b: b.values, brdf, values)
        return jnp.mean((jnp.cbrt(moved.evaluate(*pair) + 1e-6) - jnp.cbrt(target + 1e-6)) ** 2)

    values = jnp.asarray(brdf.values)
    gradient = np.asarray(jax.grad(missed)(values))
    for at in ((0, 0), (7, 1), (40, 0)):
        step = np.zeros(values.shape)
        step[at] = 1e-4
        slope = (missed(values + step) - missed(values - step)) / 2e-4
        assert gradient[at] == pytest.approx(float(slope), rel=1e-3, abs=1e-9)
    trained = values
    for _ in range(20):
        trained = trained - 50 * jax.grad(missed)(trained)
    assert missed(trained) < 0.8 * missed(values)
    written = eqx.tree_at(lambda b: b.values, brdf, trained).tree
    kept = HalfDifferenceTree.of(written)
    assert float(missed(jnp.asarray(kept.values))) == pytest.approx(float(missed(trained)))
    several = jax.vmap(lambda k: missed(k * values))(jnp.array([0.5, 1.0]))
    np.testing.assert_allclose(several, [missed(0.5 * values), missed(values)], rtol=1e-9)


def test_misuse_is_refused():
    tree = made(haar(), size=8).tree
    with pytest.raises(ValueError, match="transform"):
        HalfDifferenceTree.of(tree, "root")
    with pytest.raises(ValueError, match="a tree of 2 axes"):
        HalfDifferenceTree.of(CoefficientTree.of_coefficients(haar(), np.ones((4, 4, 1))))
    with pytest.raises(ValueError, match="a resampled tree"):
        HalfDifferenceTree.of(resampled(tree, 16))
    with pytest.raises(ValueError, match="Ward is anisotropic here"):
        half_difference_samples(Ward(np.ones(1), np.ones(1), 0.1, 0.3), 8)
