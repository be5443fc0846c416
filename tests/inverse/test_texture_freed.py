"""Nuisances found with a texture under known light: a painted ball by the exact integral.

- With ``auto`` the diagnosis names exposures that differ.  They are found within their errors, and
  sigma, mu and paint with them; what all exposures share is in the errors of the paint.
- A response that is not linear is found by name; so is a lamp that stands elsewhere.
- Where nothing is wrong nothing is freed.
- An object that lies elsewhere is found by name where paint is smooth, and pixels are
  given the sites that they show once they are moved.
- What a texture does not free is refused, what moves pixels without the surface's sites, and a
  sigma that varies.
"""

import numpy as np
import pytest
from inverse_problems import known_light, microfacet_unknowns
from scipy.spatial.transform import Rotation
from test_texture_examination import BALL, NOISE, VARIANT, VIEWS, bent, exposed, held
from texture_problems import IMAGE, MU, SIGMA, cameras, exact_columns, samples_of, texture, views

from jaxrender.geometry import Sphere, SurfacePlaces, SurfaceSamples, observe
from jaxrender.geometry.texels import sphere_coordinates, texel_coordinates, texel_sites
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import KnownLight, Observations, Outcome
from jaxrender.inverse.texture import SigmaField, SurfaceSites, TextureSettings, recover_texture
from jaxrender.inverse.texture.sites import Regions
from jaxrender.lighting import DirectionalSources

COUNT = 288


@pytest.fixture(scope="module")
def ball():
    """Samples of a ball with pixels and places, what they are without noise, and their sites."""
    seen = views(VIEWS, pixels=32)
    samples, frame, site = samples_of(seen)
    used = [view.exit_cosines > 0.2 for view in seen]
    points = np.concatenate([view.points[u] for view, u in zip(seen, used)])
    kd, ks = texture()
    diffuse, specular = np.moveaxis(exact_columns(samples), 1, 0)
    exact = kd[site] * diffuse + ks[site][:, None] * specular
    pixel = np.concatenate([np.argwhere(u) for u in used])
    places = SurfacePlaces(points, samples.normals)
    return Observations(samples, exact, frame, places, pixel=pixel), site


def recovered(ball, free, wrong=None, light=None, **given):
    clean, site = ball
    radiance = clean.radiance if wrong is None else wrong(clean.radiance, clean.frame)
    noisy = NoiseModel(NOISE, 0.0).add(radiance, np.random.default_rng(0))
    settings = TextureSettings(starts=1, search_samples=1200, exact_samples=600, free=free)
    return recover_texture(
        clean._replace(radiance=noisy),
        site,
        COUNT,
        light or known_light(48),
        VARIANT,
        unknowns=microfacet_unknowns(),
        settings=settings,
        shape=BALL,
        **given,
    )


def off(fit):
    return abs(fit.sigma - SIGMA) / fit.sigma_error, abs(fit.mu - MU) / fit.mu_error


@pytest.mark.slow
def test_auto_frees_exposures(ball):
    fit = recovered(ball, "auto", exposed)
    assert (fit.outcome, fit.diagnosis, fit.reasons) == (Outcome.CONVERGED, (), ())
    assert not fit.misfit.found
    calibration = fit.calibration
    assert calibration.free == ("exposure",)
    assert calibration.settled
    true = 0.05 * np.random.default_rng(2).normal(size=VIEWS)
    value, error = calibration.corrections.exposure, calibration.errors["exposure"]
    np.testing.assert_allclose(value - value.mean(), true - true.mean(), atol=0.005)
    assert np.all(np.abs(value - true) < 3 * error)
    # No photograph tells the mean: the paint would be as much brighter.
    mean = 0.05 / np.sqrt(VIEWS)
    np.testing.assert_allclose(error, mean, rtol=0.15)
    seen = fit.texture.seen >= 12
    paint, exact = (
        np.median((part / fit.texture.kd)[seen])
        for part in (fit.texture.kd_error, fit.texture.kd_exact_error)
    )
    assert min(paint, exact) > 0.9 * mean
    assert max(off(fit)) < 3.5
    assert min(held(fit, exact=False)) > 0.9


@pytest.mark.slow
def test_a_response_is_found_by_name(ball):
    fit = recovered(ball, ("response",), bent)
    assert fit.outcome is Outcome.CONVERGED
    value, error = fit.calibration.corrections.response[0], fit.calibration.errors["response"][0]
    assert abs(value - np.log(1.06)) < 3 * error
    assert error < 0.005
    assert max(off(fit)) < 3.5
    kd, _ = texture()
    seen = fit.texture.seen >= 12
    assert np.median(np.abs(fit.texture.kd / kd - 1)[seen]) < 0.02


