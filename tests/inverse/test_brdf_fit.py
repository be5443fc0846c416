"""The whole recovery, small: 400 samples of a ball, continuous light, the fit's image 64 x 128.

- The refined fit is within 3.5 of its own standard errors; its residual is the noise; the bias of
  the frequency fit is reported.
- 90 % intervals hold the truth in 90 % of repetitions (nothing of the photographs' light or
  quadrature is the fit's).
- Metals come without mu; a parameter at a bound is an outcome; five per cent of outliers do not
  matter to a robust loss; sources of single photographs work.
- Uniform light leaves sigma unknown without grazing angles, in words, and known with them.
- Too few samples are refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import (
    ROWS,
    SAMPLES,
    ball_samples,
    known_light,
    material,
    microfacet_unknowns,
    parameter_vector,
    photograph,
    sigma_unknown,
    with_noise,
)
from scipy.stats import binom

from jaxrender.imaging import NoiseModel
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    Outcome,
    Unknown,
    fit_brdf,
)
from jaxrender.inverse.passes import values_of
from jaxrender.lighting import DirectionalSources, Environment

STATED_ERRORS = 3.5
TRUTH = parameter_vector(material())
SETTINGS = FitSettings(starts=2)


@pytest.fixture(scope="module")
def light():
    return known_light()


@pytest.fixture(scope="module")
def exact():
    return photograph(material(), *ball_samples())


@pytest.fixture(scope="module")
def fit(light, exact):
    noisy = with_noise(exact, 0.01, 0.002)
    return fit_brdf(noisy, light, microfacet_unknowns(), material(), SETTINGS)


def scores(fit, truth=TRUTH):
    value = parameter_vector(fit.parameters.value)
    return (value - truth) / parameter_vector(fit.parameters.standard_error)


@pytest.mark.slow
def test_the_refined_fit_is_within_its_stated_errors(fit):
    assert fit.outcome is Outcome.CONVERGED
    assert np.all(np.abs(scores(fit)) < STATED_ERRORS)
    assert all(fit.identifiable.values())
    # And they are small: a few per cent, not the whole range.
    errors = parameter_vector(fit.parameters.standard_error)
    assert np.all(errors < 0.02 * TRUTH)


@pytest.mark.slow
def test_a_robust_loss_states_what_it_costs(fit, light, exact):
    """On Gaussian noise a twentieth of the efficiency; its weights alone would state less error."""
    noisy = with_noise(exact, 0.01, 0.002)
    robust = SETTINGS._replace(loss="huber")
    found = fit_brdf(noisy, light, microfacet_unknowns(), material(), robust)
    # What samples leave together is another matter.
    if_exact = [one.parameters.if_exact or one.parameters for one in (found, fit)]
    stated, plain = (parameter_vector(one.standard_error) for one in if_exact)
    np.testing.assert_allclose(stated / plain, 1 / np.sqrt(0.95), atol=0.04)


def test_the_residual_is_the_noise(fit, exact):
    measured = np.asarray(fit.final.data.radiance)
    noise = np.sqrt(np.sum((measured - exact.radiance) ** 2) / np.sum(measured**2))
    assert fit.final.relative_rms == pytest.approx(noise, rel=0.03)
    assert fit.final.noise.relative == pytest.approx(0.01, rel=0.2)


@pytest.mark.slow
def test_the_lobes_azimuth_in_the_frequency_model_fits_grazing_pixels_better(light):
    """No source taken out of the light, exit cosines down to .15, no noise: what is left is bias.

    The azimuthal mean about R is wrong where the horizon cuts the lobe; with four orders of its
    azimuth it is right.
    """
    grazing = photograph(material(), *ball_samples())
    shared = SETTINGS._replace(split="off", refine=False, noise=NoiseModel(0.01, 1e-6))
    found = [
        parameter_vector(fit_brdf(grazing, light, microfacet_unknowns(), material(), settings).brdf)
        for settings in (shared, shared._replace(transfer="azimuthal-4"))
    ]
    mean, maps = (np.abs(each / TRUTH - 1) for each in found)
    assert np.sum(maps) < 0.3 * np.sum(mean), (mean, maps)


def test_the_bias_of_the_frequency_fit_is_reported(fit):
    assert set(fit.bias) == {"kd", "ks", "sigma", "mu"}
    before = parameter_vector(fit.brdf) * (1 + parameter_vector_of(fit.bias))
    np.testing.assert_allclose(before, parameter_vector(values_of(fit.frequency)), rtol=1e-9)
    assert 0 < np.abs(parameter_vector_of(fit.bias)).max() < 0.05


def parameter_vector_of(named):
    return np.array([*named["kd"], named["ks"][0], named["sigma"], named["mu"]])


def test_values_are_those_of_the_material(fit):
    np.testing.assert_array_equal(
        parameter_vector(fit.parameters.value), parameter_vector(fit.brdf)
    )


@pytest.mark.slow
def test_intervals_hold_the_truth(light, exact):
    inside, seeds = 0, 8
    for seed in range(seeds):
        noisy = with_noise(exact, 0.02, 0.01, seed)
        found = fit_brdf(noisy, light, microfacet_unknowns(), material(), SETTINGS).parameters
        low, high = parameter_vector(found.lower), parameter_vector(found.upper)
        inside += int(np.sum((low <= TRUTH) & (high >= TRUTH)))
    low, high = binom.interval(0.999, 6 * seeds, 0.9)
    assert low <= inside <= high


def test_without_refinement_there_is_no_bias_to_report(light, exact):
    noisy = with_noise(exact, 0.01, 0.002)
    found = fit_brdf(
        noisy, light, microfacet_unknowns(), material(), SETTINGS._replace(refine=False)
    )
    assert found.exact is None
    assert found.bias == {}
    assert found.final is found.frequency
    np.testing.assert_allclose(parameter_vector(found.brdf), TRUTH, rtol=0.04)


@pytest.mark.slow
def test_a_metal_has_no_index(light):
    metal = material(mu=None)
    noisy = with_noise(photograph(metal, *ball_samples()))
    unknowns = microfacet_unknowns(mu=None)
    found = fit_brdf(noisy, light, unknowns, metal, SETTINGS._replace(refine=False))
    assert found.outcome is Outcome.CONVERGED
    assert found.brdf.mu is None
    assert set(found.identifiable) == {"kd", "ks", "sigma"}
    np.testing.assert_allclose(
        [*found.brdf.kd, found.brdf.ks[0], found.brdf.sigma], TRUTH[:5], rtol=0.04
    )


@pytest.mark.slow
def test_parameters_at_their_bounds_are_an_outcome(light, exact):
    unknowns = microfacet_unknowns(
        ks=Unknown(upper=0.15), sigma=sigma_unknown(lower=0.25, upper=0.6)
    )
    found = fit_brdf(
        with_noise(exact), light, unknowns, material(), SETTINGS._replace(refine=False)
    )
    assert found.outcome is Outcome.AT_BOUND
    assert [name for name, known in found.identifiable.items() if not known] == ["ks", "sigma"]
    assert "sigma is at a bound of its range" in found.reasons
    assert "ks is at a bound of its range" in found.reasons
    assert found.brdf.sigma == pytest.approx(0.25, rel=0.01)
    np.testing.assert_array_equal(found.brdf.ks, 0.15)
    # The truth is beyond both: the intervals reach a little way into the range, and no further.
    low, high = found.parameters.lower, found.parameters.upper
    assert np.all(high.ks - low.ks > 0)
    assert 0.25 < float(high.numbers["sigma"]) < 0.26


@pytest.mark.slow
def test_outliers_do_not_matter_to_a_robust_loss(light, exact):
    noisy = with_noise(exact)
    rng = np.random.default_rng(7)
    hit = rng.uniform(size=SAMPLES) < 0.05
    noisy.radiance[hit] *= rng.uniform(2, 5, (hit.sum(), 1))
    settings = SETTINGS._replace(refine=False)
    robust, plain = (
        fit_brdf(noisy, light, microfacet_unknowns(), material(), settings._replace(loss=loss))
        for loss in ("cauchy", "squares")
    )
    off = [np.abs(parameter_vector(found.brdf) / TRUTH - 1).max() for found in (robust, plain)]
    assert off[0] < 0.04
    assert off[1] > 3 * off[0]


def test_uniform_light_without_grazing_angles_leaves_sigma_unknown():
    found = fit_under_uniform_light(0.7)
    assert found.outcome is Outcome.NOT_IDENTIFIABLE
    assert not found.identifiable["sigma"]
    (reason,) = (reason for reason in found.reasons if reason.startswith("sigma"))
    assert "too little detail" in reason
    low, high = (
        float(found.parameters.lower.numbers["sigma"]),
        float(found.parameters.upper.numbers["sigma"]),
    )
    assert low < 0.16 < high
    assert high / low > 4


def test_uniform_light_with_grazing_angles_shows_sigma():
    found = fit_under_uniform_light(0.15)
    assert found.identifiable["sigma"]
    assert np.all(np.abs(scores(found)) < STATED_ERRORS)
    assert found.evidence.rests_on_grazing
    assert "rests on grazing angles" in found.evidence.sentence()


def fit_under_uniform_light(lowest_cosine):
    samples, frame = ball_samples(SAMPLES, lowest_cosine, seed=3)
    exact = photograph(
        material(), samples, frame, lambda directions: jnp.ones((directions.shape[0], 3)), None
    )
    light = KnownLight(Environment(np.ones((ROWS, 2 * ROWS, 3))), DirectionalSources.none())
    return fit_brdf(with_noise(exact, seed=2), light, microfacet_unknowns(), material(), SETTINGS)


def test_a_source_for_each_photograph():
    samples, frame = ball_samples()
    turned = [np.roll(np.eye(3), shift, axis=0)[:1] + 0.3 for shift in range(4)]
    sources = tuple(DirectionalSources(towards, np.ones((1, 3))) for towards in turned)
    shots = [photograph(material(), samples, frame, jnp.zeros_like, source) for source in sources]
    radiance = np.stack([shot.radiance for shot in shots])[frame, np.arange(SAMPLES)]
    noisy = with_noise(shots[0]._replace(radiance=radiance), 0.01, 0.002)
    light = KnownLight(None, DirectionalSources.none(), sources)
    found = fit_brdf(noisy, light, microfacet_unknowns(), material(), SETTINGS)
    assert np.all(np.abs(scores(found)) < STATED_ERRORS)


def test_too_few_samples_are_refused(light, exact):
    with pytest.raises(ValueError, match="3 samples cannot determine 6 unknowns"):
        fit_brdf(exact.take(np.arange(3)), light, microfacet_unknowns(), material(), SETTINGS)
