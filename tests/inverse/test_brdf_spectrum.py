"""A BRDF as coefficients from samples under known light (T 6.4.2).

- The series that was recovered is a BRDF under the integral.
- Solver test: coefficients come back to 1e-8; with noise their errors follow the predicted
  covariance (chi-squared over all coefficients, and each coefficient over seeds).
- Reciprocity imposed: rho(i, o) = rho(o, i) exactly, and half of the unknowns' errors smaller.
- Sums over samples add up: any pieces, the same answer.
- The prior keeps the series small below the horizon; light of few degrees leaves the others to it,
  and ``resolution`` says so.
- Attenuating degrees is the same as filtering the light (T 6.4.2).
- A smooth BRDF under soft light: rendered by what was recovered, other views come out right; a
  sharp one rings, and order 8 is sharper than order 3 (T figure 6.2).
"""

import jax.numpy as jnp
import numpy as np
import pytest
from brdf_spectrum_problems import (
    FORMS,
    LIMIT,
    convolved,
    some_light,
    some_samples,
    some_values,
)
from inverse_problems import unit
from scipy.stats import chi2

from jaxrender.brdf import Lambertian, Microfacet
from jaxrender.geometry import Components, SurfaceSamples
from jaxrender.harmonics import degrees
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.brdf_spectrum.basis import SpectrumBasis
from jaxrender.inverse.brdf_spectrum.harmonic_brdf import HarmonicBRDF
from jaxrender.inverse.brdf_spectrum.recovery import (
    DEFAULT_PRIOR,
    NO_PRIOR,
    Prior,
    fit_brdf_spectrum,
    normal_equations,
    solve_spectrum,
)
from jaxrender.lighting import DirectionalSources, HarmonicLight
from jaxrender.reflection import integral_columns, radiance
from jaxrender.spectra import light_coefficients


def pairs(count=60, seed=3):
    rng = np.random.default_rng(seed)
    directions = unit(rng.normal(size=(2, count, 3)))
    directions[..., 2] = np.abs(directions[..., 2])
    return directions


def noiseless(basis, values, light, count=2000):
    samples, points = some_samples(count)
    exact = convolved(basis, values, light, points)
    return Observations(samples, exact, np.zeros(count, int))


@pytest.mark.parametrize("basis", FORMS)
def test_the_series_as_a_brdf_under_the_integral(basis):
    """A source lights the recovered BRDF as its coefficients light the convolution."""
    values = some_values(basis)
    found = solve_spectrum(
        basis,
        normal_equations(
            basis, some_light(), noiseless(basis, values, some_light()), np.ones((2000, 2))
        ),
        NO_PRIOR,
    )
    brdf = HarmonicBRDF.of(found)
    incoming, outgoing = pairs()
    transfer = np.stack(brdf.transfer(Components.of(incoming), Components.of(outgoing)), axis=-1)
    np.testing.assert_allclose(transfer, found.transfer(incoming, outgoing)[0], atol=1e-9)
    assert np.all(np.asarray(brdf.evaluate(incoming * [1, 1, -1], outgoing)) == 0)
    exchange = np.abs(brdf.evaluate(incoming, outgoing) - brdf.evaluate(outgoing, incoming))
    assert (
        np.all(exchange < 1e-9 * np.abs(transfer).max() / incoming[:, 2:].min()) == brdf.reciprocal
    )


@pytest.mark.parametrize("basis", FORMS)
def test_coefficients_come_back(basis):
    values, light = some_values(basis), some_light()
    found = fit_brdf_spectrum(
        noiseless(basis, values, light), light, basis, NoiseModel(0.0, 1e-3), NO_PRIOR
    )
    np.testing.assert_allclose(found.values, values, atol=1e-8)
    np.testing.assert_allclose(found.resolution, 1, atol=1e-6)
    table = found.coefficients
    if basis.reciprocal:
        np.testing.assert_array_equal(table, table.swapaxes(0, 1))
    np.testing.assert_allclose(basis.gather(table), found.values, atol=0)


