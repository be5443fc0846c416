"""Reflection with visibility: the integral, the dual model of T 6.12, and images.

Pinned down: the integral on a concave mesh is T 6.2 in plain loops over brute-force rays, in one
light or one for each frame; a mask of all nodes is no mask; T 6.12 is its own sum, written out,
for any degree of the transfer vectors, and each of its visibilities touches its own term; what is
traced for it are the reflected rays and the sources; on a convex object it is T 6.9; images with
shadows are the integral of every pixel, whatever the batches; derivatives and single precision.
"""

import importlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reflection_problems import lobes, microfacet, smooth_coefficients, unit_vectors

from jaxrender import reflection
from jaxrender.geometry import (
    Mesh,
    Orthographic,
    SurfacePlaces,
    SurfaceSamples,
    look_at,
    observe,
    sculpture,
    visible,
)
from jaxrender.harmonics import evaluate
from jaxrender.lighting import DirectionalSources, LightNodes
from jaxrender.reflection import (
    DualLight,
    ExactForward,
    FrameNodes,
    ShadowedForward,
    Shadows,
    cast_shadows,
    dual_light,
    integral_columns_by_frame,
    render,
    render_samples,
    render_view,
    shadowed_irradiance,
    transfer_vectors,
)
from jaxrender.reflection.dual import slow_specular

ROUNDING = 1e-12
integral_columns = eqx.filter_jit(reflection.integral_columns)
dual_columns = eqx.filter_jit(reflection.dual_columns)

STATUE = sculpture(2, seed=2)
BRDF = microfacet(0.3)
RNG = np.random.default_rng(0)
POSE = look_at(np.array([3.0, -4.0, 2.0]), np.zeros(3), np.array([0.0, 0, 1]))
VIEW = observe(Orthographic(8, 8, POSE, scale=0.3), STATUE)
PLACES = SurfacePlaces.of_views([VIEW])
SAMPLES = SurfaceSamples(VIEW.normals[VIEW.hit], VIEW.outgoing[VIEW.hit])
COUNT = len(SAMPLES.normals)
NODES = LightNodes(unit_vectors(30, 1), RNG.uniform(0, 1, (30, 3)))
SOURCES = DirectionalSources(unit_vectors(5, 2), RNG.uniform(1, 2, (5, 3)))
SLOW = smooth_coefficients()


def brute_force_sees(place, directions):
    """Which directions the sample sees, by testing every triangle."""
    point, normal = PLACES.points[place], PLACES.geometric_normals[place]
    origins = np.tile(point + 1e-4 * STATUE.diagonal() * normal, (len(directions), 1))
    free = ~STATUE.occluded_brute_force(origins, np.asarray(directions))
    return free & (directions @ normal > 0)


def column_by_hand(place, nodes):
    """T 6.2 over the nodes that brute-force rays reach."""
    column = np.zeros((2, 3))
    seen = brute_force_sees(place, nodes.directions)
    for direction, irradiance, free in zip(*nodes, seen):
        if free:
            values = lobes(BRDF, SAMPLES.normals[place], SAMPLES.outgoing[place], direction)
            column += np.outer(values, irradiance)
    return column


def some_shadows(degree=4):
    """Visibilities and transfer vectors of no shape at all: to tell the terms apart."""
    rng = np.random.default_rng(3)
    return Shadows(
        rng.normal(size=(COUNT, (degree + 1) ** 2)),
        rng.integers(0, 2, COUNT) > 0,
        rng.integers(0, 2, (COUNT, 5)).astype(float),  # 1 and 0 do as well
    )


def test_the_integral_is_the_loop_over_brute_force_rays():
    seen = visible(STATUE, PLACES, NODES.directions)
    found = np.asarray(integral_columns(BRDF, SAMPLES, NODES, seen))
    expected = np.stack([column_by_hand(place, NODES) for place in range(COUNT)])
    np.testing.assert_allclose(found, expected, atol=ROUNDING * expected.max())
    unshadowed = np.asarray(integral_columns(BRDF, SAMPLES, NODES))
    assert np.mean(np.abs(found - unshadowed).max(axis=(1, 2)) > 0.01) > 0.3


def test_a_mask_of_all_nodes_is_none():
    whole = integral_columns(BRDF, SAMPLES, NODES)
    everything = np.ones((COUNT, 30), bool)
    found = integral_columns(BRDF, SAMPLES, NODES, everything)
    np.testing.assert_allclose(found, whole, rtol=1e-14)
    dark = integral_columns(BRDF, SAMPLES, NODES, ~everything)
    np.testing.assert_array_equal(dark, np.zeros((COUNT, 2, 3)))


