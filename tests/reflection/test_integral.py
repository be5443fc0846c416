"""The reference integral.

Pinned down: the sum over nodes is T 6.2 summed in plain loops, for every variant; neither chunks
nor the company of other samples change it; frames select their own light; the polar quadrature is
SciPy's adaptive integral for smooth light; the sum over an image's texels tends to it as the
module says; derivatives in sigma, mu and the light; zero lights and both precisions.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reflection_problems import (
    lobes,
    microfacet,
    random_samples,
    smooth_coefficients,
    unit_vectors,
)
from scipy.integrate import dblquad

from jaxrender import reflection
from jaxrender.brdf import Lambertian, Microfacet, Ward
from jaxrender.geometry import SurfaceSamples, rotation, world_from_local
from jaxrender.harmonics import LatLongGrid, evaluate, real_basis, synthesise
from jaxrender.lighting import DirectionalSources, Environment, LightNodes
from jaxrender.reflection import FrameNodes, integral, integral_columns_by_frame, radiance

ROUNDING = 1e-12  # relative to the brightest sample
integral_columns = eqx.filter_jit(reflection.integral_columns)
polar_columns = eqx.filter_jit(reflection.polar_columns)

RNG = np.random.default_rng(3)
NODES = LightNodes(unit_vectors(37, 10), RNG.uniform(0, 1, (37, 3)))
SAMPLES = random_samples(20)
COEFFICIENTS = smooth_coefficients()


def smooth(directions):
    return evaluate(jnp.asarray(COEFFICIENTS), directions)


def relative(found, expected):
    """Largest difference of each lobe's column, relative to the column's own largest value."""
    found, expected = np.asarray(found), np.asarray(expected)
    return np.abs(found - expected).max(axis=(0, 2)) / np.abs(expected).max(axis=(0, 2))


@pytest.mark.parametrize(("sigma", "mu"), [(0.1, 1.5), (0.5, None)])
@pytest.mark.parametrize("fresnel", ["exit", "half"])
def test_columns_are_plain_sums_of_t62(sigma, mu, fresnel):
    brdf = microfacet(sigma, mu, fresnel)
    expected = np.zeros((20, 2, 3))
    for sample, (normal, outgoing) in enumerate(zip(*SAMPLES)):
        for direction, irradiance in zip(*NODES):
            values = lobes(brdf, normal, outgoing, direction)
            expected[sample] += np.outer(values, irradiance)
    assert relative(integral_columns(brdf, SAMPLES, NODES), expected).max() < ROUNDING


def test_chunks_do_not_show(monkeypatch):
    brdf = Lambertian(np.ones(3))
    whole = reflection.integral_columns(brdf, SAMPLES, NODES)
    for pairs in (1, 37 * 7, 37 * 20):
        monkeypatch.setattr(integral, "_PAIRS_PER_CHUNK", pairs)
        chunked = reflection.integral_columns(brdf, SAMPLES, NODES)
        np.testing.assert_allclose(chunked, whole, rtol=ROUNDING)
    one = SurfaceSamples(SAMPLES.normals[4:5], SAMPLES.outgoing[4:5])
    alone = reflection.integral_columns(brdf, one, NODES)
    np.testing.assert_allclose(alone, whole[4:5], rtol=ROUNDING)


def test_blocks_of_nodes_do_not_show(monkeypatch):
    """37 nodes in blocks of 8 and a rest of 5: one light, by frame, some hidden."""
    brdf, seen = microfacet(0.2), RNG.uniform(size=(20, 37)) < 0.7
    frames = FrameNodes(*(np.asarray(a)[None] for a in NODES), np.zeros(20, int))

    def columns():
        return (
            reflection.integral_columns(brdf, SAMPLES, NODES),
            reflection.integral_columns(brdf, SAMPLES, NODES, seen),
            integral_columns_by_frame(brdf, SAMPLES, frames, seen),
        )

    whole = columns()
    monkeypatch.setattr(integral, "_MOST_NODES_AT_ONCE", 16)
    monkeypatch.setattr(integral, "_NODES_PER_BLOCK", 8)
    for blocked, expected in zip(columns(), whole):
        np.testing.assert_allclose(blocked, expected, rtol=ROUNDING)


def test_no_light_and_no_samples():
    dark = DirectionalSources.none().nodes()
    columns = integral_columns(microfacet(0.2), SAMPLES, dark)
    np.testing.assert_array_equal(columns, np.zeros((20, 2, 3)))
    none = SurfaceSamples(np.zeros((0, 3)), np.zeros((0, 3)))
    assert integral_columns(microfacet(0.2), none, NODES).shape == (0, 2, 3)


def test_frames_select_their_own_light():
    brdf = microfacet(0.3)
    directions = np.stack([unit_vectors(5, seed) for seed in range(3)])
    irradiance = RNG.uniform(0, 1, (3, 5, 3))
    frame_of_sample = RNG.integers(0, 3, 20)
    found = np.asarray(
        integral_columns_by_frame(
            brdf, SAMPLES, FrameNodes(directions, irradiance, frame_of_sample)
        )
    )
    for frame in range(3):
        own = frame_of_sample == frame
        light = LightNodes(directions[frame], irradiance[frame])
        expected = np.asarray(integral_columns(brdf, SAMPLES, light))
        np.testing.assert_allclose(found[own], expected[own], rtol=ROUNDING)


def test_radiance_is_columns_times_amplitudes():
    kd, ks = np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.4, 0.3])
    columns = integral_columns(microfacet(0.2), SAMPLES, NODES)
    brdf = eqx.tree_at(lambda b: (b.kd, b.ks), microfacet(0.2), (kd, ks))
    expected = kd * np.asarray(columns)[:, 0] + ks * np.asarray(columns)[:, 1]
    np.testing.assert_allclose(radiance(brdf, columns), expected, rtol=ROUNDING)


def test_a_lambertian_surface_has_one_column():
    lambertian = integral_columns(Lambertian(np.ones(3)), SAMPLES, NODES)
    both = integral_columns(microfacet(0.2), SAMPLES, NODES)
    np.testing.assert_allclose(lambertian, np.asarray(both)[:, :1], rtol=ROUNDING)


@pytest.mark.parametrize("sample", [0, 7])
def test_polar_quadrature_is_the_adaptive_integral(sample):
    """SciPy's dblquad in the local angles about the normal, of T 6.2 in plain Python."""
    brdf = microfacet(0.4, 1.5, "half")
    normal, outgoing = SAMPLES.normals[sample], SAMPLES.outgoing[sample]
    axes = np.asarray(world_from_local(normal))
    low = COEFFICIENTS[:4, 0]  # degree 1, so that plain Python may write it out

    def integrand(azimuth, polar, lobe):
        sine = np.sin(polar)
        d = axes @ [sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)]
        light = low[0] * np.sqrt(0.25 / np.pi)
        light += np.sqrt(0.75 / np.pi) * (low[1] * d[1] + low[2] * d[2] + low[3] * d[0])
        return lobes(brdf, normal, outgoing, d)[lobe] * light * sine

    found = polar_columns(
        brdf,
        SurfaceSamples(SAMPLES.normals[[sample]], SAMPLES.outgoing[[sample]]),
        lambda d: evaluate(jnp.asarray(COEFFICIENTS[:4]), d),
    )
    for lobe in (0, 1):
        expected = dblquad(
            integrand, 0, np.pi / 2, 0, 2 * np.pi, args=(lobe,), epsabs=1e-6, epsrel=1e-6
        )[0]
        assert float(found[0, lobe, 0]) == pytest.approx(expected, rel=1e-6)


