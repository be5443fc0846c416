"""A sigma for each sample, rendered by any model: what one sample after the other gives.

Traced widths too, with derivatives; a traced light with widths that are known is interpolated as on
the host.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import DualForward, DualLight, render_samples, render_widths


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(40, 3)) + np.array([0, 0, 3.0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outgoing = np.tile([0.0, 0.0, 1.0], (40, 1))
    sources = DirectionalSources(np.array([[0.0, 0.3, 0.95]]), np.ones((1, 3)))
    light = DualLight(rng.normal(size=(16, 3)), sources)
    lobe = Microfacet(np.full(3, 0.1), np.full(3, 0.2), 0.5, 1.5)
    return SurfaceSamples(normals, outgoing), DualForward(light), lobe


def test_each_sample_has_its_own_width(scene):
    samples, model, lobe = scene
    widths = np.exp(np.random.default_rng(1).uniform(np.log(0.1), np.log(0.3), 40))
    found = render_widths(lobe, widths, samples, model)
    for k in range(40):
        alone = SurfaceSamples(samples.normals[k : k + 1], samples.outgoing[k : k + 1])
        own = render_samples(lobe.with_roughness(widths[k], lobe.mu), alone, model)
        np.testing.assert_allclose(found[k], own[0], rtol=2e-3, atol=5e-4)


def test_one_width_is_that_of_the_lobe(scene):
    samples, model, lobe = scene
    found = render_widths(lobe, np.full(40, 0.2), samples, model)
    same = render_samples(lobe.with_roughness(0.2, lobe.mu), samples, model)
    np.testing.assert_allclose(found, same, rtol=1e-12)


def test_no_samples_and_no_width(scene):
    samples, model, lobe = scene
    none = SurfaceSamples(samples.normals[:0], samples.outgoing[:0])
    assert render_widths(lobe, np.zeros(0), none, model).shape == (0, 3)
    with pytest.raises(ValueError, match="not a positive number"):
        render_widths(lobe, np.full(40, np.nan), samples, model)


def test_traced_widths_are_rendered_one_by_one(scene):
    samples, model, lobe = scene
    few = SurfaceSamples(samples.normals[:3], samples.outgoing[:3])
    widths, move = np.array([0.1, 0.2, 0.3]), np.array([1.0, -0.5, 2.0])
    compiled = jax.jit(lambda widths: render_widths(lobe, widths, few, model))

    def alone(widths):
        for k, width in enumerate(widths):
            own = SurfaceSamples(few.normals[k : k + 1], few.outgoing[k : k + 1])
            yield render_samples(lobe.with_roughness(width, lobe.mu), own, model)

    np.testing.assert_allclose(compiled(widths), np.concatenate([*alone(widths)]), rtol=1e-9)
    slope = jax.jvp(compiled, (jnp.asarray(widths),), (jnp.asarray(move),))[1]
    step = 1e-5
    change = compiled(widths + step * move) - compiled(widths - step * move)
    np.testing.assert_allclose(slope, change / (2 * step), rtol=1e-6, atol=1e-8)


def test_known_widths_under_a_traced_light(scene):
    samples, model, lobe = scene
    widths = np.linspace(0.2, 0.22, 40)

    @jax.jit
    def compiled(slow):
        light = DualLight(slow, model.light.sources)
        return render_widths(lobe, widths, samples, DualForward(light))

    expected = render_widths(lobe, widths, samples, model)
    np.testing.assert_allclose(compiled(model.light.slow), expected, rtol=1e-9, atol=1e-12)
