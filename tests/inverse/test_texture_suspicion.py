"""What would explain what a texture under unknown light leaves: a painted ball in smooth light.

Photographs are the exact integral with 1 % noise.  Sites are solved under the true light, cut at a
degree, so that no search is needed; causes are tested as after one.

- Exposures are found with paint and light, by name or as the diagnosis names them; what all of them
  share is the light's.  What moves pixels, and what is of a light that is told, is not freed.
- The derivatives are differences of the prediction; paint keeps its mean, and the light answers.
- Exposures that differ, an object that lies elsewhere and another lobe are named; what is named is
  in the errors of paint, lobe and light.
- Clean photographs hold no more than the model, which is judged on the integral; nothing is named.
"""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import LIGHTS
from texture_problems import (
    BALL,
    IMAGE,
    LOBE,
    MU,
    SIGMA,
    SITES,
    cameras,
    texture,
    under_smooth_light,
)

from jaxrender.brdf import material_named
from jaxrender.geometry import Sphere, SurfacePlaces, SurfaceSamples, observe
from jaxrender.geometry.texels import sphere_coordinates, texel_sites
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations, Outcome, unknown
from jaxrender.inverse.calibration import Weighing
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.texture import (
    LightCoefficients,
    SiteData,
    SurfaceSites,
    UnknownLightSettings,
    by_site,
    site_sums,
    solve_freely,
    texture_columns,
    under_unknown_light,
)
from jaxrender.inverse.texture.estimate import TextureEstimate
from jaxrender.inverse.texture.free_paint_and_light import FreePaintAndLight, freed_with_light
from jaxrender.inverse.texture.judgement import Judging, judged
from jaxrender.inverse.texture.region_lobe import RegionLobe
from jaxrender.inverse.texture.sites import Regions
from jaxrender.inverse.texture.suspicion import LitPixels
from jaxrender.inverse.texture.texture import Texture
from jaxrender.inverse.texture.unknown_light import model_under
from jaxrender.reflection import polar_columns
from jaxrender.spectra import light_coefficients

VIEWS, PIXELS, BAND_LIMIT, STEP = 8, 26, 9, 1e-5
NOISE = NoiseModel(0.01, 0.0)
KD, KS = texture()


def smooth(points):
    """Paint that changes slowly along the surface; its K_s does not change."""
    slopes = np.array([[0.06, 0.02, -0.03], [-0.02, 0.05, 0.02], [0.03, -0.03, 0.04]])
    return 0.15 + points @ slopes, 0.2


def spotted(points):
    """Every texel has paint of its own."""
    paint = texel_sites(sphere_coordinates(points), IMAGE)
    return KD[paint], KS[paint][:, None]


def photographs(shape=BALL, lobe=None, paint=spotted):
    """Take exact photographs of a ball, which the fit is told to be the unit ball; their sites."""
    told, true = ([observe(c, one) for c in cameras(VIEWS, PIXELS)] for one in (BALL, shape))
    used = [a.hit & b.hit & (a.exit_cosines > 0.2) for a, b in zip(told, true)]

    def gathered(seen, name):
        return np.concatenate([getattr(view, name)[u] for view, u in zip(seen, used)])

    given, seen = (
        SurfaceSamples(gathered(views, "normals"), gathered(views, "outgoing"))
        for views in (told, true)
    )
    kd, ks = paint(gathered(true, "points") - shape.center)
    arrays = SurfaceSamples(*(jnp.asarray(part) for part in seen))
    if lobe is None:
        columns = under_smooth_light(arrays)
    else:
        columns = polar_columns(lobe, arrays, LIGHTS.radiance, polar_nodes=32)
    diffuse, specular = np.moveaxis(np.asarray(columns), 1, 0)
    exact = kd * diffuse + ks * specular
    points, frame = gathered(told, "points"), np.repeat(np.arange(VIEWS), [u.sum() for u in used])
    pixel = np.concatenate([np.argwhere(u) for u in used])
    pool = Observations(given, exact, frame, SurfacePlaces(points, given.normals), pixel=pixel)
    site = texel_sites(sphere_coordinates(points), IMAGE)
    regions = Regions(np.zeros(SITES, int), ("",))
    return pool, SurfaceSites(site, SITES, IMAGE, BALL, np.full((SITES, 3), np.nan), regions)


@pytest.fixture(scope="module")
def clean():
    return photographs()


@pytest.fixture(scope="module")
def light():
    found = np.asarray(light_coefficients(LIGHTS.to_environment(64), BAND_LIMIT))
    return LightCoefficients(found, np.full(found.shape, 0.01 * np.abs(found[0, 0])))


