"""What photographs will tell, said before they are taken.

- Predicted standard errors are those that a fit states, within 15 %, on exact-integral photographs.
- Errors of samples that stand for many pixels or few are those of their weighted least squares.
- The information of photographs in a few numbers each gives the errors that all samples give.
- What is not identifiable is said so with its cause, and the remedy that is named does help.
- Light: the errors are those of its recovery; a diffuse material tells degree 2, not 3.
- Both unknown: the errors are those of a factorization's account on noisy data.
"""

import numpy as np
import pytest
from inverse_problems import (
    ball_samples,
    known_light,
    material,
    microfacet_unknowns,
    photograph,
    toy_model,
    toy_radiance,
    unit,
    with_noise,
)

from jaxrender.brdf import AnisotropicGGX, Microfacet
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    Observations,
    Stated,
    Unknown,
    fit_brdf,
    unknowns_of,
)
from jaxrender.inverse.elimination import Data
from jaxrender.inverse.factorization.account import account_of
from jaxrender.inverse.factorization.state import FactorSettings, State, Task
from jaxrender.inverse.forecast import (
    Situation,
    Supposed,
    forecast_joint,
    forecast_light,
    forecast_material,
    foresee,
    foresee_draw,
    problem_of,
)
from jaxrender.inverse.forecast.information import frame_grams, reading_of
from jaxrender.inverse.forecast.joint import supposed_answer
from jaxrender.inverse.forecast.situation import foreseen_of, numbers_of, radiance_of, weights_of
from jaxrender.inverse.forecast.spectrum import light_coefficients
from jaxrender.inverse.lighting.coefficients import LightSettings, recover_coefficients
from jaxrender.inverse.lighting.operator import light_operator
from jaxrender.inverse.models import LinearisedModel
from jaxrender.lighting import DirectionalSources, Environment

NAMES = ("kd", "ks", "sigma", "mu")
NOISE = NoiseModel(0.01, 0.0)
# How far predicted and achieved standard errors may differ.
WITHIN = 0.15
UNIFORM = KnownLight(Environment(np.ones((32, 64, 3))), DirectionalSources.none())


def few_samples(lowest=0.15, count=240):
    return ball_samples(count, lowest, seed=3)


def toy_foreseen(**choices):
    """A toy model's photographs: three of them, told apart by their number alone."""
    brdf = Microfacet(np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.16, 1.62, **choices)
    model = toy_model(60, seed=2)
    near = LinearisedModel.about(model, numbers_of(brdf))
    samples, _ = ball_samples(60)
    return foreseen_of(Situation(samples, np.arange(60) % 3, UNIFORM), Supposed(brdf, NOISE), near)


@pytest.mark.parametrize(
    "unknowns",
    [
        microfacet_unknowns(),
        microfacet_unknowns(ks_per_channel=True, free_gains=3),
        microfacet_unknowns(kd=Unknown(fixed=(0.19, 0.11, 0.07)), free_scale=True),
        microfacet_unknowns(sigma=Unknown(fixed=(0.16,)), free_scale=True),
    ],
)
def test_a_few_numbers_a_photograph_say_what_all_samples_say(unknowns):
    foreseen = toy_foreseen()
    reading = reading_of(problem_of(unknowns, foreseen.supposed.brdf), foreseen)
    found = reading.errors(reading.information(frame_grams(foreseen))).relative
    twin = _errors_from_all_samples(unknowns, foreseen)
    assert set(found) == set(twin)
    for name, expected in twin.items():
        assert float(found[name]) == pytest.approx(expected, rel=1e-6)


def _errors_from_all_samples(unknowns, foreseen):
    from jaxrender.inverse.forecast.material import _fit_at
    from jaxrender.inverse.uncertainty import uncertain_parameters

    problem = problem_of(unknowns, foreseen.supposed.brdf)
    fit = _fit_at(problem, foreseen)
    parameters = uncertain_parameters(problem, foreseen.model, foreseen.data, fit, True)
    found = {}
    for name in NAMES:
        value, error = (np.asarray(part.of(name)) for part in (parameters[0], parameters[3]))
        if np.any(error > 0):
            found[name] = float(np.max(error / (value - (name == "mu"))))
    return found


def test_twice_the_photographs_have_errors_smaller_by_the_root_of_two():
    foreseen = toy_foreseen()
    reading = reading_of(problem_of(microfacet_unknowns(), foreseen.supposed.brdf), foreseen)
    grams = frame_grams(foreseen)
    once, twice = (
        reading.errors(reading.information(g)) for g in (grams, np.concatenate([grams, grams]))
    )
    for name in NAMES:
        # The prior on sigma and mu is next to nothing, but not nothing.
        assert float(once.relative[name] / twice.relative[name]) == pytest.approx(2**0.5, rel=1e-3)
    assert float(twice.log_determinant - once.log_determinant) == pytest.approx(
        6 * np.log(2), rel=1e-3
    )


