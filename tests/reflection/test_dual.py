"""The dual model: slow light in frequency, fast light in angle.

Pinned down: sources alone are summed exactly; light of low degree is filtered by the lobe within
the accuracy of the azimuthal mean; the split keeps every coefficient; the error falls as sources
are added, and is the one that ``sources_needed`` predicts for that very split; black light; both
precisions and the three transfers.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from reflection_problems import (
    lit_room,
    microfacet,
    random_samples,
    smooth_coefficients,
    unit_vectors,
)

from jaxrender import reflection
from jaxrender.brdf import Lambertian
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import evaluate
from jaxrender.lighting import DirectionalSources, Environment, candidates, take
from jaxrender.reflection import (
    DualGoal,
    DualLight,
    FrameNodes,
    dual_light,
    sources_needed,
)
from jaxrender.spectra import light_coefficients

ROUNDING = 1e-12
dual_columns = eqx.filter_jit(reflection.dual_columns)
integral_columns = eqx.filter_jit(reflection.integral_columns)

RNG = np.random.default_rng(0)
SOURCES = DirectionalSources(unit_vectors(6, 1), RNG.uniform(0.5, 2, (6, 3)))
SAMPLES = random_samples(40)
SIGMA = 0.15
BAND_LIMIT = 22  # 3.2 / sigma: all that the lobe passes
ROOM = lit_room(64, finest=256)
FOUND = candidates(ROOM, SIGMA)


def dual_error(count):
    """Root mean square of the specular column's error against the exact sum, relative."""
    # Dark sources make up the number, so that one program serves every count.
    missing = 100 - count
    dark = DirectionalSources(unit_vectors(missing, 0), np.zeros((missing, 3)))
    light = dual_light(take(ROOM, FOUND, count, SIGMA), dark, BAND_LIMIT)
    brdf = microfacet(SIGMA, None)
    exact = np.asarray(integral_columns(brdf, SAMPLES, ROOM.nodes()))[:, 1]
    error = np.asarray(dual_columns(brdf, SAMPLES, light))[:, 1] - exact
    return np.sqrt(np.mean(error**2) / np.mean(exact**2))


@pytest.mark.parametrize("fresnel", ["exit", "half"])
def test_sources_alone_are_exact(fresnel):
    brdf = microfacet(SIGMA, 1.5, fresnel)
    found = dual_columns(brdf, SAMPLES, dual_light(None, SOURCES, 8))
    exact = integral_columns(brdf, SAMPLES, SOURCES.nodes())
    np.testing.assert_allclose(found, exact, rtol=ROUNDING)


def test_sources_of_frames_are_added():
    frames = FrameNodes(
        np.stack([unit_vectors(2, 4), unit_vectors(2, 5)]),
        RNG.uniform(0, 1, (2, 2, 3)),
        np.arange(40) % 2,
    )
    brdf = microfacet(SIGMA)
    found = np.asarray(dual_columns(brdf, SAMPLES, dual_light(None, SOURCES, 8, frames)))
    for frame in (0, 1):
        own = DirectionalSources(
            np.concatenate([SOURCES.directions, frames.directions[frame]]),
            np.concatenate([SOURCES.irradiance, frames.irradiance[frame]]),
        )
        exact = np.asarray(integral_columns(brdf, SAMPLES, own.nodes()))
        np.testing.assert_allclose(found[frame::2], exact[frame::2], rtol=ROUNDING)


def test_slow_light_is_filtered_by_the_lobe():
    """Light of degree 3, sigma = .1, exit cosines above .5: the mean and the lobe agree to 5 %.

    The rms is under .7 %; the thesis's Gaussian does worse.
    """
    brdf, samples = microfacet(0.1), random_samples(60, 0.5)
    coefficients = smooth_coefficients()
    light = DualLight(coefficients, DirectionalSources.none())
    exact = np.asarray(
        reflection.polar_columns(
            brdf, samples, lambda d: evaluate(jnp.asarray(coefficients), d), polar_nodes=64
        )
    )
    errors = {}
    for name in ("exit-cosine", "gaussian"):
        found = np.asarray(dual_columns(brdf, samples, light, name))
        np.testing.assert_allclose(found[:, 0], exact[:, 0], rtol=1e-6)
        errors[name] = np.abs(found[:, 1] / exact[:, 1] - 1)
    assert errors["exit-cosine"].max() < 0.05
    rms = {name: np.sqrt(np.mean(error**2)) for name, error in errors.items()}
    assert rms["exit-cosine"] < 0.007
    assert rms["exit-cosine"] < rms["gaussian"]


