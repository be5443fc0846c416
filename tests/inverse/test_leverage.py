"""Draws by leverage: samples where the answer is, without a bias.

- The leverage is the diagonal of the projection on the columns.
- A draw has the number asked for, each sample once, and sums over draws are in the mean those over
  all pixels.
- Pixels in a narrow highlight are drawn many times more often than their share.
- Where the light is unknown, what smooth light leaves unexplained marks the same pixels.
- A lobe of sigma .02 under one source is found from any draw, within its errors; a uniform draw of
  the same size holds a few pixels of it.
- Width and index of a lobe are looked for within what is stated of them.
- A fit that lost the specular lobe, or ended at a bound of sigma, goes on from what the data say.
"""

import numpy as np
import pytest
from inverse_problems import microfacet_unknowns, unit

from jaxrender.brdf import INDEX_BOUNDS, Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    Observations,
    Outcome,
    factorize,
    fit_brdf,
    unknowns_of,
)
from jaxrender.inverse.bounds import checked_at_bound, lost
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.factorization import FactorSettings
from jaxrender.inverse.leverage import (
    _of_columns,
    draw,
    index_range,
    leverage,
    sharpness,
    width_range,
)
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.observations import as_pixels
from jaxrender.inverse.passes import Begin, descend
from jaxrender.inverse.stated import Stated
from jaxrender.lighting import DirectionalSources

KD, KS, SIGMA = np.array([0.2, 0.15, 0.1]), 0.1, 0.02
TOWARDS = unit(np.array([0.3, 0.2, 0.9]))
SOURCE = DirectionalSources(TOWARDS[None], np.ones((1, 3)))
LIGHT = KnownLight(None, SOURCE)
METAL = Microfacet(np.zeros(3), np.zeros(3), 0.1, None)
UNKNOWNS = microfacet_unknowns(mu=None)
# Samples of a fit, fewer than from which a search begins with few of them.
DRAWN = 3000


@pytest.fixture(scope="module")
def photographs():
    """A ball from six sides, 1 % noise; T 6.2 without Fresnel, written out in NumPy."""
    azimuth = np.arange(6) * np.pi / 9
    views = unit(np.stack([0.4 * np.cos(azimuth), 0.4 * np.sin(azimuth), np.ones(6)], -1))
    rng = np.random.default_rng(1)
    frame = np.repeat(np.arange(6), 10_000)
    outgoing = views[frame]
    normals = unit(rng.normal(size=outgoing.shape))
    seen = np.sum(normals * outgoing, -1)
    seen, normals, outgoing, frame = (a[seen > 0.15] for a in (seen, normals, outgoing, frame))
    lit = np.maximum(normals @ TOWARDS, 0)
    half = unit(outgoing + TOWARDS)
    angle = np.arccos(np.clip(np.sum(normals * half, -1), -1, 1))
    lobe = np.exp(-((angle / SIGMA) ** 2)) / (4 * np.pi * SIGMA**2 * seen) * (lit > 0)
    radiance = KD * lit[:, None] + KS * lobe[:, None]
    radiance = radiance * (1 + 0.01 * rng.normal(size=radiance.shape))
    return Observations(SurfaceSamples(normals, outgoing), radiance, frame)


@pytest.fixture(scope="module")
def weight(photographs):
    return leverage(photographs, LIGHT)


def test_a_lobe_is_looked_for_within_what_is_stated():
    """A known index is both ends of its range; about a known width there is some room."""
    lobe = Microfacet(np.zeros(3), np.zeros(3), 0.1, 1.5)
    stated = {"mu": Stated(bounds=(1.005, 2.5)), "sigma": Stated(bounds=(0.05, 0.3))}
    free, within = unknowns_of(lobe), unknowns_of(lobe, stated)
    fixed = unknowns_of(lobe, {"mu": Stated(fixed=1.7), "sigma": Stated(fixed=0.2)})
    assert index_range(free, lobe) == pytest.approx(INDEX_BOUNDS)
    assert index_range(within, lobe) == pytest.approx((1.005, 2.5))
    assert index_range(fixed, lobe) == (1.7, 1.7)
    assert width_range(within, lobe) == pytest.approx((0.05, 0.3))
    low, high = width_range(fixed, lobe)
    assert low < 0.2 < high


def test_leverage_is_the_diagonal_of_the_projection():
    columns = np.random.default_rng(0).normal(size=(50, 4)) * [1, 1e3, 1e-3, 1]
    q, _ = np.linalg.qr(columns)
    np.testing.assert_allclose(_of_columns(columns), np.sum(q**2, axis=1), rtol=1e-10)
    columns[:, 3] = columns[:, 0]
    q, _ = np.linalg.qr(columns[:, :3])
    np.testing.assert_allclose(_of_columns(columns), np.sum(q**2, axis=1), rtol=1e-8)


def test_a_draw_has_the_number_asked_for_and_stands_for_all(photographs, weight):
    some, index = draw(photographs, weight, DRAWN, 0)
    assert some.count == DRAWN
    assert len(np.unique(index)) == DRAWN
    np.testing.assert_array_equal(some.radiance, photographs.radiance[index])
    assert np.all(some.pixels >= 1)
    # Half of the chance is uniform, hence the limit on what one sample stands for.
    assert some.pixels.max() <= 2 * photographs.count / DRAWN * 1.2
    everything = draw(photographs, weight, photographs.count, 0)
    assert everything.observations is photographs