def test_singular_values_are_those_of_a_numerical_jacobian():
    foreseen, brdf = toy_foreseen(), toy_foreseen().supposed.brdf
    forecast = forecast_material(foreseen, explain=False)
    model = toy_model(60, seed=2)

    def shown(change):
        kd, ks = np.asarray(brdf.kd) * np.exp(change[2:5]), 0.21 * np.exp(change[5])
        radiance = toy_radiance(
            model, kd, ks, 0.16 * np.exp(change[0]), 1 + 0.62 * np.exp(change[1])
        )
        return (np.asarray(foreseen.data.weights) * radiance).ravel()

    step = 1e-5 * np.eye(6)
    jacobian = np.stack([(shown(h) - shown(-h)) / 2e-5 for h in step], axis=1)
    expected = np.linalg.svd(jacobian, compute_uv=False)
    np.testing.assert_allclose(forecast.singular_values, expected, rtol=1e-4)
    assert forecast.unknowns == ("sigma", "mu", "kd", "kd", "kd", "ks")
    least = jacobian @ forecast.weakest
    assert np.linalg.norm(least) == pytest.approx(expected[-1], rel=1e-3)


@pytest.mark.slow
def test_predicted_errors_are_those_that_a_fit_states():
    samples, frame = few_samples()
    light, brdf = known_light(), material()
    foreseen = foresee(Situation(samples, frame, light), Supposed(brdf, NOISE))
    forecast = forecast_material(foreseen, split="off")
    settings = FitSettings(starts=1, noise=NOISE, split="off")
    observations = with_noise(photograph(brdf, samples, frame))
    achieved = fit_brdf(observations, light, microfacet_unknowns(), brdf, settings)
    for name in NAMES:
        predicted = forecast.parameters.standard_error.of(name)
        stated = achieved.parameters.standard_error.of(name)
        np.testing.assert_allclose(predicted, stated, rtol=WITHIN)
    assert forecast.identifiable == achieved.identifiable
    *foretold, name = forecast.evidence
    assert name == achieved.evidence.name
    for one, other in zip(foretold, achieved.evidence):
        assert one == pytest.approx(other, rel=2 * WITHIN)
    assert forecast.sentences[0] == "every free parameter will be identifiable"


def test_errors_of_a_draw_are_those_of_its_least_squares():
    """Of amplitudes alone, which are linear: E diag(deviation^2) E' with E the estimator."""
    brdf = AnisotropicGGX(np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.16, 0.3, None)
    stated = {"roughness": Stated(fixed=(0.16,)), "roughness_y": Stated(fixed=(0.3,))}
    unknowns = unknowns_of(brdf, stated, ks_per_channel=True)
    source = DirectionalSources(unit(np.array([[0.3, 0.2, 0.8]])), np.full((1, 3), 2.0))
    situation = Situation(*ball_samples(2000), KnownLight(None, source))
    foreseen = foresee_draw(situation, Supposed(brdf, NoiseModel(0.01, 0.01)), count=200)
    forecast = forecast_material(foreseen, unknowns, explain=False).parameters.standard_error
    assert np.max(foreseen.shares) > 3 * np.min(foreseen.shares)
    weights = np.asarray(foreseen.data.weights)
    columns = np.stack([np.asarray(part) for part in foreseen.model.at], axis=1)
    for channel in range(3):
        own = weights[:, channel]
        deviation = np.sqrt(foreseen.shares) / own
        estimator = np.linalg.pinv(columns[:, :, channel] * own[:, None]) * own * deviation
        expected = np.sqrt(np.sum(estimator**2, axis=1))
        found = [float(np.asarray(forecast.of(name))[channel]) for name in ("kd", "ks")]
        np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_head_on_views_under_uniform_light_do_not_tell_the_roughness():
    samples, frame = few_samples(0.7)
    foreseen = foresee(Situation(samples, frame, UNIFORM), Supposed(material(), NOISE))
    forecast = forecast_material(foreseen)
    assert not forecast.identifiable["sigma"]
    assert not np.isfinite(forecast.evidence.spectrum)
    why, remedy = forecast.sentences[:2]
    assert "roughness" in why
    assert "no energy above degree 0" in why
    assert "exit cosine is above 0.7" in why
    assert "a source" in remedy
    assert "down to exit cosine 0.15" in remedy
    # The remedy is one: with grazing samples the roughness is identifiable, by them alone.
    samples, frame = few_samples(0.15)
    mended = foresee(Situation(samples, frame, UNIFORM), Supposed(material(), NOISE))
    forecast = forecast_material(mended, explain=False)
    assert forecast.identifiable["sigma"]
    assert forecast.evidence.rests_on_grazing