def test_the_constant_of_the_light_is_exact():
    """Under uniform light the azimuthal mean is all that matters."""
    brdf = microfacet(0.2, 1.5, "half", "smith")
    light = DualLight(np.full((1, 1), np.sqrt(4 * np.pi)), DirectionalSources.none(1))
    exact = reflection.polar_columns(brdf, SAMPLES, lambda d: jnp.ones_like(d[:, :1]), 96)
    found = dual_columns(brdf, SAMPLES, light)
    # The interpolation over exit cosines is good to 2e-5 at this roughness.
    np.testing.assert_allclose(found, exact, rtol=4e-5)


@pytest.mark.parametrize("count", [0, 3, 10**6])
def test_every_coefficient_is_kept(count):
    light = dual_light(take(ROOM, FOUND, count, SIGMA), SOURCES, BAND_LIMIT)
    assert light.band_limit == BAND_LIMIT
    given = light_coefficients(ROOM, BAND_LIMIT) + light_coefficients(SOURCES, BAND_LIMIT)
    found = light.slow + light_coefficients(light.sources, BAND_LIMIT)
    np.testing.assert_allclose(found, given, atol=1e-11)


def test_the_error_falls_as_sources_are_added():
    errors = [dual_error(count) for count in (0, 10, 50, 100)]
    assert errors[0] > 0.05
    assert np.all(np.diff(errors) < 0)
    assert errors[-1] < 0.01


@pytest.mark.parametrize("wanted", [0.04, 0.015])
def test_the_predicted_error_is_the_measured_one(wanted):
    goal = DualGoal(wanted, 100, BAND_LIMIT)
    needed = sources_needed(ROOM, FOUND.sources, microfacet(SIGMA, None), SAMPLES, goal)
    assert 0 < needed.count < 100
    assert needed.error <= wanted
    # Both sum the same terms in another order.
    assert needed.error == pytest.approx(dual_error(needed.count), rel=1e-8)
    assert needed.error_without == pytest.approx(dual_error(0), rel=1e-8)
    assert dual_error(needed.count - 1) > wanted


def test_an_unreachable_goal_takes_the_best_there_is():
    goal = DualGoal(0.0, 8, BAND_LIMIT)
    needed = sources_needed(ROOM, FOUND.sources, microfacet(SIGMA, None), SAMPLES, goal)
    errors = [dual_error(count) for count in range(9)]
    assert needed.count == np.argmin(errors)
    assert needed.error == pytest.approx(min(errors), rel=1e-8)


def test_black_light_needs_no_source():
    black = Environment(np.zeros((8, 16, 3)))
    sources = candidates(black, 0.3).sources
    needed = sources_needed(black, sources, microfacet(0.3), SAMPLES, DualGoal(0.01, 9, 3))
    assert needed == (0, 0.0, 0.0)


def test_a_lambertian_surface_needs_no_lobe():
    light = dual_light(take(ROOM, FOUND, 30, SIGMA), SOURCES, BAND_LIMIT)
    lambertian = dual_columns(Lambertian(np.ones(3)), SAMPLES, light)
    both = np.asarray(dual_columns(microfacet(SIGMA), SAMPLES, light))
    np.testing.assert_allclose(lambertian, both[:, :1], rtol=ROUNDING)


def test_single_precision():
    room = Environment(np.asarray(ROOM.radiance, np.float32))
    split = take(room, candidates(room, SIGMA), 30, SIGMA)
    given = DirectionalSources(*(np.asarray(a, np.float32) for a in SOURCES.nodes()))
    light = dual_light(split, given, BAND_LIMIT)
    samples = SurfaceSamples(*(a.astype(np.float32) for a in SAMPLES))
    brdf = eqx.tree_at(
        lambda b: (b.kd, b.ks, b.sigma, b.mu),
        microfacet(SIGMA),
        (np.ones(3, np.float32), np.ones(3, np.float32), jnp.float32(SIGMA), jnp.float32(1.5)),
    )
    found = dual_columns(brdf, samples, light)
    alone = dual_columns(brdf, samples, dual_light(None, given, 4))
    assert split.slow.radiance.dtype == found.dtype == alone.dtype == jnp.float32
    double = dual_light(take(ROOM, FOUND, 30, SIGMA), SOURCES, BAND_LIMIT)
    expected = np.asarray(dual_columns(microfacet(SIGMA), SAMPLES, double))
    # The lobe's own single precision (1e-4), and ties in strength that sort differently.
    np.testing.assert_allclose(found, expected, atol=2e-3 * expected.max())
