"""What sites near each other have in common.

- What is foreseen of a site is off by as much as is said, whether neighbours are alike or not.
- Where they are alike the field within a site follows the truth; where not, it is flat.
- Sites of which nothing is known have no say, and are foreseen from others.
"""

import numpy as np
import pytest

from jaxrender.inverse.texture.site_fields import Field, places_of_sites

ROWS = 20
NOISE = 0.05


def places():
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(ROWS), np.arange(ROWS)), axis=-1).reshape(-1, 2)
    flat = (grid + rng.uniform(-0.2, 0.2, grid.shape)) / ROWS
    return np.column_stack([flat, np.zeros(len(flat))])


def waves(at):
    return 0.4 * np.stack([np.sin(9 * at[:, 0] + 4 * at[:, 1]), np.cos(8 * at[:, 1])], axis=1)


def learned(value, seed=1):
    """Learn from values with noise of their own, some of which nobody knows."""
    rng = np.random.default_rng(seed)
    error = np.where(rng.random(len(value)) < 0.2, 3 * NOISE, NOISE)
    found = value + error[:, None] * rng.normal(size=value.shape)
    error[rng.permutation(len(value))[:30]] = np.inf
    return Field.learn(places(), np.where(np.isfinite(error)[:, None], found, np.nan), error, 0)


@pytest.mark.parametrize("kind", ["smooth", "each its own", "both"])
def test_what_is_foreseen_is_off_by_what_is_said(kind):
    own = 0.3 * np.random.default_rng(2).normal(size=(ROWS**2, 2))
    value = {"smooth": waves(places()), "each its own": own, "both": waves(places()) + own / 3}[
        kind
    ]
    field = learned(value)
    mean, variance = field.expected()
    z = (value - mean) / np.sqrt(variance)[:, None]
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.25)
    spread = np.std(value - mean) / np.std(value)
    assert {"smooth": spread < 0.2, "each its own": 0.9 < spread < 1.15, "both": spread < 0.6}[kind]
    assert (field.own > 0.5) == (kind == "each its own")


def test_the_field_within_a_site_follows_the_truth():
    points = np.repeat(places(), 6, axis=0)
    site = np.repeat(np.arange(ROWS**2), 6)
    points[:, :2] += np.random.default_rng(3).uniform(-0.5, 0.5, (len(points), 2)) / ROWS
    at = places_of_sites(points, site, ROWS**2)
    true = (
        waves(points)
        - places_of_sites(np.pad(waves(points), ((0, 0), (0, 1))), site, ROWS**2)[site, :2]
    )
    error = np.full(ROWS**2, NOISE / 5)
    rng = np.random.default_rng(4)
    value = waves(at) + error[:, None] * rng.normal(size=(ROWS**2, 2))
    within, mean, variance = Field.learn(at, value, error, 0).within(points, site)
    assert np.sqrt(np.mean(variance)) == pytest.approx(np.std(within - true), rel=0.5)
    assert np.std(within - true) < 0.25 * np.std(true)
    np.testing.assert_allclose(mean, waves(at), atol=0.1)
    np.testing.assert_allclose(
        [np.bincount(site, part) for part in within.T], np.zeros((2, ROWS**2)), atol=1e-9
    )
    flat, _, _ = Field.learn(at, rng.normal(size=(ROWS**2, 2)), error, 0).within(points, site)
    assert np.abs(flat).max() < 0.05


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_errors_that_are_too_small_are_told_by_neighbours(scale):
    rng = np.random.default_rng(5)
    error = rng.uniform(0.03, 0.2, ROWS**2)
    found = waves(places()) + error[:, None] * rng.normal(size=(ROWS**2, 2))
    field = Field.learn(places(), found, error / scale, 0)
    assert field.scale == pytest.approx(scale, rel=0.3)
    np.testing.assert_allclose(field.error, field.scale * error / scale)


def test_too_few_sites_tell_nothing():
    few = np.where(np.arange(ROWS**2) < 20, NOISE, np.inf)
    assert Field.learn(places(), waves(places()), few, 0) is None
