"""A material corrected by a table, where the photographs show more than its model.

- Sums by cells are the integral: of the model where the factor is 1, of the corrected BRDF for any
  factor, with shadows, and for light that each photograph has of its own.
- Two lobes photographed by an integral of their own, fitted as one: under other light the corrected
  material is several times nearer, and what is stated of that is about as large as it is.
- Where the model is right, the factor is 1 within its errors, and the prior learns to be strong.
- Nodes that no photograph saw return to the model, with the prior's deviation.
- The posterior stands where its cost is least, and its curvature is that of the cost.
- Exposures and the scale of the light that a fit has found are made up for.
- A scene's material that asks for a table is corrected by one, printed and saved with it.
- What no table corrects is refused.
"""

import dataclasses
import json

import numpy as np
import pytest
from inverse_problems import ball_samples, material, microfacet_unknowns, unit, with_noise

from jaxrender.brdf import AnisotropicWard, CorrectedBRDF, Microfacet, Mixture, lobe_named
from jaxrender.geometry import Sphere
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    Observations,
    Scene,
    fit,
    fit_brdf,
    unknown,
    unknowns_of,
)
from jaxrender.inverse.brdf_table import correct_by_table
from jaxrender.inverse.brdf_table.cell_sums import cell_sums
from jaxrender.inverse.brdf_table.correction import _Channel, _step
from jaxrender.inverse.brdf_table.smoothness import smooth_functions
from jaxrender.inverse.models import ExactModel
from jaxrender.io import read_merl
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import FrameNodes, integral_columns, integral_columns_by_frame, radiance

KD = np.array([0.19, 0.11, 0.07])
NARROW = Microfacet(KD, np.full(3, 0.12), 0.15, 1.5, "half", "smith", "ggx")
WIDE = Microfacet(np.zeros(3), np.array([0.15, 0.1, 0.05]), 0.4, None, "exit", "smith", "beckmann")
TRUTH = Mixture((NARROW, WIDE), np.ones((2, 3)))
SOURCES = DirectionalSources(
    unit(np.array([[0.2, -0.7, 0.6], [-0.9, 0.1, 0.4], [0.8, 0.7, 0.1], [0.1, 0.3, -0.9]])),
    np.array([[2.0, 1.8, 1.6], [1.0, 1.0, 1.2], [0.6, 0.7, 0.8], [0.5, 0.5, 0.5]]),
)
ELSEWHERE = DirectionalSources(
    unit(np.array([[0.9, 0.2, 0.3], [-0.1, -0.3, 1.0]])), np.array([[2.0, 2, 2], [0.5, 0.4, 0.3]])
)
SETTINGS = FitSettings(diagnose=False)
NOISE = 0.01
SHAPE = (6, 5, 4)


def photograph(brdf, samples, frame, sources=SOURCES):
    """Sum over the sources."""
    columns = integral_columns(brdf, samples, sources.nodes())
    return Observations(samples, np.asarray(radiance(brdf, columns)), frame)


def light(sources=SOURCES):
    return KnownLight(None, sources)


def exact(brdf, samples, sources=ELSEWHERE):
    return ExactModel(brdf, samples, (sources.nodes(),))


@pytest.fixture(scope="module")
def photographs():
    return with_noise(photograph(TRUTH, *ball_samples(1500)), NOISE)


def one_lobe(photographs, told=None):
    variant = lobe_named("ggx")
    return fit_brdf(photographs, told or light(), unknowns_of(variant), variant, SETTINGS)


@pytest.fixture(scope="module")
def fitted(photographs):
    return one_lobe(photographs)


@pytest.fixture(scope="module")
def corrected(fitted, photographs):
    return correct_by_table(fitted, light(), SETTINGS, pool=photographs)


# ---------------------------------------------------------------- sums by cells


def any_factor():
    return np.exp(np.random.default_rng(1).normal(size=(*SHAPE, 3)))


def summed(sums, factor):
    return np.einsum("sck,kc->sc", sums, factor.reshape(-1, 3))


@pytest.mark.parametrize("shadows", [False, True])
def test_sums_by_cells_are_the_integral(shadows):
    samples, _ = ball_samples(40)
    seen = np.random.default_rng(2).uniform(size=(40, 4)) < 0.5 if shadows else None
    of_model = exact(NARROW, samples, SOURCES)
    if shadows:
        of_model = dataclasses.replace(of_model, seen=(seen,))
    sums, factor = cell_sums(of_model, SHAPE), any_factor()
    brdf = CorrectedBRDF(NARROW, factor)
    columns = integral_columns(brdf, samples, SOURCES.nodes(), seen)
    wanted = np.asarray(radiance(brdf, columns))
    np.testing.assert_allclose(summed(sums, factor), wanted, rtol=1e-10, atol=1e-14)
    model = radiance(NARROW, integral_columns(NARROW, samples, SOURCES.nodes(), seen))
    np.testing.assert_allclose(sums.sum(axis=-1), model, rtol=1e-10, atol=1e-14)


