"""A diffuse object's texture under unknown light (T 6.1.1, class 6); exact integrals, 1 % noise.

- At rest, any light of the family explains the photographs as well, to rounding, and the family is
  everything that the light's irradiance can be; odd degrees above 1 are no part of it.
- Total variation picks paint of few colours to a few per cent, least variance paint without trend.
- The ratio of sites of one normal is identifiable whatever light is assumed.
- An object that turns tells all but the scale.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from texture_problems import IMAGE, SITES, SmoothlyLit, texture, under_smooth_light

from jaxrender.geometry import SurfaceSamples
from jaxrender.geometry.texels import neighbouring_texels, texel_coordinates
from jaxrender.inverse.texture import diffuse_problem, factor_diffuse, texture_under

# Sites of 15 degrees, each taken for one normal, and light cut at degree 2.
COARSE = 0.08


@pytest.fixture(scope="module")
def shot():
    return SmoothlyLit()


def few_colours():
    coordinates = texel_coordinates(IMAGE)
    label = (np.floor(4 * coordinates[:, 0]) + np.floor(3 * coordinates[:, 1])).astype(int) % 3
    return np.array([[0.05, 0.1, 0.2], [0.25, 0.2, 0.1], [0.12, 0.05, 0.06]])[label]


def factored(shot, kd, prior, band_limit=2):
    _, measured = shot.measured(kd, np.zeros(SITES))
    pairs = neighbouring_texels(IMAGE, measured.seen > 0, wrap=True)
    problem = diffuse_problem(measured, shot.samples.normals, pairs, band_limit)
    return problem, factor_diffuse(problem, prior)


def off_scale(found, kd):
    """The texture's relative error, a scale of each channel apart."""
    ratio = found / kd
    ratio = ratio / np.nanmedian(ratio, axis=0)
    return float(np.sqrt(np.nanmean((ratio - 1) ** 2)))


def test_least_variance_serves_paint_without_trend(shot):
    kd = texture()[0]
    _, found = factored(shot, kd, "variance")
    assert found.converged
    # 250 sites whose log K_d scatters by .55, and nine coefficients: .55 sqrt(9 / 250) = .1.
    assert off_scale(found.texture, kd) < 0.15
    # The photographs themselves, taken for the texture, are this far off.
    assert np.std(shot.columns[:, 0] / shot.columns[:, 0].mean(axis=0)) > 0.3
    np.testing.assert_allclose(np.exp(np.nanmean(np.log(found.texture), axis=0)), 0.18 / np.pi)


def test_total_variation_serves_paint_of_few_colours(shot):
    errors = {
        p: off_scale(factored(shot, few_colours(), p)[1].texture, few_colours())
        for p in ("variance", "total-variation")
    }
    assert errors["total-variation"] < COARSE
    assert errors["total-variation"] < errors["variance"]


def test_every_light_of_the_family_explains_the_photographs_as_well(shot):
    problem, found = factored(shot, texture()[0], "variance", 4)
    # Degrees 0, 1, 2 and 4: 1 + 3 + 5 + 9; degree 3 makes no irradiance.
    assert found.directions.shape[1] == 18
    assert found.unidentifiable.all()
    rng = np.random.default_rng(0)
    before = predicted(problem, found.light, found.texture)
    for _ in range(3):
        light = found.moved(0.05 * rng.normal(size=found.unidentifiable.shape))
        other = texture_under(problem, light)
        assert np.nanmax(np.abs(other / found.texture - 1)) > 0.05
        np.testing.assert_allclose(predicted(problem, light, other), before, rtol=1e-9)


def predicted(problem, light, found):
    return (problem.basis @ light) * found[problem.measured.site]


def test_ratios_of_sites_of_one_normal_are_identifiable(shot):
    _, measured = shot.measured(texture()[0], np.zeros(SITES))
    normals = np.asarray(shot.samples.normals).copy()
    # Let pairs of sites have one normal.
    twin = measured._replace(site=measured.site)
    mean = np.stack(
        [
            normals[shot.site == s].mean(axis=0) if (shot.site == s).any() else [0, 0, 1.0]
            for s in range(SITES)
        ]
    )
    normals = mean[shot.site - shot.site % 2]
    problem = diffuse_problem(twin, normals, np.zeros((0, 2), int))
    found = factor_diffuse(problem, "variance")
    light = found.moved(0.1 * np.ones(found.unidentifiable.shape))
    ratio = [t[0::2] / t[1::2] for t in (found.texture, texture_under(problem, light))]
    # The moved light may be negative somewhere, and where depends on the signs of eigenvectors.
    lit = np.isfinite(ratio[1])
    assert lit.sum() > 0.9 * np.isfinite(ratio[0]).sum()
    np.testing.assert_allclose(ratio[0][lit], ratio[1][lit], rtol=1e-9)


def test_an_object_that_turns_tells_all_but_the_scale(shot):
    angle = 2 * np.pi * shot.frame / 7
    c, s, (x, y, z) = np.cos(angle), np.sin(angle), shot.samples.normals.T
    turned = np.stack([c * x - s * y, s * x + c * y, z], axis=-1)
    diffuse = np.asarray(
        under_smooth_light(SurfaceSamples(jnp.asarray(turned), jnp.asarray(turned)))
    )[:, 0]
    kd = texture()[0]
    _, measured = shot.measured(kd, np.zeros(SITES), diffuse)
    problem = diffuse_problem(measured, turned, np.zeros((0, 2), int), pose=shot.frame)
    found = factor_diffuse(problem, "variance")
    assert found.unidentifiable.sum(axis=1).tolist() == [1, 1, 1]
    # The one that is not identifiable is the scale: the light itself.
    scale = found.directions[:, 0]
    alike = np.einsum("ck,kc->c", scale, found.light)
    alike /= np.linalg.norm(scale, axis=1) * np.linalg.norm(found.light, axis=0)
    np.testing.assert_allclose(np.abs(alike), 1, atol=1e-6)
    assert off_scale(found.texture, kd) < COARSE


def test_priors_and_neighbours_are_asked_for(shot):
    problem, _ = factored(shot, few_colours(), "variance")
    with pytest.raises(ValueError, match="variance, total-variation"):
        factor_diffuse(problem, "wishes")
    with pytest.raises(ValueError, match="neighbouring sites"):
        factor_diffuse(problem._replace(pairs=np.zeros((0, 2), int)))
