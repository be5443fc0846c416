"""A material in the words of its model: the correlations of what was free, and nothing else."""

import jax
import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.inverse.intervals import intervals
from jaxrender.inverse.own_words import OwnWords
from jaxrender.inverse.parameters import Parameters

MATERIAL = Microfacet(np.array([0.1, 0.2, 0.3]), np.full(3, 0.1), 0.2, 1.5)
VALUE = Parameters(
    {"kd": np.asarray(MATERIAL.kd), "ks": np.asarray(MATERIAL.ks)},
    {"mu": np.array(1.5), "sigma": np.array(0.2)},
    np.ones(2),
    np.array(1.0),
)
# kd and ks of three channels, mu, sigma, two gains, the scale.
COUNT = 11


def uncertain(covariance):
    error = jax.tree.map(np.zeros_like, VALUE)
    return intervals(VALUE, error, {"sigma": 0.0, "mu": 1.0}, covariance)


def drawn(shared_ks, held=()):
    """Draw unknowns that hang together in a known way, and take their covariance."""
    rng = np.random.default_rng(0)
    draws = rng.normal(size=(4000, COUNT)) @ rng.normal(size=(COUNT, COUNT))
    if shared_ks:
        draws[:, 3:6] = draws[:, 3:4]
    draws[:, list(held)] = 0
    return draws, np.cov(draws.T)


@pytest.mark.parametrize("shared", [False, True])
def test_correlations_are_those_of_draws_of_what_was_free(shared):
    # mu is held; of a shared ks only the first channel counts; gains (8, 9) stay out.
    draws, covariance = drawn(shared, held=[6])
    found = OwnWords("microfacet", MATERIAL, shared).correlations(uncertain(covariance))
    rows = [0, 1, 2, 3, 7, 10] if shared else [0, 1, 2, 3, 4, 5, 7, 10]
    ks = ["ks"] if shared else ["ks[0]", "ks[1]", "ks[2]"]
    assert found["numbers"] == ["kd[0]", "kd[1]", "kd[2]", *ks, "sigma", "scale"]
    np.testing.assert_allclose(found["matrix"], np.corrcoef(draws[:, rows].T), atol=1e-12)


def test_without_a_covariance_there_are_none():
    assert OwnWords("microfacet", MATERIAL).correlations(uncertain(None)) is None


def test_intervals_end_where_the_domain_does():
    wide = VALUE._replace(numbers={"mu": np.array(9.0), "sigma": np.array(1.4)})
    ends = {
        model: OwnWords(model, MATERIAL).intervals(VALUE, wide) for model in ("ggx", "microfacet")
    }
    assert ends["ggx"]["sigma"] == [0.2, 1.0]
    assert ends["microfacet"]["sigma"] == [0.2, 1.4]
    assert ends["ggx"]["mu"] == [1.5, 9.0]