def solved(pool, sites, light):
    """Solve the sites under a light, in the units of a recovery: the mean of kd + ks is 1."""
    columns = texture_columns(LOBE, pool.samples, model_under(light, exact=True))
    data = by_site(pool, sites.of_observation, SITES)
    weights = 1 / np.maximum(NOISE.relative * data.radiance, 1e-3)
    own = columns.map(lambda part: part[data.index])
    sums = site_sums(SiteData(data.radiance, weights, data.site, SITES), own)
    found, precision = solve_freely(sums)
    kd, ks = (
        np.where((data.seen > 2)[..., None], a, np.nan) for a in (found.kd, found.ks[:, None])
    )
    ks, errors = ks[:, 0], 1 / np.sqrt(np.maximum(np.asarray(precision), 1e-12))
    scale = np.nanmean(kd) + np.nanmean(ks)
    kd, ks = kd / scale, ks / scale
    light = LightCoefficients(light.coefficients * scale, light.standard_error * scale)
    of_kd = 0.01 * kd
    marks = np.zeros(SITES, bool)
    material = unknown("microfacet")
    paint = Texture(
        kd, ks, of_kd, errors / scale, marks * np.nan, data.seen, marks, marks, of_kd,
        errors / scale, 0.0,
    )  # fmt: skip
    lobe = RegionLobe(0, "", SITES, SIGMA, MU, 0.001, 0.004, Outcome.CONVERGED)
    return TextureEstimate(
        material, paint, (lobe,), sites, NOISE, Outcome.CONVERGED, (), "", "", light
    )


def noisy(pool, wrong=None):
    """Let something be wrong, and add noise."""
    radiance = pool.radiance if wrong is None else wrong(pool.radiance, pool.frame)
    return pool._replace(radiance=NOISE.add(radiance, np.random.default_rng(0)))


def judge(taken, light, wrong=None, freed=()):
    """Solve noisy photographs and judge them."""
    pool, sites = noisy(taken[0], wrong), taken[1]
    return judge_noisy(pool, sites, light, freed)


def judge_noisy(pool, sites, light, freed=()):
    """Solve photographs and judge them."""
    estimate = solved(pool, sites, light)
    assert estimate.light is not None
    columns = texture_columns(LOBE, pool.samples, model_under(estimate.light, exact=True))
    return judged(estimate, columns, pool, Judging(None, exact=True, diagnosing=True, freed=freed))


def test_clean_photographs_hold_nothing_more(clean, light):
    found = judge(clean, light)
    assert found.misfit.noise.relative == pytest.approx(0.01, rel=0.1)
    assert not found.misfit.found
    assert (found.diagnosis, found.outcome, found.reasons) == ((), Outcome.CONVERGED, ())


def exposed(exact, frame):
    return exact * np.exp(0.03 * np.random.default_rng(2).normal(size=VIEWS))[frame][:, None]


def test_exposures_are_named_and_in_the_errors(clean, light):
    found = judge(clean, light, exposed)
    assert found.outcome is Outcome.MISFIT
    assert found.diagnosis[0].cause == "exposure"
    assert found.diagnosis[0].explains > 0.6
    assert "(exposure)" in found.reasons[1]
    exact = found.if_exact
    assert found.lobes[0].sigma_error > found.lobes[0].exact_errors[0] == exact.lobes[0].sigma_error
    assert np.all(found.light.standard_error >= 0.01 * np.abs(found.light.coefficients[0, 0]) / 2)


@pytest.mark.slow
def test_an_object_that_lies_elsewhere_is_named(light):
    found = judge(photographs(Sphere(np.array([0.012, -0.007, 0.01])), paint=smooth), light)
    assert found.outcome is Outcome.MISFIT
    assert found.diagnosis[0].cause == "object"


@pytest.mark.slow
def test_another_lobe_is_named(light):
    other = material_named("ggx", {"kd": LOBE.kd, "ks": LOBE.ks, **LOBE.numbers})
    assert judge(photographs(lobe=other), light).diagnosis[0].cause == "lobe"


def lit_pixels(clean, light):
    """Every ninth pixel of sites that are often seen."""
    pool, sites = clean
    estimate = solved(pool, sites, light)
    estimate = replace(estimate, texture=estimate.texture._replace(misfit=np.zeros(SITES)))
    often = np.flatnonzero(estimate.texture.seen[sites.of_observation] > 8)[::9]
    return LitPixels.of(estimate, pool, often, exact=True)


