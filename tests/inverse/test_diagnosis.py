"""What would explain the rest: causes and their columns.

- The columns of a cause are what photographs change by when it is planted: in small worlds whose
  geometry is traced again and whose radiance is the integral.
"""

import dataclasses
import functools

import jax.numpy as jnp
import numpy as np
import pytest
from ball_problems import (
    BRDF,
    CLEAN,
    ENERGY,
    ENVIRONMENT,
    KNOWN,
    LAMP,
    LIGHT,
    PHOTOGRAPHS,
    SIZE,
    STEP,
    cameras,
    photographed,
    seen,
)
from scipy.spatial.transform import Rotation

from jaxrender.brdf import WIDTH_BOUNDS, lobe_named, material_named
from jaxrender.geometry import Pinhole, Sphere, SurfaceSamples, world_from_local
from jaxrender.harmonics import evaluate
from jaxrender.inverse import FitSettings, KnownLight, Outcome, fit_brdf, unknowns_of
from jaxrender.inverse.diagnosis import Suspect, diagnose
from jaxrender.inverse.diagnosis.axes import other_axes
from jaxrender.inverse.diagnosis.causes import CAUSES
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.lighting import DirectionalSources, Environment


@pytest.fixture(scope="module")
def grounds():
    some = CLEAN._replace(radiance=PHOTOGRAPHS)
    return Grounds(
        some, PHOTOGRAPHS, np.ones((CLEAN.count, 1)), BRDF, LightParts.known(KNOWN), Sphere()
    )


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


@functools.cache
def blurred():
    """Average over rays through the four pixels beside each one's own, where all meet the ball."""
    total, whole = 0.0, np.full(CLEAN.count, True)
    for offset in np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]):
        # The pixel that the principal point is moved by is seen the other way.
        row, column = SIZE / 2 - offset
        moved = seen(
            [
                Pinhole(SIZE, SIZE, one.world_from_camera, fl_x=one.fl_x, cx=column, cy=row)
                for one in cameras()
            ]
        )
        # Beside the rim normals turn so far that another part is seen.
        turned = np.sum(np.asarray(moved.samples.normals) * np.asarray(CLEAN.samples.normals), 1)
        total, whole = total + photographed(moved), whole & (turned > 0.9)
    return PHOTOGRAPHS + STEP / 2 * np.where(whole[:, None], total - 4 * PHOTOGRAPHS, 0)


def moved_light():
    """Turn the whole light about x in the fourth photograph alone."""
    lamp = LAMP @ rotation(STEP, [1, 0, 0]).T
    turned = photographed(CLEAN, turned_environment(), lamp=lamp)
    return np.where(CLEAN.frame[:, None] == 3, turned, PHOTOGRAPHS)


def defocused():
    """Blur by how much farther than on average a pixel is, in radii."""
    away = CLEAN.places.points - CLEAN.eyes[CLEAN.frame]
    distance = np.linalg.norm(away, axis=1)[:, None]
    return PHOTOGRAPHS + (distance - distance.mean()) * (blurred() - PHOTOGRAPHS)


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
    "blur": (blurred, 0),
    "moved_light": (moved_light, 9),
    "defocus": (defocused, 1),
}


@pytest.mark.parametrize("name", PLANTED)
def test_columns_are_what_photographs_change_by(grounds, name):
    planted, number = PLANTED[name]
    change = (planted() - PHOTOGRAPHS) / STEP
    column = CAUSES[name].columns(grounds)[:, :, number]
    # The environment of the columns is coarser than that of the photographs.
    allowed = 0.1 if name in ("environment", "moved_light") else 0.04
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


def test_lobes_of_other_models_and_wide_ones_are_in_the_columns_of_the_lobe(grounds):
    made = CAUSES["lobe"].columns(grounds).reshape(PHOTOGRAPHS.size, -1)
    others = (
        lobe_named("phong").with_roughness(BRDF.width, None),
        lobe_named("ggx").with_roughness(BRDF.width, BRDF.mu),
        BRDF.with_roughness(min(8 * BRDF.width, WIDTH_BOUNDS[1]), BRDF.mu),
    )
    for other in others:
        lobe = other.with_amplitudes(np.zeros(3), np.full(3, 0.1))
        change = photographed(CLEAN, brdf=lobe).ravel()
        left = change - made @ np.linalg.lstsq(made, change, rcond=None)[0]
        # The environment of the columns is coarser than that of the photographs.
        assert np.linalg.norm(left) < 0.02 * np.linalg.norm(change)


def test_causes_that_need_cameras_or_places_wait_for_them(grounds):
    unplaced = grounds.observations._replace(eyes=None, places=None)
    blind = dataclasses.replace(grounds, observations=unplaced)
    without = {name for name, cause in CAUSES.items() if cause.columns(blind) is None}
    # A ball lights no part of itself.
    assert CAUSES["interreflection"].columns(grounds) is None
    places = {"camera", "object", "scale", "nearness", "sites", "blur", "defocus"}
    assert without == places | {"interreflection"}
    lamp = dataclasses.replace(grounds, light=LightParts.known(KnownLight(None, KNOWN.directional)))
    assert CAUSES["environment"].columns(lamp) is None
    without_lamps = KnownLight(ENVIRONMENT, DirectionalSources.none())
    smooth = dataclasses.replace(grounds, light=LightParts.known(without_lamps))
    assert CAUSES["lamps"].columns(smooth) is None
    assert CAUSES["nearness"].columns(smooth) is None


