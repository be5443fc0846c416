"""Camera to image: the same radiance whatever the batches, in the right pixels.

- Batches, full or not, and the samples beside them change nothing; no samples give none.
- The exact model adds lobes and nodes; the dual model of pure sources is the exact one.
- The image has the radiance of each pixel's own sample, and zero where the ray missed.
- Compiled as a whole, in several batches, it is the same image; its derivatives by material,
  normals and light, forward and reverse, are differences of the images themselves.
"""

import importlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reflection_problems import DISCS, microfacet, random_samples

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Orthographic, Sphere, SurfaceSamples, observe
from jaxrender.lighting import DirectionalSources, LightNodes, SmoothLobes
from jaxrender.reflection import (
    DualForward,
    ExactForward,
    dual_light,
    integral_columns,
    polar_columns,
    radiance,
    render,
    render_samples,
    render_view,
    sensitivities,
)

BRDF = microfacet(0.2)
SOURCES = DirectionalSources(
    np.array([direction for direction, _, _ in DISCS]),
    np.array([[irradiance, 0.5 * irradiance, 1.0] for _, _, irradiance in DISCS]),
)
SMOOTH = SmoothLobes(np.array([[0.2, 0.1, 1.0]]), np.array([0.8]), np.ones((1, 3)))
NODES = LightNodes(*(np.asarray(array) for array in SOURCES.nodes()))
# The same sums in another order.
ROUNDING = 1e-12


@pytest.fixture
def small_batches(monkeypatch):
    """Batches of 8 samples, so that a handful makes several."""
    # By its full name: the package's own `render` is the function.
    module = importlib.import_module("jaxrender.reflection.render")
    monkeypatch.setattr(module, "_PIXELS_AT_ONCE", 8)


def test_batches_change_nothing(small_batches):
    samples = random_samples(21)
    expected = radiance(BRDF, integral_columns(BRDF, samples, NODES))
    found = render_samples(BRDF, samples, ExactForward(NODES))
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)
    for count in (1, 8, 16):
        few = SurfaceSamples(samples.normals[:count], samples.outgoing[:count])
        some = render_samples(BRDF, few, ExactForward(NODES))
        np.testing.assert_array_equal(some, found[:count])


def test_no_samples_give_none():
    nothing = SurfaceSamples(np.zeros((0, 3)), np.zeros((0, 3)))
    assert render_samples(BRDF, nothing, ExactForward(NODES)).shape == (0, 3)


def test_lobes_are_added_to_nodes(small_batches):
    samples = random_samples(5)
    smooth = polar_columns(BRDF, samples, SMOOTH.radiance, 24)
    expected = radiance(BRDF, integral_columns(BRDF, samples, NODES) + smooth)
    found = render_samples(BRDF, samples, ExactForward(NODES, SMOOTH, 24))
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)


def test_the_dual_model_of_sources_is_exact(small_batches):
    samples = random_samples(5)
    dual = DualForward(dual_light(None, SOURCES, 0))
    np.testing.assert_allclose(
        render_samples(BRDF, samples, dual),
        render_samples(BRDF, samples, ExactForward(NODES)),
        rtol=ROUNDING,
        atol=ROUNDING,
    )


def test_every_pixel_has_its_own_radiance(small_batches):
    pose = np.eye(4)
    pose[:3, 3] = [0.1, -0.2, 5]
    camera = Orthographic(7, 6, pose, scale=0.4)
    ball = Sphere(np.zeros(3), 1.0)
    view, model = observe(camera, ball), ExactForward(NODES)
    assert 5 < view.hit.sum() < 30
    image = render(BRDF, camera, ball, model)
    np.testing.assert_array_equal(image, render_view(BRDF, view, model))
    np.testing.assert_array_equal(image[~view.hit], 0)
    for row, column in np.argwhere(view.hit):
        one = SurfaceSamples(view.normals[row, column][None], view.outgoing[row, column][None])
        alone = render_samples(BRDF, one, model)
        np.testing.assert_allclose(image[row, column], alone[0], rtol=ROUNDING)


POSE = np.array([[1, 0, 0, 0.1], [0, 1, 0, -0.2], [0, 0, 1, 5], [0, 0, 0, 1.0]])
VIEW = observe(Orthographic(5, 5, POSE, scale=0.3), Sphere(np.zeros(3), 1.0))


def image_of(unknowns):
    """Render from plain arrays: amplitudes, sigma and mu, normals, directions and irradiance."""
    ks, roughness, normals, directions, irradiance = unknowns
    brdf = Microfacet(0.3 * ks, ks, *roughness)
    light = ExactForward(LightNodes(*DirectionalSources(directions, irradiance).nodes()), SMOOTH, 8)
    return render_view(brdf, VIEW._replace(normals=normals), light)


def moved(unknowns, moves, step):
    return jax.tree.map(lambda value, move: value + step * move, unknowns, moves)


def test_compiled_images_are_those_of_the_host_and_differentiable(small_batches):
    unknowns = (
        np.array([0.3, 0.5, 0.7]),
        np.array([0.3, 1.5]),
        VIEW.normals,
        np.asarray(SOURCES.directions),
        np.asarray(SOURCES.irradiance),
    )
    rng = np.random.default_rng(3)
    moves = jax.tree.map(lambda value: rng.normal(size=value.shape), unknowns)

    @jax.jit
    def both(unknowns, moves):
        value, forward = jax.jvp(image_of, (unknowns,), (moves,))
        weights = jnp.sin(jnp.arange(value.size, dtype=value.dtype)).reshape(value.shape)
        slopes = jax.vjp(image_of, unknowns)[1](weights)[0]
        products = jax.tree.map(lambda slope, move: jnp.sum(slope * move), slopes, moves)
        return value, forward, jnp.sum(weights * forward), sum(products)

    value, forward, *sums = both(unknowns, moves)
    assert isinstance(image_of(unknowns), np.ndarray)
    np.testing.assert_allclose(value, image_of(unknowns), rtol=ROUNDING)
    assert sums[0] == pytest.approx(float(sums[1]), rel=1e-9)
    step = 1e-5
    change = image_of(moved(unknowns, moves, step)) - image_of(moved(unknowns, moves, -step))
    np.testing.assert_allclose(forward, change / (2 * step), rtol=1e-5, atol=1e-6)


def test_sensitivities_are_compiled_too(small_batches):
    model = ExactForward(NODES)
    found = eqx.filter_jit(lambda brdf: sensitivities(brdf, VIEW, model))(BRDF)
    np.testing.assert_allclose(found, sensitivities(BRDF, VIEW, model), rtol=1e-9, atol=ROUNDING)


def test_no_samples_give_none_when_compiled():
    nothing = SurfaceSamples(np.zeros((0, 3)), np.zeros((0, 3)))
    found = eqx.filter_jit(render_samples)(BRDF, nothing, ExactForward(NODES))
    assert found.shape == (0, 3)
