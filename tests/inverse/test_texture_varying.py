"""A sigma that varies over the surface: a field of control points, and a width for each sample.

- The field's weights sum to one, follow any plane exactly, and live on flat and straight surfaces.
- A sigma for each sample gives every model what it gives one sample by itself.
- That it is found from photographs, with its texture, is tested where ``task: texture`` is.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import known_light, microfacet_unknowns
from texture_problems import samples_of, views

from jaxrender.brdf import Lambertian, Microfacet
from jaxrender.inverse import Observations
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import DualModel, ExactModel, LinearisedModel
from jaxrender.inverse.stated import Unknown
from jaxrender.inverse.texture import SigmaField, TextureSettings, recover_texture
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import (
    FACETS,
    DualLight,
    dual_columns,
    integral_columns,
)


@pytest.fixture(scope="module")
def scene():
    """Samples of white photographs, their sites, and where those lie."""
    samples, frame, site = samples_of(views(8, 24))
    places = np.full((site.max() + 1, 3), np.nan)
    for number in np.unique(site):
        places[number] = samples.normals[site == number].mean(axis=0)
    return Observations(samples, np.ones((len(site), 3)), frame), site, places


def test_a_field_follows_what_is_linear_in_space():
    rng = np.random.default_rng(0)
    places = rng.normal(size=(200, 3))
    places[7] = np.nan
    field = SigmaField.over(places, 12)
    known = np.isfinite(places).all(axis=1)
    np.testing.assert_allclose(field.weights[known].sum(axis=1), 1)
    assert not field.weights[7].any()
    # The control points are sites, and have weight one of themselves.
    own = [int(np.argmax(field.weights[:, k])) for k in range(12)]
    points = places[own]
    np.testing.assert_allclose(field.weights[own], np.eye(12), atol=1e-9)
    np.testing.assert_allclose(field.weights[known] @ points, places[known], atol=1e-9)


@pytest.mark.parametrize("axes", [1, 2])
def test_flat_and_straight_surfaces(axes):
    rng = np.random.default_rng(1)
    places = rng.normal(size=(50, axes)) @ rng.normal(size=(axes, 3))
    field = SigmaField.over(places, 6)
    np.testing.assert_allclose(field.weights.sum(axis=1), 1)


def test_neighbours_hold_together():
    places = np.random.default_rng(2).normal(size=(100, 3))
    field = SigmaField.over(places, 9)
    assert set(field.pairs.ravel()) == set(range(9))
    unknowns = field.unknowns(microfacet_unknowns(), np.arange(100))
    even = unknowns.spread(microfacet_unknowns().pack({"sigma": 0.2, "mu": 1.5}))
    np.testing.assert_allclose(unknowns.steps(jnp.asarray(even)), 0, atol=1e-12)
    np.testing.assert_allclose(unknowns.unpack(jnp.asarray(even)).numbers["sigma"], 0.2, rtol=1e-9)
    assert len(unknowns.names) == len(even) == 10


def test_impossible_fields_are_refused():
    places = np.random.default_rng(3).normal(size=(5, 3))
    with pytest.raises(ValueError, match="6 control points of sigma for 5 sites"):
        SigmaField.over(places, 6)
    with pytest.raises(ValueError, match="one place"):
        SigmaField.over(np.ones((5, 3)), 3)


def test_what_cannot_vary_is_refused(scene):
    observations, site, places = scene
    field = SigmaField.over(places, 4)
    lobe = Microfacet(np.ones(3), np.ones(3), 0.2, 1.5)
    args = (observations, site, len(places), known_light(16), lobe)
    fixed = microfacet_unknowns(sigma=Unknown(fixed=(0.2,)))
    with pytest.raises(ValueError, match="sigma is fixed, but it is to vary"):
        recover_texture(*args, unknowns=fixed, field=field)
    with pytest.raises(ValueError, match="on the integral alone"):
        recover_texture(*args, field=field, settings=TextureSettings(exact_samples=0))


@pytest.mark.slow
def test_a_sigma_for_each_sample(scene):
    """Every model, against one sample after the other."""
    few = scene[0].take(np.array([0, 500, 1100]))
    lobe = Microfacet(np.ones(3), np.ones(3), 0.2, 1.5, "half", "smith")
    sigma, mu = jnp.linspace(0.1, 0.3, few.count), jnp.asarray(1.6)
    nodes = exact_nodes(known_light(8), few.frame, 0.2)
    slow = np.random.default_rng(0).normal(size=(25, 3))
    sources = DirectionalSources(np.array([[0.0, 0.6, 0.8]]), np.ones((1, 3)))
    dual = DualLight(slow, sources)
    for model_of in (
        lambda seen: ExactModel(lobe, seen.samples, nodes),
        lambda seen: DualModel(lobe, seen.samples, dual, None, FACETS),
    ):
        together = model_of(few).columns({"sigma": sigma, "mu": mu})
        moved = LinearisedModel.about(model_of(few), {"sigma": sigma, "mu": mu}).columns(
            {"sigma": sigma + 1e-4, "mu": mu}
        )
        for k in range(few.count):
            one = model_of(few.take(np.array([k])))
            alone = one.columns({"sigma": sigma[k], "mu": mu})
            np.testing.assert_allclose(together.diffuse[k], alone.diffuse[0], rtol=1e-10)
            np.testing.assert_allclose(together.specular[k], alone.specular[0], rtol=1e-10)
            own = one.columns({"sigma": sigma[k] + 1e-4, "mu": mu}).specular
            np.testing.assert_allclose(moved.specular[k], own[0], rtol=1e-4)


def test_only_facets_with_a_lobe_have_widths(scene):
    samples = scene[0].take(np.arange(4)).samples
    sources = DirectionalSources(np.array([[0.0, 0.6, 0.8]]), np.ones((1, 3)))
    light, widths = DualLight(np.ones((4, 3)), sources), np.full(4, 0.2)
    lobe = Microfacet(np.ones(3), np.ones(3), 0.2, 1.5)
    with pytest.raises(ValueError, match="lobes of one width: choose 'facets'"):
        dual_columns(lobe, samples, light, widths=widths)
    with pytest.raises(ValueError, match="only a parametric BRDF has a width"):
        integral_columns(Lambertian(np.ones(3)), samples, sources.nodes(), widths=widths)
