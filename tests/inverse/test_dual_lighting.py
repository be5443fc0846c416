"""Pinned down: the light in angle and frequency at once (T 6.17 to 6.21).

- Model-made data of a band-limited light, nine parameters and the Fresnel ratio alone: the
  coefficients and the image come back to the grid's resolution, many samples a bin.
- Image and coefficients are consistent: the image is U - W L, L its moments (T 6.21).
- Transfer vectors and V(R) stand in for the convex object's nine parameters.
- The exact integral of an area light and a source: closer to the truth filtered by sigma than the
  coefficient method at l* = 12.
- Unseen bins are marked, have no error bar, and follow their rule.
- Standard errors are those that noise causes.
- Clamped and constrained images are not negative, and still consistent; the constrained solves are
  those of dense matrices.
- Misuse is refused.
"""

import numpy as np
import pytest
from inverse_problems import LIGHTS
from lighting_problems import glossy, photograph, random_light, samples_all_round

from jaxrender.brdf import Microfacet
from jaxrender.harmonics import LatLongGrid, analyse, degrees, synthesise
from jaxrender.inverse.lighting.coefficients import LightSettings, recover_coefficients
from jaxrender.inverse.lighting.dual import DualSettings, MirrorMisfit, recover_dual
from jaxrender.inverse.lighting.operator import light_operator
from jaxrender.lighting import DirectionalSources
from jaxrender.spectra import light_coefficients

ROWS, COUNT = 24, 5000
# A bilinear tent of 7.5 degrees on light of degree 2: l(l+1) h^2 / 12 twice is .017 of its size.
RESOLUTION = 0.03
SIGMA = 0.1
SOURCE = DirectionalSources(np.array([[-0.35, 0.8, 0.5]]), np.array([[0.8, 0.8, 0.8]]))


def thesis_operator(samples, band_limit=2, **keywords):
    return light_operator(glossy(), samples, band_limit, "none", **keywords)


def solid_angles(rows):
    return LatLongGrid(rows, 2 * rows).weights()[..., None]


@pytest.fixture(scope="module")
def model_made():
    samples, light = samples_all_round(COUNT), random_light(2)
    operator = thesis_operator(samples)
    return samples, light, operator, np.asarray(operator.apply(light))


def test_model_made_data(model_made):
    _, light, operator, measured = model_made
    found = recover_dual(operator, measured, None, DualSettings(ROWS))
    truth = np.asarray(synthesise(LatLongGrid(ROWS, 2 * ROWS), light))
    assert np.abs(found.coefficients - light).max() < RESOLUTION * np.abs(light).max()
    # Samples of a bin do not lie about its centre, where it has few of them.
    off = np.sqrt(np.mean((found.radiance - truth)[found.observed] ** 2))
    assert off < RESOLUTION * truth.mean()
    # Nothing but a full sphere was seen, and the moments of the image are the coefficients.
    moments = np.asarray(analyse(LatLongGrid(ROWS, 2 * ROWS), found.radiance, 2))
    np.testing.assert_allclose(moments, found.coefficients, atol=1e-9)


def test_transfer_vectors_and_shadowed_reflections():
    """A made-up concave object: every transfer vector its own, half of the reflections shadowed."""
    samples, light = samples_all_round(COUNT), random_light(2)
    rng = np.random.default_rng(0)
    vectors = np.asarray(thesis_operator(samples).diffuse(thesis_operator(samples).rows))
    vectors = vectors * rng.uniform(0.3, 1, (COUNT, 1)) + 0.1 * rng.normal(size=vectors.shape)
    unshadowed = (rng.random(COUNT) < 0.5).astype(float)
    operator = thesis_operator(samples, transfer_vectors=vectors, unshadowed=unshadowed)
    found = recover_dual(operator, np.asarray(operator.apply(light)), None, DualSettings(ROWS))
    assert np.abs(found.coefficients - light).max() < RESOLUTION * np.abs(light).max()
    convex = recover_dual(
        thesis_operator(samples, unshadowed=unshadowed),
        np.asarray(operator.apply(light)),
        None,
        DualSettings(ROWS),
    )
    assert np.abs(convex.coefficients - light).max() > 3 * RESOLUTION * np.abs(light).max()