@pytest.mark.parametrize("basis", FORMS)
def test_errors_follow_the_predicted_covariance(basis):
    """Noise of another size at every sample; all coefficients together, and each over the seeds."""
    values, light, seeds = some_values(basis), some_light(), 60
    exact = noiseless(basis, values, light)
    deviation = 0.02 * np.exp(np.random.default_rng(0).uniform(-1.5, 1.5, exact.radiance.shape))
    together, each = 0.0, []
    for seed in range(seeds):
        noise = deviation * np.random.default_rng(seed).normal(size=deviation.shape)
        noisy = exact._replace(radiance=exact.radiance + noise)
        equations = normal_equations(basis, light, noisy, deviation)
        found = solve_spectrum(basis, equations, NO_PRIOR)
        off = found.values - values
        together += sum(
            float(off[:, c] @ np.linalg.solve(found.covariance[c], off[:, c])) for c in range(2)
        )
        each.append((off / found.standard_error) ** 2)
    low, high = chi2.interval(0.999, seeds * values.size)
    assert low < together < high
    low, high = chi2.interval(1 - 1e-5, seeds)
    scores = np.sum(each, axis=0)
    assert np.all((scores > low) & (scores < high))


def test_reciprocity_makes_errors_smaller():
    basis, light = FORMS[1], some_light()
    exact = noiseless(basis, some_values(basis), light)
    free = np.asarray(exact.samples.exit_cosines)[:, None]
    errors = []
    for form in FORMS:
        # In the plain form the same data are those of B cos t_o, and of rho~ unconstrained.
        scale = 1.0 if form.reciprocal else free
        seen = exact._replace(radiance=exact.radiance * scale)
        equations = normal_equations(form, light, seen, 0.01 * scale * np.ones((2000, 2)))
        found = solve_spectrum(form, equations, NO_PRIOR)
        spread = form.spread(found.standard_error)
        np.testing.assert_allclose(found.coefficients, basis.spread(some_values(basis)), atol=1e-7)
        errors.append(spread[form.spread(np.ones((form.count, 2))) > 0])
    assert np.all(errors[1] < errors[0] * (1 + 1e-9))
    assert np.median(errors[1] / errors[0]) < 0.75


def test_any_pieces_give_the_same_sums():
    basis, light = FORMS[1], some_light()
    exact = noiseless(basis, some_values(basis), light)
    ones = np.ones((2000, 2))
    whole = normal_equations(basis, light, exact, ones)
    parts = [
        normal_equations(basis, light, exact.take(index), ones[index])
        for index in np.split(np.arange(2000), [3, 1100])
    ]
    joined = parts[0].joined(parts[1]).joined(parts[2])
    for one, other in zip(whole, joined):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-9)
    assert joined.count == 2000


def test_the_prior_decides_what_the_light_does_not_show():
    """Light of degree 1: coefficients of degrees 2 and 3 are the prior's, and said to be."""
    basis = FORMS[0]
    light = some_light() * (degrees(LIMIT) <= 1)[:, None]
    exact = noiseless(basis, some_values(basis), light)
    found = fit_brdf_spectrum(exact, light, basis, NoiseModel(0.0, 1e-3), Prior(1.0, np.inf))
    unlit = basis.indices[0] > 1
    np.testing.assert_allclose(found.values[unlit], 0, atol=1e-10)
    np.testing.assert_allclose(found.resolution[unlit], 0, atol=1e-10)
    assert np.all(found.resolution[~unlit] > 0.99)
    deviation = found.standard_error[unlit] * np.sqrt(basis.norms()[unlit, None])
    first = normal_equations(basis, light, exact, np.ones((2000, 2))).first_coefficient()
    np.testing.assert_allclose(deviation, np.broadcast_to(first, deviation.shape), rtol=1e-6)


def test_attenuating_degrees_is_softer_light():
    basis, light = FORMS[0], some_light()
    exact = noiseless(basis, some_values(basis), light)
    found = fit_brdf_spectrum(exact, light, basis, NoiseModel(0.0, 1e-3), NO_PRIOR)
    transfer = np.array([1, 0.8, 0.5, 0.1])
    softer = found.attenuated(transfer)
    filtered = light * transfer[degrees(LIMIT)][:, None]
    samples = some_samples(300, seed=8)[0]
    np.testing.assert_allclose(
        softer.radiance(light, samples), found.radiance(filtered, samples), atol=1e-8
    )
    np.testing.assert_allclose(
        softer.standard_error, found.standard_error * transfer[basis.indices[0]][:, None]
    )
    with pytest.raises(ValueError, match="2 factors for degrees 0 to 3"):
        found.attenuated(np.ones(2))


GLOSSY = Microfacet(np.array([0.2, 0.1]), np.full(2, 0.2), 0.35, None, "half", "smith")


def photographed(brdf, light, count, seed, noise=0.01):
    """Samples by the integral over a grid of the light's own nodes, with noise."""
    samples = some_samples(count, seed, 0.15)[0]
    arrays = SurfaceSamples(*(jnp.asarray(a) for a in samples))
    exact = np.asarray(radiance(brdf, integral_columns(brdf, arrays, light.nodes())))
    noisy = exact * (1 + noise * np.random.default_rng(seed).normal(size=exact.shape))
    return Observations(samples, noisy, np.zeros(count, int)), exact