@pytest.mark.slow
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


def fitted(photographs, light=KNOWN, **settings):
    rng = np.random.default_rng(1)
    noisy = photographs * (1 + 0.01 * rng.normal(size=photographs.shape))
    pool = CLEAN._replace(radiance=noisy)
    kind = dataclasses.replace(BRDF, sigma=0.1)
    settings = FitSettings(starts=2, refine_samples=600, **settings)
    return fit_brdf(pool, light, unknowns_of(kind), kind, settings, shape=Sphere(), pool=pool)


def off(fit):
    """Errors in standard errors, of kd, ks, sigma and mu."""
    value, error = fit.parameters.value, fit.parameters.standard_error
    pairs = {"kd": BRDF.kd, "ks": BRDF.ks, "sigma": BRDF.sigma, "mu": BRDF.mu}
    return max(float(np.max(np.abs(value.of(n) - t) / error.of(n))) for n, t in pairs.items())


@pytest.mark.slow
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
            lambda: PHOTOGRAPHS * (1 + 0.03 * np.cos(1.7 * CLEAN.frame))[:, None],
            marks=pytest.mark.slow,
        ),
        pytest.param("black", lambda: PHOTOGRAPHS + 0.03, marks=pytest.mark.slow),
        pytest.param(
            "object",
            lambda: photographed(seen(shape=Sphere(np.array([0.01, 0.0, 0.0])))),
            marks=pytest.mark.slow,
        ),
        ("lamps", lambda: photographed(CLEAN, energy=1.1 * ENERGY)),
    ],
    ids=["exposure", "black", "object", "lamps"],
)
def test_what_is_wrong_is_named_and_in_the_error_bars(name, planted):
    fit = fitted(planted())
    assert fit.outcome is Outcome.MISFIT
    assert fit.diagnosis[0].cause == name
    assert fit.diagnosis[0].explains > 0.7
    assert any(fit.diagnosis[0].sentence in reason for reason in fit.reasons)
    assert off(fit) < 3.5


@pytest.mark.slow
def test_a_lamp_alone_is_named_though_light_falls_where_none_should():
    # Most pixels are black, and some of those that should be are lit: no column can make these.
    elsewhere = rotation(0.01, [1, 0, 0]) @ LAMP[0]
    planted = photographed(CLEAN, lamp=elsewhere[None]) - photographed(CLEAN, energy=0 * ENERGY)
    fit = fitted(np.maximum(planted, 0), KnownLight(None, KNOWN.directional))
    should_be_black = np.asarray(CLEAN.samples.normals) @ LAMP[0] < 0
    assert np.any(planted[should_be_black] > 1e-6)
    assert fit.diagnosis[0].cause == "lamps"
    assert fit.diagnosis[0].explains > 0.9


@pytest.mark.slow
def test_a_blur_is_named_rather_than_its_general_case_and_neither_where_it_is_not_asked_for():
    blur = (blurred() - PHOTOGRAPHS) / STEP
    fit = fitted(PHOTOGRAPHS + 0.5 * blur)
    assert fit.diagnosis[0].cause == "blur"
    assert "defocus" not in [one.cause for one in fit.diagnosis]
    told = fit.final.observations
    suspect = Suspect.of(fit.final, fit.brdf, KNOWN, Sphere(), told, told)
    others = diagnose(suspect._replace(unknown=("blur",)), fit.misfit)
    assert not {"blur", "defocus"} & {one.cause for one in others}
    away = CLEAN.places.points - CLEAN.eyes[CLEAN.frame]
    distance = np.linalg.norm(away, axis=1)[:, None]
    part = (distance - distance.min()) / np.ptp(distance)
    assert fitted(PHOTOGRAPHS + part**2 * blur).diagnosis[0].cause == "defocus"


@pytest.mark.slow
def test_no_diagnosis_where_none_is_wanted():
    fit = fitted(PHOTOGRAPHS + 0.03, diagnose=False)
    assert not fit.diagnosis
    assert fit.misfit.found


def test_a_lobe_as_wide_as_its_model_allows_is_compared_with_narrower_ones(grounds):
    rough = material_named("ggx", {"kd": BRDF.kd, "ks": BRDF.ks, "sigma": 0.9, "mu": 1.5})
    columns = CAUSES["lobe"].columns(dataclasses.replace(grounds, material=rough))
    assert columns is not None
    assert np.isfinite(columns).all()


def test_paint_goes_with_each_sample(grounds):
    """Samples with amplitudes of their own change as each of them would alone."""
    rng = np.random.default_rng(0)
    shares = rng.uniform(0.5, 2, (CLEAN.count, 1, 1))
    whole = np.stack([np.asarray(part) for part in BRDF.amplitudes])
    painted = dataclasses.replace(grounds, paint=shares * whole)
    for name in ("lamps", "object"):
        plain, own = (CAUSES[name].columns(one) for one in (grounds, painted))
        np.testing.assert_allclose(own, shares * plain, rtol=1e-9, atol=1e-12)
