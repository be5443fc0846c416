"""Samples drawn over luminaires, and their density.

- The density integrates to 1 over all directions, for rectangle, box, sphere and cylinder; for a
  general surface to the part of (u, v) that faces the point.
- Told with a draw and asked for the direction drawn, the density is the same number.
- Of a box only faces that can be seen are drawn.
- The mean over samples is the integral, within standard errors: with BRDF, occluder, colour and a
  tree whose radiance changes with direction.
- Two ways of drawing, weighted by the balance heuristic, have the same mean; weights add up to 1.
- Where nothing can be seen density and radiance are zero.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf.lambertian import Lambertian
from jaxrender.brdf.phong import Phong
from jaxrender.geometry import Sphere
from jaxrender.lighting.luminaires.curved_surfaces import CylinderSurface, SphereSurface
from jaxrender.lighting.luminaires.luminaire import Luminaire
from jaxrender.lighting.luminaires.measured import compressed
from jaxrender.lighting.luminaires.parametric_surface import ParametricSurface
from jaxrender.lighting.luminaires.surfaces import Rectangle, box_faces
from jaxrender.reflection.tracing.luminaire_sampling import (
    LuminaireSampler,
    balance_weight,
    sampled_light,
)
from jaxrender.reflection.tracing.luminaires import ShadedPoints, cell_rule, direct_light

RNG = np.random.default_rng(0)
POINT = np.array([0.4, -0.6, 0.0])


def samples(size: int = 4) -> np.ndarray:
    return RNG.uniform(0.5, 2, (size, size, size, size, 2))


def luminaire(name: str) -> Luminaire:
    if name == "box":
        faces = box_faces(np.array([-1.0, 0, 1]), np.array([0.0, 0.7, 2]))
        return Luminaire(faces, [compressed(samples()) for _ in faces], convex=True)
    surface = {
        "rectangle": Rectangle(np.array([0, 0, 1.0]), np.array([0, 1.0, 0]), np.array([0.5, 0, 0])),
        "sphere": SphereSurface(np.array([0, 1.0, 2]), 0.8),
        "cylinder": CylinderSurface(np.array([-1.0, 0, 1]), np.array([2.0, 0.5, 0]), 0.3),
        "bowl": ParametricSurface(
            lambda p: jnp.stack(
                [2 * p[1] - 1, 2 * p[0] - 1, 1 + 0.5 * ((2 * p[0] - 1) ** 2 + (2 * p[1] - 1) ** 2)]
            ),
            # Silhouettes are those of triangles: with 32 x 32 pairs 2 % of its places are missed.
            (96, 96),
        ),
    }[name]
    return Luminaire([surface], [compressed(samples())])


LUMINAIRES = {name: luminaire(name) for name in ("rectangle", "box", "sphere", "cylinder", "bowl")}


def all_directions(rows: int) -> np.ndarray:
    """Centres of cells of equal solid angle."""
    cosine = (np.arange(rows) + 0.5) / rows * 2 - 1
    azimuth = 2 * np.pi * (np.arange(2 * rows) + 0.5) / (2 * rows)
    sine = np.sqrt(1 - cosine**2)
    parts = np.outer(sine, np.cos(azimuth)), np.outer(sine, np.sin(azimuth))
    return np.stack([*parts, np.outer(cosine, 1 + 0 * azimuth)], axis=-1).reshape(-1, 3)


def facing_share(name: str) -> float:
    """The part of (u, v) that faces the point, of surfaces drawn on their dark side too."""
    if name != "bowl":
        return 1.0
    on = LUMINAIRES[name].patches[0].at(RNG.uniform(size=(20000, 2)))
    return float((np.einsum("pi,pi->p", on.normals, POINT - on.points) > 0).mean())


@pytest.mark.parametrize("name", LUMINAIRES)
def test_density_integrates_to_one(name):
    directions = all_directions(600)
    points = np.broadcast_to(POINT, directions.shape)
    density = LuminaireSampler(LUMINAIRES[name]).density(points, directions)
    # Edges cut through cells, and the cylinder's density grows towards its silhouette.
    assert 4 * np.pi * density.mean() == pytest.approx(facing_share(name), abs=1e-2)


@pytest.mark.parametrize("name", LUMINAIRES)
def test_density_of_a_draw_is_that_of_its_direction(name):
    sampler = LuminaireSampler(LUMINAIRES[name])
    points = np.broadcast_to(POINT, (500, 3))
    drawn = sampler.draw(points, RNG.uniform(size=(500, 2)))
    np.testing.assert_allclose(np.linalg.norm(drawn.directions, axis=1), 1)
    drawn_at_all = drawn.density > 0
    assert drawn_at_all.mean() > facing_share(name) - 0.06
    seen = LUMINAIRES[name].radiance_along(points, drawn.directions)
    near = (np.abs(seen.distance - drawn.distance) < 1e-6) & drawn_at_all
    # At edges a rounding decides whether the ray meets it.
    assert near.sum() > 0.98 * drawn_at_all.sum()
    density = sampler.density(points, drawn.directions)
    np.testing.assert_allclose(density[near], drawn.density[near], rtol=1e-5)
    same = (np.asarray(seen.radiance) == np.asarray(drawn.radiance)).all(axis=1)
    assert same[drawn_at_all].mean() > 0.98


def test_only_faces_that_can_be_seen_are_drawn():
    drawn = LuminaireSampler(LUMINAIRES["box"]).draw(
        np.broadcast_to(POINT, (2000, 3)), RNG.uniform(size=(2000, 2))
    )
    assert (np.asarray(drawn.radiance) > 0).all()
    found = POINT + drawn.distance[:, None] * drawn.directions
    on = [np.isclose(found[:, 0], 0), np.isclose(found[:, 1], 0), np.isclose(found[:, 2], 1)]
    assert np.any(on, axis=0).all()
    assert all(face.any() for face in on)


@pytest.mark.parametrize("name", LUMINAIRES)
def test_sampled_is_integrated_within_standard_errors(name):
    normal = np.array([[0.1, 0.3, 0.9]]) / np.linalg.norm([0.1, 0.3, 0.9])
    outgoing = np.array([[0.3, -0.5, 0.6]]) / np.linalg.norm([0.3, -0.5, 0.6])
    shaded = ShadedPoints.of(POINT[None], normal, outgoing)
    brdf = Phong(np.array([0.2, 0.1]), np.array([0.2, 0.3]), 8.0)
    ball = Sphere(np.array([0.2, 0.0, 0.5]), 0.12)
    uniforms = RNG.uniform(size=(1, 20000, 2))
    estimates = np.asarray(
        sampled_light(shaded, brdf, LuminaireSampler(LUMINAIRES[name]), uniforms, ball)
    )[0]
    truth = np.asarray(direct_light(shaded, brdf, LUMINAIRES[name], cell_rule(128), ball))[0]
    error = estimates.std(axis=0) / np.sqrt(len(estimates))
    assert (error < 0.05 * truth).all()
    assert (np.abs(estimates.mean(axis=0) - truth) < 4 * error + 2e-3 * truth).all()


def test_balance_heuristic_joins_two_ways_of_drawing():
    """Light drawn over the luminaire, and cosine-distributed directions that happen to meet it."""
    sampler, count = LuminaireSampler(LUMINAIRES["box"]), 40000
    points = np.broadcast_to(POINT, (count, 3))
    drawn = sampler.draw(points, RNG.uniform(size=(count, 2)))
    cosine = np.maximum(drawn.directions[:, 2], 0)
    first = balance_weight(drawn.density, cosine / np.pi)
    light = first * cosine / drawn.density * np.asarray(drawn.radiance)[:, 0] / np.pi
    radius, azimuth = np.sqrt(RNG.uniform(size=count)), 2 * np.pi * RNG.uniform(size=count)
    height = np.sqrt(1 - radius**2)
    towards = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)
    other = sampler.density(points, towards)
    second = balance_weight(height / np.pi, other)
    met = second * np.asarray(LUMINAIRES["box"].radiance_along(points, towards).radiance)[:, 0]
    shaded = ShadedPoints.of(POINT[None], np.array([[0, 0, 1.0]]), np.array([[0, 0, 1.0]]))
    white = Lambertian(np.full(2, 1 / np.pi))
    truth = float(direct_light(shaded, white, LUMINAIRES["box"], cell_rule(128))[0, 0])
    error = np.sqrt((light.var() + met.var()) / count)
    assert abs(light.mean() + met.mean() - truth) < 4 * error + 2e-3 * truth
    np.testing.assert_allclose(first + balance_weight(cosine / np.pi, drawn.density), 1)
    assert balance_weight(np.zeros(1), np.zeros(1))[0] == 0


@pytest.mark.parametrize("name", ["rectangle", "box", "sphere", "cylinder"])
def test_where_nothing_is_seen_there_is_no_density(name):
    inside = {
        "rectangle": [0.1, 0.2, 1.5],
        "box": [-0.5, 0.3, 1.5],
        "sphere": [0, 1.0, 2.2],
        "cylinder": [0, 0.25, 1.1],
    }
    points = np.broadcast_to(np.array(inside[name]), (50, 3))
    drawn = LuminaireSampler(LUMINAIRES[name]).draw(points, RNG.uniform(size=(50, 2)))
    assert not drawn.density.any()
    assert not np.asarray(drawn.radiance).any()
    shaded = ShadedPoints.of(points[:1], np.array([[0, 0, 1.0]]), np.array([[0, 0, 1.0]]))
    white = Lambertian(np.full(2, 0.3))
    estimates = sampled_light(
        shaded, white, LuminaireSampler(LUMINAIRES[name]), RNG.uniform(size=(1, 9, 2))
    )
    assert np.isfinite(np.asarray(estimates)).all()
