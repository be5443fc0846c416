"""The systems of single sites: their exact solution, what is known of it, and the twin.

- K_d and K_s >= 0 are those of SciPy's non-negative least squares, for every pattern of bounds;
  one K_s for all sites is that of the whole system.
- The prior is one more measurement of K_s; where nothing tells K_s, it is the prior's mean.
- Derivatives through the solution are those of finite differences, bounds included.
- Standard errors are the roots of the inverse system's diagonal, and what a thousand draws scatter.
- The spread of K_s is found through the noise of its estimates.
- T 6.14 as printed; with one weight for both, alternation ends at the joint solution.
- Sites unseen by a weight get the mean K_s, or are marked.
- Chunks cut between sites, hold every observation once, and all have one shape.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import nnls

from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse import Observations
from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture import (
    SiteData,
    SpecularPrior,
    alternate,
    by_shares,
    by_site,
    confidence,
    site_errors,
    site_sums,
    solve_freely,
    solve_sites,
    spread_of,
    whole_sites,
)
from jaxrender.inverse.texture.measurements import in_chunks

# Both solve small systems directly; what is left is rounding times the condition.
TIGHT = {"rtol": 1e-8, "atol": 1e-10}
SITES, EACH = 40, 5
NO_PRIOR = SpecularPrior(np.zeros(()), np.zeros(()))


def problem(seed=0, noise=0.5, sites=SITES):
    """Random columns, noise so large that all patterns of bounds occur."""
    rng = np.random.default_rng(seed)
    site = np.repeat(np.arange(sites), EACH)
    columns = Columns(
        jnp.asarray(rng.uniform(0.2, 2, (len(site), 3))),
        jnp.asarray(rng.uniform(0, 1.5, (len(site), 3))),
    )
    kd, ks = rng.uniform(0, 0.4, (sites, 3)), rng.uniform(0, 0.6, sites)
    exact = kd[site] * columns.diffuse + ks[site][:, None] * columns.specular
    weights = rng.uniform(0.5, 2, exact.shape)
    radiance = np.asarray(exact) + noise * rng.normal(size=exact.shape)
    return SiteData(radiance, weights, site, sites), columns, (kd, ks)


def matrix_of(data, columns, site):
    """Rows of one site's system for (K_d of three channels, K_s)."""
    rows = np.asarray(data.site) == site
    weights = np.asarray(data.weights)[rows]
    diffuse, specular = (np.asarray(c)[rows] * weights for c in columns)
    blocks = [np.zeros((rows.sum(), 4)) for _ in range(3)]
    for channel, block in enumerate(blocks):
        block[:, channel], block[:, 3] = diffuse[:, channel], specular[:, channel]
    right = (np.asarray(data.radiance)[rows] * weights).T.ravel()
    return np.concatenate(blocks), right


def test_every_site_is_the_solution_of_nnls():
    data, columns, _ = problem()
    material = solve_sites(site_sums(data, columns), NO_PRIOR)
    held = set()
    for site in range(SITES):
        expected = nnls(*matrix_of(data, columns, site))[0]
        held.add(tuple(expected > 0))
        found = [*np.asarray(material.kd)[site], float(material.ks[site])]
        np.testing.assert_allclose(found, expected, **TIGHT)
    assert len(held) > 6  # patterns of what is at its bound


def test_one_specular_reflectance_for_all_is_that_of_the_whole_system():
    data, columns, _ = problem(sites=12)
    material = solve_sites(site_sums(data, columns), NO_PRIOR, True)
    rows, right = [], []
    for site in range(12):
        matrix, target = matrix_of(data, columns, site)
        whole = np.zeros((len(matrix), 37))
        whole[:, 3 * site : 3 * site + 3], whole[:, 36] = matrix[:, :3], matrix[:, 3]
        rows.append(whole)
        right.append(target)
    expected = nnls(np.concatenate(rows), np.concatenate(right))[0]
    np.testing.assert_allclose(np.asarray(material.kd).ravel(), expected[:36], **TIGHT)
    np.testing.assert_allclose(material.ks, np.full(12, expected[36]), **TIGHT)


def test_the_prior_is_one_more_measurement():
    data, columns, _ = problem(1)
    prior = SpecularPrior(np.asarray(0.3), np.asarray(4.0))
    material = solve_sites(site_sums(data, columns), prior)
    for site in range(SITES):
        matrix, right = matrix_of(data, columns, site)
        matrix = np.concatenate([matrix, [[0, 0, 0, 2.0]]])
        expected = nnls(matrix, np.append(right, 2.0 * 0.3))[0]
        np.testing.assert_allclose(float(material.ks[site]), expected[3], **TIGHT)


