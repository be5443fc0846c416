"""Variable projection: kd and ks solved for inside the search for sigma and mu.

- It ends at the optimum of SciPy's full least squares over all unknowns at once, on noisy data:
  ks shared or per channel, any subset fixed, weighted or not, metal or dielectric.
- The simplex twin ends there too; so does every start.
- Free gains of photographs and a free scale are found again.
- Single precision ends close by.
- Bounds on kd and ks hold, and an active one is met exactly.
- A search that begins with a part of many samples ends where one among all of them does.
- A few condensed residuals have the squares and the Gauss-Newton model of all of them.
- Wrong names and wrong numbers of fixed values are refused.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import microfacet_unknowns, toy_data, toy_model, toy_radiance
from scipy.optimize import least_squares

from jaxrender.inverse import Unknown
from jaxrender.inverse import search as searches
from jaxrender.inverse.elimination import (
    Objective,
    Problem,
    condensed_residuals,
    cost_at,
    residuals,
)
from jaxrender.inverse.parameters import to_parameters
from jaxrender.inverse.search import search

# Two optimisers of one smooth function: their steps end near 1e-8.
SAME_OPTIMUM = 1e-5
# Data without noise: how exactly the truth comes back.
RECOVERED = 1e-6

KD, KS, SIGMA, MU = np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.16, 1.62
MODEL = toy_model()


def fixed(*values):
    return Unknown(fixed=tuple(float(value) for value in values))


def noisy(ks=KS, mu=MU, seed=1):
    clean = toy_radiance(MODEL, KD, ks, SIGMA, mu)
    return clean * (1 + 0.02 * np.random.default_rng(seed).normal(size=clean.shape))


def vary_projected(unknowns, data, starts=2, method="variable-projection"):
    problem = Problem.of(unknowns, 3)
    fit = search(problem, MODEL, data, unknowns.starts(starts), method)
    return fit, to_parameters(problem, fit.solution.point, fit.linear.eliminated)


def scipy_optimum(data, ks_of, mu_free=True, weights=1.0):
    """All of kd, ks, log sigma and log(mu - 1) at once, by SciPy's Levenberg-Marquardt."""

    def misfit(x):
        mu = 1 + np.exp(x[-1]) if mu_free else None
        kd, ks, sigma = x[:3], ks_of(x[3:-2]), np.exp(x[-2])
        return (weights * (toy_radiance(MODEL, kd, ks, sigma, mu) - data)).ravel()

    count = 3 if ks_of is per_channel else 1
    start = np.concatenate([[0.1] * 3, [0.1] * count, [np.log(0.2), np.log(0.5)]])
    return least_squares(misfit, start, method="trf", xtol=1e-14, ftol=1e-14, gtol=1e-14)


def shared(x):
    return np.full(3, x[0])


def per_channel(x):
    return x


@pytest.mark.parametrize("ks_of", [shared, per_channel])
def test_ends_at_the_optimum_over_all_unknowns(ks_of):
    radiance = noisy(ks=KS * [1, 0.8, 0.6] if ks_of is per_channel else KS)
    unknowns = microfacet_unknowns(ks_per_channel=ks_of is per_channel)
    fit, found = vary_projected(unknowns, toy_data(radiance))
    expected = scipy_optimum(radiance, ks_of)
    assert bool(fit.solution.converged)
    np.testing.assert_allclose(fit.solution.cost, expected.cost, rtol=1e-8)
    np.testing.assert_allclose(found.kd, expected.x[:3], rtol=SAME_OPTIMUM)
    np.testing.assert_allclose(found.ks, ks_of(expected.x[3:-2]), rtol=SAME_OPTIMUM)
    np.testing.assert_allclose(found.numbers["sigma"], np.exp(expected.x[-2]), rtol=SAME_OPTIMUM)
    np.testing.assert_allclose(found.numbers["mu"], 1 + np.exp(expected.x[-1]), rtol=SAME_OPTIMUM)
    np.testing.assert_allclose(
        fit.predicted,
        toy_radiance(
            MODEL, found.kd, found.ks, float(found.numbers["sigma"]), float(found.numbers["mu"])
        ),
        rtol=1e-9,
    )


def test_weights_count_as_in_scipy():
    radiance = noisy()
    weights = np.random.default_rng(2).uniform(0.1, 3, radiance.shape)
    _, found = vary_projected(microfacet_unknowns(), toy_data(radiance, weights))
    expected = scipy_optimum(radiance, shared, weights=weights)
    _, unweighted = vary_projected(microfacet_unknowns(), toy_data(radiance))
    np.testing.assert_allclose(found.numbers["sigma"], np.exp(expected.x[-2]), rtol=SAME_OPTIMUM)
    assert abs(float(unweighted.numbers["sigma"] / found.numbers["sigma"]) - 1) > 10 * SAME_OPTIMUM


