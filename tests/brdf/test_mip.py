"""MIP pyramids of numbers, and where they are read:

- level sizes halve down to one texel, also of oblong images; blocks are what lies under a texel
- weights add up to one and are not negative, for every filter, wrap and level
- a texel's centre at a whole level gives the texel; half-way between levels, the mean of both
- a linear ramp is reproduced at every level of detail; with the indices that L 7.9-7.10 keep across
  levels (ERRATA 71) it is not
- every level of a colour map is the mean of the one below, by SciPy's box filter
- row 0 is at v = 1; repeated and clamped borders are the neighbours that they should be
- sizes become levels by their log2
- bad sides, wraps and filters are refused; float32 stays; places have derivatives
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from jaxrender.brdf.textures.mip import FILTERS, WRAPS, ColourPyramid, MipShape, blocks, level_of

RNG = np.random.default_rng(7)


def ramp(rows: int, columns: int) -> np.ndarray:
    """u + 10 v at the texels' centres."""
    u, v = (np.arange(columns) + 0.5) / columns, 1 - (np.arange(rows) + 0.5) / rows
    return (u[None, :] + 10 * v[:, None])[..., None]


def test_sizes_halve_to_one_texel():
    assert MipShape(4, 4).sizes == ((4, 4), (2, 2), (1, 1))
    assert MipShape(2, 8).sizes == ((2, 8), (1, 4), (1, 2), (1, 1))
    assert MipShape(2, 8).starts == (0, 16, 20, 22, 23)
    found = blocks(np.arange(16).reshape(2, 8))
    assert found.shape == (1, 4, 4)
    assert sorted(found[0, 1]) == [2, 3, 10, 11]
    assert blocks(np.arange(4).reshape(1, 4)).tolist() == [[[0, 1], [2, 3]]]


@pytest.mark.parametrize("chosen", list(FILTERS))
@pytest.mark.parametrize("wrap", list(WRAPS))
def test_weights_share_out_one(chosen, wrap):
    shape = MipShape(4, 8, wrap)
    taps = shape.taps(RNG.uniform(-2, 3, (200, 2)), RNG.uniform(-1, 6, 200), chosen)
    np.testing.assert_allclose(taps.weight.sum(axis=1), 1, atol=1e-12)
    assert (taps.weight >= 0).all()
    assert taps.texel.min() >= 0
    assert taps.texel.max() < shape.starts[-1]