@pytest.mark.slow
def test_frames_have_their_own_shadows():
    directions = np.stack([unit_vectors(4, seed) for seed in (4, 5)])
    frames = FrameNodes(directions, RNG.uniform(0, 1, (2, 4, 3)), np.arange(COUNT) % 2)
    by_frame = np.stack([brute_force_sees(s, directions[s % 2]) for s in range(COUNT)])
    found = np.asarray(integral_columns_by_frame(BRDF, SAMPLES, frames, by_frame))
    for place in range(COUNT):
        nodes = LightNodes(directions[place % 2], frames.irradiance[place % 2])
        np.testing.assert_allclose(found[place], column_by_hand(place, nodes), atol=ROUNDING)
    light = DualLight(np.zeros((1, 3)), SOURCES, frames)
    shadows = cast_shadows(STATUE, PLACES, SAMPLES, light, np.zeros((COUNT, 1)))
    np.testing.assert_array_equal(shadows.frame_sources, by_frame)
    alone = DualLight(np.zeros((1, 3)), DirectionalSources.none(), frames)
    shadows = shadows._replace(sources=np.zeros((COUNT, 0), bool))
    np.testing.assert_allclose(
        dual_columns(BRDF, SAMPLES, alone, shadows=shadows), found, atol=ROUNDING
    )


@pytest.mark.parametrize("degree", [1, 6])
def test_the_dual_model_is_equation_6_12(degree):
    """Sum by sum: E(x), then V(R) before the slow term, then V_j T_j (and V_j in E)."""
    light, shadows = dual_light(None, SOURCES, 0), some_shadows(degree)
    light = eqx.tree_at(lambda light: light.slow, light, SLOW)
    found = np.asarray(dual_columns(BRDF, SAMPLES, light, shadows=shadows))
    count = min((degree + 1) ** 2, 16)
    slow_terms = np.asarray(slow_specular(BRDF, SAMPLES, SLOW))
    for s in range(COUNT):
        diffuse = shadows.transfer[s, :count] @ SLOW[:count]
        specular = slow_terms[s] * shadows.reflected[s]
        for j in range(5):
            cosine, lobe = lobes(
                BRDF, SAMPLES.normals[s], SAMPLES.outgoing[s], np.asarray(SOURCES.directions)[j]
            )
            energy = np.asarray(SOURCES.irradiance)[j] * shadows.sources[s, j]
            diffuse = diffuse + cosine * energy
            specular = specular + lobe * energy
        np.testing.assert_allclose(found[s], [diffuse, specular], rtol=1e-9, atol=1e-9)


def test_what_is_traced_are_reflected_rays_and_sources():
    light = dual_light(None, SOURCES, 0)
    vectors = some_shadows().transfer
    shadows = cast_shadows(STATUE, PLACES, SAMPLES, light, vectors)
    assert shadows.transfer is vectors
    assert shadows.frame_sources is None
    for s in range(COUNT):
        normal, outgoing = SAMPLES.normals[s], SAMPLES.outgoing[s]
        mirrored = 2 * (normal @ outgoing) * normal - outgoing
        both = np.concatenate([mirrored[None], SOURCES.directions])
        found = [shadows.reflected[s], *shadows.sources[s]]
        np.testing.assert_array_equal(found, brute_force_sees(s, both))
    assert 0.5 < shadows.reflected.mean() < 1


def test_convex_objects_have_the_model_of_6_9():
    """Up to what shading normals make of rays that pass close to a facet's horizon."""
    ball = Mesh.icosphere(4)
    view = observe(Orthographic(12, 12, POSE, scale=0.15), ball)
    samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
    places = SurfacePlaces(view.points[view.hit], view.normals[view.hit])
    light = eqx.tree_at(lambda light: light.slow, dual_light(None, SOURCES, 0), SLOW)
    vectors = transfer_vectors(ball, places, samples.normals, 3).values
    shadows = cast_shadows(ball, places, samples, light, vectors)
    assert shadows.reflected.all()
    np.testing.assert_allclose(
        dual_columns(BRDF, samples, light, shadows=shadows),
        dual_columns(BRDF, samples, light),
        atol=1e-10,
    )


