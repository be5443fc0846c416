"""Nuisances found with the material: in a small world whose radiance is the BRDF itself.

A ball under two lamps, one of which stands five radii away, photographed with exposures that are
off by 3 percent.  Lamps are points, so that nothing of the fit's integrals is used.

- Freed by name, exposures and nearness are found within their errors, and the material with them;
  without, it is many of its own errors off, and with ``auto`` the diagnosis finds the way.
- A blur is found with the material, and light and pixels stay as they were told.
- Found on a part of the samples, it is what all of them say.
- A capture in which nothing is wrong stays as it is, and its errors hold the priors of what the
  photographs cannot tell.
- What cannot be freed is refused by its name; what cannot be told apart is said.
- A few pixels far off hardly count in what is left above the noise.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from jaxrender.brdf import Microfacet
from jaxrender.geometry import (
    Pinhole,
    Sphere,
    SurfacePlaces,
    SurfaceSamples,
    look_at,
    observe,
    world_from_local,
)
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, KnownLight, Observations, Outcome, fit_brdf, unknowns_of
from jaxrender.inverse.calibration import Weighing, capture, check_free
from jaxrender.inverse.diagnosis.blurring import softening
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.inverse.stated import Stated
from jaxrender.lighting import DirectionalSources

SIZE, VIEWS, DISTANCE = 24, 6, 5.0
# Masked, so that nothing jumps where a lamp sets behind the horizon.
BRDF = Microfacet(np.array([0.12, 0.17, 0.21]), np.full(3, 0.1), 0.25, 1.5, masking="smith")
LAMPS = np.array([[0.48, 0.6, 0.64], [-0.6, -0.48, 0.64]])
ENERGY = np.array([[2.0, 1.8, 1.6], [1.0, 1.1, 1.3]])
NEAR = np.array([0.2, 0.0])
GAINS = 1 + 0.03 * np.array([1.2, -0.7, 0.4, -1.3, 0.9, -0.5])
NOISE = NoiseModel(0.01, 0.003)
LIGHT = KnownLight(None, DirectionalSources(LAMPS, ENERGY))


def seen():
    """List what the cameras see of the ball."""
    cameras = []
    for number in range(VIEWS):
        azimuth = 2 * np.pi * number / VIEWS
        towards = np.array([np.cos(azimuth), np.sin(azimuth), (0.2, 0.6)[number % 2]])
        position = DISTANCE * towards / np.linalg.norm(towards)
        pose = look_at(position, np.zeros(3), np.array([0.0, 0, 1]))
        cameras.append(Pinhole(SIZE, SIZE, pose, fl_x=2.2 * SIZE))
    views = [observe(camera, Sphere()) for camera in cameras]
    usable = [view.exit_cosines > 0.3 for view in views]

    def gathered(name):
        return np.concatenate([getattr(v, name)[u] for v, u in zip(views, usable)])

    frame = np.repeat(np.arange(VIEWS), [np.count_nonzero(u) for u in usable])
    return Observations(
        SurfaceSamples(gathered("normals"), gathered("outgoing")),
        np.zeros((len(frame), 3)),
        frame,
        SurfacePlaces(gathered("points"), gathered("geometric_normals")),
        pixel=np.concatenate([np.argwhere(u) for u in usable]),
        eyes=np.stack([camera.position for camera in cameras]),
    )


SEEN = seen()


def rendered(nearness):
    """Let point lamps shine: rho E cos t / r^2, r relative to the distance of the centre."""
    frames = np.asarray(world_from_local(jnp.asarray(SEEN.samples.normals)))
    outgoing = np.einsum("sji,sj->si", frames, SEEN.samples.outgoing)
    total = np.zeros((SEEN.count, 3))
    for direction, energy, near in zip(LAMPS, ENERGY, nearness):
        offset = direction - near * SEEN.places.points
        squared = np.sum(offset**2, axis=1, keepdims=True)
        incoming = np.einsum("sji,sj->si", frames, offset / np.sqrt(squared))
        rho = np.asarray(BRDF.evaluate(jnp.asarray(incoming), jnp.asarray(outgoing)))
        total += rho * np.maximum(incoming[:, 2:], 0) * energy / squared
    return total


def photographed(nearness=NEAR, gains=GAINS):
    pixels = rendered(nearness) * gains[SEEN.frame][:, None]
    return SEEN._replace(radiance=NOISE.add(pixels, np.random.default_rng(1)))


def fitted(pool, free=(), stated=None, **settings):
    kind = dataclasses.replace(BRDF, sigma=0.1)
    chosen = FitSettings(starts=1, refine_samples=600, free=free, **settings)
    unknowns = unknowns_of(kind, stated)
    return fit_brdf(pool, LIGHT, unknowns, kind, chosen, shape=Sphere(), pool=pool)


def off(fit):
    """Say how many of its standard errors each number of the material is off, at the worst."""
    value, error = fit.parameters.value, fit.parameters.standard_error
    truth = {"kd": BRDF.kd, "ks": BRDF.ks, "sigma": BRDF.sigma}
    return {n: float(np.max(np.abs(value.of(n) - t) / error.of(n))) for n, t in truth.items()}


@pytest.fixture(scope="module")
def wrong():
    return photographed()


@pytest.fixture(scope="module")
def clean():
    return photographed(0 * NEAR, np.ones(VIEWS))


@pytest.mark.slow
def test_nuisances_are_found_with_the_material(wrong):
    without = off(fitted(wrong, diagnose=False))
    assert max(without["sigma"], without["ks"]) > 5
    fit = fitted(wrong, ("exposure", "nearness"))
    assert fit.outcome is Outcome.CONVERGED
    calibration = fit.calibration
    assert calibration.free == ("exposure", "nearness")
    assert calibration.settled
    assert max(off(fit).values()) < 4
    near = calibration.corrections.nearness
    assert np.all(np.abs(near - NEAR) < 4 * calibration.errors["nearness"])
    assert near[0] == pytest.approx(NEAR[0], rel=0.02)
    assert np.all(calibration.errors["nearness"] < 0.002)
    # Exposures are known but for the one factor that the material takes.
    found = np.exp(calibration.corrections.exposure)
    np.testing.assert_allclose(found / found.mean(), GAINS / GAINS.mean(), atol=0.005)
    np.testing.assert_array_equal(calibration.light.near.of_sources, near)
    assert not any(
        calibration.corrections.of(other).any() for other in ("camera", "lamps", "black")
    )
    mended = calibration.corrections.observations(calibration.told)
    np.testing.assert_array_equal(fit.final.observations.radiance, mended.radiance)


@pytest.mark.slow
def test_auto_frees_what_the_diagnosis_names():
    fit = fitted(photographed(NEAR / 2), "auto")
    assert fit.outcome is Outcome.CONVERGED
    assert not fit.diagnosis
    assert set(fit.calibration.free) == {"nearness", "exposure"}
    near = fit.calibration.corrections.nearness
    assert np.all(np.abs(near - NEAR / 2) < 4 * fit.calibration.errors["nearness"])
    assert max(off(fit).values()) < 4


def blurred(width):
    """Photograph without noise, blur the whole images, and keep what is far enough from the rim."""
    clean = photographed(0 * NEAR, np.ones(VIEWS))
    images, seen = np.zeros((VIEWS, SIZE, SIZE, 3)), np.zeros((VIEWS, SIZE, SIZE))
    at = (clean.frame, *clean.pixel.T)
    images[at], seen[at] = rendered(0 * NEAR), 1
    images, seen = (
        gaussian_filter(part, (0, width, width, 0)[: part.ndim]) for part in (images, seen)
    )
    kept = np.flatnonzero(seen[at] > 0.999)
    values = NOISE.add(images[at], np.random.default_rng(1))
    return clean._replace(radiance=values).take(kept)


@pytest.mark.slow
def test_a_blur_is_found_with_the_material():
    pool = blurred(0.6)
    assert off(fitted(pool, diagnose=False))["sigma"] > 3
    fit = fitted(pool, ("blur",))
    assert fit.outcome is Outcome.CONVERGED
    # A Gaussian of .6 that is sampled at pixels has the variance .356.
    assert fit.calibration.corrections.blur[0] == pytest.approx(0.356, rel=0.06)
    assert max(off(fit).values()) < 3.5


def test_a_blur_of_samples_that_are_no_pixels_is_refused(clean):
    with pytest.raises(ValueError, match="blur cannot be freed: nobody says which pixels"):
        fitted(clean._replace(pixel=None), ("blur",), diagnose=False)
    # As in pictures of a few pixels: from one to the next is far beyond the rim.
    coarse = clean._replace(pixel=clean.pixel // 12)
    with pytest.raises(ValueError, match="mixes every sample with what lies beside the object"):
        fitted(coarse, ("blur",), diagnose=False)


def test_what_a_blur_does_to_a_photograph_of_few_samples_nobody_knows(clean):
    first = np.flatnonzero(clean.frame == 0)
    few = clean.take(np.concatenate([first[::50][:5], np.flatnonzero(clean.frame > 0)]))
    values, one = np.zeros((few.count, 3)), np.ones((few.count, 1))
    grounds = Grounds(few, values, one, BRDF, LightParts.known(LIGHT), Sphere())
    found = softening(grounds, 0.2)
    assert not found.inside[:5].any()
    assert not found.added[:5].any()
    assert np.mean(found.inside[5:]) > 0.8
    assert softening(dataclasses.replace(grounds, observations=few.take(np.arange(5)))) is None


def test_a_clean_capture_is_left_alone_and_what_is_freed_is_in_the_errors(clean):
    before = fitted(clean, "auto")
    assert before.outcome is Outcome.CONVERGED
    assert before.calibration is None
    fit = fitted(clean, ("exposure", "nearness"))
    calibration = fit.calibration
    for name in calibration.free:
        assert np.all(np.abs(calibration.corrections.of(name)) < 4 * calibration.errors[name])
    before, after = (one.parameters.standard_error for one in (before, fit))
    for name in ("kd", "ks"):
        assert np.all(after.of(name) > 3 * before.of(name))
    # No photograph tells the mean exposure: its prior is 5 percent, over so many photographs.
    assert np.all(after.kd / BRDF.kd == pytest.approx(0.05 / np.sqrt(VIEWS), rel=0.1))
    assert any("exposure and the material cannot be told apart" in r for r in fit.reasons)


@pytest.mark.slow
def test_what_is_found_on_a_part_of_the_samples_is_as_good_as_on_all(wrong, monkeypatch):
    """The errors that are stated are those of all, so that the end is to be theirs, too."""
    whole = fitted(wrong, ("exposure", "nearness"), diagnose=False)
    monkeypatch.setattr(capture, "_SAMPLES", 100)
    monkeypatch.setattr(capture, "_WORK", 0)
    part = fitted(wrong, ("exposure", "nearness"), diagnose=False)
    here, there = part.calibration, whole.calibration
    for name in here.free:
        np.testing.assert_allclose(here.errors[name], there.errors[name], rtol=0.05)
        apart = (here.corrections.of(name) - there.corrections.of(name)) / there.errors[name]
        assert np.all(np.abs(apart) < 0.05)
    np.testing.assert_allclose(off(part)["sigma"], off(whole)["sigma"], atol=0.2)


def test_what_cannot_be_told_apart_is_said(clean):
    """Of a known material, all exposures together are the brightness of all lamps."""
    stated = {"kd": Stated(tuple(BRDF.kd.tolist())), "ks": Stated(tuple(BRDF.ks.tolist()))}
    both = fitted(clean, ("exposure", "lamps"), stated, diagnose=False)
    (sentence,) = both.calibration.sentences
    assert sentence.startswith("exposure and lamps cannot be told apart by these photographs")
    assert sentence in both.reasons
    alone = fitted(clean, ("exposure",), stated, diagnose=False)
    assert alone.calibration.sentences == ()
    narrow, wide = (one.calibration.errors["exposure"] for one in (alone, both))
    assert np.all(narrow < 0.002)
    assert np.all(wide > 0.01)


@pytest.mark.slow
def test_a_photograph_without_samples_keeps_its_number(wrong):
    """As where few of its pixels are usable, and none of them is drawn."""
    some = wrong.take(np.flatnonzero(wrong.frame != 2))
    fit = fitted(some, ("exposure", "nearness"))
    assert fit.outcome is Outcome.CONVERGED
    found = fit.calibration.corrections.exposure
    assert found.shape == (VIEWS,)
    assert abs(found[2]) < 1e-12
    ratio = np.exp(found[[0, 1, 3, 4, 5]]) / GAINS[[0, 1, 3, 4, 5]]
    np.testing.assert_allclose(ratio / ratio.mean(), 1, atol=0.005)


def test_what_cannot_be_freed_is_refused_by_name(wrong):
    assert check_free(("nearness", "black", "nearness")) == ("nearness", "black")
    with pytest.raises(ValueError, match="'paint' cannot be freed; choose of exposure, camera"):
        check_free(("nearness", "paint"))
    with pytest.raises(ValueError, match="environment cannot be freed: the light has no env"):
        fitted(wrong, ("exposure", "environment"), diagnose=False)
    unplaced = wrong._replace(places=None, eyes=None)
    with pytest.raises(ValueError, match=r"nearness cannot be freed: .* where the samples lie"):
        fitted(unplaced, ("nearness",), diagnose=False)


def test_a_few_pixels_far_off_do_not_decide_what_is_left_above_the_noise(clean):
    rng = np.random.default_rng(3)
    pool = clean.take(np.arange(1000))
    predicted = np.ones((1000, 3))
    weighing = Weighing.of(NOISE, NOISE, predicted)
    own = NOISE.add(predicted, rng)
    far, everywhere = own.copy(), own + 3 * NOISE.relative * np.ones((1000, 3))
    far[:5] += 200 * NOISE.relative
    nothing, few, all_of_them = (
        weighing.above_noise(pool._replace(radiance=values), predicted)
        for values in (own, far, everywhere)
    )
    # Squares of the five alone would be 600,000, and 27,000 of all that are off by three.
    assert abs(nothing) < 500
    assert few < 5000 < 8000 < all_of_them
