"""Pinned down: the light's coefficients from photographs of a known material (T 6.15, 6.16).

- Streamed normal equations are those of the dense matrix, with weights by channel, and join.
- Solver test: Lambertian and unclipped Phong lobe, light of degree 12: 1e-8 relative.
- Solver test with noise: over 200 seeds the errors follow the predicted covariance.
- The exact integral with noise: the first nine coefficients to 3 %.
- ``auto`` cuts earlier for more noise and for a rougher material.
- What a Lambertian surface does not tell has infinite error and the value 0.
- The penalty is ridge regression by l(l+1); misuse is refused.
"""

import numpy as np
import pytest
from inverse_problems import LIGHTS
from lighting_problems import (
    glossy,
    phong_operator,
    photograph,
    random_light,
    samples_all_round,
)
from scipy import stats

from jaxrender.harmonics import degrees, evaluate
from jaxrender.inverse.lighting.coefficients import (
    LightSettings,
    recover_coefficients,
    solve_coefficients,
)
from jaxrender.inverse.lighting.normal_equations import dense_normal_equations, normal_equations
from jaxrender.inverse.lighting.operator import light_operator
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import irradiance
from jaxrender.spectra import light_coefficients, phong_transfer

DEGREE = 12
KD, KS = np.array([0.2, 0.1, 0.3]), np.array([0.3, 0.4, 0.1])
SOURCE = DirectionalSources(np.array([[-0.35, 0.8, 0.5]]), np.array([[0.1, 0.1, 0.1]]))
PIXELS = 1200


def phong_radiance(samples, light, exponent=24.0):
    """Photograph with the forward model's own sums, not with the operator's."""
    band_limit = int(np.sqrt(len(light))) - 1
    passed = np.asarray(phong_transfer(exponent, band_limit))[degrees(band_limit)]
    mirror = np.asarray(evaluate(light * passed[:, None], samples.reflected))
    return np.asarray(irradiance(light, samples.normals)), mirror


def test_streamed_equations_are_the_dense_ones():
    samples, rng = samples_all_round(400), np.random.default_rng(0)
    operator = phong_operator(samples, 6, KD, KS)
    measured, weights = rng.uniform(1, 2, (400, 3)), rng.uniform(0, 3, (400, 3))
    weights[7, 1], measured[7, 1] = 0, np.nan
    found = normal_equations(operator, measured, weights)
    diffuse, specular = (np.asarray(part) for part in operator.columns(operator.rows))
    for channel in range(3):
        matrix = KD[channel] * diffuse + KS[channel] * specular
        matrix = matrix * weights[:, channel, None]
        right = np.nan_to_num(measured[:, channel]) * weights[:, channel]
        np.testing.assert_allclose(found.gram[channel], matrix.T @ matrix, rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.moment[channel], matrix.T @ right, rtol=0, atol=1e-10)
        assert found.energy[channel] == pytest.approx(right @ right, rel=1e-12)
    assert found.measured.tolist() == [400, 399, 400]
    every = np.stack([kd * diffuse + ks * specular for kd, ks in zip(KD, KS)])
    dense = dense_normal_equations(every, np.nan_to_num(measured), weights)
    for ours, streamed in zip(dense, found):
        np.testing.assert_allclose(ours, streamed, rtol=1e-10, atol=1e-10)


def test_blocks_of_samples_join():
    light, whole = random_light(6), samples_all_round(400)
    rng = np.random.default_rng(1)
    weights = rng.uniform(0.5, 2, (400, 3))
    operator = phong_operator(whole, 6, KD, KS)
    measured = np.asarray(operator.apply(light))
    parts = []
    for block in (slice(0, 200), slice(200, 400)):
        some = type(whole)(whole.normals[block], whole.outgoing[block])
        part = phong_operator(some, 6, KD, KS)
        parts.append(normal_equations(part, measured[block], weights[block]))
    joined, once = parts[0].joined(parts[1]), normal_equations(operator, measured, weights)
    for a, b in zip(joined, once):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_exact_data_give_the_light_back():
    samples, light = samples_all_round(3000), random_light(DEGREE)
    diffuse, mirror = phong_radiance(samples, light)
    measured = KD * diffuse + KS * mirror
    weights = 1 / np.random.default_rng(2).uniform(0.5, 2, measured.shape)
    operator = phong_operator(samples, DEGREE, KD, KS)
    found = recover_coefficients(operator, measured, weights, LightSettings(DEGREE))
    assert np.abs(found.coefficients - light).max() < 1e-8 * np.abs(light).max()
    assert found.degrees.singular_values.shape == (3, 169)
    assert np.all(found.chi_squared < 1e-9 * np.sum((weights * measured) ** 2, axis=0))


@pytest.mark.slow
def test_errors_follow_the_predicted_covariance():
    """Two hundred seeds are two hundred channels of one photograph."""
    seeds, count, degree = 200, 700, 6
    samples = samples_all_round(count)
    light = np.repeat(random_light(degree, 1), seeds, axis=1)
    diffuse, mirror = phong_radiance(samples, light)
    exact = 0.2 * diffuse + 0.3 * mirror
    noise = 0.01 * exact
    measured = exact + noise * np.random.default_rng(3).normal(size=exact.shape)
    operator = phong_operator(samples, degree, np.full(seeds, 0.2), np.full(seeds, 0.3))
    found = recover_coefficients(operator, measured, 1 / noise, LightSettings(degree))
    error = found.coefficients - light
    # The stated covariance is scaled up where chance made the residual large: undo that.
    scale = np.maximum(found.chi_squared / (count - 49), 1)
    chi = np.array(
        [e @ np.linalg.solve(c / s, e) for e, c, s in zip(error.T, found.covariance, scale)]
    )
    low, high = stats.chi2.interval(0.999, seeds * 49)
    assert low < chi.sum() < high
    assert stats.kstest(chi, stats.chi2(49).cdf).pvalue > 1e-3
    ratio = np.mean((error / found.standard_errors) ** 2, axis=1)
    assert 0.6 < ratio.min() < 1 < ratio.max() < 1.5


