"""Reflection and transmission as four trees.

- At the centres of cells the function, for each pair of sides, with Haar's and another wavelet.
- A diffuse sheet: shares of uniform light that stay and pass, by hand; the 16 / pi of two discs (4
  and 4 / pi; without the 4s of ERRATA 75 it would be a sixteenth).
- The reflection of a side is its BRDF; sides are told apart by the sign of z alone.
- Thresholded, values are not negative; trees that differ are refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf.scattering_trees import ScatteringTrees
from jaxrender.geometry import NUSSELT
from jaxrender.wavelets import haar, linear_spline

SIZE = 8


def tinted(incoming, outgoing):
    """Smooth, and different for each pair of sides."""
    through = (incoming[..., 2] * outgoing[..., 2] < 0).astype(incoming.dtype)
    tilt = 1 + 0.3 * incoming[..., 0] * outgoing[..., 1] + 0.2 * outgoing[..., 2]
    return jnp.stack([tilt * (1 - 0.7 * through), 0.2 * through + 0.1], axis=-1) / np.pi


def pairs(count=300):
    rng = np.random.default_rng(0)
    cells = NUSSELT.cell_directions((SIZE, SIZE)).reshape(-1, 3)
    cells = cells[cells[:, 2] > 0]
    chosen = cells[rng.integers(0, len(cells), (2, count))]
    return chosen * np.where(rng.random((2, count, 1)) < 0.5, -1, 1) ** np.array([0, 0, 1])


@pytest.mark.parametrize("wavelet", [haar(), linear_spline()], ids=["haar", "cdf-2-2"])
def test_cells_have_the_function(wavelet):
    trees = ScatteringTrees.of(tinted, SIZE, wavelet, cell_samples=1)
    incoming, outgoing = pairs()
    found = trees.evaluate(incoming, outgoing)
    np.testing.assert_allclose(found, tinted(incoming, outgoing), atol=1e-12)


def test_shares_of_a_diffuse_sheet():
    def sheet(incoming, outgoing):
        through = incoming[..., 2] * outgoing[..., 2] < 0
        return jnp.where(through, 0.3, 0.6)[..., None] / np.pi

    shares = ScatteringTrees.of(sheet, 8, cell_samples=2).reflectance()[..., 0]
    np.testing.assert_allclose(shares, [[0.6, 0.3], [0.3, 0.6]], rtol=1e-9)


def test_a_side_alone_is_a_brdf():
    trees = ScatteringTrees.of(tinted, SIZE, cell_samples=2)
    incoming, outgoing = np.abs(pairs())
    for side, sign in ((0, 1), (1, -1)):
        found = trees.reflection(side).evaluate(incoming, outgoing)
        turned = trees.evaluate(incoming * [1, 1, sign], outgoing * [1, 1, sign])
        np.testing.assert_allclose(found, turned, atol=1e-12)


def test_thresholded_values_are_not_negative():
    trees = ScatteringTrees.of(tinted, SIZE, keep=0.02, cell_samples=1)
    assert trees.trees[0].count < 100
    assert np.min(trees.evaluate(*pairs())) >= 0


def test_misuse_is_refused():
    trees = ScatteringTrees.of(tinted, 4, cell_samples=1)
    with pytest.raises(ValueError, match="give four"):
        ScatteringTrees(trees.trees[:3])
    with pytest.raises(ValueError, match="give four alike"):
        ScatteringTrees((*trees.trees[:3], ScatteringTrees.of(tinted, 8, cell_samples=1).trees[0]))
    with pytest.raises(ValueError, match="not finite"):
        ScatteringTrees.of(lambda i, o: jnp.full((*i.shape[:-1], 1), jnp.nan), 4, cell_samples=1)
