"""Sites whose K_s has a colour: exact solutions, errors, and what holds channels together.

- K_d and K_s >= 0 are those of SciPy's non-negative least squares, the prior being more rows of it.
- Channels that may not differ are the one K_s of a colourless site; channels that may differ at
  will are each by itself.
- Where nothing tells a channel's K_s, it follows the others; where nothing tells any, it is the
  prior's mean, without colour.
- Derivatives through the solution are those of finite differences, bounds included.
- Standard errors, and those of level and colour, are of the inverse system.
- The spreads of level and colour are found through the noise of their estimates.
- What photographs leave together is compared as by the algebra of one K_s, where channels may not
  differ.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import nnls

from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture import SiteData, SpecularPrior, site_errors, site_sums, solve_sites
from jaxrender.inverse.texture.clustered import Groups, excess_of
from jaxrender.inverse.texture.coloured_sites import ColouredPrior, coloured_errors
from jaxrender.inverse.texture.coloured_sites import solve_coloured as eagerly

SITES, EACH = 60, 5
TIGHT = {"rtol": 1e-7, "atol": 1e-9}


# One program, in the place of one for each line.
solve_coloured, coloured_errors = jax.jit(eagerly), jax.jit(coloured_errors)


def prior_of(mean, precision, colour):
    return ColouredPrior(*map(np.asarray, (mean, precision, colour)))


PRIOR = prior_of(0.3, 4.0, 9.0)


def problem(seed=0, noise=0.5):
    """Random columns, noise so large that all patterns of bounds occur."""
    rng = np.random.default_rng(seed)
    site = np.repeat(np.arange(SITES), EACH)
    shape = len(site), 3
    columns = Columns(*(jnp.asarray(rng.uniform(0, top, shape)) for top in (2, 1.5)))
    kd, ks = rng.uniform(0, 0.4, (SITES, 3)), rng.uniform(0, 0.6, (SITES, 3))
    exact = np.asarray(kd[site] * columns.diffuse + ks[site] * columns.specular)
    weights = rng.uniform(0.5, 2, shape)
    return SiteData(exact + noise * rng.normal(size=shape), weights, site, SITES), columns


def rows_of(data, columns, site, prior=PRIOR):
    """Write the least squares of one site down: six columns, and a row for each of the prior."""
    rows = np.flatnonzero(np.asarray(data.site) == site)
    left, right = [], []
    for channel in range(3):
        matrix = np.zeros((len(rows), 6))
        weights = data.weights[rows, channel]
        matrix[:, channel] = weights * np.asarray(columns.diffuse)[rows, channel]
        matrix[:, 3 + channel] = weights * np.asarray(columns.specular)[rows, channel]
        left.append(matrix)
        right.append(weights * data.radiance[rows, channel])
    # The inverse of the covariance of level and colour, by its root.
    covariance = np.ones((3, 3)) / float(prior.precision) + np.eye(3) / float(
        prior.colour_precision
    )
    root = np.linalg.cholesky(np.linalg.inv(covariance)).T
    left.append(np.concatenate([np.zeros((3, 3)), root], axis=1))
    right.append(root @ np.full(3, float(prior.mean)))
    return np.concatenate(left), np.concatenate(right)


def test_every_site_is_the_solution_of_nnls():
    data, columns = problem()
    material, held = solve_coloured(site_sums(data, columns), PRIOR), set()
    for site in range(SITES):
        expected = nnls(*rows_of(data, columns, site))[0]
        held.add(tuple(expected > 0))
        found = np.concatenate([material.kd[site], material.ks[site]])
        np.testing.assert_allclose(found, expected, **TIGHT)
    assert len(held) > 12


def test_channels_that_may_not_differ_are_one():
    data, columns = problem(1)
    sums, one = site_sums(data, columns), SpecularPrior(np.asarray(0.3), np.asarray(4.0))
    tied = prior_of(0.3, 4.0, 1e9)
    found, expected = solve_coloured(sums, tied), solve_sites(sums, one)
    np.testing.assert_allclose(found.ks, np.tile(expected.ks[:, None], 3), atol=1e-6)
    np.testing.assert_allclose(found.kd, expected.kd, atol=1e-6)
    errors, spread = coloured_errors(sums, tied)
    of_one = site_errors(sums, one)
    np.testing.assert_allclose(errors.ks[:, 0], of_one.ks, rtol=1e-6)
    np.testing.assert_allclose(errors.kd, of_one.kd, rtol=1e-6)
    np.testing.assert_allclose(np.sqrt(spread.level), of_one.ks, rtol=1e-6)


def test_where_nothing_tells_it_ks_has_no_colour():
    data, columns = problem(2, noise=0.01)
    specular = np.array(columns.specular)
    specular[:EACH] = 0
    specular[EACH : 2 * EACH, 2] = 0
    sums = site_sums(data, Columns(columns.diffuse, jnp.asarray(specular)))
    close = prior_of(0.3, 1.0, 1e3)
    material, (errors, spread) = solve_coloured(sums, close), coloured_errors(sums, close)
    np.testing.assert_allclose(material.ks[0], 0.3)
    np.testing.assert_allclose(errors.ks[0], np.sqrt(1 + 1e-3))
    # The third channel is what the others say, and no better known than channels are alike.
    np.testing.assert_allclose(material.ks[1, 2], np.mean(material.ks[1, :2]), atol=0.02)
    assert errors.ks[1, 2] > errors.ks[1, :2].max()
    level, colour = spread.marked(close, 3)
    assert level[0]
    assert colour[0]
    assert not level[1:].any()
    freely = prior_of(0.3, 1.0, 0.0)
    alone = solve_coloured(sums, freely)
    assert float(alone.ks[1, 2]) == pytest.approx(0.3)
    assert np.isinf(coloured_errors(sums, freely)[0].ks[1, 2])
    nothing = solve_coloured(sums, prior_of(0.3, 0.0, 0.0))
    np.testing.assert_allclose(nothing.ks[0], 0.3)
    np.testing.assert_allclose(nothing.ks[2:], alone.ks[2:])


def test_derivatives_go_through_the_bounds():
    data, columns = problem(3, noise=0.3)

    def material(amount):
        moved = Columns(columns.diffuse, columns.specular * (1 + amount * columns.diffuse))
        return eagerly(site_sums(data, moved), PRIOR)

    material = jax.jit(material)
    _, tangent = jax.jvp(material, (0.0,), (1.0,))
    step = 1e-6
    for found, ahead, behind in zip(tangent, material(step), material(-step), strict=True):
        np.testing.assert_allclose(found, (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-7)
    at_zero = material(0.0)
    assert np.any(np.asarray(at_zero.kd) == 0)
    assert np.any(np.asarray(at_zero.ks) == 0)


def test_standard_errors_are_those_of_the_inverse_system():
    data, columns = problem(4)
    errors, spread = coloured_errors(site_sums(data, columns), PRIOR)
    for site in (0, 7):
        matrix, _ = rows_of(data, columns, site)
        covariance = np.linalg.inv(matrix.T @ matrix)
        found = np.concatenate([errors.kd[site], errors.ks[site]])
        np.testing.assert_allclose(found, np.sqrt(np.diag(covariance)), **TIGHT)
        of_ks, even = covariance[3:, 3:], np.eye(3) - np.ones((3, 3)) / 3
        np.testing.assert_allclose(spread.level[site], of_ks.mean(), **TIGHT)
        np.testing.assert_allclose(spread.colour[site], np.trace(even @ of_ks) / 2, **TIGHT)


def test_the_spreads_are_found_through_their_noise():
    rng, count = np.random.default_rng(5), 4000
    true = 0.3 + 0.04 * rng.normal(size=(count, 1)) + 0.06 * rng.normal(size=(count, 3))
    error = rng.uniform(0.01, 0.1, (count, 3))
    told = error[:, :, None] ** -2 * np.eye(3)
    estimate = true + error * rng.normal(size=(count, 3))
    begin = ColouredPrior.begin(0.2, 25.0)
    whole = told + np.asarray(begin.matrix(3))
    pull = error**-2 * estimate + np.asarray(begin.matrix(3)) @ np.full(3, 0.2)
    covariance = np.linalg.inv(whole)
    prior = begin.learned(np.einsum("sij,sj->si", covariance, pull), covariance)
    # Standard errors at these numbers: about .001 each.
    assert float(prior.mean) == pytest.approx(0.3, abs=0.006)
    assert float(prior.precision) ** -0.5 == pytest.approx(0.04, abs=0.005)
    assert float(prior.colour_precision) ** -0.5 == pytest.approx(0.06, abs=0.003)
    dark = begin.learned(np.zeros((4, 3)), covariance[:4])
    assert float(dark.precision) == float(dark.colour_precision) == 0


def test_what_photographs_leave_counts_as_of_one_ks():
    data, columns = problem(6)
    frame = np.arange(SITES * EACH) % 3
    order = np.lexsort((frame, data.site))
    data = SiteData(data.radiance[order], data.weights[order], data.site[order], SITES)
    columns = columns.map(lambda part: part[order])
    sums = site_sums(data, columns)
    groups = Groups.of(data.site, frame[order])
    left = np.random.default_rng(7).normal(size=data.radiance.shape)
    one = SpecularPrior(np.asarray(0.3), np.asarray(4.0))
    excess = eqx.filter_jit(excess_of)
    expected = excess(data, columns, left, groups, sums, one)
    found = excess(data, columns, left, groups, sums, prior_of(0.3, 4.0, 1e7))
    for tied, alone in zip(found, expected, strict=True):
        np.testing.assert_allclose(tied, alone, rtol=1e-3, atol=1e-5)
