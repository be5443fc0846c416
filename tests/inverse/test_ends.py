"""How far from its end a number may lie: the ninth part in ten of a normal distribution cut there.

- SciPy's truncated normal is the oracle, where the data would have the number inside the range,
  just beyond the end, and far beyond it.
- What other unknowns can do as well tells nothing: the number may lie anywhere.
- Twice the variance of the residuals makes the reach of a silent pull sqrt(2) times as long.
"""

import numpy as np
import pytest
from scipy.stats import truncnorm

from jaxrender.inverse.ends import AtEnd

MOVES = np.array([3.0, 4.0, 0.0])
# The squares of the moves are 25: the number is known to 1 / 5.
DEVIATION = 0.2
ONE = np.ones(3)


def at_end(mean, whole=1.0):
    """Residuals that a step of ``mean`` would explain."""
    return AtEnd(MOVES, mean * MOVES + np.array([0.0, 0.0, 5.0]), whole)


@pytest.mark.parametrize("mean", [0.0, -0.1, -0.6, -1.4])
def test_it_is_the_quantile_of_a_normal_distribution_that_is_cut(mean):
    low, high = -mean / DEVIATION, (1 - mean) / DEVIATION
    expected = truncnorm.ppf(0.9, low, high, loc=mean, scale=DEVIATION)
    assert at_end(mean).within(ONE) == pytest.approx(expected, rel=1e-6)


def test_far_beyond_the_end_it_falls_off_exponentially():
    mean = -10.0
    expected = np.log(10) * DEVIATION**2 / -mean
    assert at_end(mean).within(ONE) == pytest.approx(expected, rel=1e-2)


def test_what_tells_nothing_leaves_the_whole_range():
    assert AtEnd(0 * MOVES, ONE, 0.7).within(ONE) == 0.7
    assert at_end(0.0, 1e-3).within(ONE) == pytest.approx(0.9e-3, rel=1e-3)


def test_a_pull_inwards_counts_as_none():
    """A search that ends at an end although data pull inwards has met a flat place there."""
    assert at_end(0.3).within(ONE) == at_end(0.0).within(ONE)


def test_noise_makes_it_longer():
    wide = at_end(0.0, 100.0)
    assert wide.within(2 * ONE) == pytest.approx(np.sqrt(2) * wide.within(ONE), rel=1e-9)
