"""Steps of a descent that is hard: half-way between parameters, damped, and met where they swing.

- Half-way between a bound and a place inside is half-way between the parameters' logarithms.
- Two normal distributions of a number count as their product; one without precision as nothing.
- A damped fit of linearised columns goes the way of Levenberg and Marquardt: all of it without
  damping, a share 1 / (1 + damping) of a linear one, none of it in the end.
- Two lobes fitted to a surface of other lobes come to an end; so does a fit whose weights would
  follow its prediction round and round.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import (
    ball_samples,
    known_light,
    photograph,
    toy_data,
    toy_model,
    toy_radiance,
    with_noise,
)

from jaxrender.brdf import MetallicRoughness, Microfacet, OpenPBR, lobe_named
from jaxrender.inverse import FitSettings, Outcome, Stated, fit_brdf, unknowns_of
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.models import LinearisedModel
from jaxrender.inverse.priors import Priors
from jaxrender.inverse.search import search

LOBE = Microfacet(np.full(3, 0.1), np.full(3, 0.2), 0.1, 1.5)
NONE = np.zeros(0)


def test_half_way_is_between_the_parameters():
    unknowns = unknowns_of(LOBE, free_gains=2)
    inside = unknowns.pack({"sigma": 0.2, "mu": 1.5})
    edge = np.array([-1e9, inside[1], 0.4])
    middle = unknowns.unpack(jnp.asarray(unknowns.between(inside, edge)))
    lowest = unknowns["sigma"].lower
    assert float(middle.numbers["sigma"]) == pytest.approx(np.sqrt(0.2 * lowest), rel=1e-6)
    assert float(middle.numbers["mu"]) == pytest.approx(1.5, rel=1e-9)
    np.testing.assert_allclose(middle.gains, [1, np.exp(0.2)], rtol=1e-12)


def test_two_normal_distributions_count_as_their_product():
    before = Priors(("mu",), np.array([1.5]), np.array([10.0]), NONE, NONE)
    here = Priors(("mu", "sigma"), np.array([2.0, 0.3]), np.array([20.0, 5.0]), NONE, NONE)
    both = before.held_at(here)
    assert both.names == ("mu", "sigma")
    np.testing.assert_allclose(both.precisions, [np.sqrt(500), 5], rtol=1e-12)
    np.testing.assert_allclose(both.means, [(100 * 1.5 + 400 * 2) / 500, 0.3], rtol=1e-12)
    silent = Priors(("mu",), np.array([7.0]), np.zeros(1), NONE, NONE)
    np.testing.assert_allclose(before.held_at(silent).means, [1.5], rtol=1e-12)
    np.testing.assert_array_equal(silent.held_at(silent).means, [7.0])


def test_a_damped_step_is_a_share_of_the_whole():
    fixed = Stated(fixed=(0.1, 0.1, 0.1))
    unknowns = unknowns_of(LOBE, {"kd": fixed, "ks": Stated(fixed=0.2), "mu": Stated(fixed=1.5)})
    problem, model = Problem.of(unknowns, 3), toy_model()
    data = toy_data(toy_radiance(model, np.full(3, 0.1), np.full(3, 0.2), 0.2, 1.5))
    start = unknowns.pack({"sigma": 0.19})
    numbers = unknowns.unpack(jnp.asarray(start)).numbers
    near = LinearisedModel.about(model, numbers, ("sigma",))
    linear = problem.linear(jnp.zeros(0))

    def moved(damping):
        held = problem if damping is None else problem.damped(near, data, linear, damping)
        end = search(held, near, data, start[None]).solution.point
        return float(unknowns.unpack(end).numbers["sigma"] - numbers["sigma"])

    whole = moved(None)
    assert whole > 0.005
    assert moved(1.0) == pytest.approx(whole / 2, rel=1e-3)
    assert moved(3.0) == pytest.approx(whole / 4, rel=1e-3)
    assert moved(1e9) == pytest.approx(0, abs=1e-6)


@pytest.mark.slow
def test_weights_that_would_go_round_are_kept():
    """The material of glTF on facets that it has none of, with few samples to tell it."""
    facets = Microfacet(np.array([0.19, 0.11, 0.05]), np.full(3, 0.2), 0.15, 1.5)
    photographs = with_noise(photograph(facets, *ball_samples()))
    gltf = MetallicRoughness(np.full(3, 0.5), np.ones(3), 0.5, 0.4)
    settings = FitSettings(starts=2, diagnose=False)
    fit = fit_brdf(photographs, known_light(), unknowns_of(gltf), gltf, settings)
    assert fit.outcome is not Outcome.NOT_CONVERGED


@pytest.mark.slow
def test_two_lobes_come_to_an_end_on_a_surface_of_others():
    truth = OpenPBR(
        np.array([0.05, 0.2, 0.6]),
        np.ones(3),
        base_metalness=0.2,
        specular_roughness=0.5,
        coat_weight=0.5,
        coat_roughness=0.3,
    )
    photographs = with_noise(photograph(truth, *ball_samples()), 0.005)
    two = lobe_named("two-ggx")
    unknowns = unknowns_of(two, ks_per_channel=True)
    fit = fit_brdf(photographs, known_light(), unknowns, two, FitSettings(diagnose=False))
    assert fit.outcome is not Outcome.NOT_CONVERGED