def test_the_derivatives_are_differences(clean, light):
    some = lit_pixels(clean, light)
    pool = clean[0]
    suspect = some.suspect(BALL, some.observations, pool, NOISE)
    known = suspect.derivatives(np.arange(len(some.number)))
    site, channel, part = 3, 1, 5
    kd, ks, coefficients = some.kd.copy(), some.ks.copy(), some.light.coefficients.copy()
    kd[site, channel] += STEP
    ks[site] += STEP
    coefficients[part, channel] += STEP
    mean = some.light.coefficients.copy()
    mean[0, channel] += STEP

    def difference(moved):
        after = moved.suspect(BALL, some.observations, pool, NOISE).predicted
        return known.weights * (after - suspect.predicted) / STEP

    first, sites = some.kd.size, len(some.ks)
    rougher = some.lobe.with_numbers({"sigma": SIGMA + STEP, "mu": MU})
    columns = {
        3 * site + channel: some._replace(kd=kd),
        first + site: some._replace(ks=ks),
        first + sites: some._replace(lobe=rougher),
        first + sites + 2 + channel: some._replace(light=some.light._replace(coefficients=mean)),
    }
    for column, moved in columns.items():
        expected = difference(moved)
        np.testing.assert_allclose(
            known.by_unknown[:, :, column], expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max()
        )
    expected = difference(some._replace(light=some.light._replace(coefficients=coefficients)))
    found = known.prior[channel][:, part - 1]
    ratio = np.sum(found * expected[:, channel]) / np.sum(expected[:, channel] ** 2)
    np.testing.assert_allclose(found, ratio * expected[:, channel], atol=1e-5)
    # So much the coefficient may be off: three times the size of its degree.
    degree = slice(4, 9)
    size = np.mean((coefficients**2 + some.light.standard_error**2)[degree, channel])
    assert ratio == pytest.approx(3 * np.sqrt(size), rel=1e-3)


def test_paint_keeps_its_mean_and_the_light_answers(clean, light):
    """A factor on all of the paint is none: the light takes it, and nothing moves."""
    some = lit_pixels(clean, light)
    suspect = some.suspect(BALL, some.observations, clean[0], NOISE)
    known = suspect.derivatives(np.arange(5))
    count = some.kd.size + some.ks.size
    brighter = np.zeros(known.parameters.shape[1])
    brighter[:count] = np.concatenate([some.kd.ravel(), some.ks])
    moved = known.parameters @ brighter
    np.testing.assert_allclose(moved[:count], 0, atol=1e-12)
    np.testing.assert_allclose(moved[count : -light.coefficients.size], 0, atol=1e-12)
    np.testing.assert_allclose(
        moved[-light.coefficients.size :].reshape(3, -1).T, some.light.coefficients
    )


@pytest.mark.parametrize("free", [("exposure",), pytest.param("auto", marks=pytest.mark.slow)])
def test_exposures_are_found_with_paint_and_light(clean, light, free):
    pool, sites = noisy(clean[0], exposed), clean[1]
    before = judge_noisy(pool, sites, light)

    def refit(observed, freed):
        return judge_noisy(observed, sites, light, freed)

    found = freed_with_light(before, pool, free, refit, exact=True)
    assert (found.outcome, found.diagnosis, found.reasons) == (Outcome.CONVERGED, (), ())
    calibration = found.calibration
    assert calibration.free == ("exposure",)
    assert calibration.settled
    assert calibration.absorbed > 0.9
    true = 0.03 * np.random.default_rng(2).normal(size=VIEWS)
    value, error = calibration.corrections.exposure, calibration.errors["exposure"]
    off = value - (true - true.mean())
    assert np.sqrt(np.mean(off**2)) < 0.005
    np.testing.assert_allclose(off, 0, atol=0.01)
    # No photograph tells the mean: the light would be as much brighter.
    np.testing.assert_allclose(error, 0.05 / np.sqrt(VIEWS), rtol=0.15)


def test_paint_and_lobe_answer_to_corrections(clean, light):
    """From a lobe that is a tenth too wide, two steps come back to the true one."""
    pool = noisy(clean[0])
    some = lit_pixels((pool, clean[1]), light)
    wide = some._replace(lobe=some.lobe.with_numbers({"sigma": 1.1 * SIGMA}))
    told = Told(some.observations, None, BALL)
    predicted = some.suspect(BALL, some.observations, pool, NOISE).predicted
    weighing = Weighing.of(NOISE, NOISE, predicted)
    capture = FreePaintAndLight(wide, told, ("exposure",), weighing, 100 / predicted)
    none = Corrections.none(told)
    first = capture.answered(none, wide)
    second = capture.corrected(none, first)
    assert float(second.pixels.lobe.sigma) == pytest.approx(SIGMA, rel=0.02)
    # Paint keeps its mean: the light answers.
    kept = [np.mean(one.kd[one.told]) + np.mean(one.ks[one.told]) for one in (wide, second.pixels)]
    assert kept[1] == pytest.approx(kept[0], rel=1e-6)


def test_what_is_not_freed_with_a_light_is_refused(clean, light):
    pool, sites = clean
    for name in ("camera", "object", "scale", "lamps", "blur"):
        with pytest.raises(ValueError, match=f"{name} cannot be freed with a texture under unkn"):
            under_unknown_light(
                pool, sites, unknown("microfacet"), UnknownLightSettings(free=(name,))
            )
    settings = UnknownLightSettings(free="auto", diagnose=False)
    with pytest.raises(ValueError, match="free='auto' frees what the diagnosis names"):
        under_unknown_light(pool, sites, unknown("microfacet"), settings)
    with pytest.raises(ValueError, match="nothing is freed with diffuse paint"):
        under_unknown_light(
            pool, sites, unknown("lambertian"), UnknownLightSettings(free=("exposure",))
        )
