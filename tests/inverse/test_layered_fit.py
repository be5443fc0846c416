"""The materials of renderers from photographs by an integral of their own.

- All free numbers are found within their stated errors; what is settled stays so and has none.
- A share that ends at 0 is a value, and no bound that stands in the way; how far it may lie from
  there is what fits say in which it is held there.
- A coat over the base is found where it is freed.
- The clear interface is as bright as physics says: under light that is known up to a factor, base
  color and factor are both found.
- Derivatives by what is settled are not made.
- Where the surface has another lobe, that is what is named, and the stated errors grow.
"""

import numpy as np
import pytest
from ball_problems import CLEAN, KNOWN, PHOTOGRAPHS
from inverse_problems import ball_samples, known_light, photograph, with_noise

from jaxrender.brdf import MetallicRoughness, OpenPBR, Principled
from jaxrender.geometry import Sphere
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, Outcome, Stated, fit_brdf, unknowns_of
from jaxrender.inverse.models import LinearisedModel

STATED_ERRORS = 3.5
COLOR, CLEAR = np.array([0.6, 0.35, 0.15]), np.ones(3)
SETTINGS = FitSettings(starts=2, diagnose=False)
GLTF = MetallicRoughness(COLOR, CLEAR, 0.6, 0.4)


def found(truth, free=(), scale=1.0, **options):
    samples = ball_samples()
    photographs = with_noise(photograph(truth, *samples))
    photographs = photographs._replace(radiance=scale * np.asarray(photographs.radiance))
    unknowns = unknowns_of(truth, dict.fromkeys(free, Stated()), **options)
    return fit_brdf(photographs, known_light(), unknowns, truth, SETTINGS)


def off(fit, name, true):
    value = np.asarray(fit.parameters.value.of(name))
    error = np.asarray(fit.parameters.standard_error.of(name))
    assert np.all(error > 0), name
    return np.max(np.abs(value - true) / error)


def test_metallic_roughness_is_found():
    fit = found(GLTF)
    assert fit.outcome is Outcome.CONVERGED
    for name, true in {"base_color": COLOR, "metallic": 0.6, "roughness": 0.4}.items():
        assert off(fit, name, true) < STATED_ERRORS
    assert float(fit.brdf.ior) == 1.5
    assert np.all(np.asarray(fit.parameters.standard_error.of("interface")) == 0)


@pytest.mark.slow
def test_a_share_that_ends_at_nothing_is_a_value():
    fit = found(MetallicRoughness(COLOR, CLEAR, 0.0, 0.4))
    assert fit.outcome is Outcome.CONVERGED
    assert float(fit.brdf.metallic) < 0.01
    # The interval begins at the end, and is as wide as where there is some metal.
    low, high = (float(b.of("metallic")) for b in (fit.parameters.lower, fit.parameters.upper))
    little = found(MetallicRoughness(COLOR, CLEAR, 0.05, 0.4))
    error = float(little.parameters.standard_error.of("metallic"))
    assert low == 0 < high
    assert 0.3 * error < high < 3 * error
    assert off(fit, "base_color", COLOR) < STATED_ERRORS


@pytest.mark.slow
def test_the_reach_of_a_share_at_its_end_is_that_of_fits_in_which_it_is_held():
    """A smaller index than is supposed reflects less, as if there were less metal than none."""
    truth = MetallicRoughness(COLOR, CLEAR, 0.0, 0.4, ior=1.48)
    photographs = with_noise(photograph(truth, *ball_samples()))
    settings = SETTINGS._replace(noise=NoiseModel(0.01, 0.0))

    def fitted(**stated):
        unknowns = unknowns_of(GLTF, stated)
        return fit_brdf(photographs, known_light(), unknowns, GLTF, settings)

    def cost(metallic):
        end = fitted(metallic=Stated(fixed=metallic)).final
        left = end.data.weights * (end.data.radiance - np.asarray(end.fit.predicted))
        return float(np.sum(left**2) / 2)

    free = fitted()
    assert float(free.brdf.metallic) < 1e-4
    exact = free.parameters.if_exact
    assert float(exact.lower.of("metallic")) == 0
    high = float(exact.upper.of("metallic"))
    tried = np.array([0.0, high, 2 * high])
    costs = np.array([cost(one) for one in tried])
    # The wrong index leaves more than the noise, which counts as noise here.
    parabola = np.polyfit(tried, costs / max(2 * costs[0] / photographs.radiance.size, 1), 2)
    grid = np.linspace(0, 6 * high, 2000)
    likelihood = np.exp(np.polyval(parabola, 0) - np.polyval(parabola, grid))
    held = np.cumsum(likelihood) / np.sum(likelihood)
    assert grid[np.searchsorted(held, 0.9)] == pytest.approx(high, rel=0.1)
    # Samples that err together make the stated reach longer.
    assert float(free.parameters.upper.of("metallic")) > high


@pytest.mark.slow
def test_a_coat_is_found():
    coat = {"coat_weight": 0.7, "coat_roughness": 0.3}
    fit = found(OpenPBR(COLOR, CLEAR, 0.3, 0.75, **coat), coat)
    for name, true in {"base_color": COLOR, "specular_roughness": 0.75, **coat}.items():
        assert off(fit, name, true) < STATED_ERRORS


@pytest.mark.slow
def test_sheen_is_found():
    truth = Principled(COLOR, CLEAR, 0.3 * CLEAR, 0 * CLEAR, 0.2, 0.5)
    fit = found(truth, ("sheen",))
    for name, true in {"base_color": COLOR, "sheen": 0.3, "metallic": 0.2}.items():
        assert off(fit, name, true) < STATED_ERRORS


@pytest.mark.slow
def test_the_interface_tells_how_bright_the_light_is():
    fit = found(GLTF, scale=1.7, free_scale=True)
    assert off(fit, "base_color", COLOR) < STATED_ERRORS
    assert float(fit.parameters.value.scale) == pytest.approx(1.7, rel=0.02)


@pytest.fixture(scope="module")
def other_facets():
    """Photographs of the thesis's facets, fitted as the material of glTF."""
    rng = np.random.default_rng(1)
    pool = CLEAN._replace(radiance=PHOTOGRAPHS * (1 + 0.01 * rng.normal(size=PHOTOGRAPHS.shape)))
    settings = FitSettings(starts=2, refine_samples=600)
    return fit_brdf(pool, KNOWN, unknowns_of(GLTF), GLTF, settings, shape=Sphere(), pool=pool)


@pytest.mark.slow
def test_another_lobe_is_named(other_facets):
    assert other_facets.outcome is Outcome.MISFIT
    assert other_facets.diagnosis[0].cause == "lobe"


@pytest.mark.slow
def test_errors_grow_with_what_is_wrong(other_facets):
    wide, exact = other_facets.parameters, other_facets.parameters.if_exact
    for name in ("base_color", "roughness"):
        grown = np.asarray(wide.standard_error.of(name)) / exact.standard_error.of(name)
        assert np.all(grown > 1.5)


def test_what_is_settled_has_no_derivatives(monkeypatch):
    seen = set()
    about = LinearisedModel.about.__func__

    def watched(cls, model, numbers, by=None):
        seen.add(tuple(numbers if by is None else by))
        return about(cls, model, numbers, by)

    monkeypatch.setattr(LinearisedModel, "about", classmethod(watched))
    found(GLTF)
    assert seen == {("roughness", "metallic"), ()} or seen == {("roughness", "metallic")}