@pytest.mark.slow
def test_lamps_that_stand_elsewhere_are_found(ball):
    """The light that is told has its sources turned by two degrees."""
    light = known_light(48)
    turn = Rotation.from_rotvec(np.radians([1.2, -0.96, 1.28])).as_matrix()
    sources = light.directional
    wrong = KnownLight(
        light.environment,
        DirectionalSources(np.array(sources.directions) @ turn.T, sources.irradiance),
    )
    fit = recovered(ball, ("lamps",), light=wrong)
    assert fit.outcome is Outcome.CONVERGED
    mended = np.asarray(fit.calibration.light.directional.directions)
    aside = np.degrees(np.arccos(np.clip(np.sum(mended * sources.directions, axis=1), -1, 1)))
    assert np.all(aside < 0.6)
    assert max(off(fit)) < 3.5


@pytest.mark.slow
def test_a_clean_capture_is_left_alone(ball):
    fit = recovered(ball, "auto")
    assert fit.calibration is None
    assert fit.outcome is Outcome.CONVERGED


def smooth(points):
    """Paint that changes slowly along the surface; its K_s does not change."""
    slopes = np.array([[0.06, 0.02, -0.03], [-0.02, 0.05, 0.02], [0.03, -0.03, 0.04]])
    return 0.15 + points @ slopes


def moved(shape):
    """Photographs of a ball of smooth paint that is told to be the unit ball."""
    told, true = ([observe(c, one) for c in cameras(VIEWS, 32)] for one in (BALL, shape))
    used = [a.hit & b.hit & (a.exit_cosines > 0.3) for a, b in zip(told, true)]

    def gathered(seen):
        parts = (
            np.concatenate([getattr(view, name)[u] for view, u in zip(seen, used)])
            for name in ("points", "normals", "outgoing")
        )
        points, normals, outgoing = parts
        return points, SurfaceSamples(normals, outgoing)

    points, samples = gathered(true)
    diffuse, specular = np.moveaxis(exact_columns(samples), 1, 0)
    away = (points - shape.center) / shape.radius
    radiance = smooth(away) * diffuse + 0.2 * specular
    points, samples = gathered(told)
    frame = np.repeat(np.arange(VIEWS), [int(u.sum()) for u in used])
    places = SurfacePlaces(points, samples.normals)
    pixel = np.concatenate([np.argwhere(u) for u in used])
    pool = Observations(samples, radiance, frame, places, pixel=pixel)
    return pool, texel_sites(sphere_coordinates(points), IMAGE)


def freed_with_sites(told, free):
    """Free what moves pixels, given what they would then show."""
    sites = SurfaceSites(
        told[1],
        COUNT,
        IMAGE,
        BALL,
        np.full((COUNT, 3), np.nan),
        Regions(np.zeros(COUNT, int), ("",)),
    )
    return recovered(told, free, sites=sites)


def kd_off(fit):
    """Compare the paint of texels that are often seen with that of their middles."""
    u, v = texel_coordinates(IMAGE).T
    polar, azimuth = np.pi * (1 - v), 2 * np.pi * u
    level = np.sin(polar)
    middle = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.cos(polar)], axis=1)
    return np.median(np.abs(fit.texture.kd / smooth(middle) - 1)[fit.texture.seen >= 12])


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.3, 1])
def test_an_object_that_lies_elsewhere_is_found(size):
    aside = size * np.array([0.02, -0.012, 0.016])
    fit = freed_with_sites(moved(Sphere(aside)), ("object",))
    calibration = fit.calibration
    value, error = calibration.corrections.object, calibration.errors["object"]
    np.testing.assert_allclose(value, aside, atol=0.003)
    assert np.all(np.abs(value - aside) < 3.5 * error)
    assert max(off(fit)) < 3.5
    assert kd_off(fit) < 0.02


def test_what_a_texture_does_not_free_is_refused(ball):
    for name in ("nearness", "blur"):
        with pytest.raises(ValueError, match=f"{name} cannot be freed with a texture"):
            recovered(ball, (name,))
    for name in ("camera", "object", "scale"):
        with pytest.raises(ValueError, match=f"{name} cannot be freed: nobody says"):
            recovered(ball, (name,))
    field = SigmaField.over(np.asarray(ball[0].samples.normals)[:COUNT], 4)
    with pytest.raises(ValueError, match="nothing is freed where sigma varies"):
        recovered(ball, ("exposure",), field=field)
