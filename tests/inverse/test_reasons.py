"""What makes up for a parameter that is not identifiable is named."""

import numpy as np
import pytest

from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.parameters import Parameters
from jaxrender.inverse.reasons import made_up_for

AMPLITUDES = {"kd": np.full(3, 0.2), "ks": np.array([0.01, 0.02, 0.03])}
VALUE = Parameters(AMPLITUDES, {"sigma": np.array(0.1)}, np.ones(2), np.array(1.0))


def uncertain(row, column, correlation, errors=0.1):
    """All have the same error, and two of them go together."""
    labels = VALUE.labels
    covariance = np.eye(len(labels)) * errors**2
    a, b = labels.index(row), labels.index(column)
    covariance[a, b] = covariance[b, a] = correlation * errors**2
    return Uncertain(VALUE, VALUE, VALUE, VALUE, covariance)


def test_the_other_unknown_is_named():
    found = uncertain("ks[1]", "sigma", 0.95)
    assert made_up_for("sigma", ("kd", "ks"), found) == "ks makes up for it (correlation 0.95)"
    assert made_up_for("sigma", ("kd",), found) == ""
    assert made_up_for("kd", ("ks", "sigma"), found) == ""
    assert made_up_for("sigma", ("kd", "ks"), uncertain("ks[1]", "sigma", 0.85)) == ""


def test_of_two_amplitudes_the_sum_of_that_channel_is_said():
    found = uncertain("kd[2]", "ks[2]", -0.995)
    # 1.645 times the root of 2 (1 - .995) times the error.
    said = "ks makes up for it (correlation -0.99); their sum is 0.23, within 0.016 at 90 %"
    assert made_up_for("kd", ("kd", "ks", "sigma"), found) == said


@pytest.mark.parametrize("name", ["kd", "sigma"])
def test_nothing_is_said_of_what_is_fixed(name):
    assert made_up_for(name, ("kd", "ks", "sigma"), uncertain("ks[0]", "sigma", 1.0, 0.0)) == ""
    without = Uncertain(VALUE, VALUE, VALUE, VALUE)
    assert made_up_for(name, ("kd", "ks", "sigma"), without) == ""
