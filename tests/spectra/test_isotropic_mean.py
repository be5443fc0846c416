"""The isotropic part of a BRDF, and through it the spectrum of a wavelet tree (rho_lpq of T 5.7).

- The mean of an isotropic BRDF is itself; that of any does not change when directions turn or are
  mirrored, and has the same mean square product with isotropic ones (it is a projection).
- A tree's rho_lpq differ from the original's by no more than its own error allows:
  sqrt(sum |difference|^2) <= 8 rms of the difference over the squares, since
  int int (d cos t_i)^2 over both spheres about R = int int d^2 cos^2 t_i 4 cos t_o dw_i dw_o
  <= 4 int int d^2 cos t_i cos t_o dw_i dw_o = 64 times its mean square over Nusselt's squares.
- The spectrum of a tree asks for the isotropic mean by name; float32 works; misuse is refused.
"""

import dataclasses

import numpy as np
import pytest

from jaxrender.brdf import Microfacet, Phong, Ward, WaveletBRDF
from jaxrender.brdf.isotropic_mean import IsotropicMean
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.geometry import NUSSELT
from jaxrender.spectra.central import central_spectrum_of
from jaxrender.wavelets import CoefficientTree, analyse_nonstandard, haar, keep_fraction

SIZE = 16
LIMITS = (8, 4)
MATERIAL = Phong(np.array([0.2]), np.array([0.3]), 6.0)


def directions(count: int, seed: int) -> np.ndarray:
    places = np.random.default_rng(seed).uniform(size=(4 * count, 2))
    return np.asarray(NUSSELT.direction_from_square(places[NUSSELT.covers(places)][:count]))


PAIR = directions(400, 1), directions(400, 2)


def turned(vectors: np.ndarray, angle: float, side: float = 1.0) -> np.ndarray:
    x, y, z = (vectors * [1, side, 1]).T
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)


@pytest.fixture(scope="module")
def tree():
    table = tabulate(MATERIAL, SIZE, dtype=np.float64, cell_samples=1).values
    kept = keep_fraction(analyse_nonstandard(haar(), table), 0.1, joint=True)
    return CoefficientTree.of_coefficients(haar(), kept.coefficients)


def test_an_isotropic_brdf_is_its_own_mean():
    found = IsotropicMean(MATERIAL, 5).evaluate(*PAIR)
    np.testing.assert_allclose(found, MATERIAL.evaluate(*PAIR), rtol=1e-9, atol=1e-12)


def test_the_mean_turns_and_mirrors():
    ward = Ward(np.array([0.1, 0.2]), np.array([0.2, 0.1]), 0.3, 0.6)
    mean, some = IsotropicMean(ward, 24), [w[:60] for w in PAIR]
    here = np.asarray(mean.evaluate(*some))
    for angle, side in ((2 * np.pi / 24, 1.0), (0.0, -1.0), (0.05, -1.0)):
        there = mean.evaluate(*(turned(w, angle, side) for w in some))
        np.testing.assert_allclose(there, here, rtol=2e-3, atol=1e-4)
    by_hand = np.mean(
        [
            ward.evaluate(*(turned(w, 2 * np.pi * k / 48, s) for w in some))
            for k in range(48)
            for s in (1, -1)
        ],
        axis=0,
    )
    np.testing.assert_allclose(here, by_hand, rtol=2e-3, atol=1e-4)
    assert np.abs(np.asarray(ward.evaluate(*some)) / here - 1).max() > 0.3
    assert mean.isotropic
    assert mean.reciprocal


def test_the_spectrum_of_a_tree_is_the_original_s_within_its_error(tree):
    brdf = WaveletBRDF(tree)
    places = np.random.default_rng(5).uniform(size=(200_000, 4))
    ends = [np.asarray(NUSSELT.direction_from_square(places[:, i : i + 2])) for i in (0, 2)]
    apart = np.asarray(brdf.evaluate(*ends)) - np.asarray(MATERIAL.evaluate(*ends))
    # Beyond the disc both are 0, and so are the directions' cosines there.
    inside = NUSSELT.covers(places[:, :2]) & NUSSELT.covers(places[:, 2:])
    bound = 8 * np.sqrt(np.mean(np.where(inside[:, None], apart, 0) ** 2))
    original = central_spectrum_of(MATERIAL, LIMITS)
    found = central_spectrum_of(IsotropicMean(brdf, 12), LIMITS)
    pairs = np.where(np.arange(found.coefficients.shape[2]) > 0, 2.0, 1.0)[:, None]
    apart = np.asarray(found.coefficients) - np.asarray(original.coefficients)
    error = np.sqrt(np.sum(pairs * apart**2))
    whole = np.sqrt(np.sum(pairs * np.asarray(original.coefficients) ** 2))
    assert error <= bound
    assert error < 0.1 * whole
    np.testing.assert_allclose(found.energy, original.energy, rtol=0.1)


def test_a_tree_s_own_spectrum_is_refused(tree):
    with pytest.raises(ValueError, match="WaveletBRDF is anisotropic"):
        central_spectrum_of(WaveletBRDF(tree), LIMITS)
    with pytest.raises(ValueError, match="turns=0: give at least one"):
        IsotropicMean(MATERIAL, 0)


def test_float32_stays(tree):
    some = [w[:20].astype(np.float32) for w in PAIR]
    root, values = (np.asarray(a).astype(np.float32) for a in (tree.root, tree.values))
    small = dataclasses.replace(tree, root=root, values=values)
    metal = Microfacet(*(np.ones(1, np.float32),) * 2, np.array(0.3, np.float32), None)
    for brdf in (metal, WaveletBRDF(small)):
        lobes = IsotropicMean(brdf, 3).evaluate(*some)
        assert lobes.dtype == np.float32
        assert np.isfinite(lobes).all()
