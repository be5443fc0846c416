"""BRDF textures and their pyramids:

- a level's samples are the means of the BRDFs' samples, to rounding, down to the last texel
- evaluation through one forest agrees with the filtered BRDF itself (``tree_at``, one by one)
- Lambertian texels: the pyramid is the MIP of their kd, between levels too (ERRATA 71 goes red)
- a pixel over a whole block: the mean over the block's texels, each shaded on its own, under a
  directional light; the pyramid's own level without the error of interpolation
- equal texels, equal blocks and equal trees are kept once: a checkerboard has three trees
- thresholds on the way leave no more error than is stated, and fewer coefficients
- measured levels are taken as they are, each texel from its own rectangle, row 0 at v = 1
- zero below the horizon, clamped at zero, precision kept, nothing but Haar's
- bad images, levels and trees are refused, and pyramids too large for memory
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf.blinn_phong import BlinnPhong
from jaxrender.brdf.lambertian import Lambertian
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.brdf.textures import pyramid as module
from jaxrender.brdf.textures.mip import ColourPyramid
from jaxrender.brdf.textures.pyramid import BRDFPyramid
from jaxrender.brdf.textures.texture import BRDFTexture, thresholded, tree_of
from jaxrender.brdf.wavelet import WaveletBRDF
from jaxrender.geometry import NUSSELT
from jaxrender.wavelets import CoefficientTree, Traversal, haar, linear_spline, scaled

RNG = np.random.default_rng(3)
SIZE = 8
BRDFS = [
    BlinnPhong(np.array([0.1, 0.2]), np.array([0.5, 0.1]), 5.0),
    Lambertian(np.array([0.3, 0.05])),
    BlinnPhong(np.array([0.05, 0.0]), np.array([0.2, 0.4]), 20.0),
]
TREES = [tree_of(brdf, SIZE, cell_samples=1) for brdf in BRDFS]
INDEX = RNG.integers(0, 3, (4, 8))


def directions(count: int) -> np.ndarray:
    found = RNG.normal(size=(count, 3))
    found[:, 2] = np.abs(found[:, 2]) + 0.1
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def pyramid() -> BRDFPyramid:
    return BRDFPyramid.averaging(BRDFTexture.of(INDEX, TREES))


@pytest.mark.slow
def test_levels_are_means_of_samples(pyramid):
    tables = [np.asarray(TabulatedBRDF.of(b, SIZE, outside="zero").values) for b in BRDFS]
    for level, width in ((1, 2), (2, 4)):
        texture = pyramid.level(level)
        for row, column in ((0, 0), (texture.index.shape[0] - 1, texture.index.shape[1] - 1)):
            under = INDEX[row * width : (row + 1) * width, column * width : (column + 1) * width]
            expected = np.mean([tables[k] for k in under.ravel()], axis=0)
            found = texture.trees[texture.index[row, column]].samples()
            np.testing.assert_allclose(found, expected, atol=1e-14)
    everything = np.mean([tables[k] for k in INDEX.ravel()], axis=0)
    np.testing.assert_allclose(pyramid.level(3).trees[0].samples(), everything, atol=1e-14)


@pytest.mark.parametrize("chosen", ["trilinear", "levels", "nearest"])
def test_the_forest_agrees_with_the_filtered_brdf(pyramid, chosen):
    places, levels = RNG.uniform(-1, 2, (4, 2)), RNG.uniform(0, 3, 4)
    towards, away = directions(4), directions(4)
    found = pyramid.evaluate(places, levels, towards, away, chosen)
    for k in range(4):
        whole = WaveletBRDF(pyramid.tree_at(tuple(places[k]), levels[k], chosen))
        expected = whole.evaluate(towards[k : k + 1], away[k : k + 1])[0]
        np.testing.assert_allclose(found[k], expected, atol=1e-13)


def test_lambertian_texels_are_a_mip_of_kd():
    levels_of_kd = np.linspace(0.05, 0.3, 8)
    trees = [tree_of(Lambertian(np.array([kd])), 2, cell_samples=1) for kd in levels_of_kd]
    # A size of 2 has all of its cells' centres above the horizon, so the trees are constant.
    index = np.tile(np.arange(8), (8, 1))
    found = BRDFPyramid.averaging(BRDFTexture.of(index, trees), "clamp")
    u, mu = RNG.uniform(1 / 8, 7 / 8, 50), RNG.uniform(0, 2, 50)
    inside = np.abs(u - 0.5) < 0.5 - 0.5 * 2 ** np.ceil(mu) / 8
    places = np.stack([u, RNG.uniform(0, 1, 50)], axis=1)
    rho = np.asarray(found.evaluate(places, mu, directions(50), directions(50)))[:, 0]
    ramp = 0.05 + (u * 8 - 0.5) * (0.25 / 7)
    assert inside.sum() > 20
    np.testing.assert_allclose(rho[inside], ramp[inside], atol=1e-12)
    colours = ColourPyramid.of(levels_of_kd[index][..., None], "clamp").evaluate(places, mu)
    np.testing.assert_allclose(rho, np.asarray(colours)[:, 0], atol=1e-12)


def test_a_pixel_over_a_block_is_the_mean_of_its_texels(pyramid):
    source = np.array([[0.3, 0.4, np.sqrt(0.75)]])
    eye = np.array([[-0.35, -0.3, np.sqrt(1 - 0.35**2 - 0.3**2)]])
    # The cell's centre, where a table is the BRDF itself.
    centred = [
        np.asarray(NUSSELT.direction_from_square((np.floor(p * SIZE) + 0.5) / SIZE))
        for p in (np.asarray(NUSSELT.square_from_direction(w)) for w in (source, eye))
    ]
    shaded = np.array([np.asarray(b.evaluate(*centred))[0] for b in BRDFS])
    for level, width in ((0, 1), (1, 2), (2, 4)):
        place = np.array([[width * 0.5 / 8, 1 - width * 0.5 / 4]])
        expected = shaded[INDEX[:width, :width]].reshape(-1, 2).mean(axis=0)
        found = pyramid.evaluate(place, np.array([float(level)]), source, eye)[0]
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_checkerboard_has_three_trees():
    board = np.indices((64, 64)).sum(axis=0) % 2
    fine = BRDFPyramid.averaging(BRDFTexture.of(board, [TREES[0], TREES[2]]))
    assert len(fine.trees) == 3
    assert len(fine.level(6).trees) == 1
    coarse = np.kron(board[:8, :8], np.ones((8, 8), int))
    assert len(BRDFPyramid.averaging(BRDFTexture.of(coarse, TREES[:2])).trees) == 3


def test_equal_trees_are_joined_and_unused_ones_dropped():
    twin = tree_of(BRDFS[0], SIZE, cell_samples=1)
    texture = BRDFTexture.of(np.array([[0, 1], [1, 3]]), [TREES[0], twin, TREES[1], TREES[2]])
    assert texture.index.tolist() == [[0, 0], [0, 1]]
    assert len(texture.trees) == 2


@pytest.mark.slow
def test_thresholds_cost_what_they_say(pyramid):
    rms = 2e-3
    coarse = BRDFPyramid.averaging(BRDFTexture.of(INDEX, TREES), rms=rms)
    assert pyramid.errors == (0, 0, 0, 0)
    assert coarse.errors[0] == 0
    assert 0 < coarse.errors[1] <= rms
    assert max(coarse.errors) <= 3 * rms
    for level in (1, 2, 3):
        (true, found), top = (p.level(level) for p in (pyramid, coarse)), (0, 0)
        true, found = (texture.trees[texture.index[top]] for texture in (true, found))
        missing = np.asarray(true.samples() - found.samples())
        error = np.sqrt(np.sum(missing**2, axis=-1).mean())
        assert 0 < error <= coarse.errors[level] * (1 + 1e-9)
        assert found.count < true.count
    alone, error = thresholded(TREES[0], rms)
    missing = np.asarray(TREES[0].samples() - alone.samples())
    assert np.sqrt(np.sum(missing**2, axis=-1).mean()) == pytest.approx(error, rel=1e-9)
    assert 0.5 * rms < error <= rms
    assert thresholded(TREES[0], 0.0)[0].count == TREES[0].count


def test_measured_levels_are_taken_as_they_are():
    asked = []

    def measure(level, u0, v0, u1, v1) -> CoefficientTree:
        asked.append((level, u0, v0, u1, v1))
        return scaled(TREES[1], 1.0 + level + 10 * u0 + 100 * v0)

    found = BRDFPyramid.measured(measure, (2, 4), "clamp")
    assert len(asked) == 8 + 2 + 1
    assert asked[0] == (0, 0, 0.5, 0.25, 1)
    assert asked[7] == (0, 0.75, 0, 1, 0.5)
    assert asked[8] == (1, 0, 0, 0.5, 1)
    assert asked[10] == (2, 0, 0, 1, 1)
    up = np.tile([[0.0, 0, 1]], (3, 1))
    places = np.array([[0.875, 0.75], [0.75, 0.5], [0.3, 0.3]])
    rho = np.asarray(found.evaluate(places, np.array([0.0, 1, 2]), up, up))
    mean = np.array([0.3, 0.05])
    np.testing.assert_allclose(rho, mean * np.array([[1 + 7.5 + 50], [2 + 5], [3.0]]), rtol=1e-12)


def test_below_the_horizon_and_clamped(pyramid):
    down = np.array([[0.6, 0, -0.8]])
    up = np.array([[0.0, 0, 1]])
    place, level = np.full((1, 2), 0.5), np.zeros(1)
    assert not np.any(pyramid.evaluate(place, level, down, up))
    assert not np.any(pyramid.evaluate(place, level, up, down))
    alone = BRDFTexture.of(np.zeros((1, 1), int), [scaled(TREES[0], -1.0)])
    negative = BRDFPyramid.averaging(alone)
    assert not np.any(negative.evaluate(place, level, up, up))


def test_precision_follows_the_input(pyramid):
    towards, away = directions(4), directions(4)
    places, levels = RNG.uniform(size=(4, 2)), RNG.uniform(0, 3, 4)
    exact = pyramid.evaluate(places, levels, towards, away)
    # Away from the cells' borders, which rounding crosses.
    single = [np.asarray(a, np.float32) for a in (places, levels, towards, away)]
    found = pyramid.evaluate(*single)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, exact, rtol=1e-4)


def test_what_is_refused(pyramid, monkeypatch):
    with pytest.raises(ValueError, match="indices 0 to 3"):
        BRDFTexture.of(np.array([[0, 3]]), TREES)
    with pytest.raises(ValueError, match="make them alike"):
        BRDFTexture.of(np.array([[0, 1]]), [TREES[0], tree_of(BRDFS[1], 4)])
    flat = CoefficientTree.of_coefficients(haar(), np.ones((4, 4, 1)))
    with pytest.raises(ValueError, match="2 axes"):
        BRDFTexture.of(np.array([[0]]), [flat])
    with pytest.raises(ValueError, match="power of two"):
        BRDFPyramid.averaging(BRDFTexture.of(np.zeros((3, 4), int), TREES))
    with pytest.raises(ValueError, match="finest first"):
        BRDFPyramid.of_levels([pyramid.level(0), pyramid.level(2)])
    with pytest.raises(ValueError, match="level 4"):
        pyramid.level(4)
    smooth = tree_of(BRDFS[1], 4, wavelet=linear_spline())
    with pytest.raises(ValueError, match="Haar"):
        BRDFPyramid.averaging(BRDFTexture.of(np.zeros((1, 1), int), [smooth]))
    monkeypatch.setattr(module, "_MOST_NUMBERS", 100_000)
    with pytest.raises(ValueError, match="different trees"):
        BRDFPyramid.averaging(BRDFTexture.of(INDEX, TREES))


def test_tree_of_keeps_the_largest():
    whole, part = TREES[0], tree_of(BRDFS[0], SIZE, keep=0.1, cell_samples=1)
    assert part.count <= 0.1 * whole.count + 2
    points = RNG.uniform(0.2, 0.8, (20, 4))
    found = Traversal.of(whole).evaluate(points)
    table = np.asarray(TabulatedBRDF.of(BRDFS[0], SIZE, outside="zero").values)
    np.testing.assert_allclose(found, table[tuple((points * SIZE).astype(int).T)], atol=1e-13)
