"""Models ranked by held-out pixels: the one that made the photographs comes first.

- Photographs by the exact integral of GGX rank GGX first, of Ward's model Ward first, with a
  chi-squared of one and the others told apart; a diffuse material is far behind.
- What is held out was not fitted, is the same for all, and is drawn by the seed.
- Two equal candidates are behind by nothing, and are not told apart.
- The simplest model within one standard error is kept, and a ladder ends where nothing is gained.
- Differences have the errors of whole photographs: one that is off makes them unsure.
- A sample that stands for several pixels counts as if each of them had been held out.
"""

import numpy as np
import pytest
from inverse_problems import ball_samples, known_light, microfacet_unknowns, photograph, with_noise

from jaxrender.brdf import Microfacet, Ward, lobe_named
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, Unknown, unknowns_of
from jaxrender.inverse.comparison import (
    Candidate,
    _Judged,
    _ranked,
    compare_models,
    divided,
)

KD, KS = np.array([0.19, 0.11, 0.07]), np.full(3, 0.21)
GGX = Microfacet(KD, KS, 0.16, None, "half", "smith", "ggx")
WARD = Ward(KD, KS, 0.16)
METALLIC = microfacet_unknowns(mu=None)
DIFFUSE = microfacet_unknowns(ks=Unknown((0.0,)), sigma=Unknown((0.1,)), mu=None)
CANDIDATES = (
    Candidate("lambertian", Microfacet(KD, KS, 0.1, None), DIFFUSE),
    Candidate("ward", lobe_named("ward"), unknowns_of(lobe_named("ward"))),
    Candidate("ggx", GGX.with_roughness(0.1), METALLIC),
)
SETTINGS = FitSettings(starts=1, refine_samples=320)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "truth"), [("ggx", GGX), ("ward", WARD)])
def test_the_true_model_comes_first(name, truth):
    noisy = with_noise(photograph(truth, *ball_samples()), 0.01, 0.002)
    found = compare_models(noisy, known_light(), CANDIDATES, SETTINGS)
    assert found.best.name == name
    assert found.held_out == 80
    best, second, last = found.scores
    # The mean of 240 squared normal deviates, and the noise itself is known to 3 %.
    assert best.chi_squared == pytest.approx(1, abs=0.4)
    assert (best.behind, best.behind_error) == (0, 0)
    assert second.told_apart
    assert last.told_apart
    assert last.name == "lambertian"
    assert last.chi_squared > 3 * second.chi_squared > 6 * best.chi_squared
    assert best.relative_rms < second.relative_rms < last.relative_rms
    assert second.behind == pytest.approx(second.chi_squared - best.chi_squared)


def test_held_out_samples_take_no_part():
    observations = photograph(WARD, *ball_samples(50))
    training, rest = divided(observations, 0.2, 3)
    assert (training.count, rest.count) == (40, 10)
    rows = np.concatenate([training.radiance, rest.radiance])
    assert len(np.unique(rows, axis=0)) == 50
    np.testing.assert_array_equal(divided(observations, 0.2, 3)[1].radiance, rest.radiance)
    assert np.any(divided(observations, 0.2, 4)[1].radiance != rest.radiance)


@pytest.mark.slow
def test_the_same_model_twice_is_no_better():
    noisy = with_noise(photograph(WARD, *ball_samples()), 0.01, 0.002)
    settings = SETTINGS._replace(refine=False)
    twice = (CANDIDATES[1], CANDIDATES[1]._replace(name="again"))
    found = compare_models(noisy, known_light(), twice, settings)
    assert found.scores[1].behind == 0
    assert not found.scores[1].told_apart


