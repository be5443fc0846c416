"""What would explain the rest: score tests, and the columns of each cause.

A score test is the fit with more columns, to first order: least squares themselves are its oracle.
The columns of a cause are what photographs change by when it is planted: in small worlds whose
geometry is traced again and whose radiance is the integral.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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
from jaxrender.harmonics import evaluate
from jaxrender.inverse import FitSettings, KnownLight, Observations, Outcome, fit_brdf, unknowns_of
from jaxrender.inverse.diagnosis.axes import other_axes
from jaxrender.inverse.diagnosis.causes import CAUSES
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.diagnosis.scores import Leftover
from jaxrender.lighting import DirectionalSources, Environment, HarmonicLight
from jaxrender.reflection import integral_columns, radiance

SIZE, VIEWS, DISTANCE = 24, 6, 5.0
# Masked, so that nothing jumps where texels set behind the horizon: differences mean something.
BRDF = Microfacet(np.array([0.12, 0.17, 0.21]), np.full(3, 0.1), 0.25, 1.5, masking="smith")
LAMP = np.array([[0.48, 0.6, 0.64]])
ENERGY = np.array([[2.0, 1.8, 1.6]])

STEP = 1e-4


def smooth_light():
    """Make coefficients of smooth light, bright enough to be positive."""
    rng = np.random.default_rng(5)
    light = 0.25 * rng.normal(size=(16, 3))
    light[0] = 4.0
    return light


LIGHT = smooth_light()
ENVIRONMENT = HarmonicLight(LIGHT).to_environment(48)


def cameras(turn=0.0, axis=None):
    found = []
    for number in range(VIEWS):
        azimuth = 2 * np.pi * number / VIEWS
        height = (0.2, 0.6)[number % 2]
        towards = np.array([np.cos(azimuth), np.sin(azimuth), height])
        pose = look_at(
            DISTANCE * towards / np.linalg.norm(towards), np.zeros(3), np.array([0.0, 0, 1])
        )
        if axis is not None and number == 0:
            pose[:3, :3] = Rotation.from_rotvec(turn * np.asarray(axis)).as_matrix() @ pose[:3, :3]
        found.append(Pinhole(SIZE, SIZE, pose, fl_x=2.2 * SIZE))
    return found


def seen(every=None, shape=None):
    """List what cameras see of a ball, at those pixels that the clean ones see well."""
    clean = [observe(camera, Sphere()) for camera in cameras()]
    views = clean
    if every is not None or shape is not None:
        views = [observe(camera, shape or Sphere()) for camera in every or cameras()]
    usable = [view.exit_cosines > 0.4 for view in clean]

    def gathered(name):
        return np.concatenate([getattr(v, name)[u] for v, u in zip(views, usable)])

    samples = SurfaceSamples(gathered("normals"), gathered("outgoing"))
    places = SurfacePlaces(gathered("points"), gathered("geometric_normals"))
    frame = np.repeat(np.arange(VIEWS), [np.count_nonzero(u) for u in usable])
    pixel = np.concatenate([np.argwhere(u) for u in usable])
    eyes = np.stack([camera.position for camera in cameras()])
    blank = np.zeros((len(frame), 3))
    return Observations(samples, blank, frame, places, pixel=pixel, eyes=eyes)


def photographed(observations, light=None, lamp=LAMP, energy=ENERGY, brdf=BRDF):
    """Integrate over an environment, and over one lamp."""
    samples = SurfaceSamples(*(jnp.asarray(part) for part in observations.samples))
    nodes = (light or ENVIRONMENT).nodes(), DirectionalSources(lamp, energy).nodes()
    return sum(np.asarray(radiance(brdf, integral_columns(brdf, samples, part))) for part in nodes)


CLEAN = seen()
PHOTOGRAPHS = photographed(CLEAN)
KNOWN = KnownLight(ENVIRONMENT, DirectionalSources(LAMP, ENERGY))


@pytest.fixture(scope="module")
def grounds():
    some = CLEAN._replace(radiance=PHOTOGRAPHS)
    return Grounds(some, PHOTOGRAPHS, np.ones((CLEAN.count, 1)), BRDF, KNOWN, Sphere())


def rotation(angle, axis):
    return Rotation.from_rotvec(angle * np.asarray(axis, float)).as_matrix()


def turned_environment():
    """Turn the smooth light about x: what stood at w stands at R w."""
    directions = ENVIRONMENT.grid.directions()
    turned = np.asarray(evaluate(LIGHT, directions @ rotation(STEP, [1, 0, 0])))
    return Environment(turned)


def bumpy():
    """Turn normals by minus the gradient of the height z, which is sqrt(4 pi / 3) Y_10."""
    normals = np.asarray(CLEAN.samples.normals)
    gradient = np.array([0.0, 0.0, 1.0]) - normals[:, 2:] * normals
    moved = normals - STEP * np.sqrt(3 / (4 * np.pi)) * gradient
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    return CLEAN._replace(samples=SurfaceSamples(moved, CLEAN.samples.outgoing))


def near_lamp():
    """Stand the lamp at 1 / STEP radii: another direction and irradiance at every point."""
    offset = LAMP - STEP * np.asarray(CLEAN.places.points)
    squared = np.sum(offset**2, axis=1, keepdims=True)
    # Under a source the integral is the BRDF itself times the cosine.
    frames = np.asarray(world_from_local(jnp.asarray(CLEAN.samples.normals)))
    incoming = np.einsum("sji,sj->si", frames, offset / np.sqrt(squared))
    outgoing = np.einsum("sji,sj->si", frames, np.asarray(CLEAN.samples.outgoing))
    rho = np.asarray(BRDF.evaluate(jnp.asarray(incoming), jnp.asarray(outgoing)))
    lit = rho * np.maximum(incoming[:, 2:], 0) * ENERGY / squared
    return lit + photographed(CLEAN, energy=0 * ENERGY)


# Black levels are relative to the mean radiance (rms).
LEVEL = np.sqrt(np.mean(PHOTOGRAPHS**2))
# For each cause: the photographs with a little of it, and which of its columns that is.
PLANTED = {
    "camera": (lambda: photographed(seen(cameras(STEP, [0, 0, 1]))), 2),
    "object": (lambda: photographed(seen(shape=Sphere(np.array([0, STEP, 0])))), 1),
    "scale": (lambda: photographed(seen(shape=Sphere(radius=1 + STEP))), 0),
    "environment": (lambda: photographed(CLEAN, turned_environment()), 0),
    "normals": (lambda: photographed(bumpy()), 1),
    "nearness": (near_lamp, 0),
    "gain": (lambda: PHOTOGRAPHS * (1 + STEP * np.eye(3)[1]), 1),
    "exposure": (lambda: PHOTOGRAPHS * (1 + STEP * (CLEAN.frame[:, None] == 3)), 3),
    "black": (lambda: PHOTOGRAPHS + STEP * LEVEL * np.eye(3)[2], 2),
    "response": (lambda: PHOTOGRAPHS ** (1 + STEP), 0),
}


@pytest.mark.parametrize("name", PLANTED)
def test_columns_are_what_photographs_change_by(grounds, name):
    planted, number = PLANTED[name]
    change = (planted() - PHOTOGRAPHS) / STEP
    column = CAUSES[name].columns(grounds)[:, :, number]
    # The environment of the columns is coarser than that of the photographs.
    allowed = 0.1 if name == "environment" else 0.04
    assert np.linalg.norm(change - column) < allowed * np.linalg.norm(change)


def test_a_lamp_moved_aside_or_brighter_is_in_its_columns(grounds):
    lamp = CAUSES["lamps"].columns(grounds).reshape(PHOTOGRAPHS.size, 4)
    for planted in (
        photographed(CLEAN, lamp=LAMP @ rotation(STEP, [0, 0, 1]).T),
        photographed(CLEAN, energy=ENERGY * (1 + STEP)),
    ):
        change = ((planted - PHOTOGRAPHS) / STEP).ravel()
        left = change - lamp @ np.linalg.lstsq(lamp, change, rcond=None)[0]
        assert np.linalg.norm(left) < 0.02 * np.linalg.norm(change)


def test_causes_that_need_cameras_or_places_wait_for_them(grounds):
    unplaced = grounds.observations._replace(eyes=None, places=None)
    blind = dataclasses.replace(grounds, observations=unplaced)
    without = {name for name, cause in CAUSES.items() if cause.columns(blind) is None}
    assert without == {"camera", "object", "scale", "nearness", "sites"}
    lamp = dataclasses.replace(grounds, light=KnownLight(None, KNOWN.directional))
    assert CAUSES["environment"].columns(lamp) is None
    smooth = dataclasses.replace(grounds, light=KnownLight(ENVIRONMENT, DirectionalSources.none()))
    assert CAUSES["lamps"].columns(smooth) is None
    assert CAUSES["nearness"].columns(smooth) is None


def test_an_environment_in_another_convention_is_told_by_its_axes(grounds):
    # y up for z up, seen in a mirror too: right-handed axes alone would not find it.
    matrix = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]) @ np.diag([1.0, -1, 1])
    directions = ENVIRONMENT.grid.directions()
    turned = Environment(np.asarray(evaluate(LIGHT, directions @ matrix)))
    wrong = photographed(CLEAN, turned)
    some = dataclasses.replace(
        grounds, observations=CLEAN._replace(radiance=wrong), predicted=wrong
    )
    found = other_axes(some)
    np.testing.assert_array_equal(found.matrix, matrix)
    assert "its axes x, y, z should lie along +y, -z, +x" in found.sentence()
    assert other_axes(grounds) is None


def test_a_score_is_least_squares_with_more_columns():
    rng = np.random.default_rng(2)
    own, more = rng.normal(size=(200, 4)), rng.normal(size=(200, 3))
    more[:, 0] += own @ [1.0, 2, 0, 0]
    measured = own @ [1.0, -1, 2, 0] + more @ [0.3, 0, 0.2] + 0.1 * rng.normal(size=200)
    start = np.linalg.lstsq(own, measured, rcond=None)[0]
    left = measured - own @ start
    both = np.concatenate([own, more], axis=1)
    end = np.linalg.lstsq(both, measured, rcond=None)[0]
    score = Leftover(left, own).score(more)
    assert score.explained == pytest.approx(left @ left - np.sum((measured - both @ end) ** 2))
    np.testing.assert_allclose(score.shift, (end[:4] - start), atol=1e-9)
    assert score.columns == 3
    assert score.gain > 100


def test_columns_that_the_fit_makes_itself_explain_nothing():
    rng = np.random.default_rng(4)
    own, left = rng.normal(size=(100, 3)), rng.normal(size=100)
    score = Leftover(left, own).score(own @ rng.normal(size=(3, 2)))
    assert (score.columns, score.gain, score.explained) == (0, 0.0, 0.0)
    assert not Leftover(left, own).score(np.zeros((100, 2))).columns


def test_values_left_out_are_not_in_the_fit():
    rng = np.random.default_rng(6)
    own = rng.normal(size=(100, 2))
    left = 0.01 * rng.normal(size=100)
    left[:10] += 3
    clipped = np.arange(100) < 10
    score = Leftover(left, own).without(clipped, 1)
    expected = np.linalg.lstsq(own[10:], left[10:], rcond=None)[0]
    np.testing.assert_allclose(score.shift, expected)
    assert score.gain > 100


def fitted(photographs, **settings):
    rng = np.random.default_rng(1)
    noisy = photographs * (1 + 0.01 * rng.normal(size=photographs.shape))
    pool = CLEAN._replace(radiance=noisy)
    kind = dataclasses.replace(BRDF, sigma=0.1)
    settings = FitSettings(starts=2, refine_samples=600, **settings)
    return fit_brdf(pool, KNOWN, unknowns_of(kind), kind, settings, shape=Sphere(), pool=pool)


def off(fit):
    """Errors in standard errors, of kd, ks, sigma and mu."""
    value, error = fit.parameters.value, fit.parameters.standard_error
    pairs = {"kd": BRDF.kd, "ks": BRDF.ks, "sigma": BRDF.sigma, "mu": BRDF.mu}
    return max(float(np.max(np.abs(value.of(n) - t) / error.of(n))) for n, t in pairs.items())


def test_a_clean_capture_has_no_diagnosis():
    fit = fitted(PHOTOGRAPHS)
    assert fit.outcome is Outcome.CONVERGED
    assert not fit.diagnosis
    assert not fit.misfit.found
    assert fit.noise.relative == pytest.approx(0.01, rel=0.1)
    exact = fit.parameters.if_exact
    wider = fit.parameters.standard_error.kd / exact.standard_error.kd
    assert np.all(wider >= 1)
    assert np.all(wider < 1.6)


@pytest.mark.parametrize(
    ("name", "planted"),
    [
        pytest.param(
            "exposure",
            PHOTOGRAPHS * (1 + 0.03 * np.cos(1.7 * CLEAN.frame))[:, None],
            marks=pytest.mark.slow,
        ),
        pytest.param("black", PHOTOGRAPHS + 0.03, marks=pytest.mark.slow),
        pytest.param(
            "object",
            photographed(seen(shape=Sphere(np.array([0.01, 0.0, 0.0])))),
            marks=pytest.mark.slow,
        ),
        ("lamps", photographed(CLEAN, energy=1.1 * ENERGY)),
    ],
)
def test_what_is_wrong_is_named_and_in_the_error_bars(name, planted):
    fit = fitted(planted)
    assert fit.outcome is Outcome.MISFIT
    assert fit.diagnosis[0].cause == name
    assert fit.diagnosis[0].explains > 0.7
    assert any(fit.diagnosis[0].sentence in reason for reason in fit.reasons)
    assert off(fit) < 3.5


def test_no_diagnosis_where_none_is_wanted():
    fit = fitted(PHOTOGRAPHS + 0.03, diagnose=False)
    assert not fit.diagnosis
    assert fit.misfit.found