def test_a_metal_has_no_fresnel_ratio():
    radiance = noisy(mu=None)
    _, found = vary_projected(microfacet_unknowns(mu=None), toy_data(radiance))
    expected = scipy_optimum(radiance, shared, mu_free=False)
    np.testing.assert_allclose(found.numbers["sigma"], np.exp(expected.x[-2]), rtol=SAME_OPTIMUM)
    np.testing.assert_allclose(found.ks, expected.x[3], rtol=SAME_OPTIMUM)
    assert "mu" not in found.numbers


@pytest.mark.slow
def test_the_simplex_twin_ends_at_the_same_place():
    data = toy_data(noisy())
    newton, found = vary_projected(microfacet_unknowns(), data)
    simplex, twin = vary_projected(microfacet_unknowns(), data, 1, "simplex")
    assert int(simplex.solution.steps) > int(newton.solution.steps)
    np.testing.assert_allclose(simplex.solution.cost, newton.solution.cost, rtol=1e-8)
    np.testing.assert_allclose(twin.numbers["sigma"], found.numbers["sigma"], rtol=1e-4)
    np.testing.assert_allclose(twin.numbers["mu"], found.numbers["mu"], rtol=1e-4)


FIXED = {
    "kd and mu": microfacet_unknowns(kd=fixed(*KD), mu=fixed(MU)),
    "ks and sigma": microfacet_unknowns(ks=fixed(KS[0]), sigma=fixed(SIGMA)),
}


@pytest.mark.parametrize("name", FIXED)
def test_what_is_fixed_stays_and_the_rest_is_found(name):
    clean = toy_radiance(MODEL, KD, KS, SIGMA, MU)
    fit, found = vary_projected(FIXED[name], toy_data(clean), starts=1)
    assert bool(fit.solution.converged)
    np.testing.assert_allclose(found.kd, KD, rtol=RECOVERED)
    np.testing.assert_allclose(found.ks, KS, rtol=RECOVERED)
    np.testing.assert_allclose(found.numbers["sigma"], SIGMA, rtol=RECOVERED)
    np.testing.assert_allclose(found.numbers["mu"], MU, rtol=RECOVERED)


def test_free_gains_and_a_free_scale_are_found_again():
    frame = np.arange(60) % 3
    gains = np.array([1.0, 1.7, 0.6])
    radiance = 3.7 * toy_radiance(MODEL, KD, KS, SIGMA, MU) * gains[frame][:, None]
    unknowns = microfacet_unknowns(free_gains=3, free_scale=True)
    _, found = vary_projected(unknowns, toy_data(radiance, frame=frame), starts=1)
    # Neither kd nor ks is fixed: the gauge is a mean kd + ks of one.
    total = np.mean(KD + KS)
    np.testing.assert_allclose(found.gains, gains, rtol=RECOVERED)
    np.testing.assert_allclose(found.numbers["sigma"], SIGMA, rtol=RECOVERED)
    np.testing.assert_allclose(np.mean(found.kd + found.ks), 1, rtol=RECOVERED)
    np.testing.assert_allclose(found.kd, KD / total, rtol=RECOVERED)
    np.testing.assert_allclose(found.scale, 3.7 * total, rtol=RECOVERED)


def test_a_free_scale_is_gauged_by_what_is_fixed():
    radiance = 3.7 * toy_radiance(MODEL, KD, KS, SIGMA, MU)
    unknowns = microfacet_unknowns(kd=fixed(*KD), sigma=fixed(SIGMA), mu=fixed(MU), free_scale=True)
    _, found = vary_projected(unknowns, toy_data(radiance), starts=1)
    np.testing.assert_allclose(found.kd, KD, rtol=RECOVERED)
    np.testing.assert_allclose(found.ks, KS, rtol=RECOVERED)
    np.testing.assert_allclose(found.scale, 3.7, rtol=RECOVERED)


def test_an_active_bound_of_ks_is_met_exactly():
    radiance, bound = noisy(), 0.1
    unknowns = microfacet_unknowns(ks=Unknown(upper=bound), mu=fixed(MU))
    fit, found = vary_projected(unknowns, toy_data(radiance), starts=1)
    np.testing.assert_array_equal(found.ks, bound)

    def misfit(x):
        return (toy_radiance(MODEL, x[:3], np.full(3, bound), np.exp(x[3]), MU) - radiance).ravel()

    expected = least_squares(misfit, [0.1, 0.1, 0.1, np.log(0.2)], xtol=1e-14, ftol=1e-14)
    np.testing.assert_allclose(fit.solution.cost, expected.cost, rtol=1e-7)
    np.testing.assert_allclose(found.kd, expected.x[:3], rtol=1e-4)


def test_kd_is_never_negative():
    radiance = toy_radiance(MODEL, [0.2, 0.1, -0.05], KS, SIGMA, MU)
    _, found = vary_projected(microfacet_unknowns(), toy_data(radiance), starts=1)
    assert float(found.kd[2]) == 0
    assert np.all(np.asarray(found.kd)[:2] > 0.05)


