"""Error bars.

- Standard errors are those of the full Jacobian of all unknowns, eliminated ones included, as a
  numerical derivative in NumPy gives them.
- They are in the parameters' own units, whatever the search variables.
- With a given noise, they widen when the data scatter more, and never shrink.
- Intervals are 1.645 standard errors to either side, symmetric in the logarithm for sigma, mu - 1.
- What is fixed has none; what the data say nothing of has that of its range.
- What is at a bound is held there for the others, and its own interval reaches into the range.
- Intervals hold the truth in 90 % of repetitions.
- Halves of the samples differ by what their residuals scatter, be that more in some places than in
  others; halves of two materials differ by more.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import (
    microfacet_unknowns,
    parameter_vector,
    sigma_unknown,
    toy_data,
    toy_model,
    toy_radiance,
)
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.stats import binom, chi2

from jaxrender.brdf import WIDTH_BOUNDS
from jaxrender.inverse import Unknown
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.intervals import Uncertain, intervals, within_reach
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.parameters import Parameters
from jaxrender.inverse.reasons import not_identifiable
from jaxrender.inverse.search import search
from jaxrender.inverse.uncertainty import held_at_bounds, uncertain_parameters

MODEL = toy_model(seed=5)
KD, KS, SIGMA, MU = np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.16, 1.62
NOISE = 0.02
# A numerical Jacobian by central differences, against exact derivatives and the weak prior.
SAME_ERROR = 2e-3
# Halves of the samples that differ in noise alone reach this once in a thousand draws.
BEYOND_NOISE = chi2.ppf(0.999, 6)
UNKNOWNS = microfacet_unknowns()
PROBLEM = Problem.of(UNKNOWNS, 3)


def noisy(seed, relative=NOISE):
    clean = toy_radiance(MODEL, KD, KS, SIGMA, MU)
    noise = np.random.default_rng(seed).normal(size=clean.shape)
    return clean * (1 + relative * noise), 1 / (NOISE * clean)


def account(seed, relative=NOISE, noise_given=False, weight=1.0):
    radiance, weights = noisy(seed, relative)
    data = toy_data(radiance, weight * weights)
    fit = search(PROBLEM, MODEL, data, UNKNOWNS.pack({"sigma": SIGMA, "mu": MU})[None])
    physical = UNKNOWNS.unpack(fit.solution.point)
    near = LinearisedModel.about(MODEL, physical.numbers)
    return uncertain_parameters(PROBLEM, near, data, fit, noise_given), fit, data


def numerical_errors(x, data):
    """Of kd (3), ks, sigma, mu by central differences, with s^2 from the residual."""

    def misfit(x):
        predicted = toy_radiance(MODEL, x[:3], np.full(3, x[3]), x[4], x[5])
        return (data.weights * (data.radiance - predicted)).ravel()

    steps = 1e-6 * np.eye(6)
    jacobian = np.stack([(misfit(x + h) - misfit(x - h)) / 2e-6 for h in steps], axis=1)
    variance = np.sum(misfit(x) ** 2) / (misfit(x).size - 6)
    return np.sqrt(np.diag(variance * np.linalg.inv(jacobian.T @ jacobian)))


def test_errors_are_those_of_the_full_jacobian():
    found, _, data = account(0)
    value, error = parameter_vector(found.value), parameter_vector(found.standard_error)
    np.testing.assert_allclose(error, numerical_errors(value, data), rtol=SAME_ERROR)


def test_estimated_noise_does_not_depend_on_the_scale_of_the_weights():
    one, tenfold = account(0)[0], account(0, weight=10.0)[0]
    np.testing.assert_allclose(
        parameter_vector(one.standard_error),
        parameter_vector(tenfold.standard_error),
        rtol=SAME_ERROR,
    )


def test_given_noise_widens_and_never_narrows():
    errors = {
        (scatter, given): parameter_vector(account(0, scatter * NOISE, given)[0].standard_error)
        for scatter in (0.5, 2.0)
        for given in (False, True)
    }
    np.testing.assert_allclose(errors[2.0, True], errors[2.0, False], rtol=1e-9)
    # Data twice as good as their stated noise: the stated noise stands.
    np.testing.assert_allclose(errors[0.5, True] / errors[0.5, False], 2, rtol=0.1)


def test_intervals_are_ninety_per_cent():
    found, _, _ = account(1)
    value, low, high, error = (parameter_vector(part) for part in found[:4])
    np.testing.assert_allclose(high[:4] - value[:4], 1.6448536 * error[:4], rtol=1e-6)
    np.testing.assert_allclose(value[:4] - low[:4], 1.6448536 * error[:4], rtol=1e-6)
    origin = np.array([0.0, 1.0])
    logs = [np.log(part[4:] - origin) for part in (low, value, high)]
    np.testing.assert_allclose(logs[2] - logs[1], logs[1] - logs[0], rtol=1e-9)
    relative = 1.6448536 * error[4:] / (value[4:] - origin)
    np.testing.assert_allclose(logs[2] - logs[1], relative, rtol=1e-6)


def chi_squared_of_halves(model, radiance):
    """What ``disagreement`` is a part of: it has as many degrees of freedom as unknowns."""
    weights = 1 / (NOISE * toy_radiance(model, KD, KS, SIGMA, MU))
    data = toy_data(radiance, weights)
    fit = search(PROBLEM, model, data, UNKNOWNS.pack({"sigma": SIGMA, "mu": MU})[None])
    near = LinearisedModel.about(model, UNKNOWNS.unpack(fit.solution.point).numbers)
    return uncertain_parameters(PROBLEM, near, data, fit, False).disagreement * BEYOND_NOISE


def test_halves_agree_where_the_model_is_wrong_in_some_places():
    """Forty times the scatter where the lobe is brightest, as a lobe of another shape leaves it.

    Of one variance for all samples the mean was 11.6, and one draw in five seemed to disagree.
    """
    model = toy_model(600, seed=5)
    lobe, clean = (toy_radiance(model, kd, KS, SIGMA, MU) for kd in (0 * KD, KD))
    scatter = NOISE * np.where(lobe > np.quantile(lobe, 0.97), 40, 1)
    rng = np.random.default_rng(0)
    noises = rng.normal(size=(20, *clean.shape))
    found = [chi_squared_of_halves(model, clean * (1 + scatter * noise)) for noise in noises]
    assert 4 < np.mean(found) < 9
    assert np.max(found) < BEYOND_NOISE


def test_halves_of_two_materials_do_not_agree():
    one, other = (toy_radiance(MODEL, KD, KS, sigma, MU) for sigma in (SIGMA, 1.2 * SIGMA))
    half = np.random.default_rng(0).permutation(len(one)) % 2 == 0
    noise = np.random.default_rng(1).normal(size=one.shape)
    mixed = np.where(half[:, None], one, other) * (1 + NOISE * noise)
    assert chi_squared_of_halves(MODEL, mixed) > 5 * BEYOND_NOISE


def test_what_is_fixed_has_no_error():
    radiance, weights = noisy(2)
    unknowns = microfacet_unknowns(ks=Unknown(fixed=(0.21,)), sigma=Unknown(fixed=(SIGMA,)))
    problem = Problem.of(unknowns, 3)
    data = toy_data(radiance, weights)
    fit = search(problem, MODEL, data, unknowns.starts(1))
    physical = unknowns.unpack(fit.solution.point)
    near = LinearisedModel.about(MODEL, physical.numbers)
    found = uncertain_parameters(problem, near, data, fit, False)
    np.testing.assert_array_equal(found.standard_error.ks, 0)
    assert float(found.standard_error.numbers["sigma"]) == 0
    assert float(found.lower.numbers["sigma"]) == pytest.approx(SIGMA)
    assert float(found.upper.numbers["sigma"]) == pytest.approx(SIGMA)
    assert np.all(found.standard_error.kd > 0)
    assert float(found.standard_error.numbers["mu"]) > 0


def test_an_interval_that_nothing_bounds_has_no_end():
    value = Parameters(
        {}, {"sigma": np.array(0.2), "mu": np.array(1.02)}, np.ones(1), np.array(1.0)
    )
    error = Parameters(
        {}, {"sigma": np.array(0.02), "mu": np.array(5.0)}, np.zeros(1), np.array(0.0)
    )
    found = intervals(value, error, {"sigma": 0.0, "mu": 1.0})
    assert (float(found.lower.of("mu")), float(found.upper.of("mu"))) == (1.0, np.inf)
    assert float(found.upper.of("sigma")) == pytest.approx(0.2 * np.exp(0.1 * 1.6449), rel=1e-4)
    assert not within_reach(found, "mu")
    assert within_reach(found, "sigma")
    assert not_identifiable("mu", found).endswith("its 90 % interval is 1 or more")


# Too little for the noise to tell from 0, and a bound next to what is true.
DARK, NEXT_TO_IT = 2e-3, 1.001


def at_bound(kd, bounds, seed, **rest):
    """Fit noisy radiance with sigma between bounds; returns intervals, what is held, and data."""
    unknowns = microfacet_unknowns(sigma=sigma_unknown(*bounds), **rest)
    problem = Problem.of(unknowns, 3)
    clean = toy_radiance(MODEL, np.asarray(kd), KS, SIGMA, MU)
    noise = np.random.default_rng(seed).normal(size=clean.shape)
    deviation = NOISE * np.mean(clean) * np.ones_like(clean)
    data = toy_data(clean + deviation * noise, 1 / deviation)
    start = unknowns.pack({"sigma": float(np.sqrt(np.prod(bounds))), "mu": MU})[None]
    fit = search(problem, MODEL, data, start)
    near = LinearisedModel.about(MODEL, unknowns.unpack(fit.solution.point).numbers)
    held = held_at_bounds(problem, fit)
    return uncertain_parameters(problem, near, data, fit, True), held, data


@pytest.mark.parametrize(
    ("label", "kd", "bounds"),
    [
        ("kd", [KD[0], KD[1], DARK], WIDTH_BOUNDS),
        ("sigma", KD, (WIDTH_BOUNDS[0], SIGMA * NEXT_TO_IT)),
        pytest.param("sigma", KD, (SIGMA / NEXT_TO_IT, WIDTH_BOUNDS[1]), marks=pytest.mark.slow),
    ],
)
def test_an_interval_at_a_bound_reaches_to_the_truth(label, kd, bounds):
    truth, (least, most) = (DARK, (0, 1)) if label == "kd" else (SIGMA, bounds)
    reached = []
    for seed in range(40):
        found, held, _ = at_bound(kd, bounds, seed)
        if held[4 if label == "kd" else 0]:
            low, high = (np.ravel(part.of(label))[-1] for part in (found.lower, found.upper))
            assert least <= low <= high <= most * (1 + 1e-9)
            reached.append(low <= truth <= high)
    assert len(reached) > 8
    assert np.mean(reached) > 0.8


@pytest.mark.parametrize(
    ("place", "kd", "bounds", "inwards"),
    [
        (2, [KD[0], KD[1], -2 * DARK], WIDTH_BOUNDS, 1),
        (4, KD, (WIDTH_BOUNDS[0], SIGMA / 1.01), -1),
        (4, KD, (SIGMA * 1.01, WIDTH_BOUNDS[1]), 1),
    ],
    ids=["kd", "sigma below", "sigma above"],
)
def test_an_interval_at_a_bound_is_the_tail_of_the_likelihood(place, kd, bounds, inwards):
    """Data that pull beyond it: all others at their best by SciPy, for each value inside."""
    found, held, data = at_bound(kd, bounds, 3)
    assert np.sum(held) == 1
    value = parameter_vector(found.value)
    ends = parameter_vector(found.upper if inwards > 0 else found.lower)
    reach = abs(ends[place] - value[place])

    def chi_squared(inside):
        def left(others):
            x = np.insert(others, place, inside)
            predicted = toy_radiance(MODEL, x[:3], np.full(3, x[3]), x[4], x[5])
            return (data.weights * (data.radiance - predicted)).ravel()

        return 2 * least_squares(left, np.delete(value, place), method="lm").cost

    steps = reach * np.linspace(0, 6, 61)
    squares = np.array([chi_squared(value[place] + inwards * step) for step in steps])
    freedom = data.radiance.size - (len(value) - 1)
    likelihood = np.exp((squares[0] - squares) / 2 / max(squares[0] / freedom, 1))
    below = cumulative_trapezoid(likelihood, steps, initial=0)
    assert reach == pytest.approx(np.interp(0.9 * below[-1], below, steps), rel=0.05)


def test_an_interval_at_a_bound_is_in_the_units_of_the_material():
    dark = [KD[0], KD[1], -DARK]
    known, scaled = (at_bound(dark, WIDTH_BOUNDS, 3, free_scale=free)[0] for free in (False, True))
    assert known.upper.kd[2] > 0
    upper = scaled.upper.kd[2] * float(scaled.value.scale)
    assert upper == pytest.approx(known.upper.kd[2], rel=1e-3)


def test_a_parameter_without_evidence_has_the_error_of_its_range():
    # A lobe that does not change with sigma: all that is known of it are its bounds.
    found, fit, data = account(3)
    near = LinearisedModel.about(MODEL, {"sigma": jnp.asarray(SIGMA), "mu": jnp.asarray(MU)})
    (slope,) = near.slopes["sigma"]
    slopes = {**near.slopes, "sigma": (jnp.zeros_like(slope),)}
    silent = LinearisedModel(near.at, slopes, near.numbers)
    blind = uncertain_parameters(PROBLEM, silent, data, fit, False)
    assert not within_reach(blind, "sigma")
    assert np.all(np.isfinite(parameter_vector(blind.upper)))
    assert 0.005 < float(blind.lower.numbers["sigma"]) < 0.05
    assert 0.4 < float(blind.upper.numbers["sigma"]) < 5
    # The others are known no worse for it: better, as sigma is no longer confused with them.
    assert np.all(np.asarray(blind.standard_error.kd) <= np.asarray(found.standard_error.kd) * 1.01)


def interval(**half_widths):
    """Parameters of 1 (mu: 2) with the given relative half widths of their intervals."""

    def side(sign):
        kd = np.full(3, 1 + sign * half_widths.get("kd", 0.0))
        ks = np.full(3, 1 + sign * half_widths.get("ks", 0.0))
        sigma = np.asarray(1 + sign * half_widths.get("sigma", 0.0))
        mu = np.asarray(2 + sign * half_widths.get("mu", 0.0))
        return Parameters({"kd": kd, "ks": ks}, {"sigma": sigma, "mu": mu}, np.ones(1), np.ones(()))

    return Uncertain(side(0), side(-1), side(1), side(0), origins={"sigma": 0.0, "mu": 1.0})


@pytest.mark.parametrize("name", ["kd", "ks", "sigma", "mu"])
def test_identifiable_is_a_quarter_to_either_side(name):
    # For mu a quarter of mu - 1.
    assert within_reach(interval(**{name: 0.249}), name)
    assert not within_reach(interval(**{name: 0.251}), name)


def test_intervals_hold_the_truth():
    truth = np.array([*KD, KS[0], SIGMA, MU])
    inside, seeds = 0, 60
    for seed in range(seeds):
        found, _, _ = account(100 + seed)
        low, high = parameter_vector(found.lower), parameter_vector(found.upper)
        inside += int(np.sum((low <= truth) & (truth <= high)))
    low, high = binom.interval(0.999, 6 * seeds, 0.9)
    assert low <= inside <= high