@pytest.mark.slow
def test_closer_to_the_filtered_truth_than_twelve_degrees():
    samples = samples_all_round(COUNT, lowest_cosine=0.7)
    brdf = Microfacet(np.full(3, 0.15), np.full(3, 0.2), SIGMA, 1.5)
    exact = photograph(brdf, samples, LIGHTS, SOURCE)
    noise = 0.01 * exact
    measured = exact + noise * np.random.default_rng(1).normal(size=exact.shape)
    light = np.asarray(light_coefficients(LIGHTS.to_environment(64), 30))
    light = light + np.asarray(light_coefficients(SOURCE, 30))
    degree = degrees(30)
    grid = LatLongGrid(48, 96)
    filtered = np.exp(-(SIGMA**2) * degree * (degree + 1))[:, None] * light
    truth = np.asarray(synthesise(grid, filtered))

    def error(image):
        square = np.sum(solid_angles(48) * (image - truth) ** 2)
        return np.sqrt(square / np.sum(solid_angles(48) * truth**2))

    cut = recover_coefficients(
        light_operator(brdf, samples, 12, "none"), measured, 1 / noise, LightSettings(12)
    )
    nine = light_operator(brdf, samples, 2, "none")
    dual = recover_dual(nine, measured, 1 / noise, DualSettings(48))
    assert error(dual.radiance) < 0.8 * error(cut.image(48))
    # The lobe's own transfer undoes the filter in the coefficients of the diffuse light.
    own = light_operator(brdf, samples, 2)
    exact_dual = recover_dual(own, measured, 1 / noise, DualSettings(48))
    off = [
        np.linalg.norm(one.coefficients[:9] - light[:9]) / np.linalg.norm(light[:9])
        for one in (dual, exact_dual)
    ]
    assert off[1] < 0.03
    assert off[1] < off[0]


@pytest.fixture(scope="module")
def half_seen():
    """The samples whose R points up, of a brighter sky above a darker ground."""
    samples = samples_all_round(COUNT)
    up = np.flatnonzero(np.asarray(samples.reflected)[:, 2] > -0.5)[:3500]
    some = type(samples)(samples.normals[up], samples.outgoing[up])
    light = np.zeros((9, 3))
    light[0], light[2] = 4, 1
    operator = thesis_operator(some)
    return operator, light, np.asarray(operator.apply(light))


def test_unseen_bins_are_marked(half_seen):
    operator, _, measured = half_seen
    found = recover_dual(operator, measured, None, DualSettings(ROWS))
    height = LatLongGrid(ROWS, 2 * ROWS).directions()[..., 2]
    assert not found.observed[height < -0.65].any()
    assert found.observed[height > -0.4].mean() > 0.95
    assert np.isinf(found.standard_errors[~found.observed]).all()
    assert (found.confidence[~found.observed] == 0).all()
    assert "reflected nowhere: filled smoothly" in found.reasons[0]
    seen = found.radiance[found.observed]
    hidden = found.radiance[~found.observed]
    assert hidden.min() >= seen.min() - 1e-9
    assert hidden.max() <= seen.max() + 1e-9
    # The membrane goes on from the rim of what was seen, which is darker than the mean.
    assert hidden.mean() < seen.mean()
    filled = analyse(LatLongGrid(ROWS, 2 * ROWS), found.radiance, 2)
    np.testing.assert_allclose(filled, found.coefficients, atol=1e-9)


def test_left_out_bins(half_seen):
    operator, light, measured = half_seen
    found = recover_dual(operator, measured, None, DualSettings(ROWS, unseen="left-out"))
    assert (found.radiance[~found.observed] == 0).all()
    # Light of degree 2 is fitted exactly from what was seen of it.
    assert np.abs(found.coefficients - light).max() < 2 * RESOLUTION * np.abs(light).max()
    assert "left out" in found.reasons[0]


