"""What the data say about sigma, and from where.

- The predicted error of log sigma is that of a numerical Jacobian; it scales with the weights.
- Data that say nothing give infinity; a fixed sigma has no error.
- The sentence names grazing angles only where neither the rest nor the spectrum comes close.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import microfacet_unknowns, toy_data, toy_model, toy_radiance

from jaxrender.inverse import Unknown
from jaxrender.inverse.conditioning import WidthEvidence, relative_standard_error
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.models import LinearisedModel

MODEL = toy_model(seed=5)
KD, KS, SIGMA, MU = np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.16, 1.62
UNKNOWNS = microfacet_unknowns()
PROBLEM = Problem.of(UNKNOWNS, 3)
WEIGHTS = 1 / (0.02 * toy_radiance(MODEL, KD, KS, SIGMA, MU))


def error_of_sigma(weights, near=None):
    near = (
        LinearisedModel.about(MODEL, {"sigma": jnp.asarray(SIGMA), "mu": jnp.asarray(MU)})
        if near is None
        else near
    )
    data = toy_data(toy_radiance(MODEL, KD, KS, SIGMA, MU), weights)
    at = (jnp.asarray(UNKNOWNS.pack({"sigma": SIGMA, "mu": MU})), jnp.asarray([*KD, KS[0]]))
    return relative_standard_error("sigma", PROBLEM, near, data, *at)


def test_the_error_is_that_of_a_numerical_jacobian():
    def predict(x):
        radiance = toy_radiance(MODEL, x[:3], np.full(3, x[3]), np.exp(x[4]), x[5])
        return (WEIGHTS * radiance).ravel()

    x = np.array([*KD, KS[0], np.log(SIGMA), MU])
    jacobian = np.stack(
        [(predict(x + h) - predict(x - h)) / 2e-6 for h in 1e-6 * np.eye(6)], axis=1
    )
    expected = np.sqrt(np.linalg.inv(jacobian.T @ jacobian)[4, 4])
    assert error_of_sigma(WEIGHTS) == pytest.approx(expected, rel=1e-4)
    assert error_of_sigma(WEIGHTS / 3) == pytest.approx(3 * expected, rel=1e-4)


def test_silent_data_give_infinity():
    near = LinearisedModel.about(MODEL, {"sigma": jnp.asarray(SIGMA), "mu": jnp.asarray(MU)})
    (slope,) = near.slopes["sigma"]
    slopes = {**near.slopes, "sigma": (jnp.zeros_like(slope),)}
    silent = LinearisedModel(near.at, slopes, near.numbers)
    assert error_of_sigma(WEIGHTS, silent) == np.inf


def test_a_fixed_sigma_has_no_error():
    problem = Problem.of(microfacet_unknowns(sigma=Unknown(fixed=(SIGMA,))), 3)
    near = LinearisedModel.about(MODEL, {"sigma": jnp.asarray(SIGMA), "mu": jnp.asarray(MU)})
    data = toy_data(toy_radiance(MODEL, KD, KS, SIGMA, MU), WEIGHTS)
    assert relative_standard_error("sigma", problem, near, data, jnp.zeros(1), jnp.zeros(4)) == 0


@pytest.mark.parametrize(
    ("without_grazing", "spectrum", "rests"),
    [
        (0.015, 0.012, False),
        (np.inf, 0.012, False),
        (0.015, np.inf, False),
        (0.05, 0.06, True),
        (np.inf, np.inf, True),
    ],
)
def test_grazing_is_named_where_sigma_rests_on_it(without_grazing, spectrum, rests):
    evidence = WidthEvidence(0.01, without_grazing, spectrum)
    assert evidence.rests_on_grazing == rests
    assert ("rests on grazing angles" in evidence.sentence()) == rests
    assert "1 % from all samples" in evidence.sentence()


def test_nothing_known_rests_on_nothing():
    evidence = WidthEvidence(np.inf, np.inf, np.inf)
    assert not evidence.rests_on_grazing
    assert "no information" in evidence.sentence()
    assert "grazing angles:" not in evidence.sentence()
