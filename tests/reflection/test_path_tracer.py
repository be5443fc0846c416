"""The path tracer against closed forms, the reference integral and the sum of bounces.

Against Mitsuba's path tracer: experiments/path_tracer_mitsuba.py.

- A white concave object in a white furnace cannot be seen; a closed cavity of albedo rho that glows
  has the partial sums of 1 / (1 - rho).  (L 8.4 as printed, without its 4, would give a quarter.)
- Direct light on a convex mesh is the reference integral: exactly for one directional source,
  within the standard errors for an image with a small bright source on a glossy ball, and so for
  any sampler: both samplers are weighted, neither counted twice.
- Standard errors are right: pulls have unit scatter.
- The irradiance of a bowl with all bounces is what the sum over bounces makes of it.
- Roulette changes no mean; faces are black from behind unless two-sided; anisotropic lobes follow
  the tangents; the result depends on the seed alone.
"""

import numpy as np
import pytest

from jaxrender.brdf import Lambertian, Phong, Ward
from jaxrender.brdf.samplers import COSINE, CosineSampler, DirectionSampler
from jaxrender.geometry import Mesh, SurfaceSamples
from jaxrender.geometry.height_fields import sawtooth
from jaxrender.geometry.periodic import PeriodicSurface
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.reflection.integral import integral_columns, radiance
from jaxrender.reflection.tracing.emitters import (
    DirectionalEmitter,
    Emitter,
    EnvironmentEmitter,
    LightSample,
)
from jaxrender.reflection.tracing.path_tracer import PathSettings, path_radiance
from jaxrender.reflection.tracing.scattering import Scene, trace

WHITE = Lambertian(np.ones(1) / np.pi)
BALL = Mesh.icosphere(2)


class UniformSampler(DirectionSampler):
    """The whole hemisphere alike."""

    def draw(self, outgoing, uniforms):
        sine = np.sqrt(1 - uniforms[:, 0] ** 2)
        azimuth = 2 * np.pi * uniforms[:, 1]
        return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), uniforms[:, 0]], axis=-1)

    def density(self, outgoing, incoming):
        return np.where(incoming[:, 2] > 0, 1 / (2 * np.pi), 0.0)


class Glow(Emitter):
    """Every surface emits radiance 1; nobody can draw it."""

    @property
    def channels(self):
        return 1

    @property
    def is_met(self):
        return True

    def draw(self, points, uniforms):
        nothing = np.zeros(len(points))
        return LightSample(
            np.tile([0.0, 0, 1], (len(points), 1)), nothing, nothing[:, None], nothing
        )

    def radiance(self, origins, directions, reach):
        return np.isfinite(reach)[:, None].astype(float)

    def density(self, origins, directions):
        return np.zeros(len(origins))


def camera_rays(count, seed=0, towards=(0.2, -0.3, -1.0)):
    """Parallel rays onto the unit ball, from the side the direction comes from."""
    rng = np.random.default_rng(seed)
    direction = np.array(towards) / np.linalg.norm(towards)
    places = rng.normal(size=(count, 3))
    places -= np.outer(places @ direction, direction)
    places *= 0.85 * np.sqrt(rng.random((count, 1))) / np.linalg.norm(places, axis=1, keepdims=True)
    return places - 4 * direction, np.tile(direction, (count, 1))


def below(mesh, height):
    """The inside of a ball below a height."""
    low = mesh.vertices[mesh.faces].mean(axis=1)[:, 2] < height
    return Mesh(mesh.vertices, mesh.faces[low][:, ::-1])


@pytest.mark.parametrize("sampler", [COSINE, UniformSampler()])
def test_white_grooves_vanish_in_a_furnace(sampler):
    patch = sawtooth(1, 1.0, 0.6)
    scene = Scene.of(PeriodicSurface(patch), [WHITE], np.zeros(4, int), samplers=[sampler])
    origins = np.random.default_rng(0).uniform((0, 0, 2), (1, 1, 3), (50, 3))
    directions = np.tile([0.3, 0.2, -1.0], (50, 1))
    furnace = [EnvironmentEmitter.uniform(np.ones(1))]
    found = path_radiance(scene, furnace, origins, directions, PathSettings(256, 40))
    error = np.sqrt(np.mean(found.standard_error**2) / 50)
    assert error < 0.01
    assert abs(found.radiance.mean() - 1) < 4 * error