def test_sums_by_cells_of_light_that_each_photograph_has(monkeypatch):
    # In blocks of seven samples, the last of which is not full.
    monkeypatch.setattr("jaxrender.inverse.brdf_table.cell_sums._PAIRS", 14)
    samples, frame = ball_samples(40)
    rng = np.random.default_rng(3)
    count = int(frame.max()) + 1
    nodes = FrameNodes(unit(rng.normal(size=(count, 2, 3))), rng.uniform(size=(count, 2, 3)), frame)
    sums, factor = cell_sums(ExactModel(NARROW, samples, (nodes,)), SHAPE), any_factor()
    brdf = CorrectedBRDF(NARROW, factor)
    wanted = np.asarray(radiance(brdf, integral_columns_by_frame(brdf, samples, nodes)))
    np.testing.assert_allclose(summed(sums, factor), wanted, rtol=1e-10, atol=1e-14)


def test_mirrored_cells_are_one_place():
    smooth = smooth_functions((24, 12, 8))
    nodes = np.arange(24 * 12 * 8).reshape(24, 12, 8)
    assert np.array_equal(smooth.place[nodes[5, 4, 1:]], smooth.place[nodes[5, 4, :0:-1]])
    np.testing.assert_allclose(np.sum(smooth.functions**2, axis=1), 1, atol=0.02)
    sums = np.random.default_rng(4).uniform(size=(3, nodes.size))
    np.testing.assert_allclose(
        smooth.by_place(sums) @ smooth.functions, sums @ smooth.at_cells, rtol=1e-9, atol=1e-12
    )


# ---------------------------------------------------------------- what is found


