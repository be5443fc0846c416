"""The model nearest to a BRDF that is a tree.

- From the Haar tree of its own 32^4 table at 8 % of the coefficients a model is ranked first,
  misses about as much as the tree does, and is found again: shape to 3 %, amplitudes to 5 %.
- Of an exact BRDF the fit is exact; the error of a wrong model is that of least squares by SciPy.
- Brushed metal and rough diffuse paint are found again, in their own words.
- Misuse is refused.
"""

import equinox as eqx
import numpy as np
import pytest
import scipy.optimize

from jaxrender.brdf import (
    BRDF,
    BlinnPhong,
    Microfacet,
    OrenNayar,
    Phong,
    TorranceSparrow,
    Ward,
    WaveletBRDF,
)
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.geometry import NUSSELT
from jaxrender.inverse.nearest_models import best_models
from jaxrender.wavelets import CoefficientTree, analyse_nonstandard, haar, keep_fraction

evaluate = eqx.filter_jit(BRDF.evaluate)
KD, KS = np.array([0.1]), np.array([0.4])
TRUTHS = {
    "microfacet": Microfacet(KD, KS, 0.25, 1.6),
    "ggx": Microfacet(KD, KS, 0.3, 1.6, "half", "smith", "ggx"),
    "ward": Ward(KD, KS, 0.25),
    "phong": Phong(KD, KS, 20.0),
    "blinn-phong": BlinnPhong(KD, KS, 30.0),
    "torrance-sparrow": TorranceSparrow(KD, 4 * KS, 0.25, 1.6),
}
# Few enough to be searched as they are, without the programs that make many fewer.
PAIRS = 3900


# All six are fitted to each: these three stand for an index, a tail and a power.
@pytest.mark.slow
@pytest.mark.parametrize("name", ["microfacet", "ggx", "phong"])
def test_a_model_is_found_again_from_its_own_tree(name):
    truth = TRUTHS[name]
    table = tabulate(truth, 32, dtype=np.float64).values
    kept = keep_fraction(analyse_nonstandard(haar(), table), 0.08, joint=True)
    tree = CoefficientTree.of_coefficients(haar(), kept.coefficients)
    missed = kept.predicted_rms / np.sqrt(np.mean(table**2))
    first, *others = best_models(WaveletBRDF(tree), size=32, most_pairs=PAIRS)
    assert first.name == name
    assert first.converged
    # Of few pairs: the largest errors are at few cells.
    assert first.relative_rms < 2.5 * missed
    assert all(other.relative_rms > 1.5 * first.relative_rms for other in others)
    found = first.brdf
    shape = type(truth).shape.name
    assert float(getattr(found, shape)) == pytest.approx(float(getattr(truth, shape)), rel=0.04)
    np.testing.assert_allclose(np.ravel(found.kd), truth.kd, rtol=0.05)
    np.testing.assert_allclose(np.ravel(found.ks), truth.ks, rtol=0.05)
    if truth.mu is not None:
        assert float(found.mu) == pytest.approx(float(truth.mu), rel=0.02)


def test_least_squares_of_a_wrong_model_is_scipy_s():
    """Phong's lobe for Blinn's, 8 cells across: all pairs, by an independent search."""
    truth = BlinnPhong(np.array([0.1, 0.2]), np.array([0.3, 0.1]), 4.0)
    cells = NUSSELT.cell_directions((8, 8)).reshape(-1, 3)
    cells = cells[cells[:, 2] > 0]
    pairs = [np.repeat(cells, len(cells), axis=0), np.tile(cells, (len(cells), 1))]
    values = np.asarray(truth.evaluate(*pairs))

    def missed(log_exponent: float) -> float:
        lobe = evaluate(Phong(np.zeros(1), np.ones(1), np.array(np.exp(log_exponent))), *pairs)
        columns = np.concatenate([np.ones((len(lobe), 1)), np.asarray(lobe)], axis=1)
        return sum(scipy.optimize.nnls(columns, channel)[1] ** 2 for channel in values.T)

    best = scipy.optimize.minimize_scalar(missed, bounds=(-0.5, 4), method="bounded")
    found = best_models(truth, ["phong"], size=8, most_pairs=PAIRS)[0]
    expected = np.sqrt(best.fun / np.sum(values**2))
    assert found.relative_rms == pytest.approx(expected, rel=1e-4)
    assert found.parameters["exponent"] == pytest.approx(np.exp(best.x), rel=0.01)
    np.testing.assert_allclose(found.parameters["kd"], found.brdf.kd)
    exact = best_models(truth, ["phong", "blinn-phong"], size=8, most_pairs=PAIRS)[0]
    assert (exact.name, exact.relative_rms < 1e-4) == ("blinn-phong", True)
    assert exact.parameters["exponent"] == pytest.approx(4.0, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "truth", "numbers"),
    [
        (
            "anisotropic-ward",
            Ward(np.array([0.1]), np.array([0.3]), 0.2, 0.5),
            {"kd": [0.1], "ks": [0.3], "roughness": 0.2, "roughness_y": 0.5},
        ),
        ("oren-nayar", OrenNayar(np.array([0.2]), 0.4, True), {"kd": [0.2], "sigma": 0.4}),
    ],
)
def test_models_without_a_lobe_about_the_mirror_speak_their_own_words(name, truth, numbers):
    found = best_models(truth, [name], size=8, most_pairs=PAIRS)[0]
    assert found.relative_rms < 1e-4
    assert set(found.parameters) == set(numbers)
    for key, value in numbers.items():
        np.testing.assert_allclose(found.parameters[key], value, rtol=1e-3)


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="choose some of microfacet"):
        best_models(TRUTHS["phong"], ["marble"])
    with pytest.raises(ValueError, match="choose some of"):
        best_models(TRUTHS["phong"], [])
    with pytest.raises(ValueError, match="zero, or not finite"):
        best_models(Phong(np.zeros(1), np.zeros(1), 3.0), ["phong"], size=4)
    with pytest.raises(ValueError, match="size=1"):
        best_models(TRUTHS["phong"], size=1)
