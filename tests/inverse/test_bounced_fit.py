"""A diffuse bowl that lights itself: the albedo comes back only where the bounces are modelled.

The photographs are closed form: the inside of half a sphere sees itself equally everywhere, so with
albedo a it has the irradiance E_0 + a / 2 mean(E_0) / (1 - a / 2), E_0 from a source overhead that
reaches every place.

- Without bounces kd is too large by what they add; with them it is within a per cent, which is what
  the bowl's flat facets leave.
- What a fit leaves without them is named, and what they would add is estimated to a few per cent.
- The account says what bounces add, and that it has settled; a convex shape has nothing to add.
"""

import numpy as np
import pytest
from inverse_problems import microfacet_unknowns

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Mesh, SurfacePlaces, SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    Observations,
    Outcome,
    Unknown,
    fit_brdf,
)
from jaxrender.inverse.interreflection import added_by_bounces
from jaxrender.lighting import DirectionalSources

ALBEDO = np.array([0.8, 0.5, 0.1])
# E_0 = cos t from overhead: its mean over the half sphere is 1/2.
ADDED = ALBEDO / 2 * 0.5 / (1 - ALBEDO / 2)
DIFFUSE = microfacet_unknowns(ks=Unknown((0.0,)), sigma=Unknown((0.4,)), mu=None)
BLACK = Microfacet(np.zeros(3), np.zeros(3), 0.4, None)
LIGHT = KnownLight(None, DirectionalSources(np.array([[0.0, 0, 1]]), np.ones((1, 3))))


def bowl():
    """The inside of the lower half of the unit sphere."""
    ball = Mesh.icosphere(3)
    below = ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0
    used, renamed = np.unique(ball.faces[below][:, ::-1], return_inverse=True)
    return Mesh(ball.vertices[used], renamed.reshape(-1, 3))


def photographed(mesh):
    """Samples of the faces' middles, with the sphere's own normals, 1 % noise."""
    face = np.arange(0, len(mesh.faces), 2)
    places = SurfacePlaces.on_faces(mesh, face, np.full((len(face), 3), 1 / 3))
    normals = -places.points / np.linalg.norm(places.points, axis=1, keepdims=True)
    direct = normals[:, 2:]
    kept = direct[:, 0] > 0.2
    radiance = ALBEDO / np.pi * (direct + ADDED)
    radiance = radiance * (1 + 0.01 * np.random.default_rng(0).normal(size=radiance.shape))
    samples = SurfaceSamples(normals[kept], normals[kept])
    places = SurfacePlaces(*(a[kept] for a in places))
    return Observations(samples, radiance[kept], np.zeros(kept.sum(), int), places)


def fit(observations, shape, bounces):
    settings = FitSettings(starts=1, interreflection=bounces)
    return fit_brdf(observations, LIGHT, DIFFUSE, BLACK, settings, shape=shape)


@pytest.mark.slow
def test_bounces_are_told_from_albedo():
    mesh = bowl()
    observations = photographed(mesh)
    without, whole = (fit(observations, mesh, bounces) for bounces in (False, True))
    assert without.bounced is None
    off = np.pi * without.brdf.kd / ALBEDO - 1
    assert off[0] > 0.4
    assert np.all(off > 0.03)
    np.testing.assert_allclose(np.pi * whole.brdf.kd, ALBEDO, rtol=0.02)
    found = whole.bounced
    assert found.settled
    assert 2 <= found.rounds <= 12
    np.testing.assert_array_equal(found.kd_without, without.brdf.kd)
    # What is added to the samples' mean cosine; bright channels count more.
    cosines = np.asarray(whole.final.observations.samples.normals)[:, 2]
    added = np.average(ADDED, weights=ALBEDO) / cosines.mean()
    assert found.part == pytest.approx(added, rel=0.03)
    at_middle = found.senders[0].bounced[np.argmin(mesh.vertices[:, 2])]
    np.testing.assert_allclose(at_middle, ADDED, rtol=0.05)


def test_what_bounces_would_add_is_estimated_soon():
    mesh = bowl()
    found = added_by_bounces(mesh, LIGHT, photographed(mesh), ALBEDO / np.pi)
    added = ALBEDO / np.pi * ADDED
    np.testing.assert_allclose(found.mean(axis=0), added, rtol=0.03)
    np.testing.assert_allclose(found, np.broadcast_to(added, found.shape), rtol=0.15)


@pytest.mark.slow
def test_bounces_that_a_fit_leaves_out_are_named():
    """In half a sphere they are a black level, which explains as much; nothing else does."""
    mesh = bowl()
    observed, settings = photographed(mesh), FitSettings(starts=1, noise=NoiseModel(0.01, 0.0))
    without = fit_brdf(observed, LIGHT, DIFFUSE, BLACK, settings, shape=mesh)
    assert without.outcome is Outcome.MISFIT
    assert {one.cause for one in without.diagnosis[:2]} == {"black", "interreflection"}
    assert without.diagnosis[1].explains > 0.95
    whole = settings._replace(interreflection=True)
    assert not fit_brdf(observed, LIGHT, DIFFUSE, BLACK, whole, shape=mesh).diagnosis


def test_a_convex_shape_has_nothing_to_bounce():
    ball = Mesh.icosphere(2)
    places = SurfacePlaces.on_faces(ball, np.arange(60), np.full((60, 3), 1 / 3))
    normals = places.geometric_normals
    radiance = ALBEDO / np.pi * np.maximum(normals[:, 2:], 0) + 1e-6
    samples = SurfaceSamples(normals, normals)
    found = fit(Observations(samples, radiance, np.zeros(60, int), places), ball, True)
    assert found.bounced is None