def test_where_nothing_tells_ks_it_is_the_priors_mean():
    data, columns, _ = problem(2, noise=0.01)
    # Specular like diffuse at one site, nothing at all at another, no light at a third.
    specular = np.array(columns.specular)
    specular[:EACH] = 0.7 * np.asarray(columns.diffuse)[:EACH]
    specular[EACH : 2 * EACH] = 0
    diffuse = np.array(columns.diffuse)
    diffuse[2 * EACH : 3 * EACH] = 0
    sums = site_sums(data, Columns(jnp.asarray(diffuse), jnp.asarray(specular)))
    prior = SpecularPrior(np.asarray(0.3), np.asarray(1e-6))
    material, errors = solve_sites(sums, prior), site_errors(sums, prior)
    # Colours of the specular light differ, so its sum over channels has to be alike, too.
    np.testing.assert_allclose(material.ks[1], 0.3, rtol=1e-6)
    assert float(errors.ks[1]) == pytest.approx(1e3, rel=1e-6)
    np.testing.assert_array_equal(material.kd[2], 0)
    assert np.isinf(np.asarray(errors.kd)[2]).all()
    assert np.isfinite(np.asarray(material.kd)).all()
    assert float(errors.ks[0]) > 100 * float(errors.ks[5])


def test_derivatives_go_through_the_bounds():
    data, columns, _ = problem(3, noise=0.3, sites=15)
    prior = SpecularPrior(np.asarray(0.3), np.asarray(0.5))

    def material(amount):
        moved = Columns(columns.diffuse, columns.specular * (1 + amount * columns.diffuse))
        return solve_sites(site_sums(data, moved), prior)

    _, tangent = jax.jvp(material, (0.0,), (1.0,))
    step = 1e-5
    for found, ahead, behind in zip(tangent, material(step), material(-step)):
        np.testing.assert_allclose(found, (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-7)
    at_bound = np.asarray(material(0.0).kd) == 0
    assert at_bound.any()


def test_standard_errors_are_those_of_the_inverse_system():
    data, columns, _ = problem(4)
    prior = SpecularPrior(np.asarray(0.3), np.asarray(2.0))
    errors = site_errors(site_sums(data, columns), prior)
    for site in (0, 7):
        matrix, _ = matrix_of(data, columns, site)
        normal = matrix.T @ matrix + np.diag([0, 0, 0, 2.0])
        expected = np.sqrt(np.diag(np.linalg.inv(normal)))
        np.testing.assert_allclose(np.asarray(errors.kd)[site], expected[:3], **TIGHT)
        np.testing.assert_allclose(float(errors.ks[site]), expected[3], **TIGHT)


def test_the_spread_of_ks_is_found_through_its_noise():
    rng = np.random.default_rng(5)
    error = rng.uniform(0.02, 0.2, 4000)
    estimates = rng.normal(0.3, 0.07, 4000) + error * rng.normal(size=4000)
    prior = spread_of(estimates, error**-2)
    # Standard errors of mean and spread at these numbers: .0022 and .002.
    assert float(prior.mean) == pytest.approx(0.3, abs=0.008)
    assert float(prior.precision) ** -0.5 == pytest.approx(0.07, abs=0.007)
    one = spread_of(0.3 + error * rng.normal(size=4000), error**-2)
    assert float(one.precision) ** -0.5 < 0.012
    assert spread_of(np.zeros(3), np.zeros(3)).precision == 0


def test_confidence_is_that_of_the_thesis():
    _, columns, _ = problem(6)
    cosines = np.random.default_rng(0).uniform(0.1, 1, SITES * EACH)
    trust = confidence(columns, cosines)
    diffuse, specular = (np.asarray(c).mean(axis=1) for c in columns)
    epsilon = 0.01 * specular.mean()
    np.testing.assert_allclose(trust.diffuse, diffuse * cosines / (epsilon + specular), rtol=1e-12)
    np.testing.assert_allclose(trust.specular, specular * cosines, rtol=1e-12)


def test_alternation_with_one_weight_ends_at_the_joint_solution():
    data, columns, _ = problem(7)
    sums = site_sums(data, columns)
    found = alternate(sums, sums, jnp.asarray(0.3), 20000, 1e-12)
    joint = solve_sites(sums, NO_PRIOR)
    assert bool(found.converged)
    assert int(found.steps) > 3
    np.testing.assert_allclose(found.material.kd, joint.kd, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(found.material.ks, joint.ks, rtol=1e-5, atol=1e-7)


def test_alternation_with_the_thesis_weights_recovers_exact_data_and_marks_the_unseen():
    data, columns, (kd, ks) = problem(8, noise=0.0)
    specular = np.array(columns.specular)
    specular[:EACH] = 0
    columns = Columns(columns.diffuse, jnp.asarray(specular))
    radiance = kd[data.site] * columns.diffuse + ks[data.site][:, None] * columns.specular
    trust = confidence(columns, np.ones(len(data.site)))
    sums = []
    for one in trust:
        weights = jnp.broadcast_to(jnp.sqrt(one)[:, None], radiance.shape)
        sums.append(site_sums(SiteData(radiance, weights, data.site, SITES), columns))
    found = alternate(*sums, jnp.asarray(0.3), 20000, 1e-13)
    np.testing.assert_allclose(found.material.kd, kd, atol=1e-6)
    np.testing.assert_allclose(found.material.ks[1:], ks[1:], atol=1e-6)
    assert np.flatnonzero(found.specular_unseen).tolist() == [0]
    assert float(found.material.ks[0]) == pytest.approx(ks[1:].mean(), abs=1e-6)


def test_free_solutions_know_no_bounds():
    data, columns, _ = problem(9)
    material, precision = solve_freely(site_sums(data, columns))
    matrix, right = matrix_of(data, columns, 3)
    expected = np.linalg.lstsq(matrix, right, rcond=None)[0]
    np.testing.assert_allclose([*material.kd[3], material.ks[3]], expected, **TIGHT)
    normal = np.linalg.inv(matrix.T @ matrix)
    np.testing.assert_allclose(precision[3], 1 / normal[3, 3], **TIGHT)


def observations(count):
    rng = np.random.default_rng(10)
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    return Observations(SurfaceSamples(up, up), rng.uniform(size=(count, 3)), np.zeros(count, int))


def test_observations_are_sorted_by_site_and_cut_between_sites():
    site = np.random.default_rng(11).integers(-1, 30, 200)
    seen = observations(200)
    measured = by_site(seen, site, 35)
    assert (np.diff(measured.site) >= 0).all()
    np.testing.assert_array_equal(measured.radiance, np.asarray(seen.radiance)[measured.index])
    np.testing.assert_array_equal(measured.site, site[measured.index])
    found = []
    for chunk in in_chunks(measured, 32):
        assert len(chunk.measured.site) == 32
        kept = ~chunk.filled
        np.testing.assert_array_equal(
            chunk.sites[chunk.measured.site[kept]], site[chunk.measured.index[kept]]
        )
        found.append(chunk.measured.index[kept])
    np.testing.assert_array_equal(np.concatenate(found), measured.index)


def test_sites_are_drawn_whole():
    site = np.random.default_rng(12).integers(0, 30, 200)
    measured = by_site(observations(200), site, 30)
    some = whole_sites(measured, 60, 0)
    assert len(some.site) <= 60
    drawn = np.unique(site[some.index])
    assert some.count == len(drawn) == some.site.max() + 1
    np.testing.assert_array_equal(np.isin(site, drawn).sum(), len(some.site))


def test_shared_observations_count_in_parts():
    sites = np.array([[0, 1], [1, 2]])
    shares = np.array([[0.25, 0.75], [1.0, 0.0]])
    measured = by_shares(observations(2), sites, shares, 3)
    assert measured.site.tolist() == [0, 1, 1]
    assert measured.share.tolist() == [0.25, 0.75, 1.0]
    assert measured.index.tolist() == [0, 0, 1]


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="site 7 of 5 sites"):
        by_site(observations(2), np.array([7, 1]), 5)
    with pytest.raises(ValueError, match="no observation has a site"):
        by_site(observations(2), np.array([-1, -1]), 5)
    bad = observations(2)
    bad = bad._replace(radiance=np.where(np.eye(2, 3) > 0, np.nan, bad.radiance))
    with pytest.raises(ValueError, match="not finite"):
        by_site(bad, np.array([0, 1]), 5)