def test_the_dual_model_is_close_to_the_integral():
    """In the diffuse part, where shadows matter most here; a reflected ray is seen whole or not.

    The specular part is blurred over .3 radians, of which V(R) asks for one direction: it errs as
    much as without shadows, elsewhere.
    """
    fine = sculpture(3, seed=2)
    view = observe(Orthographic(24, 24, POSE, scale=0.1), fine)
    places = SurfacePlaces.of_views([view])
    samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
    good = np.asarray(samples.exit_cosines) > 0.3
    sphere = unit_vectors(4000, 8)
    nodes = LightNodes(sphere, np.asarray(evaluate(jnp.asarray(SLOW), sphere)) * np.pi / 1000)
    seen = visible(fine, places, sphere)
    exact = np.asarray(integral_columns(BRDF, samples, nodes, seen))[good]
    vectors = transfer_vectors(fine, places, samples.normals, 3).values
    light = DualLight(SLOW, DirectionalSources.none())
    shadows = cast_shadows(fine, places, samples, light, vectors)
    found = np.asarray(dual_columns(BRDF, samples, light, shadows=shadows))[good]
    without = np.asarray(dual_columns(BRDF, samples, light))[good]
    error, before = (
        np.sqrt(np.mean((model - exact) ** 2, axis=(0, 2)) / np.mean(exact**2, axis=(0, 2)))
        for model in (found, without)
    )
    # Random directions err by 1.5 %, the diffuse part without shadows by 8 %.
    assert error[0] < 0.03
    assert before[0] > 0.06
    assert error[1] < 0.15


@pytest.fixture
def small_batches(monkeypatch):
    module = importlib.import_module("jaxrender.reflection.render")
    monkeypatch.setattr(module, "_MOST_PAIRS", 7 * 30)


def test_images_with_shadows(small_batches):
    model = ShadowedForward(STATUE, NODES)
    image = render_view(BRDF, VIEW, model)
    seen = visible(STATUE, PLACES, NODES.directions)
    columns = integral_columns(BRDF, SAMPLES, NODES, seen)
    expected = reflection.radiance(BRDF, columns)
    np.testing.assert_allclose(image[VIEW.hit], expected, rtol=1e-9)
    np.testing.assert_array_equal(image[~VIEW.hit], 0)
    camera = Orthographic(8, 8, POSE, scale=0.3)
    np.testing.assert_array_equal(render(BRDF, camera, STATUE, model), image)
    compiled = eqx.filter_jit(lambda brdf: render_view(brdf, VIEW, model))(BRDF)
    np.testing.assert_allclose(compiled, image, rtol=1e-9)
    with pytest.raises(ValueError, match="traced on the host"):
        jax.jit(lambda n: render_view(BRDF, VIEW._replace(normals=n), model))(VIEW.normals)
    bright = render_view(BRDF, VIEW, ExactForward(NODES))
    assert np.all(image <= bright + ROUNDING)
    assert image.sum() < 0.97 * bright.sum()


def test_shadows_need_places():
    with pytest.raises(ValueError, match="give their places"):
        render_samples(BRDF, SAMPLES, ShadowedForward(STATUE, NODES))


def test_derivatives_pass_the_shadows():
    shadows = some_shadows()
    light = DualLight(SLOW, SOURCES)

    def total(sigma, transfer):
        own = shadows._replace(transfer=transfer)
        return jnp.sum(reflection.dual_columns(microfacet(sigma), SAMPLES, light, shadows=own))

    by_sigma, by_transfer = jax.jit(jax.grad(total, (0, 1)))(0.3, jnp.asarray(shadows.transfer))
    at = jax.jit(total)
    step = 1e-5
    numeric = (at(0.3 + step, shadows.transfer) - at(0.3 - step, shadows.transfer)) / (2 * step)
    assert float(by_sigma) == pytest.approx(float(numeric), rel=1e-5)
    np.testing.assert_allclose(by_transfer[:, :16], np.tile(SLOW.sum(axis=1), (COUNT, 1)))


def test_single_precision():
    single = SurfaceSamples(*(a.astype(np.float32) for a in SAMPLES))
    light = DualLight(
        SLOW.astype(np.float32),
        DirectionalSources(
            *(np.asarray(a, np.float32) for a in (SOURCES.directions, SOURCES.irradiance))
        ),
    )
    brdf = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), BRDF)
    columns = dual_columns(brdf, single, light, shadows=some_shadows())
    assert columns.dtype == jnp.float32
    exact = dual_columns(BRDF, SAMPLES, DualLight(SLOW, SOURCES), shadows=some_shadows())
    np.testing.assert_allclose(columns, exact, atol=1e-3 * float(jnp.abs(exact).max()))
    bare = shadowed_irradiance(light.slow, some_shadows().transfer)
    assert bare.dtype == jnp.float32
