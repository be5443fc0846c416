"""Which sources of a recovered light are idle: a solver test, on linear systems made here.

Pinned down: of two sources that can stand in for each other one stays, though each by itself could
go; what is dropped costs less than it is worth; a dark source and one lost in the noise go, sources
that are switched off are never marked.
"""

import numpy as np

from jaxrender.inverse.factorization.sources import _idle_sources

# What a source must take off chi-squared.
WORTH = 25.0
ACTIVE = np.array([True, True, True, True, False])


def system() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Sources 0 and 1 nearly alike, 2 bright, 3 in the noise, 4 off: columns, data and fit."""
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(60, 5))
    columns[:, 1] = columns[:, 0] + 0.04 * rng.normal(size=60)
    columns[:, 4] = 0
    data = columns @ np.array([1.0, 1.0, 2.0, 0.01, 0.0]) + 0.1 * rng.normal(size=60)
    normal = columns.T @ columns / 0.01 + np.diag([0.0, 0.0, 0.0, 0.0, 1.0])
    covariance = np.linalg.inv(normal)
    return columns, data, covariance @ columns.T @ data / 0.01, covariance


def chi_squared(columns: np.ndarray, data: np.ndarray) -> float:
    fitted = np.linalg.lstsq(columns, data, rcond=None)[0]
    return float(np.sum((data - columns @ fitted) ** 2) / 0.01)


def test_of_two_that_stand_in_for_each_other_one_stays():
    columns, data, energies, covariance = system()
    alone = energies**2 / np.diag(covariance)
    assert np.all(alone[:2] < WORTH)
    idle = _idle_sources(energies[None], covariance[None], ACTIVE, WORTH)
    assert np.count_nonzero(idle[:2]) == 1
    np.testing.assert_array_equal(idle[2:], [False, True, False])
    lost = chi_squared(columns[:, ~idle], data) - chi_squared(columns, data)
    assert lost < WORTH * np.count_nonzero(idle)
    assert chi_squared(columns[:, 2:], data) > 100 * WORTH


def test_channels_speak_for_a_source_together():
    _, _, energies, covariance = system()
    three = np.stack([energies] * 3), np.stack([covariance] * 3)
    assert _idle_sources(*three, ACTIVE, 1e12)[ACTIVE].all()
    alone = energies[3] ** 2 / covariance[3, 3]
    assert not _idle_sources(*three, ACTIVE, 2 * alone)[3]
    assert _idle_sources(energies[None], covariance[None], ACTIVE, 2 * alone)[3]
