"""The noise model and its estimate.

Pinned down: the standard deviation's formula on NumPy and JAX arrays; added noise has it; the
estimate recovers relative part and floor within 3.5 of its own standard errors (the Cramer-Rao
bound) from 20,000 heteroscedastic samples, with 1 % gross outliers, with either part zero, without
bias from the cut, whatever the unit of radiance; many outliers do not catch its start, in whose
formulas a deviation for a variance shows only then; degenerate residuals; what is refused.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxrender.imaging import NoiseModel, estimate_noise

SAMPLES = 20_000
# Errors are judged in predicted standard errors; 3.5 is passed by 99.95 %.
STANDARD_ERRORS = 3.5
# Cutting at 3.5 standard deviations and 1 % fewer samples cost this much efficiency.
EFFICIENCY = 1.1


def predictions(seed):
    """Pixels from black to a few highlights."""
    return np.random.default_rng(seed).exponential(0.3, SAMPLES)


def standard_errors(model, radiance):
    """Of the two parts, by the Fisher information of their squares; NaN where a part is zero."""
    variance = model.standard_deviation(radiance) ** 2
    slopes = np.stack([radiance**2, np.ones_like(radiance)]) / variance
    covariance = np.linalg.inv(slopes @ slopes.T / 2)
    parts = np.array([model.relative, model.floor])
    return EFFICIENCY * np.sqrt(np.diag(covariance)) / (2 * parts)


def noisy_residuals(model, radiance, seed, outliers=0.0):
    rng = np.random.default_rng(seed)
    residuals = model.add(radiance, rng) - radiance
    bad = rng.random(len(radiance)) < outliers
    gross = rng.choice([-1, 1], len(radiance)) * rng.uniform(6, 60, len(radiance))
    return residuals + bad * gross * model.standard_deviation(radiance)


def test_standard_deviation_on_either_kind_of_array():
    model = NoiseModel(0.03, 0.4)
    np.testing.assert_allclose(model.standard_deviation(np.array([0.0, 10.0])), [0.4, 0.5])
    single = jax.jit(model.standard_deviation)(jnp.array([0, 10], jnp.float32))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, [0.4, 0.5], rtol=1e-6)


def test_added_noise_is_gaussian_of_that_deviation():
    model, radiance = NoiseModel(0.05, 0.01), predictions(0)
    noisy = model.add(radiance, np.random.default_rng(1))
    scores = (noisy - radiance) / model.standard_deviation(radiance)
    assert stats.kstest(scores, "norm").pvalue > 1e-3


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("outliers", [0.0, 0.01])
@pytest.mark.parametrize("truth", [(0.01, 0.002), (0.05, 0.0005), (0.02, 0.02)])
def test_both_parts_are_recovered_within_their_standard_errors(truth, outliers, seed):
    model, radiance = NoiseModel(*truth), predictions(seed)
    found = estimate_noise(noisy_residuals(model, radiance, seed + 10, outliers), radiance)
    errors = np.array([found.relative, found.floor]) - truth
    assert np.all(np.abs(errors) < STANDARD_ERRORS * standard_errors(model, radiance))


def test_cutting_outliers_does_not_bias_clean_residuals():
    # Quantiles of the Gaussian have its variance to 1e-4; the uncorrected cut would lose 1 %.
    quantiles = stats.norm.ppf((np.arange(SAMPLES) + 0.5) / SAMPLES)
    found = estimate_noise(0.01 * quantiles, np.full(SAMPLES, 2.0))
    np.testing.assert_allclose(found.standard_deviation(np.array([2.0])), 0.01, rtol=3e-4)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_many_far_outliers_do_not_catch_the_start(unit):
    # All residuals together have 16 times the deviation: at 3.5 times that nothing would be cut.
    rng = np.random.default_rng(15)
    residuals = rng.normal(0, 0.01, SAMPLES)
    residuals[rng.random(SAMPLES) < 0.1] = 0.5
    found = estimate_noise(unit * residuals, np.full(SAMPLES, unit))
    deviation = found.standard_deviation(np.array([unit]))
    np.testing.assert_allclose(deviation, unit * 0.01, rtol=0.05)


def test_outliers_of_a_few_bright_pixels_do_not_catch_the_start():
    # One pixel in 16 is lit, and one in ten of these is off by six deviations: with a start 4 times
    # too large none of them would be cut.
    rng = np.random.default_rng(16)
    radiance = np.where(np.arange(SAMPLES) < SAMPLES // 16, 1.0, 0.0)
    model = NoiseModel(0.01, 1e-4)
    residuals = model.add(radiance, rng) - radiance
    residuals[: SAMPLES // 160] = 0.06
    found = estimate_noise(residuals, radiance)
    np.testing.assert_allclose([found.relative, found.floor], [0.01, 1e-4], rtol=0.1)


@pytest.mark.parametrize("outliers", [0.0, 0.01])
def test_a_zero_floor_is_recovered(outliers):
    model, radiance = NoiseModel(0.01, 0.0), predictions(5)
    found = estimate_noise(noisy_residuals(model, radiance, 6, outliers), radiance)
    error = EFFICIENCY * 0.01 / np.sqrt(2 * SAMPLES)
    assert abs(found.relative - 0.01) < STANDARD_ERRORS * error
    assert found.floor < 1e-5  # 0.3 % of the noise at the mean radiance


@pytest.mark.parametrize("outliers", [0.0, 0.01])
def test_a_zero_relative_part_is_recovered(outliers):
    model, radiance = NoiseModel(0.0, 0.003), predictions(7)
    found = estimate_noise(noisy_residuals(model, radiance, 8, outliers), radiance)
    # At zero the square of a part is what has a standard error.
    squares = np.stack([radiance**2, np.ones_like(radiance)]) / 0.003**2
    covariance = EFFICIENCY**2 * np.linalg.inv(squares @ squares.T / 2)
    assert found.relative**2 < STANDARD_ERRORS * np.sqrt(covariance[0, 0])
    assert abs(found.floor**2 - 0.003**2) < STANDARD_ERRORS * np.sqrt(covariance[1, 1])


@pytest.mark.parametrize("unit", [1e-15, 1e6])
def test_the_unit_of_radiance_does_not_matter(unit):
    radiance = predictions(9)
    # Without a floor black pixels weigh most, and as much as their least variance lets them.
    for model in (NoiseModel(0.01, 0.002), NoiseModel(0.01, 0.0)):
        residuals = noisy_residuals(model, radiance, 10)
        found = estimate_noise(residuals, radiance)
        scaled = estimate_noise(unit * residuals, unit * radiance)
        np.testing.assert_allclose(scaled.relative, found.relative, rtol=1e-6)
        np.testing.assert_allclose(scaled.floor, unit * found.floor, rtol=1e-6)


def test_constant_or_black_predictions_put_all_noise_somewhere():
    residuals = np.random.default_rng(11).normal(0, 0.1, (100, 30))
    for level in (0.0, 2.0):
        found = estimate_noise(residuals, np.full_like(residuals, level))
        deviation = found.standard_deviation(np.array([level]))
        np.testing.assert_allclose(deviation, residuals.std(), rtol=0.02)


@pytest.mark.parametrize("step", [1e-3, 1.0, 1e3])
def test_residuals_quantised_mostly_to_zero_still_have_noise(step):
    residuals = step * np.round(np.random.default_rng(12).normal(0, 0.4, 5000))
    found = estimate_noise(residuals, np.linspace(0, step, 5000))
    deviation = np.sqrt(np.mean(found.standard_deviation(np.linspace(0, step, 5000)) ** 2))
    np.testing.assert_allclose(deviation, residuals.std(), rtol=0.1)


def test_perfect_residuals_have_no_noise():
    found = estimate_noise(np.zeros(50), np.ones(50))
    assert (found.relative, found.floor) == (0, 0)


@pytest.mark.parametrize(
    ("parts", "message"),
    [((-0.1, 0.0), "noise relative is -0.1"), ((0.0, np.nan), "noise floor is nan")],
)
def test_bad_models_are_refused(parts, message):
    with pytest.raises(ValueError, match=message):
        NoiseModel(*parts)


def test_bad_residuals_are_refused():
    with pytest.raises(ValueError, match="9 residuals: a noise model needs 10"):
        estimate_noise(np.ones(9), np.ones(9))
    with pytest.raises(ValueError, match="mask invalid pixels"):
        estimate_noise(np.full(20, np.inf), np.ones(20))


def test_the_floor_is_what_is_known_of_it_or_more():
    rng = np.random.default_rng(6)
    predictions = rng.uniform(0.1, 1, 5000)
    residuals = 0.01 * predictions * rng.normal(size=5000)
    assert estimate_noise(residuals, predictions, 0.003).floor == pytest.approx(0.003)
    assert estimate_noise(0 * residuals, predictions, 0.003) == NoiseModel(0.0, 0.003)
    coarse = 0.02 * rng.normal(size=5000)
    free, least = (estimate_noise(coarse, predictions, floor) for floor in (0.0, 0.003))
    assert free == least
