"""What the data say of slightly different models.

- Photographs made with Fresnel at the half angle reject Fresnel at the exit angle, and not the
  other way about.
- A parameter is sensitive when it moves by more than 25 % under a variant that stands.
- Every other choice of angle and masking is tried; a metal has no angle to vary.
- The one model that is compiled for all of them equals each of them.
"""

import numpy as np
import pytest
from inverse_problems import (
    ball_samples,
    known_light,
    material,
    microfacet_unknowns,
    photograph,
    with_noise,
)

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Components
from jaxrender.inverse import FitSettings, fit_brdf
from jaxrender.inverse.variants import (
    Variant,
    _others,
    _Switched,
    fit_variants,
    model_sensitive,
)

SETTINGS = FitSettings(starts=2)


@pytest.fixture(scope="module")
def variants_by_truth():
    """For either Fresnel angle as the truth: the fit with the exit angle, and its variants."""
    light, found = known_light(), {}
    for angle in ("exit", "half"):
        truth = material(mu=1.4, fresnel=angle)
        noisy = with_noise(photograph(truth, *ball_samples(lowest_cosine=0.1)), 0.002)
        fit = fit_brdf(noisy, light, microfacet_unknowns(), material(mu=1.4), SETTINGS)
        found[angle] = fit, fit_variants(fit, light, SETTINGS)
    return found


def named(variants):
    return {(variant.fresnel, variant.masking): variant for variant in variants}


@pytest.mark.slow
def test_every_other_choice_is_tried(variants_by_truth):
    _, variants = variants_by_truth["exit"]
    assert set(named(variants)) == {("exit", "smith"), ("half", "none"), ("half", "smith")}


@pytest.mark.slow
def test_the_right_model_stands_and_the_wrong_falls(variants_by_truth):
    _, variants = variants_by_truth["exit"]
    assert named(variants)["half", "none"].rejected
    _, variants = variants_by_truth["half"]
    better = named(variants)["half", "none"]
    assert not better.rejected
    # The half angle explains what the exit angle could not.
    assert better.chi_squared < -10
    assert float(better.parameters.numbers["mu"]) == pytest.approx(1.4, rel=0.05)


@pytest.mark.slow
def test_a_metal_varies_its_masking_alone(variants_by_truth):
    fit, _ = variants_by_truth["exit"]
    others = _others(fit.brdf.as_metal())
    assert [(brdf.fresnel, brdf.masking) for brdf in others] == [("exit", "smith")]


def moved(parameters, chi_squared, **factors):
    numbers = {
        name: np.asarray(value) * factors.get(name, 1.0)
        for name, value in parameters.numbers.items()
    }
    return Variant("half", "none", parameters._replace(numbers=numbers), chi_squared)


@pytest.mark.slow
def test_sensitive_is_a_quarter_under_a_variant_that_stands(variants_by_truth):
    fit, _ = variants_by_truth["exit"]
    value = fit.parameters.value
    assert model_sensitive(fit, (moved(value, 9.9, sigma=1.26),))["sigma"]
    assert not model_sensitive(fit, (moved(value, 9.9, sigma=1.24),))["sigma"]
    assert not model_sensitive(fit, (moved(value, 10.1, sigma=1.26),))["sigma"]
    # A quarter of mu - 1, not of mu.
    assert model_sensitive(fit, (moved(value, 0.0, mu=1.1),))["mu"]
    assert not model_sensitive(fit, (moved(value, 0.0, mu=1.05),))["mu"]


@pytest.mark.parametrize("distribution", ["gaussian", "beckmann", "ggx"])
@pytest.mark.parametrize("masking", ["none", "smith"])
@pytest.mark.parametrize("angle", ["exit", "half"])
def test_switches_make_every_variant(angle, masking, distribution):
    directions = np.random.default_rng(1).normal(size=(2, 50, 3))
    directions[..., 2] = np.abs(directions[..., 2])
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    incoming, outgoing = (Components.of(some) for some in directions)
    numbers = (np.array([0.2]), np.array([0.1]), 0.2, 1.4)
    brdf = Microfacet(*numbers, angle, masking, distribution)
    switched = _Switched.to(brdf).with_roughness(brdf.sigma, brdf.mu)
    np.testing.assert_allclose(
        switched.transfer(incoming, outgoing)[1], brdf.transfer(incoming, outgoing)[1], rtol=1e-12
    )
