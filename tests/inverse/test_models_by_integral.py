"""Materials whose lobe is not about the reflected direction: rough diffuse, brushed, fibres.

- Photographs by the exact integral with 1 % noise give the material back within 3.5 of the stated
  standard errors in its own numbers, along and across the tangent; the noise is the residual.
- Under unknown light a brushed surface gives back both roughnesses, its ks and the sources.
- The response to unknown light is the integral: under each harmonic, towards each source, and the
  radiance under a light is that of its columns.
- A concave object keeps from itself what the integral with visibility says, and a brushed one gives
  its material back under unknown light.
- The degrees of the light that can be had back are those that the frequency view foresees where
  there is one.
- What has no frequency view has no evidence from it, and is refused where that is needed.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import (
    SOURCES,
    ball_samples,
    known_light,
    photograph,
    unit,
    with_noise,
)

from jaxrender.brdf import (
    AnisotropicGGX,
    AnisotropicWard,
    KajiyaKay,
    OrenNayarLobe,
    PoulinFournier,
    Ward,
)
from jaxrender.geometry import SurfacePlaces, SurfaceSamples, fibonacci_sphere, sculpture, visible
from jaxrender.harmonics import real_basis
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import (
    FactorSettings,
    FitSettings,
    Observations,
    Outcome,
    factorize,
    fit_brdf,
    unknowns_of,
)
from jaxrender.inverse.factorization import predict
from jaxrender.inverse.factorization.integral_response import (
    IntegralResponse,
    columns_under_slow_light,
)
from jaxrender.inverse.factorization.response import Guess
from jaxrender.inverse.factorization.sight import Sight
from jaxrender.inverse.forecast import Situation, Supposed, forecast_light
from jaxrender.inverse.stated import Stated
from jaxrender.lighting import LightNodes
from jaxrender.reflection import integral_columns, polar_columns, radiance

STATED_ERRORS = 3.5
KD, KS = np.array([0.19, 0.11, 0.07]), np.full(3, 0.21)
BRUSHED = AnisotropicWard(KD, KS, 0.15, 0.35)
MODELS = {
    "oren-nayar": OrenNayarLobe(KD, 0.5),
    "kajiya-kay": KajiyaKay(KD, KS, 30.0),
    "anisotropic-ward": BRUSHED,
    "anisotropic-ggx": AnisotropicGGX(KD, KS, 0.15, 0.3, None, 0.3),
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("oren-nayar", marks=pytest.mark.slow),
        pytest.param("kajiya-kay", marks=pytest.mark.slow),
        "anisotropic-ward",
        pytest.param("anisotropic-ggx", marks=pytest.mark.slow),
    ],
)
def test_photographs_give_the_material_back(name):
    truth = MODELS[name]
    noisy = with_noise(photograph(truth, *ball_samples()), 0.01, 0.002)
    kind = truth.with_roughness(0.1, None if truth.mu is None else 1.5)
    unknowns = unknowns_of(truth, dict.fromkeys(truth.settled, Stated()))
    fit = fit_brdf(noisy, known_light(), unknowns, kind, FitSettings(starts=6))
    assert fit.outcome is Outcome.CONVERGED
    assert type(fit.brdf) is type(truth)
    own = fit.parameters
    pairs = [
        (own.value.of(name), own.standard_error.of(name), getattr(truth, name))
        for name in truth.amplitude_names
    ]
    for name, number in truth.numbers.items():
        pairs.append((own.value.of(name), own.standard_error.of(name), float(number)))
    for value, error, true in pairs:
        assert np.all(np.abs(value - true) <= STATED_ERRORS * error)
        assert np.all(error <= 0.03 * np.asarray(true))
    assert fit.final.noise.relative == pytest.approx(0.01, rel=0.2)
    assert fit.evidence is None
    assert set(fit.identifiable) == {*truth.amplitude_names, *truth.numbers}


@pytest.mark.slow
def test_brushed_metal_under_unknown_light():
    truth = AnisotropicWard(np.array([0.6, 0.5, 0.4]), np.array([0.4, 0.5, 0.6]), 0.15, 0.35)
    noisy = with_noise(photograph(truth, *ball_samples(500)), 0.01, 0.002)
    settings = FactorSettings(band_limit=5, most_sources=4)
    fit = factorize(noisy, truth.with_roughness(0.3, 1.3), settings)
    own = fit.parameters
    np.testing.assert_allclose(own.value.ks, truth.ks, atol=0.015)
    assert float(own.value.of("roughness")) == pytest.approx(0.15, rel=0.03)
    assert float(own.value.of("roughness_y")) == pytest.approx(0.35, rel=0.03)
    assert set(fit.identifiable) == {"kd", "ks", "roughness", "roughness_y"}
    assert fit.relative_rms < 0.013
    source = np.asarray(SOURCES.directions)[0]
    nearest = np.max(np.asarray(fit.scene.sources.directions) @ source / np.linalg.norm(source))
    assert np.degrees(np.arccos(min(nearest, 1.0))) < 1.5


@pytest.mark.parametrize(
    "brdf", [BRUSHED, pytest.param(PoulinFournier(KD, KS, 20.0, 2.4, 0.7), marks=pytest.mark.slow)]
)
def test_the_response_is_the_integral(brdf):
    samples = SurfaceSamples(*(np.asarray(a)[::20] for a in ball_samples()[0]))
    sources = np.array([[0.3, 0.5, 0.8], [-0.2, -0.9, 0.4]])
    sources = sources / np.linalg.norm(sources, axis=1, keepdims=True)
    response = IntegralResponse.of_convex(brdf, samples, 2, len(sources))
    mu = 1.5 if brdf.mu is None else float(brdf.mu)
    numbers = (np.log(float(brdf.sigma)), np.log(mu - 1))
    guess = Guess(jnp.zeros(3), *map(jnp.asarray, numbers), jnp.asarray(sources))
    found = response.columns(guess)

    def sky(directions):
        # Y_00 and Y_10, the first and third coefficient.
        z = np.sqrt(3 / (4 * np.pi)) * directions[:, 2]
        return jnp.stack([jnp.full_like(z, np.sqrt(1 / (4 * np.pi))), z], axis=-1)

    slow = np.asarray(polar_columns(brdf, samples, sky, 64))
    for lobe, columns in enumerate(found):
        np.testing.assert_allclose(columns[:, [0, 2]], slow[:, lobe], rtol=2e-3, atol=1e-4)
    nodes = LightNodes(sources, np.eye(2))
    fast = np.asarray(integral_columns(brdf, samples, nodes))
    for lobe, columns in enumerate(found):
        np.testing.assert_allclose(columns[:, 9:], fast[:, lobe], atol=1e-12)
    light = np.random.default_rng(0).normal(size=(11, 3))
    under = response.slow_columns(response.passed(guess)) @ jnp.asarray(light[:9])
    under = under + response.source_specular(guess) @ light[9:]
    np.testing.assert_allclose(under, found.specular @ light, rtol=1e-10, atol=1e-12)
    assert response.thinned(3).columns(guess).specular.shape == (len(samples.normals[::3]), 11)


def test_degrees_of_the_light_are_foreseen_as_by_frequency():
    samples, frame = ball_samples()
    situation, noise = (
        Situation(samples, np.asarray(frame), known_light(32)),
        NoiseModel(0.01, 0.002),
    )
    brushed, round_ = (
        forecast_light(situation, Supposed(brdf, noise), 6)
        for brdf in (AnisotropicWard(KD, KS, 0.15, 0.15), Ward(KD, KS, 0.15))
    )
    np.testing.assert_allclose(brushed.report.noise, round_.report.noise, rtol=0.05)
    assert brushed.recoverable_degree == round_.recoverable_degree
    wide = forecast_light(situation, Supposed(AnisotropicWard(KD, KS, 0.15, 0.6), noise), 6)
    assert np.all(wide.report.noise[4:] > 1.2 * brushed.report.noise[4:])
    sparse = forecast_light(situation, Supposed(BRUSHED, NoiseModel(0.03, 0.002)))
    assert "a lobe of width 0.15 blurs what is finer" in sparse.sentences[0]


STATUE = sculpture(3, seed=1)


@pytest.fixture(scope="module")
def statue() -> tuple[Observations, LightNodes]:
    """Places on a statue that face one of four views, and the nodes of area light and source."""
    rng = np.random.default_rng(0)
    views = unit(np.array([[1.0, 0.2, 0.4], [-0.9, 0.6, 0.3], [0.1, -1.0, 0.5], [0.3, 0.4, 1.0]]))
    frame = rng.integers(len(views), size=len(STATUE.vertices))
    cosines = np.einsum("pi,pi->p", STATUE.normals, views[frame])
    kept = np.flatnonzero(cosines > 0.2)[:360]
    places = SurfacePlaces(*(rows[kept] for rows in SurfacePlaces.of_vertices(STATUE)))
    samples = SurfaceSamples(STATUE.normals[kept], views[frame[kept]])
    directions = fibonacci_sphere(6000)
    sky = 4 * np.pi / 6000 * (1 + 0.8 * directions @ unit(np.array([0.9, 0.5, 0.4])))
    source = unit(np.array([[-0.35, 0.8, 0.5]]))
    nodes = LightNodes(
        np.concatenate([directions, source]), np.concatenate([sky, [2.0]])[:, None] * np.ones(3)
    )
    observations = Observations(samples, np.ones((len(kept), 3)), frame[kept], places)
    return observations, nodes


@pytest.mark.slow
def test_a_concave_object_hides_light_from_itself(statue):
    observations, nodes = statue
    few = observations.take(np.arange(0, observations.count, 12))
    seen = visible(STATUE, few.places, nodes.directions)
    directions = nodes.directions[:-1]
    harmonics = np.asarray(real_basis(directions, 2)) * 4 * np.pi / len(directions)
    exact = integral_columns(BRUSHED, few.samples, LightNodes(directions, harmonics), seen[:, :-1])
    convex = IntegralResponse.of_convex(BRUSHED, few.samples, 2, 0)
    hidden = Sight(STATUE, few.places).hidden()
    found = convex.shadowed(hidden)
    guess = Guess(jnp.zeros(3), *map(jnp.log, (0.15, 0.35)), jnp.zeros((0, 3)))
    for response, tolerance in ((found, 0.02), (convex, None)):
        columns = response.columns(guess)
        off = [
            np.sqrt(np.mean((own - exact[:, k]) ** 2) / np.mean(exact[:, k] ** 2))
            for k, own in enumerate(columns)
        ]
        # What is hidden is a tenth.
        assert max(off) < tolerance if tolerance else min(off) > 0.05
    light = np.random.default_rng(0).normal(size=(9, 3))
    own = np.asarray(columns_under_slow_light(BRUSHED, few.samples, light, hidden))
    np.testing.assert_allclose(own[:, 1], found.columns(guess).specular @ light, rtol=1e-9)


@pytest.mark.slow
def test_brushed_metal_on_a_concave_object_under_unknown_light(statue):
    observations, nodes = statue
    truth = AnisotropicWard(np.array([0.6, 0.5, 0.4]), np.array([0.4, 0.5, 0.6]), 0.15, 0.35)
    seen = visible(STATUE, observations.places, nodes.directions)
    columns = integral_columns(truth, observations.samples, nodes, seen)
    noisy = with_noise(
        observations._replace(radiance=np.asarray(radiance(truth, columns))), 0.01, 0.002
    )
    settings = FactorSettings(band_limit=3, most_sources=1)
    kind = truth.with_roughness(0.3, 1.3)
    fit = factorize(noisy, kind, settings, shape=STATUE)
    own = fit.parameters
    np.testing.assert_allclose(own.value.ks, truth.ks, atol=0.03)
    assert float(own.value.of("roughness")) == pytest.approx(0.15, rel=0.05)
    assert float(own.value.of("roughness_y")) == pytest.approx(0.35, rel=0.05)
    assert fit.relative_rms < 0.02
    again = predict(fit.brdf, fit.scene, noisy, STATUE)
    np.testing.assert_allclose(again, fit.predicted, rtol=2e-3, atol=2e-3 * again.mean())
