"""A floor and a glossy wall: what the wall sends down, against an integral over its area.

The lamp shines along the floor, so that all light there comes from the wall.  The twin sums
over patches of the wall, rho_wall(w_i, to x) E cos cos / r^2, where the program follows rays of x.

- What a place gets and its lobes reflect is the twin's, and so is the irradiance at vertices.
- What vertices see is kept bit by bit, and each photograph has the bounces of its own light.
- A fit finds kd, ks, sigma and mu of both from the floor's photographs and the wall's; without
  bounces it does not, and says so.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import microfacet_unknowns

from jaxrender.brdf import Microfacet
from jaxrender.geometry import (
    Components,
    Mesh,
    Pinhole,
    SurfacePlaces,
    SurfaceSamples,
    look_at,
    meridian_frames,
    observe,
    pair_in_frame,
)
from jaxrender.inverse import FitSettings, KnownLight, Observations, Outcome, fit_brdf
from jaxrender.inverse.interreflection import outside
from jaxrender.inverse.models import columns_under
from jaxrender.lighting import DirectionalSources, LightNodes
from jaxrender.reflection import visible_nodes
from jaxrender.reflection.indirect import Exchange, Gathered, Outside, Rays, Sender

# Dark, so that what bounces three times is less than the noise.
KD, KS, SIGMA, MU = 0.03, 0.12, 0.25, 1.5
GLOSSY = Microfacet(np.array([KD]), np.array([KS]), SIGMA, MU, "half", "smith", "ggx")
GAP, CELLS, PATCHES = 0.02, 12, 60
UP, ACROSS = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
LAMP = np.array([0.9, 0.2, 0]) / np.sqrt(0.85)
IRRADIANCE = 3.0
LIGHT = KnownLight(None, DirectionalSources(LAMP[None], np.array([[IRRADIANCE]])))


def square(corner, along, up):
    """A unit square of small faces, and its normals by their order."""
    steps = np.linspace(0, 1, CELLS + 1)
    a, b = np.meshgrid(steps, steps, indexing="ij")
    index = np.arange(a.size).reshape(a.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1)
    quads = quads.reshape(-1, 4)
    points = corner + a[..., None] * along + b[..., None] * up
    return points.reshape(-1, 3), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def corner():
    floor = square(np.array([GAP, -0.5, 0]), ACROSS, np.array([0.0, 1, 0]))
    wall = square(np.array([0, -0.5, GAP]), np.array([0.0, 1, 0]), UP)
    faces = np.concatenate([floor[1], wall[1] + len(floor[0])])
    return Mesh(np.concatenate([floor[0], wall[0]]), faces)


def lobes(normal, incoming, outgoing):
    """Both lobes times the cosine, one after the other."""
    pair = (Components.of(jnp.asarray(one)) for one in (incoming, outgoing))
    found = GLOSSY.transfer(*pair_in_frame(*pair, meridian_frames(jnp.asarray(normal))))
    return np.stack([np.asarray(one) for one in found])


def patches():
    steps = (np.arange(PATCHES) + 0.5) / PATCHES
    y, z = np.meshgrid(steps - 0.5, steps + GAP, indexing="ij")
    return np.stack([np.zeros_like(y), y, z], axis=-1).reshape(-1, 3)


def sent_to(point):
    """Directions from a point of the floor to the patches, their radiance and solid angles."""
    away = point - patches()
    distance = np.linalg.norm(away, axis=1)
    away = away / distance[:, None]
    lamp = np.broadcast_to(LAMP, away.shape)
    radiance = IRRADIANCE * np.array([KD, KS]) @ lobes(ACROSS, lamp, away)
    return -away, radiance, away[:, 0] / distance**2 / PATCHES**2


def columns_at(point, outgoing):
    """Both lobes of the floor under what the wall sends."""
    directions, radiance, solid = sent_to(point)
    outgoing = np.broadcast_to(outgoing, directions.shape)
    return lobes(UP, directions, outgoing) @ (radiance * solid)


def views_of(count, seed):
    """Points of the floor and directions that look at it against the wall's highlights."""
    rng = np.random.default_rng(seed)
    points = np.stack(
        [rng.uniform(0.1, 0.9, count), rng.uniform(-0.4, 0.4, count), np.zeros(count)], axis=-1
    )
    outgoing = np.stack([rng.uniform(0.2, 1, count), rng.uniform(-0.5, 0.5, count),
                         rng.uniform(0.3, 1, count)], axis=-1)  # fmt: skip
    return points, outgoing / np.linalg.norm(outgoing, axis=1, keepdims=True)


def test_a_place_gets_what_the_wall_sends_and_its_lobes_reflect_it():
    mesh, (points, outgoing) = corner(), views_of(12, 0)
    normals = np.tile(UP, (len(points), 1))
    sender = Sender.of(Exchange.of(mesh, True), GLOSSY, outside(mesh, LIGHT, True))
    # What bounces more often is not in the twin.
    once = sender._replace(bounced=np.zeros_like(sender.bounced))
    samples = SurfaceSamples(normals, outgoing)
    rays = Rays.of(samples, SIGMA, 2048, 512)
    gathered = Gathered.along(mesh, SurfacePlaces(points, normals), rays)
    nodes = gathered.nodes((once,), np.zeros(len(points), int))
    found = np.asarray(columns_under(GLOSSY, samples, nodes))[:, :, 0]
    expected = np.array([columns_at(*one) for one in zip(points, outgoing)])
    np.testing.assert_allclose(found, expected, rtol=0.05)
    np.testing.assert_allclose(found.mean(axis=0), expected.mean(axis=0), rtol=0.01)