@pytest.mark.slow
def test_too_much_noise_asks_for_more_samples():
    samples, frame = few_samples(count=40)
    sources = DirectionalSources(unit(np.array([[0.3, 0.2, 0.8]])), np.full((1, 3), 2.0))
    supposed = Supposed(material(), NoiseModel(0.25, 0.0))
    foreseen = foresee(Situation(samples, frame, KnownLight(None, sources)), supposed)
    forecast = forecast_material(foreseen)
    lost = [name for name, known in forecast.identifiable.items() if not known]
    assert lost
    assert "times as many samples as these 40" in " ".join(forecast.sentences)


def test_a_material_outside_the_bounds_is_refused():
    with pytest.raises(ValueError, match=r"the supposed sigma is 0\.16"):
        forecast_material(
            toy_foreseen(), microfacet_unknowns(sigma=Unknown(None, 0.2, 0.5)), explain=False
        )


def test_the_light_s_errors_are_those_of_its_recovery():
    samples, frame = few_samples()
    situation, supposed = Situation(samples, frame, known_light(32)), Supposed(material(), NOISE)
    degree = 5
    forecast = forecast_light(situation, supposed, degree)
    operator = light_operator(material(), samples, degree)
    recovered = recover_coefficients(
        operator,
        np.asarray(operator.apply(light_coefficients(known_light(32), degree))),
        weights_of(NOISE, radiance_of(situation, supposed)),
        LightSettings(degree),
    )
    own = np.sqrt(np.mean(recovered.standard_errors[degree**2 :] ** 2))
    assert forecast.report.noise[degree] == pytest.approx(own, rel=1e-6)
    assert forecast.recoverable_degree == degree


def test_a_diffuse_material_tells_the_light_to_degree_two():
    samples, frame = few_samples()
    diffuse = Supposed(Microfacet(np.full(3, 0.2), np.zeros(3), 0.1, None), NOISE)
    forecast = forecast_light(Situation(samples, frame, known_light(32)), diffuse)
    assert forecast.recoverable_degree == 2
    # T 2.65: of odd degrees above 1 a diffuse material shows nothing.
    assert "of degree 3, 5" in forecast.sentences[1]
    assert np.all(forecast.singular_values(3) < 1e-5 * forecast.singular_values(0).min())


@pytest.mark.slow
def test_with_the_light_unknown_errors_are_those_of_a_factorization():
    samples, frame = few_samples()
    supposed = Supposed(material(), NOISE)
    situation = Situation(samples, frame, known_light(32))
    forecast = forecast_joint(situation, supposed, 4)
    answer = supposed_answer(situation, material(), 4)
    response, guess, light = answer
    truth = answer.measured(supposed, 1.0)
    rng = np.random.default_rng(1)
    noisy = truth.radiance + rng.normal(size=truth.radiance.shape) / truth.weights
    level = np.abs(light[0]) / np.sqrt(4 * np.pi)
    sources = len(guess.directions)
    settings = FactorSettings(4, sources, refine=False, noise=NOISE)
    task = Task(Observations(samples, noisy, frame), response, settings=settings)
    state = State(guess, np.ones(sources, bool), truth.weights, level)
    achieved, _ = account_of(task, state, "per-channel")
    for name in NAMES:
        np.testing.assert_allclose(
            forecast.parameters.standard_error.of(name),
            achieved.standard_error.of(name),
            rtol=0.2,  # noise of few samples
        )
    assert forecast.is_identifiable
    assert len(forecast.gauge) == 3
    # Unknown light does not tell more than known light; the penalty on it is a little knowledge.
    known = forecast_material(foresee(situation, supposed), explain=False).parameters
    for name in ("sigma", "mu"):
        now, then = (p.standard_error.of(name) for p in (forecast.parameters, known))
        assert now > 0.9 * then


def test_what_no_factorization_can_begin_with_is_refused():
    samples, frame = few_samples()
    situation = Situation(samples, frame, UNIFORM)
    partly = Supposed(Microfacet(np.full(3, 0.2), np.array([0.1, 0, 0.1]), 0.1, 1.5), NOISE)
    with pytest.raises(ValueError, match="kd and ks must be above 0"):
        forecast_joint(situation, partly)
    with pytest.raises(ValueError, match="240 samples for light of 169 coefficients"):
        forecast_joint(situation, Supposed(), 12)
    sources = tuple(DirectionalSources(np.eye(3)[:1], np.ones((1, 3))) for _ in range(4))
    moving = KnownLight(None, DirectionalSources.none(), sources)
    with pytest.raises(ValueError, match="differs from photograph to photograph"):
        forecast_light(Situation(samples, frame, moving), Supposed())


def test_data_hold_no_noise():
    data: Data = toy_foreseen().data
    np.testing.assert_allclose(data.weights * data.radiance, 100, rtol=1e-4)