def test_polar_quadrature_has_converged():
    """From 48 to 96 nodes nothing moves for sigma = .2 and exit cosines from .15."""
    brdf = microfacet(0.2)
    fine = polar_columns(brdf, SAMPLES, smooth, 96)
    assert relative(polar_columns(brdf, SAMPLES, smooth), fine).max() < 1e-6


def test_polar_quadrature_has_a_derivative_head_on():
    normals = jnp.asarray(unit_vectors(4, 5))

    def total(outgoing):
        return jnp.sum(polar_columns(microfacet(0.3), SurfaceSamples(normals, outgoing), smooth))

    assert np.all(np.isfinite(jax.grad(total)(normals)))


def test_polar_quadrature_head_on():
    """Without a plane of incidence: uniform light gives pi and the lobe's own integral."""
    normals = unit_vectors(6, 5)
    columns = polar_columns(
        microfacet(0.3, None), SurfaceSamples(normals, normals), lambda d: jnp.ones_like(d)
    )
    np.testing.assert_allclose(columns[:, 0], np.pi, rtol=1e-9)
    np.testing.assert_allclose(columns[:, 1], 0.9414809, rtol=1e-6)  # ERRATA 27: .941


@pytest.mark.slow
def test_sum_over_texels_tends_to_the_integral():
    """The module's figures; lobes of sigma = .1 at exit cosines below .3 see up to four times."""
    samples, brdf = random_samples(30, 0.3, seed=5), microfacet(0.3)
    exact = np.asarray(polar_columns(brdf, samples, smooth))
    errors = []
    for rows, horizon_error in ((64, 1.5e-2), (128, 2e-3), (512, 3e-4)):
        image = synthesise(LatLongGrid(rows, 2 * rows), COEFFICIENTS)
        summed = integral_columns(brdf, samples, Environment(image).nodes())
        diffuse, specular = np.abs(summed / exact - 1).max(axis=(0, 2))
        assert diffuse < 1e-3
        assert specular < horizon_error
        errors.append(specular)
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


