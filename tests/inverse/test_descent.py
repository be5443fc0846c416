"""Newton's method with halved steps.

- A quadratic takes one step; a step that overshoots is halved until the cost falls.
- A direction that only goes up ends where it began; steps that never settle are told.
"""

import numpy as np
import pytest

from jaxrender.inverse.descent import descend


def settled(before, after):
    return np.abs(after - before).max() < 1e-12


def test_a_quadratic():
    matrix, middle = np.array([[3.0, 1.0], [1.0, 2.0]]), np.array([0.3, -0.4])
    found = descend(
        np.zeros(2),
        lambda at: float((at - middle) @ matrix @ (at - middle)),
        lambda at: middle - at,
        settled,
    )
    assert found.converged
    np.testing.assert_array_equal(found.point, middle)


def test_steps_that_overshoot_are_halved():
    """Newton's method for the minimum of sqrt(1 + x^2) runs away from any start beyond 1."""
    found = descend(
        np.array([5.0]),
        lambda at: float(np.sqrt(1 + at @ at)),
        lambda at: -at * (1 + at @ at),
        settled,
    )
    assert found.converged
    assert found.point[0] == pytest.approx(0, abs=1e-7)


def test_where_no_step_gains():
    start = np.array([1.0])
    found = descend(start, lambda at: float(at @ at), lambda at: at, settled)
    assert found.converged
    assert found.point is start


def test_a_descent_without_end_is_told():
    found = descend(np.zeros(1), lambda at: -float(at[0]), lambda at: np.ones(1), settled)
    assert not found.converged