def test_sums_over_draws_are_those_over_all_pixels(photographs, weight):
    values = photographs.radiance[:, 0]
    sums = []
    for seed in range(200):
        some, index = draw(photographs, weight, 500, seed)
        sums.append(np.sum(some.pixels * values[index]))
    error = np.std(sums) / np.sqrt(len(sums))
    assert abs(np.mean(sums) - values.sum()) < 3.5 * error
    # Without what they stand for, highlights would count many times over.
    assert np.mean(values[index]) * photographs.count > 1.2 * values.sum()


def test_highlights_are_drawn_many_times_more_often(photographs, weight):
    reflected = np.asarray(photographs.samples.reflected)
    near = reflected @ TOWARDS > np.cos(4 * SIGMA)
    _, index = draw(photographs, weight, DRAWN, 0)
    assert near[index].mean() > 5 * near.mean()


def test_pixels_are_an_even_picture_of_all(photographs, weight):
    some, _ = draw(photographs, weight, DRAWN, 0)
    even = as_pixels(some)
    assert len(even) == DRAWN
    # Of the exit cosines, which highlights and grazing angles unsettle in the draw itself.
    cosines = np.asarray(photographs.samples.exit_cosines)
    of_even = np.asarray(some.samples.exit_cosines)[even]
    assert abs(of_even.mean() - cosines.mean()) < 3.5 * cosines.std() / np.sqrt(DRAWN)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_narrow_lobe_is_found_without_the_light(photographs, seed):
    """The draw knows the photographs alone, and samples of it stand for 1 to 40 pixels."""
    some = draw(photographs, sharpness(photographs), DRAWN, seed).observations
    found = factorize(some, METAL, FactorSettings(3, 4))
    value, error = found.parameters.value, found.parameters.standard_error
    assert abs(value.of("sigma") - SIGMA) < 3.5 * error.of("sigma") < 0.01 * SIGMA
    assert np.all(np.abs(value.ks - KS / (KD + KS)) < 3.5 * error.ks)
    assert found.outcome is Outcome.CONVERGED
    assert found.scene.sources.directions[0] @ TOWARDS > np.cos(0.01 * SIGMA)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))]
)
def test_a_narrow_lobe_is_found_from_any_draw(photographs, weight, seed):
    some = draw(photographs, weight, DRAWN, seed).observations
    settings = FitSettings(refine_samples=DRAWN, starts=3, seed=seed)
    fit = fit_brdf(some, LIGHT, UNKNOWNS, METAL, settings)
    value, error = fit.parameters.value, fit.parameters.standard_error
    assert abs(value.of("sigma") - SIGMA) < 3.5 * error.of("sigma")
    assert abs(value.ks[0] - KS) < 3.5 * error.ks[0]
    assert np.all(np.abs(value.kd - KD) < 3.5 * error.kd)
    assert error.of("sigma") < 0.01 * SIGMA


def test_a_fit_without_specular_goes_on_from_the_data(photographs, weight):
    some = draw(photographs, weight, DRAWN, 0).observations
    settings = FitSettings()
    problem = Problem.of(UNKNOWNS, 3)
    model = ExactModel(METAL, some.samples, exact_nodes(LIGHT, some.frame, SIGMA))
    begin = Begin(None, None, UNKNOWNS.pack({"sigma": 0.97})[None])
    astray = descend(problem, model, some, begin, settings)
    assert lost(astray)
    found = checked_at_bound(astray, model, settings)
    assert not lost(found)
    sigma = float(UNKNOWNS.unpack(found.fit.solution.point).numbers["sigma"])
    assert abs(sigma / SIGMA - 1) < 0.02


def test_without_the_light_the_radiance_marks_the_highlight(photographs):
    found = sharpness(photographs)
    reflected = np.asarray(photographs.samples.reflected)
    highlight = reflected @ TOWARDS > np.cos(3 * SIGMA)
    assert found.sum() == pytest.approx(1)
    # Of 60,000 pixels some dozens are in the highlight.
    assert found[highlight].sum() > 0.9
    drawn = draw(photographs, found, DRAWN, 0)
    assert np.isin(np.flatnonzero(highlight), drawn.index).mean() > 0.9


def test_smooth_light_leaves_nothing(photographs):
    """Irradiance of degree 2, and of nothing at all: every sample is as likely as any other."""
    normals = np.asarray(photographs.samples.normals)
    smooth = photographs._replace(radiance=1 + normals[:, [2]] ** 2 + normals[:, [0, 0, 0]])
    left = np.asarray(smooth.radiance)
    assert np.all(np.isfinite(sharpness(smooth)))
    dark = sharpness(photographs._replace(radiance=np.zeros_like(left)))
    np.testing.assert_allclose(dark, 1 / photographs.count)
    assert sharpness(photographs.take(np.zeros(0, int))).shape == (0,)