@pytest.mark.slow
def test_another_lobe_is_found(fitted, corrected):
    assert corrected.settled
    assert corrected.before > 5 * NOISE
    assert corrected.after < 1.2 * NOISE
    samples, frame = ball_samples(400, seed=5)
    truth = np.asarray(photograph(TRUTH, samples, frame, ELSEWHERE).radiance)
    found = corrected.predict(exact(fitted.brdf, samples))
    model = np.asarray(photograph(fitted.brdf, samples, frame, ELSEWHERE).radiance)

    def off(predicted):
        return np.sqrt(np.sum((predicted - truth) ** 2) / np.sum(truth**2))

    assert off(found.radiance) < 0.03
    assert off(found.radiance) < off(model) / 3
    lit = truth > 1e-3 * truth.max()
    told = np.abs(found.radiance - truth)[lit] / found.deviation[lit]
    assert 0.3 < np.median(told) < 1.5
    # The prediction is that of the corrected material itself.
    same = np.asarray(photograph(corrected.brdf, samples, frame, ELSEWHERE).radiance)
    np.testing.assert_allclose(found.radiance, same, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_of_a_right_model_the_factor_is_one():
    truth = material()
    photographs = with_noise(photograph(truth, *ball_samples(1500)), NOISE)
    variant = Microfacet(np.zeros(3), np.zeros(3), 0.1, 1.5)
    plain = fit_brdf(photographs, light(), microfacet_unknowns(), variant, SETTINGS)
    found = correct_by_table(plain, light(), SETTINGS, pool=photographs)
    assert found.strength < 0.1
    assert found.unexplained == pytest.approx(1, abs=0.1)
    off = np.log(np.asarray(found.brdf.factor)) / np.maximum(found.log_error, 1e-9)
    assert np.mean(np.abs(off) < 1.645) > 0.85


@pytest.mark.slow
def test_what_no_photograph_saw_is_the_model(corrected):
    factor, seen = np.asarray(corrected.brdf.factor), corrected.seen
    assert 0.1 < np.mean(seen) < 0.9
    # Half vectors that lie flat are met by no pair of directions above the horizon.
    assert not seen[-1, 8:, 0].any()
    np.testing.assert_allclose(factor[-1, 8:, 0], 1, atol=0.2)
    np.testing.assert_allclose(corrected.log_error[-1, 8:, 0], corrected.strength, rtol=0.1)
    assert np.all(corrected.log_error <= corrected.strength * 1.01)


def test_the_posterior_is_where_its_cost_is_least():
    rng = np.random.default_rng(6)
    functions = rng.normal(size=(30, 5)) / 3
    sums = rng.uniform(size=(200, 30))
    truth = rng.normal(size=5)
    measured = sums @ np.exp(functions @ truth) + rng.normal(size=200)
    channel = _Channel(sums, functions, measured, np.ones(200))
    weights = np.zeros(5)
    for _ in range(30):
        step = _step(channel, weights, 0.7, 1.3)
        weights = step.weights
    assert step.moved < 1e-6
    ends = [channel.cost(weights + d, 0.7, 1.3) for d in 1e-4 * np.eye(5)]
    others = [channel.cost(weights - d, 0.7, 1.3) for d in 1e-4 * np.eye(5)]
    slopes = (np.array(ends) - np.array(others)) / 2e-4
    scale = 1 / np.sqrt(np.diag(step.covariance))
    assert np.all(np.abs(slopes) < 1e-3 * scale)
    # Of small residuals Gauss and Newton's curvature is the cost's.
    at = channel.cost(weights, 0.7, 1.3)
    curved = (np.array(ends) + np.array(others) - 2 * at) / 1e-8
    wanted = np.diag(np.linalg.inv(step.covariance))
    np.testing.assert_allclose(curved, wanted, rtol=0.15)


@pytest.mark.slow
def test_exposures_and_scale_are_made_up_for(fitted, photographs, corrected):
    gains = np.linspace(0.7, 1.4, photographs.frames)
    value = fitted.parameters.value._replace(gains=gains, scale=1.7)
    parameters = fitted.parameters._replace(value=value)
    brighter = photographs._replace(
        radiance=1.7 * gains[photographs.frame][:, None] * photographs.radiance
    )
    found = correct_by_table(
        fitted._replace(parameters=parameters), light(), SETTINGS, pool=brighter
    )
    seen = corrected.seen
    np.testing.assert_allclose(
        np.log(np.asarray(found.brdf.factor))[seen],
        np.log(np.asarray(corrected.brdf.factor))[seen],
        atol=0.05,
    )


@pytest.mark.slow
def test_a_scene_asks_for_a_table(photographs, tmp_path):
    scene = Scene(unknown("ggx", table=True), Sphere(), SOURCES)
    estimate = fit(scene, photographs, SETTINGS)
    assert isinstance(estimate.brdf, CorrectedBRDF)
    assert estimate.correction.after < estimate.correction.before / 3
    assert estimate.correction.sentence in str(estimate)
    saved = estimate.save(tmp_path)
    table = read_merl(saved / "table.binary").brdf()
    pair = unit(np.array([[0.3, 0.2, 0.9]])), unit(np.array([[-0.2, 0.1, 0.8]]))
    np.testing.assert_allclose(table.evaluate(*pair), estimate.brdf.evaluate(*pair), rtol=0.05)
    stated = json.loads((saved / "estimate.json").read_text())["table"]
    assert stated == {"merl": "table.binary", "sentence": estimate.correction.sentence}
    # The picture is that of the corrected material.
    plain = estimate._replace(correction=None)
    assert plain.brdf is estimate.material
    assert np.abs(estimate.ball(32) - plain.ball(32)).max() > 0.01


# ---------------------------------------------------------------- refusals


def test_a_table_under_unknown_light_is_refused(photographs):
    with pytest.raises(ValueError, match="under known light; leave table out"):
        fit(Scene(unknown("ggx", table=True), Sphere()), photographs)


@pytest.mark.slow
def test_what_no_table_corrects_is_refused(fitted, photographs):
    brushed = AnisotropicWard(KD, np.full(3, 0.1), 0.1, 0.3)
    with pytest.raises(ValueError, match="anisotropic"):
        correct_by_table(fitted._replace(brdf=brushed), light(), SETTINGS)
    first = photographs.take(np.flatnonzero(photographs.frame == 0))
    with pytest.raises(ValueError, match="two photographs"):
        correct_by_table(fitted, light(), SETTINGS, pool=first)
    # A scene is refused before its fit.
    with pytest.raises(ValueError, match="two photographs"):
        fit(Scene(unknown("ggx", table=True), Sphere(), SOURCES), first)
    with pytest.raises(ValueError, match="anisotropic"):
        fit(Scene(unknown("anisotropic-ward", table=True), Sphere(), SOURCES), photographs)
    few = photographs.take(np.arange(100))
    with pytest.raises(ValueError, match="100 samples are too few"):
        correct_by_table(fitted, light(), SETTINGS, pool=few)
