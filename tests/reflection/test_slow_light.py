"""Slow light with all azimuthal orders is the reflection integral; its mean alone is not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import coefficient_count, degrees, legendre, real_basis
from jaxrender.reflection import polar_columns, reflect_slow_light, slow_light_columns
from jaxrender.spectra import FacetLobe, mirror_frame, transfer_of_samples
from jaxrender.spectra.mirror_frame import azimuthal_transfer

BAND_LIMIT = 8
# More than the table of exit cosines has knots, so that it is looked up.
SAMPLES = 80


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def scene():
    """Samples with exit cosines from .15 to 1, one of them head-on, and coloured slow light."""
    rng = np.random.default_rng(5)
    normals = unit(rng.normal(size=(SAMPLES, 3)))
    cosines = np.concatenate([[1.0], rng.uniform(0.15, 1, SAMPLES - 1)])
    across = unit(np.cross(normals, rng.normal(size=(SAMPLES, 3))))
    outgoing = cosines[:, None] * normals + np.sqrt(1 - cosines**2)[:, None] * across
    light = rng.normal(size=(coefficient_count(BAND_LIMIT), 2))
    light = light / (1 + degrees(BAND_LIMIT))[:, None]
    return SurfaceSamples(normals, unit(outgoing)), light


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(Microfacet(np.ones(2), np.ones(2), 0.12, 1.6), marks=pytest.mark.slow),
        Microfacet(np.ones(2), np.ones(2), 0.3, None, "exit", "smith"),
        pytest.param(
            Microfacet(np.ones(2), np.ones(2), 0.2, 1.5, "half", "smith", "ggx"),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["gaussian", "masked", "ggx"],
)
def test_equals_the_integral(scene, kind):
    samples, light = scene
    found = np.asarray(reflect_slow_light(kind, samples, light))
    exact = polar_columns(
        kind, samples, lambda towards: real_basis(towards, BAND_LIMIT) @ light, 96
    )
    exact = np.asarray(exact)[:, 1]
    size = np.sqrt(np.mean(exact**2))
    assert np.abs(found - exact).max() < 5e-4 * size
    # The azimuthal mean, which the dual model keeps, is another matter.
    mean = np.asarray(transfer_of_samples(kind, samples.exit_cosines, BAND_LIMIT))
    basis = np.asarray(real_basis(samples.reflected, BAND_LIMIT))
    dual = (mean[:, degrees(BAND_LIMIT)] * basis) @ light
    assert np.abs(dual - exact).max() > 20 * np.abs(found - exact).max()


def test_columns_of_every_coefficient_add_up_to_the_light(scene):
    samples, light = scene
    kind = Microfacet(np.ones(2), np.ones(2), 0.3, 1.5, "half", "smith")
    columns = np.asarray(slow_light_columns(kind, samples, BAND_LIMIT))
    np.testing.assert_allclose(
        columns @ light, np.asarray(reflect_slow_light(kind, samples, light)), atol=1e-12
    )


def test_mirror_frames(scene):
    """R is the third axis; the normal has no component along the second, none below the first."""
    samples, _ = scene
    frames = np.asarray(samples.world_from_mirror)
    np.testing.assert_allclose(
        frames @ np.swapaxes(frames, 1, 2), np.eye(3)[None].repeat(SAMPLES, 0), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1, atol=1e-12)
    np.testing.assert_allclose(frames[:, :, 2], samples.reflected, atol=1e-12)
    local = np.einsum("sij,si->sj", frames, samples.normals)
    np.testing.assert_allclose(local[:, 1], 0, atol=1e-7)
    assert np.all(local[:, 0] > -1e-7)


def test_high_orders_are_the_integral_too():
    """A source cut off at degree 48: the azimuth about R is followed to order 48."""
    band_limit, axis = 48, np.array([0.6, 0, 0.8])
    degree = np.arange(band_limit + 1)
    falling = (2 * degree + 1) / (4 * np.pi)
    coefficients = (falling * 4 * np.pi / (2 * degree + 1))[degrees(band_limit)]
    coefficients = (coefficients * np.asarray(real_basis(axis[None], band_limit))[0])[:, None]
    cosines = np.array([0.05, 0.8])
    outgoing = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=-1)
    samples = SurfaceSamples(np.tile([[0.0, 0.0, 1.0]], (2, 1)), outgoing)
    wide = Microfacet(np.ones(1), np.ones(1), 0.6, 1.6)
    found = np.asarray(reflect_slow_light(wide, samples, coefficients))
    exact = np.asarray(
        polar_columns(
            wide, samples, lambda towards: (legendre(towards @ axis, 48) @ falling)[:, None], 112
        )
    )[:, 1]
    assert np.abs(found - exact).max() < 1e-4 * np.abs(exact).max()


def test_a_few_samples_are_what_many_are(scene):
    """Fewer than the knots are integrated each by itself, more are looked up."""
    samples, light = scene
    kind = Microfacet(np.ones(2), np.ones(2), 0.3, 1.5)
    some = SurfaceSamples(*(np.asarray(a)[:7] for a in samples))
    few, many = (np.asarray(reflect_slow_light(kind, s, light)) for s in (some, samples))
    assert 0 < np.abs(few - many[:7]).max() < 1e-4 * np.abs(few).max()


def test_blocks_of_exit_cosines_are_the_whole(monkeypatch):
    """Value and derivative, in blocks of three and of all seven."""
    cosines = jnp.linspace(0.1, 1, 7)

    def total(sigma):
        lobe = FacetLobe(sigma)
        terms = azimuthal_transfer(lobe, cosines, (3, 3), *lobe.extent)
        return jnp.sum(terms**2), terms

    evaluate = jax.value_and_grad(total, has_aux=True)

    def fresh():
        """Not traced yet, so that it sees what is patched."""
        return lambda sigma: evaluate(sigma)

    loops = str(jax.make_jaxpr(fresh())(0.3)).count("scan[")
    (_, whole), slope = jax.jit(fresh())(0.3)
    monkeypatch.setattr(
        mirror_frame, "_MOST_NUMBERS", 3 * 2 * mirror_frame._node_count(3, False) * 16
    )
    (_, parts), slope_of_parts = jax.jit(fresh())(0.3)
    assert str(jax.make_jaxpr(fresh())(0.3)).count("scan[") > loops
    np.testing.assert_allclose(parts, whole, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(slope_of_parts, slope, rtol=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_seen_head_on_it_has_the_derivative_of_its_neighbours(dtype):
    """By the exit direction, V = N included: no NaN, and what differences say."""
    brdf = Microfacet(*(np.asarray(x, dtype) for x in ([1.0], [1.0], 0.3, 1.5)))
    rng = np.random.default_rng(2)
    light = jnp.asarray(rng.normal(size=(9, 1)), dtype)
    normal = jnp.asarray([[0.6, 0, 0.8]], dtype)
    axis = jnp.asarray([[0.8, 0, -0.6]], dtype)

    def total(angle):
        outgoing = jnp.cos(angle) * normal + jnp.sin(angle) * axis
        return reflect_slow_light(brdf, SurfaceSamples(normal, outgoing), light)[0, 0]

    slope = jax.jit(jax.grad(total))
    at_normal, beside = slope(jnp.asarray(0, dtype)), slope(jnp.asarray(1e-2, dtype))
    assert abs(at_normal - beside) < 0.02 * max(1, abs(beside))