@pytest.fixture(scope="module")
def photographed():
    """The exact integral of smooth light and a source, with 1 % noise."""
    samples, brdf = samples_all_round(PIXELS), glossy(0.14)
    exact = photograph(brdf, samples, LIGHTS, SOURCE)
    noise = 0.01 * exact
    return samples, brdf, exact + noise * np.random.default_rng(4).normal(size=exact.shape), noise


def test_the_exact_integral(photographed):
    samples, brdf, measured, noise = photographed
    operator = light_operator(brdf, samples, 14)
    found = recover_coefficients(operator, measured, 1 / noise)
    truth = np.asarray(light_coefficients(LIGHTS.to_environment(64), 8)) + np.asarray(
        light_coefficients(SOURCE, 8)
    )
    nine = np.linalg.norm(found.coefficients[:9] - truth[:9]) / np.linalg.norm(truth[:9])
    assert nine < 0.03
    assert 8 <= found.band_limit <= 14
    assert found.light.band_limit == found.band_limit
    assert "is the highest that is identifiable" in found.reasons[0]


def test_auto_cuts_earlier_for_noise_and_roughness():
    samples, light = samples_all_round(2000), random_light(20, 1)
    rng = np.random.default_rng(5)
    limits = {}
    for noise, exponent in ((0.01, 60.0), (0.1, 60.0), (0.01, 12.0)):
        diffuse, mirror = phong_radiance(samples, light, exponent)
        exact = 0.1 * diffuse + 0.3 * mirror
        spread = noise * exact.mean() * np.ones_like(exact)
        operator = phong_operator(samples, 20, [0.1], [0.3], exponent)
        measured = exact + spread * rng.normal(size=exact.shape)
        found = recover_coefficients(operator, measured, 1 / spread)
        limits[noise, exponent] = found.band_limit
        # The error of the highest degree is as predicted, within its own scatter.
        last = slice(found.band_limit**2, None)
        truth = light[: len(found.coefficients)]
        error = np.sqrt(np.mean((found.coefficients - truth)[last] ** 2))
        assert error < 2 * np.sqrt(np.mean(found.standard_errors[last] ** 2)) + 1e-9
    assert limits[0.01, 60.0] > limits[0.1, 60.0]
    assert limits[0.01, 60.0] > limits[0.01, 12.0]


def test_unknown_noise_is_estimated():
    samples, light = samples_all_round(800), random_light(4)
    exact = np.asarray(phong_operator(samples, 4, KD, KS).apply(light))
    measured = exact + 0.02 * np.random.default_rng(6).normal(size=exact.shape)
    operator = phong_operator(samples, 4, KD, KS)
    known = recover_coefficients(operator, measured, np.full(exact.shape, 50.0), LightSettings(4))
    found = recover_coefficients(operator, measured, None, LightSettings(4))
    np.testing.assert_allclose(found.standard_errors, known.standard_errors, rtol=0.08)


def test_what_is_not_identifiable_is_said_to_be_unknown():
    samples, light = samples_all_round(800), random_light(4)
    operator = phong_operator(samples, 4, KD, np.zeros(3))
    found = recover_coefficients(
        operator, np.asarray(operator.apply(light)), np.ones((800, 3)), LightSettings(4)
    )
    odd = degrees(4) == 3
    assert np.isinf(found.standard_errors[odd]).all()
    assert np.isfinite(found.standard_errors[~odd]).all()
    assert np.abs(found.coefficients[odd]).max() < 1e-6
    assert np.abs((found.coefficients - light)[~odd]).max() < 1e-8 * np.abs(light).max()


def test_the_penalty_is_ridge_regression_by_degree():
    samples, light = samples_all_round(800), random_light(4)
    operator = phong_operator(samples, 4, KD, KS)
    equations = normal_equations(operator, np.asarray(operator.apply(light)))
    found = solve_coefficients(equations, LightSettings(4, penalty=0.1))
    degree = degrees(4)
    ridge = 0.1 * equations.gram[:, 0, 0].mean() * degree * (degree + 1)
    for channel in range(3):
        expected = np.linalg.solve(
            equations.gram[channel] + np.diag(ridge), equations.moment[channel]
        )
        np.testing.assert_allclose(found.coefficients[:, channel], expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (LightSettings(6), "a degree from 0 to 5"),
        (LightSettings("all"), "give 'auto'"),
        (LightSettings(penalty=-1.0), "may be negative"),
        (LightSettings(positivity="maybe"), "choose one of none, soft, hard"),
    ],
)
def test_misuse_is_refused(settings, message):
    operator = phong_operator(samples_all_round(50), 5, KD, KS)
    with pytest.raises(ValueError, match=message):
        recover_coefficients(operator, np.ones((50, 3)), None, settings)


def test_data_that_say_nothing_are_refused():
    operator = phong_operator(samples_all_round(50), 5, KD, KS)
    with pytest.raises(ValueError, match="no measurement"):
        recover_coefficients(operator, np.ones((50, 3)), np.zeros((50, 3)))
    with pytest.raises(ValueError, match="not finite"):
        recover_coefficients(operator, np.full((50, 3), np.nan))
    with pytest.raises(ValueError, match="not negative"):
        recover_coefficients(operator, np.ones((50, 3)), np.full((50, 3), -1.0))
