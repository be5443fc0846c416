"""Other glossy models than the thesis's under light that is unknown too.

- Photographs of an area light and a source by the exact integral, with noise, give material and
  source back within a few of the stated standard errors; the residual is the noise.
- The forecast of such a fit foresees its errors.
- Of several models the one that was photographed predicts best what was held out.
- The search begins with as much specular as diffuse, whatever unit the model's ks has.
- What is said of the width is said by the model's own name.
"""

import numpy as np
import pytest
from area_and_source import AREA, ENERGY, KD, NOISE, SOURCE, photographs
from inverse_problems import ball_samples

from jaxrender.brdf import CosineLobe, HeTorranceLobe, Phong, TorranceSparrow, Ward
from jaxrender.inverse import KnownLight, Observations, Outcome
from jaxrender.inverse.comparison import Asked, compare_factorizations
from jaxrender.inverse.factorization import FactorSettings, factorize
from jaxrender.inverse.factorization.response import MirrorResponse, specular_share
from jaxrender.inverse.factorization.state import Task, begin
from jaxrender.inverse.forecast.joint import forecast_joint
from jaxrender.inverse.forecast.situation import Situation, Supposed
from jaxrender.lighting import DirectionalSources

MODELS = {
    "ward": Ward(KD, np.full(3, 0.15), 0.15),
    "phong": Phong(KD, np.full(3, 0.15), 22.0),
    "lafortune": CosineLobe(KD, np.full(3, 0.7), 20.0, 0.9),
    "torrance-sparrow": TorranceSparrow(KD, np.ones(3), 0.15, 1.7),
    "he-torrance": HeTorranceLobe(KD, np.full(3, 0.15), 0.2),
}
SETTINGS = FactorSettings(6, 2)
STATED_ERRORS = 4


# Each model compiles for some ten seconds; one without an index is found where two are compared.
@pytest.mark.slow
def test_material_and_source_are_found():
    truth = MODELS["torrance-sparrow"]
    observed = photographs(truth)
    found = factorize(observed, truth.with_roughness(0.3, truth.mu), SETTINGS)
    assert type(found.brdf) is type(truth)
    value, error = found.parameters.value, found.parameters.standard_error
    total = KD + truth.ks
    pairs = {"kd": KD / total, "ks": truth.ks / total}
    pairs |= {"roughness": float(truth.roughness), "mu": float(truth.mu)}
    for name, true in pairs.items():
        off = np.abs(value.of(name) - true) / error.of(name)
        assert np.all(off < STATED_ERRORS), (name, off)
        assert np.all(error.of(name) < 0.03 * np.asarray(true)), name
    assert found.relative_rms == pytest.approx(0.01, rel=0.15)
    assert found.scene.sources.directions[0] @ SOURCE > np.cos(np.radians(0.1))
    off = found.scene.sources.irradiance[0] - ENERGY * total
    assert np.all(np.abs(off) < STATED_ERRORS * found.scene.energy_error[0])
    assert set(found.identifiable) == {"kd", "ks", truth.shape.name, "mu"}
    # What was foreseen, with a source for every part of the area light that is too fine.
    light = KnownLight(AREA.to_environment(32), DirectionalSources(SOURCE[None], ENERGY[None]))
    situation = Situation(observed.samples, np.asarray(observed.frame), light)
    foreseen = forecast_joint(situation, Supposed(truth, NOISE), 6).parameters.standard_error
    for name in pairs:
        ratio = np.asarray(foreseen.of(name)) / np.asarray(error.of(name))
        assert np.all((ratio > 0.7) & (ratio < 1.4)), (name, ratio)


@pytest.mark.slow
def test_the_right_model_predicts_what_was_held_out():
    asked = (Asked("phong", MODELS["phong"]), Asked("ward", MODELS["ward"]))
    observed = photographs(MODELS["ward"])
    # Not what is fitted: every fit is told that these pixels are clipped.
    pool = observed._replace(radiance=np.minimum(observed.radiance, np.median(observed.radiance)))
    found = compare_factorizations(observed, asked, SETTINGS, pool=pool)
    assert [score.name for score in found.scores] == ["ward", "phong"]
    best, other = found.scores
    # Each has found a light of its own; the right one leaves the noise, here and there.
    assert found.held_out == 180
    assert best.relative_rms == pytest.approx(0.01, rel=0.2)
    assert best.chi_squared == pytest.approx(1, abs=0.25)
    assert (best.behind, best.told_apart, other.told_apart) == (0, False, True)
    assert found.best.fit.predicted.shape == (720, 3)
    assert found.best.fit.outcome is Outcome.MISFIT
    assert "clipped" in found.best.fit.reasons[0]


def test_a_comparison_needs_two_models():
    with pytest.raises(ValueError, match="two models or more"):
        compare_factorizations(photographs(MODELS["ward"]), (Asked("a", MODELS["ward"]),), SETTINGS)


def test_the_search_begins_with_as_much_specular_as_diffuse():
    samples, _ = ball_samples(20, 0.15, seed=1)
    for truth in MODELS.values():
        grey = Observations(samples, np.ones((20, 3)), np.zeros(20, int))
        task = Task(grey, MirrorResponse.of_convex(truth, samples, 2, 2))
        guess = begin(task).guess
        share = np.asarray(specular_share(guess))
        energy = float(task.response.lobe(guess).energy)
        np.testing.assert_allclose(share * energy, 1 - share)