@pytest.mark.parametrize("roulette", [None, 1])
@pytest.mark.parametrize("rho", [1.0, 0.6])
def test_glowing_cavity_adds_up(rho, roulette):
    cavity = Scene.of(
        Mesh(BALL.vertices, BALL.faces[:, ::-1]), [Lambertian(np.full(1, rho) / np.pi)]
    )
    directions = np.random.default_rng(1).normal(size=(64, 3))
    settings = PathSettings(64, 6, roulette)
    found = path_radiance(cavity, [Glow()], 0 * directions, directions, settings)
    expected = sum(rho**k for k in range(7))
    error = max(float(np.sqrt(np.mean(found.standard_error**2) / 64)), 1e-3)
    assert found.radiance.mean() == pytest.approx(expected, abs=4 * error)
    if roulette is None:
        np.testing.assert_allclose(found.radiance, expected, rtol=0.01)


def test_one_source_on_a_convex_mesh_is_the_integral():
    brdf = Phong(np.array([0.1, 0.2]), np.array([0.4, 0.3]), 20.0)
    sources = DirectionalSources(np.array([[0.5, -0.2, 0.8]]), np.array([[2.0, 3.0]]))
    rays = camera_rays(200)
    scene = Scene.of(BALL, [brdf])
    found = path_radiance(scene, [DirectionalEmitter(sources)], *rays, PathSettings(2, 3))
    hits = BALL.first_hits(*rays)
    samples = SurfaceSamples(hits.geometric_normals, -rays[1])
    expected = radiance(brdf, integral_columns(brdf, samples, sources.nodes()))
    np.testing.assert_allclose(found.radiance, expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.standard_error, 0, atol=1e-12)


@pytest.mark.parametrize("sampler", [COSINE, UniformSampler()])
def test_an_image_of_a_small_source_on_a_glossy_ball_is_the_integral(sampler):
    rng = np.random.default_rng(3)
    image = rng.uniform(0.2, 1, (8, 16, 2))
    image[2, 5] = 40
    fine = Environment(np.repeat(np.repeat(image, 32, axis=0), 32, axis=1))
    brdf = Phong(np.array([0.1, 0.2]), np.array([0.5, 0.3]), 40.0)
    rays = camera_rays(60, 2)
    scene = Scene.of(BALL, [brdf], samplers=[sampler])
    light = [EnvironmentEmitter(Environment(image))]
    found = path_radiance(scene, light, *rays, PathSettings(1024, 1, seed=2))
    samples = SurfaceSamples(BALL.first_hits(*rays).geometric_normals, -rays[1])
    expected = np.asarray(radiance(brdf, integral_columns(brdf, samples, fine.nodes())))
    pulls = (found.radiance - expected) / np.hypot(found.standard_error, 1e-3 * expected)
    assert np.sqrt(np.mean(pulls**2)) == pytest.approx(1, abs=0.25)
    assert abs(pulls.mean()) < 0.35


def test_bowl_is_the_sum_of_its_bounces():
    # Of a sphere's inside, any place sees any other equally: E = E_0 + rho f mean(E).
    rho, bowl = 0.8, below(Mesh.icosphere(3), 0.0)
    scene = Scene.of(bowl, [Lambertian(np.full(1, rho) / np.pi)])
    sun = DirectionalSources(np.array([[0.0, 0.0, 1.0]]), np.ones((1, 1)))
    origins, directions = camera_rays(300, 4, (0.0, 0.0, -1.0))
    settings = PathSettings(64, 30)
    found = path_radiance(scene, [DirectionalEmitter(sun)], origins, directions, settings)
    normals = bowl.first_hits(origins, directions).geometric_normals
    # Light from the zenith: E_0 = cos, its mean 1/2 over the lower half, of which f = 1/2 is there.
    mean = 0.5 / (1 - rho / 2)
    expected = rho / np.pi * (normals[:, 2] + rho * 0.5 * mean)
    assert found.radiance.mean() == pytest.approx(expected.mean(), rel=0.01)


def test_faces_are_black_from_behind():
    flat = Mesh(np.array([[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]]), np.array([[0, 2, 1]]))
    sun = DirectionalEmitter(DirectionalSources(np.array([[0.0, 0.6, 0.8]]), np.ones((1, 1))))
    rays = np.array([[0.0, 0, 1]]), np.array([[0.1, 0, -1]])
    for two_sided, expected in ((False, 0.0), (True, 0.8 / np.pi)):
        scene = Scene.of(flat, [WHITE], two_sided=two_sided)
        found = path_radiance(scene, [sun], *rays, PathSettings(2, 2))
        assert found.radiance[0, 0] == pytest.approx(expected)


