"""A coefficient tree as a BRDF.

- At the centres of cells the table, 1e-12, for Haar and the linear spline.
- Thresholded, its rms error over the table is at most the predicted one (ERRATA 76: clamped).
- Zero below the horizon; batches of any shape, inside jit; the level of detail is that of the tree.
- Another number of axes or levels than there are is refused.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import BRDF, Phong, WaveletBRDF
from jaxrender.geometry import NUSSELT
from jaxrender.wavelets import (
    CoefficientTree,
    analyse_nonstandard,
    haar,
    keep_fraction,
    linear_spline,
)

SIZE = 8
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
