"""Errors of sites that know of misfit.

- The excess of each site is that of dense matrices, photograph by photograph.
- Noise alone shows no more than it should, and hardly widens anything.
- Photographs whose exposures differ widen errors until these hold the truth; the exact ones do not.
"""

import numpy as np
import pytest
from texture_problems import exact_columns, samples_of, texture, views

from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture import by_site
from jaxrender.inverse.texture.clustered import Excess, excess_of_surface, widening

NOISE, NORMAL_90 = 0.01, 1.645


def photographed(gains, seed=0):
    """Photograph a painted ball, and solve every site by dense least squares of known columns."""
    samples, frame, site = samples_of(views(len(gains)))
    kd, ks = texture()
    diffuse, specular = np.moveaxis(exact_columns(samples), 1, 0)
    exact = kd[site] * diffuse + ks[site][:, None] * specular
    rng = np.random.default_rng(seed)
    seen = exact * np.asarray(gains)[frame][:, None] * (1 + NOISE * rng.normal(size=exact.shape))
    return Observations(samples, seen, frame), site, Columns(diffuse, specular)


def dense(columns, radiance, frame):
    """One site: its material, and q_g, their expectation and the variances by dense matrices."""
    channels = radiance.shape[1]
    rows = [
        np.concatenate([np.eye(channels)[c] * columns.diffuse[i, c], [columns.specular[i, c]]])
        for i in range(len(radiance))
        for c in range(channels)
    ]
    matrix, which = np.array(rows), np.repeat(frame, channels)
    weights = 1 / (NOISE * radiance.ravel())
    for _ in range(2):
        found = np.linalg.lstsq(matrix * weights[:, None], radiance.ravel() * weights, rcond=None)[
            0
        ]
        weights = 1 / (NOISE * np.maximum(matrix @ found, 1e-9))
    left = radiance.ravel() - matrix @ found
    whole = np.linalg.inv((matrix * weights[:, None] ** 2).T @ matrix)
    shown, expected = np.zeros(channels + 1), np.zeros(channels + 1)
    for number in np.unique(frame):
        own = which == number
        part = matrix[own] * weights[own, None] ** 2
        shown += (whole @ part.T @ left[own]) ** 2
        of_group = part.T @ matrix[own]
        expected += np.diag(whole @ (of_group - of_group @ whole @ of_group) @ whole)
    return found, left.reshape(radiance.shape), np.diag(whole), shown, expected


def solved(gains, seed=0):
    """All sites seen well, by dense matrices: the truth, values, variances, left, and twins."""
    seen, site, columns = photographed(gains, seed)
    left = np.zeros_like(seen.radiance)
    found = {}
    for number in np.unique(site):
        own = np.flatnonzero(site == number)
        if len(np.unique(seen.frame[own])) < 4:
            site[own] = -1
            continue
        some = Columns(columns.diffuse[own], columns.specular[own])
        one = dense(some, seen.radiance[own], seen.frame[own])
        found[int(number)], left[own] = (one[0], *one[2:]), one[1]
    measured = by_site(seen, site, 288)
    excess = excess_of_surface(measured, columns, left, NoiseModel(NOISE, 0.0), 500)
    return found, excess


def test_the_excess_is_that_of_dense_matrices():
    found, excess = solved(np.exp(0.05 * np.random.default_rng(1).normal(size=8)))
    for number, (_, variance, shown, expected) in found.items():
        scaled = shown / variance, expected / variance
        for mine, twin in zip(excess[:2], scaled):
            both = [twin[:-1].mean(), twin[-1]]
            np.testing.assert_allclose(mine[number], both, rtol=1e-5, atol=1e-9)


def errors_of(found, excess):
    """Values beside the truth, in standard errors: exact ones, and as stated."""
    wider, (kd, ks) = widening(excess), texture()
    truth = np.concatenate([kd, ks[:, None]], axis=1)
    numbers = list(found)
    off = np.array([found[n][0] - truth[n] for n in numbers])
    exact = np.sqrt([found[n][1] for n in numbers])
    factor = np.concatenate([np.repeat(wider[:, :1], 3, axis=1), wider[:, 1:]], axis=1)[numbers]
    return np.abs(off / exact), np.abs(off / (factor * exact)), factor


def test_noise_alone_hardly_widens_anything():
    exact, stated, factor = errors_of(*solved(np.ones(8)))
    assert np.mean(exact < NORMAL_90) > 0.86
    assert 0.86 < np.mean(stated < NORMAL_90) < 0.96
    assert np.median(factor) < 1.15


def test_exposures_that_differ_are_in_the_errors():
    gains = np.exp(0.05 * np.random.default_rng(2).normal(size=8))
    exact, stated, _ = errors_of(*solved(gains))
    assert np.mean(exact < NORMAL_90) < 0.5
    assert np.mean(stated < NORMAL_90) > 0.75


def test_too_few_sites_say_nothing():
    few = Excess(np.full((3, 2), 9.0), np.ones((3, 2)), np.full((3, 2), 0.2))
    assert (widening(few) == 1).all()


@pytest.mark.parametrize("excess", [1.0, 9.0])
def test_a_site_that_agrees_with_no_other_keeps_its_own_excess(excess):
    """Half of the sites show much more than the others: each half is widened by its own."""
    rng = np.random.default_rng(0)
    freedom = 20
    ratio = rng.chisquare(freedom, (400, 2)) / freedom
    ratio[:200] *= excess
    found = widening(Excess(ratio, np.ones((400, 2)), np.full((400, 2), 1 / freedom)))
    assert np.median(found[:200]) == pytest.approx(np.sqrt(excess), rel=0.25)
    assert np.median(found[200:]) < 1.3
