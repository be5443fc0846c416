"""Covariances by clusters: what samples leave unexplained together counts together.

The law is that of a linear fit whose residuals share a random part in each photograph, or in each
cell of the reflected direction: the variance of its estimate over many such worlds.
"""

import numpy as np
import pytest

from jaxrender.geometry import SurfaceSamples, fibonacci_sphere
from jaxrender.inverse.clusters import Clusters, widened
from jaxrender.inverse.observations import Observations

PHOTOGRAPHS, EACH, WORLDS = 100, 12, 400
COUNT = PHOTOGRAPHS * EACH
RNG = np.random.default_rng(3)
FRAME = np.repeat(np.arange(PHOTOGRAPHS), EACH)
CELL = RNG.integers(0, 60, COUNT)
# One regressor changes from photograph to photograph, one from cell to cell, one is noise.
REGRESSORS = np.stack(
    [
        RNG.normal(size=PHOTOGRAPHS)[FRAME],
        RNG.normal(size=60)[CELL],
        RNG.normal(size=COUNT),
    ],
    axis=1,
)
BREAD = np.linalg.inv(REGRESSORS.T @ REGRESSORS)


def world(rng, by_photograph, by_cell):
    """Draw residuals, and say how far each sample moves the estimate of the three coefficients."""
    noise = rng.normal(size=COUNT)
    noise += by_photograph * rng.normal(size=PHOTOGRAPHS)[FRAME]
    noise += by_cell * rng.normal(size=60)[CELL]
    found = BREAD @ (REGRESSORS.T @ noise)
    left = noise - REGRESSORS @ found
    return found, left[:, None] * (REGRESSORS @ BREAD)


@pytest.mark.parametrize(("by_photograph", "by_cell"), [(1.0, 0.0), (0.0, 1.0), (0.7, 0.7)])
def test_the_variance_over_many_worlds_is_what_clusters_say(by_photograph, by_cell):
    rng = np.random.default_rng(7)
    clusters = Clusters(FRAME, CELL)
    drawn = [world(rng, by_photograph, by_cell) for _ in range(WORLDS)]
    found = np.array([estimate for estimate, _ in drawn])
    stated = np.mean([np.diag(clusters.covariance(moves)) for _, moves in drawn], axis=0)
    np.testing.assert_allclose(np.sqrt(stated), found.std(axis=0), rtol=0.12)


def test_independent_noise_is_hardly_widened():
    rng = np.random.default_rng(8)
    clusters, ratios = Clusters(FRAME, CELL), []
    for _ in range(100):
        _, moves = world(rng, 0.0, 0.0)
        wide = widened(BREAD, clusters.covariance(moves))
        ratios.append(np.sqrt(np.diag(wide) / np.diag(BREAD)))
    assert np.all(np.array(ratios) >= 1)
    assert np.mean(ratios) < 1.15


def test_widening_keeps_correlations_and_what_is_held():
    covariance = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    wide = widened(covariance, np.diag([16.0, 0.25, 9.0]))
    np.testing.assert_allclose(np.diag(wide), [16.0, 1.0, 0.0])
    np.testing.assert_allclose(wide[0, 1] / np.sqrt(wide[0, 0] * wide[1, 1]), 0.5)


@pytest.mark.parametrize("photographs", [1, 2, 7])
def test_few_photographs_have_their_cells_alone(photographs):
    rng = np.random.default_rng(9)
    _, moves = world(rng, 0.0, 1.0)
    few = Clusters(np.arange(COUNT) % photographs, CELL).covariance(moves)
    one = Clusters(np.zeros(COUNT, int), CELL).covariance(moves)
    np.testing.assert_array_equal(few, one)
    assert one[1, 1] > 2 * BREAD[1, 1]


def test_cells_are_those_of_the_reflected_direction():
    normals = np.asarray(fibonacci_sphere(60))
    # Seen head-on the reflected direction is the normal.
    samples = SurfaceSamples(normals, normals)
    observations = Observations(samples, np.ones((60, 3)), np.zeros(60, int))
    np.testing.assert_array_equal(Clusters.of(observations).cell, np.arange(60))