def test_the_simplest_of_equals_is_kept():
    rest = photograph(WARD, *ball_samples(400))
    exact = np.asarray(rest.radiance)
    off = 0.01 * np.random.default_rng(0).normal(size=exact.shape) * exact
    measured = rest._replace(radiance=exact + off)
    rich = _Judged("rich", None, exact, NoiseModel(0.01, 0.0), 9)
    # Worse in two photographs and better in the others; and then worse in all.
    part = np.array([1.1, 0.95, 1.05, 0.93])[np.asarray(rest.frame), None]
    near = rich._replace(name="simple", predicted=exact + (1 - part) * off, size=2)
    far = near._replace(predicted=exact * 1.02)
    kept = _ranked([rich, near], measured, "squares")
    assert kept.best.name == "simple"
    assert kept.best.behind <= kept.best.behind_error
    assert _ranked([rich, far], measured, "squares").best.name == "rich"


def test_a_photograph_that_is_off_makes_differences_unsure():
    rest = photograph(WARD, *ball_samples(400))
    exact, noise = np.asarray(rest.radiance), NoiseModel(0.01, 0.0)
    one = (np.asarray(rest.frame) == 0)[:, None]
    right = _Judged("right", None, exact, noise)
    off = right._replace(name="off", predicted=np.where(one, 1.03, 1) * exact)
    score = _ranked([right, off], rest, "squares").scores[1]
    # A quarter of the pixels of one of four photographs: no more than a hint.
    assert 0.5 * score.behind < score.behind_error < 2 * score.behind
    assert not score.told_apart


@pytest.mark.slow
def test_a_ladder_ends_where_nothing_is_gained():
    diffuse = WARD.with_amplitudes(KD, 0 * KS)
    noisy = with_noise(photograph(diffuse, *ball_samples()), 0.01, 0.002)
    rungs = (CANDIDATES[0], CANDIDATES[2], CANDIDATES[1])
    settings = SETTINGS._replace(refine=False)
    found = compare_models(noisy, known_light(), rungs, settings, ladder=True)
    assert found.best.name == "lambertian"
    assert {score.name for score in found.scores} == {"lambertian", "ggx"}


def test_samples_count_by_their_pixels():
    """One model is right where samples stand for many pixels, the other elsewhere."""
    rest = photograph(WARD, *ball_samples(40))
    pixels = np.where(np.arange(40) < 10, 9.0, 1.0)
    noise, truth = NoiseModel(0.01, 0.0), np.asarray(rest.radiance)
    wrong = truth * (1 + 0.02 * np.sin(np.arange(40)))[:, None]
    few = (np.arange(40) < 10)[:, None]
    judged = [
        _Judged("few", None, np.where(few, truth, wrong), noise),
        _Judged("rest", None, np.where(few, wrong, truth), noise),
    ]
    assert _ranked(judged, rest, "squares").best.name == "rest"
    drawn = _ranked(judged, rest._replace(stands_for=pixels), "squares")
    assert drawn.best.name == "few"
    each = np.repeat(np.arange(40), pixels.astype(int))
    repeated = [one._replace(predicted=one.predicted[each]) for one in judged]
    for ours, theirs in zip(drawn.scores, _ranked(repeated, rest.take(each), "squares").scores):
        assert ours.chi_squared == pytest.approx(theirs.chi_squared)
        assert ours.relative_rms == pytest.approx(theirs.relative_rms)
        assert ours.behind == pytest.approx(theirs.behind)
    # Measured once: to stand for more pixels makes no sample surer.
    plain, twice = (
        _ranked(judged, rest._replace(stands_for=np.full(40, count)), "squares").scores[1]
        for count in (1.0, 2.0)
    )
    assert twice.behind_error == pytest.approx(plain.behind_error)


def test_bad_comparisons_are_refused():
    observations = photograph(WARD, *ball_samples(50))
    with pytest.raises(ValueError, match="two models or more"):
        compare_models(observations, known_light(), CANDIDATES[:1], SETTINGS)
    for part in (0.0, 1.0, 0.001):
        with pytest.raises(ValueError, match="leaves samples on both sides"):
            divided(observations, part, 0)