def test_anisotropic_lobes_follow_the_tangents():
    brdf = Ward(np.zeros(1), np.ones(1), 0.1, 0.5)
    flat = Mesh(np.array([[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]]), np.array([[0, 1, 2]]))
    light, view = np.array([0.3, 0.1, 0.9]), np.array([0.2, -0.4, 0.8])
    light, view = light / np.linalg.norm(light), view / np.linalg.norm(view)
    sun = DirectionalEmitter(DirectionalSources(light[None], np.ones((1, 1))))
    turn = 0.7
    x, y = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
    scene = Scene.of(flat, [brdf], tangents=(x + np.array([0, 0, 0.5]))[None])
    found = path_radiance(scene, [sun], view[None], -view[None], PathSettings(2, 1))
    local = [np.array([d @ x, d @ y, d[2]]) for d in (light, view)]
    expected = brdf.evaluate(*local) * light[2]
    np.testing.assert_allclose(found.radiance[0], expected, rtol=1e-6)


def test_the_seed_alone_decides():
    scene = Scene.of(below(BALL, 0.0), [WHITE])
    light, rays = [EnvironmentEmitter.uniform(np.ones(1))], camera_rays(700, 5)
    one, same, other = (
        path_radiance(scene, light, *rays, PathSettings(32, 3, seed=seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.radiance, same.radiance)
    assert not np.array_equal(one.radiance, other.radiance)
    # A ray alone has another chunk's numbers, but the same mean.
    assert one.standard_error.max() < 0.2


def test_environment_is_drawn_as_it_is_met():
    image = np.random.default_rng(0).uniform(0, 1, (4, 8, 2)) ** 4
    image[1] = 0
    light = EnvironmentEmitter(Environment(image))
    drawn = light.draw(np.zeros((20000, 3)), np.random.default_rng(1).random((20000, 2)))
    np.testing.assert_allclose(light.density(drawn.directions, drawn.directions), drawn.density)
    free = np.full(20000, np.inf)
    seen = light.radiance(drawn.directions, drawn.directions, free)
    np.testing.assert_allclose(seen / drawn.density[:, None], drawn.irradiance)
    # The mean of irradiances is the integral of radiance over the sphere; of 1 / density the area.
    areas = np.repeat(-np.diff(np.cos(np.pi * np.arange(5) / 4)), 8) * np.pi / 4
    total = areas @ image.reshape(-1, 2)
    np.testing.assert_allclose(drawn.irradiance.mean(axis=0), total, rtol=0.03)
    assert not light.radiance(drawn.directions, drawn.directions, np.ones(20000)).any()


@pytest.mark.parametrize(
    ("settings", "words"),
    [(PathSettings(1), "at least 2 samples"), (PathSettings(4, 0), "1 bounce")],
)
def test_settings_are_checked(settings, words):
    light, rays = [EnvironmentEmitter.uniform(np.ones(1))], camera_rays(3)
    with pytest.raises(ValueError, match=words):
        path_radiance(Scene.of(BALL, [WHITE]), light, *rays, settings)


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="one or more"):
        Scene.of(BALL, [])
    with pytest.raises(ValueError, match="samplers"):
        Scene.of(BALL, [WHITE], samplers=[])
    with pytest.raises(ValueError, match="black"):
        EnvironmentEmitter(Environment(np.zeros((4, 8, 1))))
    scene, light, rays = (
        Scene.of(BALL, [WHITE]),
        EnvironmentEmitter.uniform(np.ones(3)),
        camera_rays(3),
    )
    with pytest.raises(ValueError, match="channels"):
        path_radiance(scene, [light], *rays)


def test_vertices_start_above_their_faces():
    rays = camera_rays(50)
    vertices, reach = trace(Scene.of(BALL, [WHITE]), *rays)
    assert len(vertices.ray) == 50
    assert (vertices.outgoing[:, 2] > 0).all()
    there = rays[0] + reach[:, None] * rays[1]
    lift = np.einsum("vi,vi->v", vertices.points - there, vertices.frames[:, :, 2])
    np.testing.assert_allclose(lift, 1e-4 * BALL.diagonal(), rtol=1e-4)
    np.testing.assert_allclose(vertices.to_world(vertices.outgoing), -rays[1], atol=1e-12)
    assert isinstance(COSINE, CosineSampler)