def test_the_best_start_wins():
    data = toy_data(noisy())
    unknowns = microfacet_unknowns()
    problem = Problem.of(unknowns, 3)
    starts = np.stack(
        [unknowns.pack({"sigma": 0.9, "mu": 5.5}), unknowns.pack({"sigma": 0.15, "mu": 1.5})]
    )
    both = search(problem, MODEL, data, starts)
    alone = [float(search(problem, MODEL, data, start[None]).solution.cost) for start in starts]
    assert float(both.solution.cost) == min(alone)


@pytest.mark.slow
def test_single_precision_runs_and_agrees():
    radiance = noisy()
    _, double = vary_projected(microfacet_unknowns(), toy_data(radiance))
    unknowns = microfacet_unknowns()
    # As with x64 off; the solvers' own constants follow that switch.
    with jax.enable_x64(False):
        data = toy_data(radiance.astype(np.float32))._replace(frame=np.zeros(60, np.int32))
        problem = Problem.of(unknowns, 3, np.float32)
        start = unknowns.pack({"sigma": 0.2, "mu": 1.5}).astype(np.float32)[None]
        fit = search(problem, toy_model(dtype=np.float32), data, start)
        found = to_parameters(problem, fit.solution.point, fit.linear.eliminated)
    assert fit.predicted.dtype == np.float32
    # The square root of single precision, times the problem's condition of some ten.
    np.testing.assert_allclose(found.numbers["sigma"], double.numbers["sigma"], rtol=3e-3)
    np.testing.assert_allclose(found.kd, double.kd, rtol=3e-3)


def test_cost_is_half_the_weighted_squares():
    radiance = noisy()
    data = toy_data(radiance, np.full_like(radiance, 2.0))
    unknowns = microfacet_unknowns(kd=fixed(*KD), ks=fixed(KS[0]))
    point = jnp.asarray(unknowns.pack({"sigma": SIGMA, "mu": MU}))
    expected = 2 * np.sum((radiance - toy_radiance(MODEL, KD, KS, SIGMA, MU)) ** 2)
    assert float(cost_at(Problem.of(unknowns, 3), MODEL, data, point)) == pytest.approx(expected)


def test_condensed_residuals_have_the_same_squares_and_slopes_and_predict_the_same():
    data = toy_data(noisy(), np.random.default_rng(2).uniform(0.1, 3, (60, 3)))
    unknowns = microfacet_unknowns()
    args = Objective(Problem.of(unknowns, 3), MODEL, data)
    point = jnp.asarray(unknowns.pack({"sigma": 0.22, "mu": 1.4}))

    @jax.jit
    def normal_equations(point):
        found = []
        for form in (residuals, condensed_residuals):
            value, explained = form(point, args)
            slope, _ = jax.jacfwd(form, has_aux=True)(point, args)
            squares = value @ value, slope.T @ value, slope.T @ slope
            found.append((*squares, explained.linear.amplitudes, explained.predicted))
        return found

    for full, few in zip(*normal_equations(point)):
        np.testing.assert_allclose(few, full, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.3])
def test_a_part_of_many_samples_leads_where_all_of_them_lead(noise):
    """Thousands of samples take the short way, whose end is within a tenth of a standard error."""
    model = toy_model(count=5000, seed=4)
    clean = toy_radiance(model, KD, KS, SIGMA, MU)
    radiance = clean * (1 + noise * np.random.default_rng(5).normal(size=clean.shape))
    unknowns = microfacet_unknowns()
    problem, data = Problem.of(unknowns, 3), toy_data(radiance)
    short = search(problem, model, data, unknowns.starts(3))
    start = unknowns.pack({"sigma": SIGMA, "mu": MU})[None]
    # The simplex knows no short way.
    long = search(problem, model, data, start, "simplex")
    assert bool(short.solution.converged)
    ends = [to_parameters(problem, f.solution.point, f.linear.eliminated) for f in (short, long)]
    for name in ("sigma", "mu"):
        np.testing.assert_allclose(*(end.of(name) for end in ends), rtol=3e-4)
    np.testing.assert_allclose(ends[0].kd, ends[1].kd, rtol=3e-4)
    np.testing.assert_allclose(short.predicted, long.predicted, rtol=1e-3)


@pytest.mark.slow
def test_where_the_short_way_does_not_settle_the_long_one_is_taken(monkeypatch):
    model = toy_model(count=5000, seed=4)
    radiance = toy_radiance(model, KD, KS, SIGMA, MU)
    unknowns = microfacet_unknowns()
    problem, data = Problem.of(unknowns, 3), toy_data(radiance)
    monkeypatch.setattr(searches, "_LAST_STEPS", 0)
    fit = search(problem, model, data, unknowns.starts(2))
    assert bool(fit.solution.converged)
    np.testing.assert_allclose(
        unknowns.unpack(fit.solution.point).numbers["sigma"], SIGMA, rtol=1e-6
    )


def test_wrong_names_and_numbers_are_refused():
    with pytest.raises(ValueError, match="choose one of variable-projection, simplex"):
        vary_projected(microfacet_unknowns(), toy_data(noisy()), method="guess")
    with pytest.raises(ValueError, match="give one value or 3"):
        Problem.of(microfacet_unknowns(kd=fixed(0.1, 0.2)), 3)