def test_vertices_get_as_much():
    mesh = corner()
    sender = Sender.of(Exchange.of(mesh, True), GLOSSY, outside(mesh, LIGHT, True))
    inside = (mesh.vertices[:, 2] == 0) & (np.abs(mesh.vertices[:, 0] - 0.5) < 0.3)
    expected = [columns_at(point, UP)[0] for point in mesh.vertices[inside]]
    # Three bounces are not in the twin, and 64 rays are few.
    np.testing.assert_allclose(sender.bounced[inside, 0], expected, rtol=0.25)
    np.testing.assert_allclose(np.mean(sender.bounced[inside]), np.mean(expected), rtol=0.03)


def test_what_vertices_see_is_kept_bit_by_bit():
    """Eleven lamps do not fill two bytes; the floor hides those below it from the wall."""
    mesh, angles = corner(), np.linspace(-1.4, 1.4, 11)
    lamps = np.stack([np.cos(angles), np.zeros(11), np.sin(angles)], axis=-1)
    nodes = DirectionalSources(lamps, np.ones((11, 1))).nodes()
    seen = visible_nodes(mesh, SurfacePlaces.of_vertices(mesh), nodes)
    assert 0.2 < seen.mean() < 0.8
    kept = Outside.on(mesh, nodes, True)
    some = np.array([330, 3, 200, 3])
    np.testing.assert_array_equal(kept.seen_by(some), seen[some])
    assert Outside.on(mesh, nodes, False).seen is None


def test_every_photograph_has_the_light_that_bounced_of_its_own():
    mesh, (points, outgoing) = corner(), views_of(6, 3)
    normals = np.tile(UP, (6, 1))
    exchange, lit = Exchange.of(mesh, True), outside(mesh, LIGHT, True)
    brighter = lit._replace(
        nodes=LightNodes(lit.nodes.directions, 3 * lit.nodes.irradiance),
        irradiance=3 * lit.irradiance,
    )
    senders = [Sender.of(exchange, GLOSSY, one) for one in (lit, brighter)]
    rays = Rays.of(SurfaceSamples(normals, outgoing), SIGMA, 64, 16)
    gathered = Gathered.along(mesh, SurfacePlaces(points, normals), rays)
    alone = gathered.nodes(senders[:1], np.zeros(6, int)).irradiance
    both = gathered.nodes(senders, np.arange(6) % 2).irradiance
    np.testing.assert_allclose(both, alone * (1 + 2 * (np.arange(6) % 2))[:, None, None])


@pytest.fixture(scope="module")
def photographs():
    """The floor by the twin, the wall under the lamp alone, 1 % noise."""
    points, outgoing = views_of(160, 1)
    down = np.array([[KD, KS] @ columns_at(*one) for one in zip(points, outgoing)])
    rng = np.random.default_rng(2)
    at = patches()[rng.permutation(PATCHES**2)[:160]]
    towards = np.stack([rng.uniform(0.2, 1, 160), rng.uniform(-0.8, 0.4, 160),
                        rng.uniform(-0.2, 0.8, 160)], axis=-1)  # fmt: skip
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    lamp = np.broadcast_to(LAMP, towards.shape)
    there = IRRADIANCE * np.array([KD, KS]) @ lobes(ACROSS, lamp, towards)
    normals = np.repeat([UP, ACROSS], 160, axis=0)
    radiance = np.concatenate([down, there])[:, None]
    radiance = radiance * (1 + 0.01 * rng.normal(size=radiance.shape))
    places = SurfacePlaces(np.concatenate([points, at]), normals)
    samples = SurfaceSamples(normals, np.concatenate([outgoing, towards]))
    return Observations(samples, radiance, np.zeros(320, int), places)


def fitted(photographs, bounces):
    settings = FitSettings(starts=1, interreflection=bounces)
    return fit_brdf(photographs, LIGHT, microfacet_unknowns(), GLOSSY, settings, shape=corner())


@pytest.mark.slow
def test_a_glossy_material_is_found_by_light_that_bounced(photographs):
    fit = fitted(photographs, True)
    off = np.array([fit.brdf.kd[0] / KD, fit.brdf.ks[0] / KS, float(fit.brdf.sigma) / SIGMA]) - 1
    assert fit.bounced.settled
    assert np.all(np.abs(off) < 0.04)
    assert fit.final.relative_rms < 0.03
    # A photograph of the floor, which has no other light.
    pose = look_at(np.array([2.0, 0, 1]), np.array([0.5, 0, 0]), UP)
    view = observe(Pinhole(8, 8, pose, fl_x=20.0), corner())
    found = fit.bounced.radiance(GLOSSY, view, 0)[:, 0]
    floor = np.abs(view.normals[view.hit][:, 2] - 1) < 1e-9
    seen = zip(view.points[view.hit][floor], view.outgoing[view.hit][floor])
    expected = np.array([[KD, KS] @ columns_at(*one) for one in seen])
    assert len(expected) > 20
    np.testing.assert_allclose(found[floor], expected, rtol=0.2)
    np.testing.assert_allclose(found[floor].mean(), expected.mean(), rtol=0.05)


@pytest.mark.slow
def test_without_bounces_it_is_not_found(photographs):
    assert fitted(photographs, False).outcome is not Outcome.CONVERGED