@pytest.mark.parametrize("fresnel", ["exit", "half"])
def test_derivatives(fresnel):
    """Forward derivatives in sigma, mu and one node's irradiance against central differences."""

    def columns(sigma, mu, brighter):
        weights = jnp.asarray(NODES.irradiance).at[0].add(brighter)
        brdf = microfacet(sigma, mu, fresnel, "smith")
        return reflection.integral_columns(brdf, SAMPLES, LightNodes(NODES.directions, weights))

    columns = jax.jit(columns)
    at = tuple(jnp.asarray(value) for value in (0.3, 1.5, 0.0))
    step = 1e-5  # leaves 1e-9 of truncation and 1e-11 / 1e-5 of rounding
    for argument in range(3):
        moves = jnp.eye(3)[argument] * step
        ahead = columns(*(a + m for a, m in zip(at, moves)))
        behind = columns(*(a - m for a, m in zip(at, moves)))
        numeric = np.asarray((ahead - behind) / (2 * step))
        exact = np.asarray(jax.jacfwd(columns, argument)(*at))
        np.testing.assert_allclose(exact, numeric, atol=1e-6 * np.abs(numeric).max())


def test_single_precision():
    single = SurfaceSamples(*(a.astype(np.float32) for a in SAMPLES))
    nodes = LightNodes(*(a.astype(np.float32) for a in NODES))
    brdf = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), microfacet(0.2))
    columns = integral_columns(brdf, single, nodes)
    assert columns.dtype == jnp.float32
    assert relative(columns, integral_columns(microfacet(0.2), SAMPLES, NODES)).max() < 1e-4
    flat = polar_columns(brdf, single, lambda d: jnp.ones_like(d))
    assert flat.dtype == jnp.float32


def test_polar_quadrature_knows_the_tangent():
    """Along the meridian, wherever the plane of incidence is; the twin sums over texels."""
    along, across = (Ward(np.zeros(3), np.ones(3), *pair) for pair in ((0.2, 0.6), (0.6, 0.2)))
    light = Environment(np.asarray(synthesise(LatLongGrid(256, 512), jnp.asarray(COEFFICIENTS))))
    summed = integral_columns(along, SAMPLES, light.nodes())[:, 1]
    found, turned = (polar_columns(brdf, SAMPLES, smooth)[:, 1] for brdf in (along, across))
    assert np.abs(found - summed).max() < 0.01 * np.abs(summed).max()
    assert np.abs(turned - summed).max() > 0.05 * np.abs(summed).max()


def test_the_tangent_is_the_meridian():
    """It turns along with a turn about +Z, and has no jump at the equator."""
    brdf = Ward(np.zeros(3), np.ones(3), 0.2, 0.6)
    turn = rotation(0.0, 1.1, 0.0)
    turned = SurfaceSamples(*(np.asarray(a) @ np.asarray(turn).T for a in SAMPLES))
    light = LightNodes(NODES.directions @ np.asarray(turn).T, NODES.irradiance)
    found = integral_columns(brdf, turned, light)
    np.testing.assert_allclose(found, integral_columns(brdf, SAMPLES, NODES), atol=1e-12)
    outgoing = np.array([0.6, 0.64, 0.48])
    above, below = (
        SurfaceSamples(np.array([[0.8, 0.6, z]]), outgoing[None]) for z in (1e-9, -1e-9)
    )
    near = integral_columns(brdf, above, NODES)
    np.testing.assert_allclose(near, integral_columns(brdf, below, NODES), rtol=1e-6)


@pytest.mark.slow
def test_polar_coefficients_are_the_columns_under_each_harmonic():
    brdf = Microfacet(np.full(3, 0.2), np.full(3, 0.3), 0.2, 1.5)
    columns = polar_columns(brdf, SAMPLES, lambda directions: real_basis(directions, 4), 24)
    found = reflection.polar_coefficients(brdf, SAMPLES, 4, 24)
    np.testing.assert_allclose(found, columns, atol=1e-12)


@pytest.mark.parametrize("distribution", ["gaussian", "ggx"])
def test_narrow_lobes_keep_their_digits_in_single_precision(distribution):
    """At grazing exit too, where both directions nearly cancel along the normal."""
    sigma, rng = 0.01, np.random.default_rng(4)
    normals = unit_vectors(60, 5)
    across = np.cross(normals, unit_vectors(60, 6))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    exits = np.linspace(0.02, 1, 60)[:, None]
    outgoing = exits * normals + np.sqrt(1 - exits**2) * across
    mirrored = 2 * exits * normals - outgoing + 0.5 * sigma * rng.standard_normal((60, 3))
    mirrored /= np.linalg.norm(mirrored, axis=1, keepdims=True)
    brdf = Microfacet(np.ones(3), np.ones(3), sigma, 1.5, distribution=distribution)
    whole = (brdf, SurfaceSamples(normals, outgoing), LightNodes(mirrored, np.ones((60, 3))))
    few = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), whole)
    rounded = jax.tree.map(lambda a: np.asarray(a, np.float64), few)
    found, expected = integral_columns(*few), integral_columns(*rounded)
    assert found.dtype == np.float32
    assert relative(found, expected).max() < 5e-6
