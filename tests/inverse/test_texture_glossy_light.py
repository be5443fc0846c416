"""A glossy object's texture under unknown light (T 6.1.1, class 7); exact integrals, 1 % noise.

- The light's specular image is found whatever the texture, and with it K_d and K_s in one unit.
- The diffuse constants of the sites have no part in it.
- sigma and mu are found on model-made data (solver test), and within their errors on exact ones.
- The errors of light and K_d are of the size that they are stated to be.
- One photograph of each place is refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import LIGHTS, microfacet_unknowns
from texture_problems import LOBE, MU, SIGMA, SITES, SmoothlyLit, texture

from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse import Observations, Unknown
from jaxrender.inverse.texture import (
    GlossyProblem,
    SiteData,
    SiteMaterial,
    by_site,
    recover_glossy,
    solve_view_dependent,
)
from jaxrender.inverse.texture.harmonic_columns import LobeColumns, diffuse_basis, harmonic_columns
from jaxrender.spectra import light_coefficients

FIXED = microfacet_unknowns(sigma=Unknown((SIGMA,)), mu=Unknown((MU,)))


@pytest.fixture(scope="module")
def shot():
    return SmoothlyLit()


def off_scale(found, kd):
    ratio = found / kd
    ratio = ratio / np.nanmedian(ratio, axis=0)
    return float(np.sqrt(np.nanmean((ratio - 1) ** 2)))


# Coefficients beyond this are left out.  At 7 mu is 4 standard errors off: 1.6 %.
BAND_LIMIT = 9


@pytest.fixture(scope="module")
def truth():
    return np.asarray(light_coefficients(LIGHTS.to_environment(64), BAND_LIMIT))


@pytest.fixture(scope="module")
def glossy(shot):
    kd, ks = texture()
    seen, measured = shot.measured(kd, ks)
    problem = GlossyProblem(measured, seen, LOBE, BAND_LIMIT, (0.01, 0.0))
    mean = float(ks[measured.seen > 1].mean())
    return problem, recover_glossy(problem, FIXED, mean_ks=mean)


@pytest.mark.slow
def test_the_light_is_found_by_what_moves_with_the_view(glossy, truth):
    light = glossy[1].light
    scale = np.sum(light.coefficients * truth) / np.sum(truth**2)
    # The mean of K_s over some 250 sites, each known to some 10 %, sets the scale.
    assert scale == pytest.approx(1, abs=0.07)
    low = slice(0, 9)
    error = np.linalg.norm(light.coefficients[low] / scale - truth[low])
    assert error < 0.07 * np.linalg.norm(truth[low])
    assert (light.relative_error_by_degree[:3] < 0.1).all()


@pytest.mark.slow
def test_the_texture_follows_from_the_light(glossy):
    kd, ks = texture()
    problem, found = glossy
    seen = problem.measured.seen > 4
    assert off_scale(found.kd[seen], kd[seen]) < 0.12
    assert np.nanmedian(found.kd[seen] / kd[seen]) == pytest.approx(1, abs=0.1)
    assert np.corrcoef(found.ks[seen], ks[seen])[0, 1] > 0.85
    assert np.isnan(found.kd[problem.measured.seen == 0]).all()


@pytest.mark.slow
def test_diffuse_constants_have_no_part_in_the_light(shot, glossy):
    ks = texture()[1]
    measured = glossy[0].measured
    extra = np.random.default_rng(1).uniform(0, 0.2, (SITES, 3))
    samples = SurfaceSamples(*(jnp.asarray(a)[measured.index] for a in shot.samples))
    columns = harmonic_columns(samples, LOBE, 5, False)
    guess = SiteMaterial(np.zeros((SITES, 3)), ks / 0.2)
    weights = np.ones_like(measured.radiance)
    lights = [
        solve_view_dependent(
            LobeColumns(columns, columns), SiteData(radiance, weights, measured.site, SITES), guess
        ).coefficients
        for radiance in (measured.radiance, measured.radiance + extra[measured.site])
    ]
    np.testing.assert_allclose(lights[0], lights[1], rtol=1e-5, atol=1e-6)


@pytest.mark.slow
def test_roughness_and_index_are_found_on_model_made_data(shot, truth):
    samples = SurfaceSamples(*(jnp.asarray(a) for a in shot.samples))
    light = truth[:36]
    lit = (np.asarray(part @ light) for part in _columns(samples))
    radiance = sum(
        amount[shot.site] * part for amount, part in zip((texture()[0], texture()[1][:, None]), lit)
    )
    seen = Observations(shot.samples, radiance, shot.frame)
    problem = GlossyProblem(by_site(seen, shot.site, SITES), seen, LOBE, 5, (0.01, 0.0), False)
    found = recover_glossy(problem, microfacet_unknowns(), mean_ks=0.2)
    assert found.light.sigma == pytest.approx(SIGMA, rel=0.005)
    assert found.light.mu - 1 == pytest.approx(MU - 1, rel=0.01)
    assert found.light.converged


def _columns(samples):
    return diffuse_basis(samples, 5), harmonic_columns(samples, LOBE, 5, False)


@pytest.mark.slow
def test_roughness_and_index_are_within_their_errors(glossy):
    """K_s varies by a third, which one K_s for all would take for roughness (10 % off)."""
    light = recover_glossy(glossy[0], microfacet_unknowns()).light
    assert light.mu is not None
    assert light.mu_error is not None
    assert abs(light.sigma - SIGMA) < 3 * light.sigma_error
    assert abs(light.mu - MU) < 3 * light.mu_error
    assert light.sigma_error < 0.03 * SIGMA
    assert light.mu_error < 0.05 * (MU - 1)


@pytest.mark.slow
def test_errors_of_light_and_texture(glossy, truth):
    kd, ks = texture()
    problem, found = glossy
    often = problem.measured.seen > 3
    # The unit is the mean K_s; whose, is a choice, so that it is taken out first.
    weights = np.where(often, found.ks_error**-2.0, 0)
    scale = np.nansum(weights * ks) / np.nansum(weights * found.ks)
    off = (found.light.coefficients / scale - truth)[:16] / found.light.standard_error[:16]
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.5
    off = ((scale * found.kd - kd) / found.kd_error)[often]
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.4


def test_what_is_not_identifiable_is_refused(shot):
    seen, measured = shot.measured(texture()[0], texture()[1])
    once = measured.take(np.unique(measured.site, return_index=True)[1])
    with pytest.raises(ValueError, match="no site is seen more than once"):
        recover_glossy(GlossyProblem(once, seen, LOBE, 5, (0.01, 0.0)), FIXED)