def test_standard_errors_are_those_of_noise():
    """Sixty seeds are sixty channels of one photograph."""
    seeds = 60
    samples, light = samples_all_round(2000), np.repeat(random_light(2, 1), 60, axis=1)
    brdf = Microfacet(np.full(seeds, 0.3), np.full(seeds, 0.1), SIGMA, 1.5)
    operator = light_operator(brdf, samples, 2, "none")
    exact = np.asarray(operator.apply(light))
    measured = exact + 0.02 * np.random.default_rng(2).normal(size=exact.shape)
    found = recover_dual(operator, measured, np.full(exact.shape, 50.0), DualSettings(8))
    spread = found.radiance.std(axis=-1, ddof=1)[found.observed]
    stated = found.standard_errors.mean(axis=-1)[found.observed]
    assert np.mean(spread**2 / stated**2) == pytest.approx(1, abs=0.1)


def test_positive_images(model_made):
    _, light, operator, _ = model_made
    dark = light.copy()
    dark[0] = 1.0
    rng = np.random.default_rng(3)
    measured = np.asarray(operator.apply(dark)) + 0.02 * rng.normal(size=(COUNT, 3))
    weights = np.full(measured.shape, 50.0)
    found = {
        name: recover_dual(operator, measured, weights, DualSettings(12, name))
        for name in ("none", "clamp", "soft", "hard")
    }
    lowest = {name: one.radiance.min() for name, one in found.items()}
    assert lowest["none"] < -0.1
    assert lowest["clamp"] == 0
    assert lowest["none"] < lowest["soft"]
    assert abs(lowest["hard"]) < 1e-6
    for one in found.values():
        moments = np.asarray(analyse(LatLongGrid(12, 24), one.radiance, 2))
        np.testing.assert_allclose(moments, one.coefficients, atol=1e-8)
    assert (np.asarray(found["none"].to_environment().radiance) >= 0).all()


def test_the_constrained_solve_is_that_of_the_dense_matrix():
    rng = np.random.default_rng(4)
    nodes, count = 40, 4
    misfit = MirrorMisfit(
        direct=rng.normal(size=nodes),
        diffuse=rng.normal(size=(nodes, count)),
        confidence=rng.uniform(0.5, 2, nodes),
        moments=0.1 * rng.normal(size=(nodes, count)),
        weights=np.ones(nodes),
        rest=1.0,
        measured=100.0,
    )
    stiffness, aim = rng.uniform(0, 3, nodes) * (rng.random(nodes) < 0.5), rng.normal(size=nodes)
    whole = np.eye(nodes) + misfit.diffuse @ misfit.moments.T
    left = whole.T @ (misfit.confidence[:, None] * whole) + np.diag(stiffness)
    right = whole.T @ (misfit.confidence * misfit.direct) + stiffness * aim
    found = misfit.minimum(stiffness, aim)
    np.testing.assert_allclose(found, np.linalg.solve(left, right), rtol=1e-9, atol=1e-12)
    residual = whole @ found - misfit.direct
    assert misfit.squares(found) == pytest.approx(1 + misfit.confidence @ residual**2)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (DualSettings(positivity="maybe"), "choose one of none, clamp, soft, hard"),
        (DualSettings(unseen="guess"), "choose one of smooth, left-out"),
        (DualSettings(height=4), "need 5 rows"),
    ],
)
def test_misuse_is_refused(settings, message):
    samples = samples_all_round(20)
    with pytest.raises(ValueError, match=message):
        recover_dual(thesis_operator(samples), np.ones((20, 3)), None, settings)


def test_what_shows_no_mirror_image_is_refused():
    samples = samples_all_round(20)
    chalk = Microfacet(np.ones(3), np.zeros(3), SIGMA, 1.5)
    with pytest.raises(ValueError, match="without a specular part"):
        recover_dual(light_operator(chalk, samples, 2, "none"), np.ones((20, 3)))
    hidden = thesis_operator(samples, unshadowed=np.zeros(20))
    with pytest.raises(ValueError, match="no sample shows"):
        recover_dual(hidden, np.ones((20, 3)))