@pytest.mark.parametrize("chosen", list(FILTERS))
def test_centres_give_their_texels(chosen):
    image = RNG.uniform(size=(4, 8, 3))
    pyramid = ColourPyramid.of(image, "clamp")
    row, column = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(8), indexing="ij"))
    places = np.stack([(column + 0.5) / 8, 1 - (row + 0.5) / 4], axis=1)
    found = pyramid.evaluate(places, np.zeros(32), chosen)
    np.testing.assert_allclose(found, image.reshape(-1, 3), atol=1e-12)
    coarse = image.reshape(2, 2, 4, 2, 3).mean(axis=(1, 3))
    places = np.stack([(column[:8] // 2 + 0.5) / 4, np.full(8, 0.75)], axis=1)
    found = pyramid.evaluate(places, np.ones(8), chosen)
    np.testing.assert_allclose(found, coarse[0, np.arange(8) // 2], atol=1e-12)


def test_between_levels_both_count():
    image = RNG.uniform(size=(4, 4, 1))
    pyramid = ColourPyramid.of(image)
    place = np.array([[0.125, 0.625]])
    fine, coarse = image[1, 0, 0], image[:2, :2].mean()
    found = float(pyramid.evaluate(place, np.array([0.25]), "levels")[0, 0])
    assert found == pytest.approx(0.75 * fine + 0.25 * coarse, rel=1e-12)
    nearest = float(pyramid.evaluate(place, np.array([0.6]), "nearest")[0, 0])
    assert nearest == pytest.approx(coarse, rel=1e-12)


def test_a_ramp_is_reproduced_between_levels():
    pyramid = ColourPyramid.of(ramp(8, 16), "clamp")
    # Inside the outermost centres of level 2, which has 2 x 4 texels.
    places = np.stack([RNG.uniform(1 / 8, 7 / 8, 100), RNG.uniform(1 / 4, 3 / 4, 100)], axis=1)
    expected = places[:, 0] + 10 * places[:, 1]
    found = np.asarray(pyramid.evaluate(places, RNG.uniform(0, 2, 100)))[:, 0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_indices_kept_across_levels_miss_the_ramp():
    """ERRATA 71: F^(l+1) at the texel of the same index is not the one above, mostly not there."""
    values = [ramp(8, 8)[0, :, 0], ramp(8, 8)[0, :, 0].reshape(4, 2).mean(axis=1)]
    column, expected = 3, values[0][3]
    kept = 0.5 * values[0][column] + 0.5 * values[1][column]
    halved = 0.5 * values[0][column] + 0.5 * values[1][column // 2]
    assert abs(kept - expected) > 0.2
    assert abs(halved - expected) < 0.05
    pyramid = ColourPyramid.of(ramp(8, 8), "clamp")
    place = np.array([[(column + 0.5) / 8, 1 - 0.5 / 8]])
    vertical = 0.5 * (ramp(8, 8)[:2, 0].mean() - ramp(8, 8)[0, 0, 0])
    found = float(pyramid.evaluate(place, np.array([0.5]), "levels")[0, 0])
    assert found - vertical == pytest.approx(halved, abs=1e-12)


def test_levels_are_means():
    image = RNG.uniform(size=(16, 16, 3))
    pyramid = ColourPyramid.of(image)
    for level, (rows, _) in enumerate(pyramid.shape.sizes):
        width = 16 // rows
        blurred = ndimage.uniform_filter1d(image, width, axis=0, mode="wrap")
        blurred = ndimage.uniform_filter1d(blurred, width, axis=1, mode="wrap")
        centres = blurred[8 // rows :: 16 // rows, 8 // rows :: 16 // rows] if level else image
        start, stop = pyramid.shape.starts[level : level + 2]
        np.testing.assert_allclose(pyramid.values[start:stop], centres.reshape(-1, 3), atol=1e-12)


def test_borders():
    image = np.arange(4.0).reshape(1, 4, 1)
    across = np.array([[1.0, 0.5], [-0.125, 0.5], [1.125, 0.5]])
    repeated = ColourPyramid.of(image).evaluate(across, np.zeros(3))
    np.testing.assert_allclose(np.asarray(repeated)[:, 0], [1.5, 3, 0], atol=1e-12)
    clamped = ColourPyramid.of(image, "clamp").evaluate(across, np.zeros(3))
    np.testing.assert_allclose(np.asarray(clamped)[:, 0], [3, 0, 3], atol=1e-12)


def test_sizes_become_levels():
    found = level_of(np.array([0.0, 0.3, 1, 2, 4, 6]))
    np.testing.assert_allclose(found, [0, 0, 0, 1, 2, 2.584963], atol=1e-6)


def test_what_is_refused():
    with pytest.raises(ValueError, match="6 x 4 texels"):
        MipShape(4, 6)
    with pytest.raises(ValueError, match="mirror"):
        MipShape(4, 4, "mirror")
    with pytest.raises(ValueError, match="sharp"):
        MipShape(4, 4).taps(np.zeros((1, 2)), np.zeros(1), "sharp")


@pytest.mark.slow
def test_precision_and_derivatives():
    pyramid = ColourPyramid.of(ramp(8, 8).astype(np.float32), "clamp")
    places, levels = np.full((3, 2), 0.4, np.float32), np.full(3, 0.5, np.float32)
    assert pyramid.evaluate(places, levels).dtype == np.float32
    slopes = jax.grad(lambda p: ColourPyramid.of(ramp(8, 8)).evaluate(p, jnp.full(1, 0.5)).sum())
    np.testing.assert_allclose(slopes(jnp.array([[0.4, 0.45]])), [[1, 10]], atol=1e-9)
