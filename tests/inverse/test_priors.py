"""What is known of a number beforehand, as a normal distribution.

- The posterior of a linear amplitude is the closed form of two normal distributions.
- A number that the photographs say nothing of keeps its prior, mean and error, and says so.
- A prior that contradicts the photographs is named, and its number is not called identifiable.
- A wide prior changes nothing.
- Priors that contradict what else is stated are refused by the number's name.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import ball_samples, known_light, photograph, with_noise

from jaxrender.brdf import Microfacet
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    Outcome,
    Prior,
    Stated,
    fit_brdf,
    unknowns_of,
)
from jaxrender.inverse.factorization import known_of
from jaxrender.lighting import DirectionalSources, Environment

KD, KS, SIGMA, MU = np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.16, 1.62
TRUTH = Microfacet(KD, KS, SIGMA, MU)
NOISE = NoiseModel(0.01, 0.002)
SETTINGS = FitSettings(starts=2, noise=NOISE)


@pytest.fixture(scope="module")
def photographs():
    return with_noise(photograph(TRUTH, *ball_samples()), NOISE.relative, NOISE.floor)


def fitted(photographs, light=None, **priors):
    stated = {name: Stated(prior=Prior(*prior)) for name, prior in priors.items()}
    unknowns = unknowns_of(TRUTH, stated)
    return fit_brdf(photographs, light or known_light(), unknowns, TRUTH, SETTINGS)


def found_of(fit, name):
    """The value, and its error if the model is exact, as it is here."""
    exact = fit.parameters.if_exact
    return np.asarray(exact.value.of(name)), np.asarray(exact.standard_error.of(name))


@pytest.fixture(scope="module")
def free(photographs):
    return fitted(photographs)


@pytest.mark.parametrize(
    "name", ["sigma", *(pytest.param(n, marks=pytest.mark.slow) for n in ("ks", "mu"))]
)
def test_two_normal_distributions_make_one(name, photographs, free):
    """By how much each is sure: all other numbers follow, as their covariance asks."""
    value, error = (np.max(part) for part in found_of(free, name))
    prior = (value + 2 * error, error)
    found, spread = (np.max(part) for part in found_of(fitted(photographs, **{name: prior}), name))
    assert found == pytest.approx(value + error, abs=0.15 * error)
    assert spread == pytest.approx(error / np.sqrt(2), rel=0.05)


@pytest.mark.parametrize(
    ("off", "contradicts"), [pytest.param(2, False, marks=pytest.mark.slow), (12, True)]
)
def test_a_prior_that_contradicts_the_photographs_is_said_to(off, contradicts, photographs, free):
    value, error = (float(part) for part in found_of(free, "sigma"))
    fit = fitted(photographs, sigma=(value + off * error, error))
    said = [reason for reason in fit.reasons if "off its prior: one of the two is wrong" in reason]
    assert bool(said) == contradicts
    assert fit.identifiable["sigma"] != contradicts
    # The distance is that of two normal distributions of one error each.
    assert not said or said[0].startswith(f"sigma in the photographs is {off / np.sqrt(2):.0f} ")


@pytest.mark.slow
def test_a_wide_prior_changes_nothing(photographs, free):
    fit = fitted(photographs, sigma=(0.2, 50.0), kd=(0.1, 100.0))
    for name in ("kd", "ks", "sigma", "mu"):
        (value, error), (before, _) = found_of(fit, name), found_of(free, name)
        assert np.all(np.abs(value - before) < 0.01 * error)


@pytest.mark.slow
def test_what_the_photographs_do_not_say_stays_the_prior():
    # Under uniform light seen head-on nothing tells the index from ks.
    light = KnownLight(Environment(np.ones((16, 32, 3))), DirectionalSources.none())
    even = lambda directions: jnp.ones((len(directions), 3))  # noqa: E731
    seen = photograph(TRUTH, *ball_samples(lowest_cosine=0.8), even, None)
    seen = with_noise(seen, NOISE.relative, NOISE.floor)
    fit = fitted(seen, light, sigma=(0.16, 0.004), mu=(1.6, 0.05), ks=(0.21, 0.005))
    value, error = found_of(fit, "sigma")
    assert abs(value - 0.16) < 0.004
    assert error == pytest.approx(0.004, rel=0.1)
    assert not fit.identifiable["sigma"]
    assert fit.outcome is Outcome.NOT_IDENTIFIABLE
    assert any(reason.startswith("sigma is what its prior says") for reason in fit.reasons)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (Stated(fixed=0.1, prior=Prior(0.1, 0.01)), "sigma: a fixed value needs no prior"),
        (Stated(bounds=(0.2, 0.3), prior=Prior(0.1, 0.01)), "sigma: prior mean 0.1 is outside"),
        (Stated(prior=Prior(0.1, 0.0)), "sigma: prior standard deviation 0: give a number above 0"),
    ],
)
def test_contradictions_are_refused(stated, said):
    with pytest.raises(ValueError, match=said):
        unknowns_of(TRUTH, {"sigma": stated})


def test_priors_are_refused_where_no_fit_asks_for_them(photographs):
    unknowns = unknowns_of(TRUTH, {"sigma": Stated(prior=Prior(0.1, 0.01))})
    with pytest.raises(ValueError, match=r"sigma has a prior; .* under known light"):
        known_of(unknowns, TRUTH)
    scaled = unknowns_of(TRUTH, {"kd": Stated(prior=Prior(0.1, 0.01))}, free_scale=True)
    with pytest.raises(ValueError, match="kd has a prior, but the light is known up to a factor"):
        fit_brdf(photographs, known_light(), scaled, TRUTH, SETTINGS)
