"""Slow light over a lobe's facets: equal to the normal-centred integral, to the horizon."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import BlinnPhong, Microfacet, Ward
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import coefficient_count, degrees, real_basis
from jaxrender.lighting import DirectionalSources, Environment, candidates
from jaxrender.reflection import (
    FACETS,
    DualGoal,
    DualLight,
    dual_columns,
    facet_coefficients,
    polar_columns,
    reflect_by_facets,
    reflect_slow_light,
    sources_needed,
)

BAND_LIMIT = 10
ONES = np.ones(2)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rms(values):
    return np.sqrt(np.mean(np.asarray(values) ** 2))


@pytest.fixture(scope="module")
def samples():
    """Exit cosines from .15 to 1, one of them head-on."""
    rng = np.random.default_rng(7)
    normals = unit(rng.normal(size=(60, 3)))
    cosines = np.concatenate([[1.0], rng.uniform(0.15, 1, 59)])
    across = unit(np.cross(normals, rng.normal(size=(60, 3))))
    outgoing = cosines[:, None] * normals + np.sqrt(1 - cosines**2)[:, None] * across
    return SurfaceSamples(normals, unit(outgoing))


@pytest.fixture(scope="module")
def slow():
    rng = np.random.default_rng(8)
    light = rng.normal(size=(coefficient_count(BAND_LIMIT), 2))
    light = light / (1 + degrees(BAND_LIMIT))[:, None]
    light[0] = 3.0
    return light


@pytest.mark.parametrize(
    "kind",
    [
        Microfacet(ONES, ONES, 0.08, 1.6),
        pytest.param(Microfacet(ONES, ONES, 0.3, None, "exit", "smith"), marks=pytest.mark.slow),
        pytest.param(
            Microfacet(ONES, ONES, 0.2, 1.5, "half", "smith", "ggx"), marks=pytest.mark.slow
        ),
        pytest.param(Ward(ONES, ONES, 0.15), marks=pytest.mark.slow),
        pytest.param(BlinnPhong(ONES, ONES, 80.0), marks=pytest.mark.slow),
    ],
    ids=["gaussian", "masked", "ggx", "ward", "blinn-phong"],
)
def test_equals_the_integral_about_the_normal(samples, slow, kind):
    found = np.asarray(reflect_by_facets(kind, samples, slow))
    exact = polar_columns(kind, samples, lambda towards: real_basis(towards, BAND_LIMIT) @ slow, 96)
    exact = np.asarray(exact)[:, 1]
    assert rms(found - exact) < 1.5e-3 * rms(exact)
    assert np.abs(found - exact).max() < 1e-2 * rms(exact)


def test_equals_all_azimuthal_orders(samples, slow):
    kind = Microfacet(ONES, ONES, 0.15, 1.5)
    found = np.asarray(reflect_by_facets(kind, samples, slow))
    orders = np.asarray(reflect_slow_light(kind, samples, slow))
    assert rms(found - orders) < 1e-3 * rms(orders)


def test_coefficients_are_the_same_integral(samples, slow):
    kind = Microfacet(ONES, ONES, 0.12, 1.5)
    by_light = np.asarray(reflect_by_facets(kind, samples, slow))
    by_harmonic = np.asarray(facet_coefficients(kind, samples, BAND_LIMIT)) @ slow
    # The one interpolates the light between the rows of an image.
    assert rms(by_light - by_harmonic) < 5e-4 * rms(by_light)


@pytest.mark.parametrize("which", ["sigma", pytest.param("mu", marks=pytest.mark.slow)])
def test_derivatives(samples, slow, which):
    """The nodes follow sigma but are held still by the derivative, which must not matter."""
    numbers = {"sigma": 0.15, "mu": 1.5}

    def by_facets(value):
        return reflect_by_facets(Microfacet(ONES, ONES, **numbers | {which: value}), samples, slow)

    def about_the_normal(value):
        lobe = Microfacet(ONES, ONES, **numbers | {which: value})
        return polar_columns(lobe, samples, lambda w: real_basis(w, BAND_LIMIT) @ slow, 64)[:, 1]

    along = (jnp.asarray(numbers[which]),), (jnp.ones(()),)
    _, found = jax.jvp(by_facets, *along)
    _, exact = jax.jvp(about_the_normal, *along)
    assert rms(found - exact) < 2e-2 * rms(exact)


def test_the_split_for_facets_needs_no_source_where_light_is_slow(samples):
    """A wide glow: its azimuthal mean is off however many sources there are."""
    rows = 64
    grid = Environment(np.ones((rows, 2 * rows, 1))).grid
    glow = np.exp(3 * (grid.directions() @ unit(np.array([1.0, 1.0, 1.0])) - 1))[..., None]
    room = Environment(glow)
    lobe = Microfacet(np.ones(1), np.ones(1), 0.3, None)
    sources = candidates(room, 0.3).sources
    limit = 12
    by_mean = sources_needed(room, sources, lobe, samples, DualGoal(0.01, 64, limit))
    by_facets = sources_needed(room, sources, lobe, samples, DualGoal(0.01, 64, limit, FACETS))
    assert by_mean.error_without > 0.01
    assert by_facets.count == 0
    assert by_facets.error < 0.1 * by_mean.error_without


@pytest.mark.slow
def test_the_dual_model_filters_by_facets_where_asked(samples, slow):
    dark = DirectionalSources(np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 2)))
    kind = Microfacet(ONES, ONES, 0.2, 1.5)
    found = np.asarray(dual_columns(kind, samples, DualLight(slow, dark), FACETS))
    np.testing.assert_allclose(found[:, 1], reflect_by_facets(kind, samples, slow), rtol=1e-12)
    # The diffuse column is the same by any name.
    np.testing.assert_allclose(
        found[:, 0], dual_columns(kind, samples, DualLight(slow, dark))[:, 0], rtol=1e-12
    )