@pytest.mark.slow
def test_what_was_recovered_under_rich_light_renders_soft_light():
    """T figure 6.2, bottom middle: low-frequency light needs the low frequencies only."""
    source = DirectionalSources(np.array([[0.3, -0.5, 0.8]]), np.array([[3.0, 2.0]]))
    soft = HarmonicLight(np.outer([3.0, 0.3, 0.8, -0.4], [1.0, 0.7]), 32)
    rich = some_rich_light(source, soft, LIMIT)
    basis = SpectrumBasis(LIMIT, reciprocal=True)
    soft_shots, _ = photographed(GLOSSY, soft, 1500, 5)
    lit, _ = photographed(GLOSSY, source, 1500, 5)
    both = soft_shots._replace(radiance=soft_shots.radiance + lit.radiance)
    found = fit_brdf_spectrum(both, rich, basis)
    fresh, exact = photographed(GLOSSY, soft, 300, 6, 0.0)
    off = found.radiance(soft.coefficients, fresh.samples) - exact
    assert np.sqrt(np.sum(off**2) / np.sum(exact**2)) < 0.03
    # The source's own degrees above the order are left over.
    assert found.relative_rms < 0.12


def some_rich_light(source, soft, limit):
    return np.asarray(light_coefficients(source, limit)) + np.asarray(
        light_coefficients(soft, limit)
    )


@pytest.mark.slow
def test_sharp_brdfs_ring_and_higher_orders_are_sharper():
    brdf = Microfacet(np.full(2, 0.1), np.full(2, 0.3), 0.15, None, "half", "smith")
    source = DirectionalSources(np.array([[0.3, -0.5, 0.8]]), np.ones((1, 2)))
    shots, _ = photographed(brdf, source, 4000, 7)
    outgoing = np.array([[0.6, 0, 0.8]])
    mirror = outgoing * [-1, 1, 1]
    azimuth = np.radians(np.arange(0, 360, 10))
    ring = np.stack([0.6 * np.cos(azimuth), 0.6 * np.sin(azimuth), 0.8 + 0 * azimuth], axis=-1)
    peaks, dips = [], []
    for limit in (LIMIT, 8):
        light = np.asarray(light_coefficients(source, limit))
        found = fit_brdf_spectrum(shots, light, SpectrumBasis(limit, reciprocal=True))
        peaks.append(found.transfer(mirror, outgoing)[0].mean())
        dips.append(found.transfer(ring, np.repeat(outgoing, len(ring), 0))[0].min())
    truth = float(brdf.evaluate(mirror, outgoing).mean()) * 0.8
    assert peaks[0] < 0.7 * truth
    assert peaks[1] > 0.9 * truth
    assert min(dips) < 0.9 * 0.1 * 0.8


def test_a_diffuse_surface():
    """Lambertian: rho_l00 are the clamped cosine's, up to what lies below the horizon."""
    brdf = Lambertian(np.full(2, 1 / np.pi))
    light = HarmonicLight(some_light(2), 32)
    shots, _ = photographed(brdf, light, 1500, 9, 0.002)
    found = fit_brdf_spectrum(shots, some_light(2), SpectrumBasis(2), prior=DEFAULT_PRIOR)
    incoming, outgoing = pairs()
    value, error = found.transfer(incoming, outgoing)
    # The clamped cosine to degree 2 in t_i, whatever the view: T 3.33's numbers.
    cosine = incoming[:, 2]
    series = (1 / 4 + cosine / 2 + 5 / 16 * (3 * cosine**2 - 1) / 2) / np.pi
    np.testing.assert_allclose(value, np.stack([series, series], 1), atol=0.01)
    assert np.median(error) < 0.01


def test_refusals():
    basis = FORMS[0]
    nothing = Observations(
        SurfaceSamples(np.zeros((0, 3)), np.zeros((0, 3))), np.zeros((0, 2)), np.zeros(0, int)
    )
    with pytest.raises(ValueError, match="no samples"):
        fit_brdf_spectrum(nothing, some_light(), basis)
    with pytest.raises(ValueError, match="degree 0 is zero"):
        fit_brdf_spectrum(
            noiseless(basis, some_values(basis), some_light()), 0 * some_light(), basis
        )
    with pytest.raises(ValueError, match="-1"):
        SpectrumBasis(-1)
