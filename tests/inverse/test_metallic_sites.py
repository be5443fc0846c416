"""glTF's material of every site under known light.

- What is tabulated over the roughness is the integral, at any share of metal and index; its slopes
  are differences.
- From photographs by the integral, base colour, roughness and metalness of sites are found within
  their errors: under lamps, and under continuous light that no fit uses.
- Errors reach the truth where exposures differ, of which the fit knows nothing.
- Where little is seen of a site its error knows of all kinds of material that it may be.
- A number that all sites share is found with them.
- A concave shape casts shadows.
- Kinds of sites are told by their numbers, and the joined errors are those of a mixture.
- What cannot be found is refused in words.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import known_light
from metallic_worlds import BOTH, VARIANT, MetallicWorld, lamps, under_a_sky
from site_worlds import LAMPS, NOISY
from texture_problems import SOURCES, cameras

from jaxrender.geometry import Mesh, SurfacePlaces, SurfaceSamples, observe, visible
from jaxrender.geometry.texels import surface_sites
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel, LinearisedModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.stated import Stated
from jaxrender.inverse.texture import recover_metallic
from jaxrender.inverse.texture.metallic_table import finest_cell, tabulated
from jaxrender.inverse.texture.site_equations import SiteEquations
from jaxrender.inverse.texture.site_minima import joined_minima
from jaxrender.inverse.texture.site_solver import Solved
from jaxrender.inverse.texture.site_sums import SiteMaterial
from jaxrender.inverse.texture.site_systems import KnownSpecular
from jaxrender.inverse.texture.specular_prior import kinds_of
from jaxrender.inverse.unknowns import unknowns_of
from jaxrender.reflection import integral_columns


@pytest.fixture(scope="module")
def world():
    return lamps()


@pytest.fixture(scope="module")
def found(world):
    return world, world.fitted()


def off(world, fit, name):
    """Errors beside what is stated, and where the stated ones are small."""
    if name == "base_color":
        error = fit.base_color - world.color
        return error, fit.color_error, np.all(fit.color_error < 0.05 * fit.base_color, axis=1)
    value, stated = fit.numbers[name]
    if name == "metallic":
        return value - world.metal, stated, stated < 0.15
    return np.log(value / world.rough), stated / value, stated < 0.15 * value


def test_the_table_is_the_integral(world):
    light, rows = known_light(48), np.arange(0, len(world.site), 61)
    samples = world.observations.take(rows).samples
    seen = Observations(samples, np.zeros((len(rows), 3)), np.zeros(len(rows), int))
    table = tabulated(VARIANT, light, seen, (0.25, 0.9), finest_cell(light, len(rows)))
    exact = ExactModel(VARIANT, samples, exact_nodes(light, None, 0.06))
    for rough, metal, index in ((0.31, 0.0, 1.5), (0.47, 0.7, 1.5), (0.8, 1.0, 1.3)):
        numbers = {"roughness": rough, "metallic": metal, "ior": index}
        numbers = {name: jnp.asarray(value) for name, value in numbers.items()}
        for one, other in zip(table.columns(numbers), exact.columns(numbers), strict=True):
            rms = np.sqrt(np.mean((one - other) ** 2) / np.mean(np.asarray(other) ** 2))
            assert rms < 8e-3
    count = len(rows)
    own = {"roughness": jnp.full(count, 0.4), "metallic": jnp.full(count, 0.3)}
    own["ior"] = jnp.asarray(1.5)
    near = LinearisedModel.about(table, own, ("roughness", "metallic"))
    for name in near.slopes:
        ends = [table.columns(own | {name: own[name] + sign * 1e-5}) for sign in (1, -1)]
        for slope, one, other in zip(near.slopes[name], *ends, strict=True):
            difference = (np.asarray(one) - np.asarray(other)) / 2e-5
            np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-8)


def check(world, fit, least, most, metal_error):
    seen = fit.seen > 0
    for name in ("base_color", "roughness", "metallic"):
        error, stated, sure = off(world, fit, name)
        assert np.count_nonzero(sure & seen) > least
        assert np.median(np.abs(error[sure & seen])) < {"metallic": metal_error}.get(name, 0.02)
        # Shares that end at 0 or 1 are nearer to it than their errors say.
        z = np.abs(error / stated)[seen]
        assert (0 if name == "metallic" else 0.4) < np.quantile(z, 0.683) < 1.2
        assert np.quantile(z, 0.9) < 2.2
        assert np.max(z) < most
    assert fit.noise.relative == pytest.approx(NOISY.relative, rel=0.2)


def test_all_is_found_within_its_errors(found):
    world, fit = found
    check(world, fit, 90, 9.0, 0.01)
    # One lobe for all leaves far more.
    assert fit.relative_rms < 1.2 * NOISY.relative


@pytest.mark.slow
def test_errors_know_what_single_photographs_leave():
    """Exposures that differ by 6 % move sites by more than what is left of a site says."""
    world = lamps()
    gains = 1 + 0.06 * np.random.default_rng(5).normal(size=world.frame.max() + 1)
    world.radiance *= gains[world.frame][:, None]
    fit = world.fitted()
    for name, least in (("base_color", 0.88), ("roughness", 0.92), ("metallic", 0.93)):
        error, stated, _ = off(world, fit, name)
        inside = np.abs(error / stated)[fit.seen > 0] < 1.645
        assert np.mean(inside) > least, name


@pytest.mark.slow
def test_the_same_under_continuous_light():
    world = MetallicWorld(known_light(96), under_a_sky)
    check(world, world.fitted(), 240, 4.5, 0.01)


def test_who_saw_little_knows_no_kind(found):
    """Under few lamps many sites show no highlight: dark metal, or dark paint."""
    world, fit = found
    metallic, error = fit.numbers["metallic"]
    seen = fit.seen > 0
    unsure, sure = seen & (error > 0.3), seen & (error < 0.1)
    assert 20 < unsure.sum() < 150
    wrong = np.abs(metallic - world.metal) > 0.2
    assert np.mean(wrong[unsure]) > 0.1
    assert np.mean(wrong[sure]) < 0.02
    assert np.nanmin(metallic) >= 0
    assert np.nanmax(metallic) <= 1


def test_nothing_is_known_of_what_nobody_saw(found):
    world, fit = found
    lost = world.hidden
    assert fit.seen[lost] == 0
    assert np.isnan(fit.base_color[lost]).all()
    assert np.isinf(fit.color_error[lost]).all()
    for value, error in fit.numbers.values():
        assert np.isnan(value[lost])
        assert np.isinf(error[lost])


@pytest.mark.slow
def test_a_shared_roughness_is_found_with_the_maps():
    world = lamps(roughnesses=(0.4,))
    fit = world.fitted(BOTH._replace(maps=("metalness",)))
    value, error = fit.shared["roughness"]
    assert abs(value - 0.4) < 3 * error
    assert error < 0.01
    assert "roughness" not in fit.numbers
    known, _, sure = off(world, fit, "metallic")
    assert np.median(np.abs(known[sure])) < 0.01
    np.testing.assert_allclose(fit.number("roughness"), value)


def test_kinds_are_told_apart():
    rng = np.random.default_rng(0)
    kind = rng.random(4000) < 0.3
    precision = rng.uniform(25, 2500, 4000)
    truth = np.where(kind, rng.normal(0.95, 0.08, 4000), rng.normal(0.05, 0.1, 4000))
    seen = truth + rng.normal(size=4000) / np.sqrt(precision)
    kinds = kinds_of(seen, precision, ((0.0, 0.1), (1.0, 0.1)), 0.02)
    np.testing.assert_allclose(kinds.share, [0.7, 0.3], atol=0.03)
    np.testing.assert_allclose(kinds.mean, [0.05, 0.95], atol=0.02)
    np.testing.assert_allclose(kinds.spread, [0.1, 0.08], atol=0.015)
    nothing = kinds_of(seen, 0 * precision, ((0.0, 0.1), (1.0, 0.2)), 0.02)
    np.testing.assert_allclose(nothing.share, 0.5)
    np.testing.assert_allclose(nothing.spread, [0.1, 0.2])


def end(cost, value, precision):
    """End a search of two sites at a base colour of 1 and a number."""
    matrix = np.tile(np.diag([4.0, precision]), (2, 1, 1))
    material = SiteMaterial(np.ones((2, 1)), np.ones(2))
    local = SiteEquations(np.array([cost, cost]), np.zeros((2, 2)), matrix, material)
    return Solved(np.full((2, 1), value), local, np.zeros((2, 2, 3)), np.zeros((2, 1)))


def test_several_minima_are_a_mixture():
    site, prior = np.arange(2), KnownSpecular(np.ones(()))
    best, covariance = joined_minima([end(3.0, 0.0, 100.0), end(1.0, 1.0, 25.0)], prior, site)
    np.testing.assert_allclose(best.value, 1.0)
    weights = np.exp([-1.5, -0.5]) / np.sqrt([400.0, 100.0])
    share = weights / weights.sum()
    expected = share[0] * (1 / 100 + 1) + share[1] / 25
    np.testing.assert_allclose(covariance[:, 1, 1], expected)
    np.testing.assert_allclose(covariance[:, 0, 0], 0.25)
    # The same minimum found twice counts once.
    again = [end(1.0, 1.0, 25.0), end(1.0, 1.001, 25.0)]
    np.testing.assert_allclose(joined_minima(again, prior, site)[1][:, 1, 1], 1 / 25)


def test_what_cannot_be_found_is_refused(world):
    def refused(words, settings=BOTH, **stated):
        with pytest.raises(ValueError, match=words):
            world.fitted(settings, **stated)

    refused("choose of roughness, metalness", BOTH._replace(maps=("sigma",)))
    refused("metallic is fixed", metallic=Stated(fixed=1.0))
    refused("roughness is fixed", roughness=Stated(fixed=0.4))
    refused("leave free out", BOTH._replace(free=("camera",)))
    refused("choose joint", BOTH._replace(method="thesis"))


@pytest.mark.slow
def test_a_concave_shape_casts_shadows():
    shape = bowl()
    seen = [observe(camera, shape) for camera in cameras(6, 20)]
    used = [view.hit & (view.exit_cosines > 0.2) for view in seen]
    site = np.concatenate([surface_sites(shape, v, (1, 1)).of_pixel[u] for v, u in zip(seen, used)])
    parts = zip(*[(v.normals[u], v.outgoing[u], v.points[u]) for v, u in zip(seen, used)])
    normals, outgoing, points = map(np.concatenate, parts)
    faces = np.concatenate([v.geometric_normals[u] for v, u in zip(seen, used)])
    samples, places = SurfaceSamples(normals, outgoing), SurfacePlaces(points, faces)
    color = np.random.default_rng(0).uniform(0.2, 0.8, (len(shape.vertices), 3))
    lit = visible(shape, places, np.asarray(SOURCES.nodes().directions))
    columns = np.asarray(integral_columns(VARIANT, samples, SOURCES.nodes(), lit))
    exact = color[site] * columns[:, 0] + columns[:, 1]
    radiance = NOISY.add(exact, np.random.default_rng(1))
    frame = np.repeat(np.arange(len(seen)), [int(u.sum()) for u in used])
    observed = Observations(samples, radiance, frame, places)

    def left(shape):
        unknowns = unknowns_of(VARIANT, {"roughness": Stated(fixed=0.4)})
        settings = BOTH._replace(maps=("metalness",))
        count = len(color)
        return recover_metallic(
            observed, site, count, LAMPS, VARIANT, unknowns, settings, shape
        ).relative_rms

    assert left(shape) < 1.3 * np.sqrt(np.mean((radiance - exact) ** 2) / np.mean(radiance**2))
    assert left(None) > 2 * left(shape)


def bowl():
    """Make a ball with a deep dent."""
    ball = Mesh.icosphere(2)
    vertices = np.array(ball.vertices)
    vertices[vertices[:, 2] > 0.7] *= 0.35
    return Mesh(vertices, np.array(ball.faces))
