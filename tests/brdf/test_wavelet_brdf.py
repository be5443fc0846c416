"""A coefficient tree as a BRDF.

- At the centres of cells the table, 1e-12, for Haar and the linear spline.
- Thresholded, its rms error over the table is at most the predicted one (ERRATA 76: clamped).
- Zero below the horizon; batches of any shape, inside jit; the level of detail is that of the tree.
- Training moves the tree itself, which is what a file then holds; ``jit`` and ``vmap`` go through.
- Another number of axes or levels than there are is refused.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import BRDF, Phong, TreeSampler, WaveletBRDF
from jaxrender.geometry import NUSSELT
from jaxrender.io.tree_layout import BRDF_AXES, TreeAbout
from jaxrender.io.trees import read_tree, write_tree
from jaxrender.wavelets import (
    CoefficientTree,
    analyse_nonstandard,
    haar,
    keep_fraction,
    linear_spline,
    scaled,
)

SIZE = 8
ABOUT = TreeAbout("made up", "nusselt", BRDF_AXES, channels="plain")
DIRECTIONS = NUSSELT.cell_directions((SIZE, SIZE)).reshape(-1, 3)
ABOVE = np.flatnonzero(DIRECTIONS[:, 2] > 0)


@pytest.fixture(scope="module")
def table():
    phong = Phong(np.array([0.1, 0.2]), np.array([0.3, 0.2]), 5.0)
    pairs = np.broadcast_arrays(DIRECTIONS[:, None], DIRECTIONS[None])
    values = np.array(phong.evaluate(*pairs))
    values[DIRECTIONS[:, 2] <= 0] = 0
    return values.reshape(*(SIZE,) * 4, 2)


def tree_of(table, wavelet, fraction):
    kept = keep_fraction(analyse_nonstandard(wavelet, jnp.asarray(table)), fraction, joint=True)
    return CoefficientTree.of_coefficients(wavelet, kept.coefficients), kept.predicted_rms


@pytest.mark.parametrize("wavelet", [haar(), linear_spline()], ids=["haar", "cdf-2-2"])
def test_full_tree_is_the_table(table, wavelet):
    brdf = WaveletBRDF(tree_of(table, wavelet, 1.0)[0])
    incoming, outgoing = np.random.default_rng(0).choice(ABOVE, (2, 200))
    found = brdf.evaluate(DIRECTIONS[incoming], DIRECTIONS[outgoing])
    expected = table.reshape(SIZE**2, SIZE**2, 2)[incoming, outgoing]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_clamping_only_helps(table):
    tree, predicted = tree_of(table, haar(), 0.05)
    assert np.min(tree.samples()) < 0
    pairs = np.broadcast_arrays(DIRECTIONS[ABOVE][:, None], DIRECTIONS[ABOVE][None])
    found = np.asarray(WaveletBRDF(tree).evaluate(*pairs))
    assert found.min() >= 0
    error = found - table.reshape(SIZE**2, SIZE**2, 2)[np.ix_(ABOVE, ABOVE)]
    rms = np.sqrt(np.sum(error**2) / SIZE**4)
    assert 0.5 * predicted < rms <= predicted


def test_below_the_horizon_is_black_in_any_batch(table):
    brdf = WaveletBRDF(tree_of(table, haar(), 1.0)[0])
    up, down = np.array([0.0, 0.6, 0.8]), np.array([0.0, 0.6, -0.8])
    batch = np.broadcast_to([[up, down, up]] * 2, (2, 3, 3))
    found = eqx.filter_jit(BRDF.evaluate)(brdf, batch, np.broadcast_to(up, (2, 3, 3)))
    assert found.shape == (2, 3, 2)
    assert (np.asarray(found[:, 1]) == 0).all()
    assert (np.asarray(found[:, 0]) > 0).all()


def test_level_of_detail(table):
    tree = tree_of(table, haar(), 1.0)[0]
    up = np.array([0.1, 0.2, np.sqrt(0.95)])
    mean = np.asarray(WaveletBRDF(tree, levels=0).evaluate(up, up))
    np.testing.assert_allclose(mean, table.mean(axis=(0, 1, 2, 3)), rtol=1e-12)


def test_misuse_is_refused(table):
    tree = tree_of(table, haar(), 1.0)[0]
    with pytest.raises(ValueError, match="ask for 0 to that"):
        WaveletBRDF(tree, levels=9)
    flat = CoefficientTree.of_coefficients(haar(), analyse_nonstandard(haar(), table[0]))
    with pytest.raises(ValueError, match="a BRDF has 4"):
        WaveletBRDF(flat)


@pytest.mark.parametrize("wavelet", [haar(), linear_spline()], ids=["haar", "cdf-2-2"])
def test_its_tree_is_what_is_trained_and_written(table, wavelet, tmp_path):
    """A gradient step changes the tree itself, and so what a file of it evaluates to."""
    tree = jax.tree.map(jnp.asarray, tree_of(table, wavelet, 0.05)[0])
    rng = np.random.default_rng(2)
    cells = rng.choice(ABOVE, (2, 60))
    incoming, outgoing = DIRECTIONS[cells]
    target = jnp.asarray(table.reshape(SIZE**2, SIZE**2, 2)[cells[0], cells[1]])

    @jax.jit
    def loss(brdf):
        return jnp.mean((brdf.evaluate(incoming, outgoing) - target) ** 2)

    brdf = WaveletBRDF(tree)
    slopes = jax.grad(loss)(brdf)
    for at in ((0, 0), (20, 1)):
        step = jnp.zeros_like(tree.values).at[at].set(1e-5)
        both = [
            loss(WaveletBRDF(dataclasses.replace(tree, values=tree.values + sign * step)))
            for sign in (1, -1)
        ]
        slope = float(both[0] - both[1]) / 2e-5
        assert slopes.tree.values[at] == pytest.approx(slope, rel=1e-5, abs=1e-12)
    trained = jax.tree.map(lambda leaf, slope: leaf - 0.01 * slope, brdf, slopes)
    assert loss(trained) < loss(brdf)
    write_tree(tmp_path / "t.nc", trained.tree, ABOUT, np.float64)
    again = WaveletBRDF(read_tree(tmp_path / "t.nc").tree)
    np.testing.assert_array_equal(
        again.evaluate(incoming, outgoing), trained.evaluate(incoming, outgoing)
    )


def test_it_goes_through_filter_jit_and_vmap(table):
    brdf = WaveletBRDF(jax.tree.map(jnp.asarray, tree_of(table, haar(), 0.2)[0]))
    pair = DIRECTIONS[ABOVE[:20]], DIRECTIONS[ABOVE[20:40]]
    expected = brdf.evaluate(*pair)
    np.testing.assert_allclose(eqx.filter_jit(BRDF.evaluate)(brdf, *pair), expected, atol=1e-14)
    several = jax.vmap(lambda k: WaveletBRDF(scaled(brdf.tree, k)).evaluate(*pair))(jnp.arange(3.0))
    np.testing.assert_allclose(several[2], 2 * expected, atol=1e-13)
    sampler = jax.jit(TreeSampler.of)(brdf.tree)
    uniforms = np.random.default_rng(1).random((20, 2))
    known = TreeSampler.of(brdf.tree)
    np.testing.assert_allclose(
        sampler.draw(pair[1], uniforms), known.draw(pair[1], uniforms), atol=1e-12
    )
