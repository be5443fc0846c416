"""Keeping the largest coefficients.

Pinned down: how many are kept, and that they are the largest; fractions are of the non-zero ones;
the predicted error equals the measured one for orthonormal wavelets and not for the linear spline,
and is the root of a sum of squares (ERRATA 61); the fewest are kept within an error; equal
magnitudes; what is refused.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.wavelets import (
    WAVELETS,
    analyse_nonstandard,
    analyse_standard,
    keep_fraction,
    keep_largest,
    keep_within,
    synthesise_nonstandard,
    synthesise_standard,
    wavelet_named,
)

EXACT = 1e-12
KINDS = {
    "standard": (analyse_standard, synthesise_standard),
    "nonstandard": (analyse_nonstandard, synthesise_nonstandard),
}


def bump() -> np.ndarray:
    """A smooth function of four variables that is zero in part, as BRDFs are."""
    x = np.linspace(-1.0, 1.0, 8)
    a, b, c, d = np.meshgrid(x, x, x, x, indexing="ij")
    peak = np.exp(-4.0 * ((a + c) ** 2 + (b + d) ** 2)) * (a**2 + b**2 < 1.0)
    return np.stack([peak, 0.5 * peak], axis=-1)


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("name", WAVELETS)
@pytest.mark.parametrize("kind", KINDS)
def test_predicted_error_is_the_measured_one_if_orthonormal(kind, name):
    wavelet, values = wavelet_named(name), bump()
    analyse, synthesise = KINDS[kind]
    result = keep_fraction(analyse(wavelet, values), 0.1)
    measured = rms(synthesise(wavelet, result.coefficients) - values)
    exact = abs(result.predicted_rms / measured - 1.0) < EXACT
    assert exact == wavelet.orthonormal
    assert 0.3 < result.predicted_rms / measured < 3.0


def test_the_largest_are_kept():
    values = np.random.default_rng(0).normal(size=(4, 8, 2))
    result = keep_largest(values, 10)
    held = np.asarray(result.coefficients)
    assert result.kept == np.count_nonzero(held) == 10
    assert np.abs(held[held != 0]).min() > np.abs(values[held == 0]).max()
    np.testing.assert_array_equal(held[held != 0], values[held != 0])
    expected = np.sqrt(np.sum(values[held == 0] ** 2) / values.size)
    np.testing.assert_allclose(result.predicted_rms, expected, rtol=EXACT)


def test_fractions_are_of_the_coefficients_that_are_not_zero():
    values = np.zeros((100, 2))
    values[:20] = np.random.default_rng(1).normal(size=(20, 2))
    assert keep_fraction(values, 0.25).kept == 10
    assert keep_fraction(values, 1e-9).kept == 1
    everything = keep_fraction(values, 1.0)
    assert everything.kept == 40
    assert everything.predicted_rms == 0.0


def test_as_few_as_possible_are_kept_within_an_error():
    values = np.random.default_rng(2).normal(size=(64, 1))
    for error in (0.05, 0.3, 0.8):
        result = keep_within(values, error)
        assert result.predicted_rms <= error
        assert keep_largest(values, result.kept - 1).predicted_rms > error


def test_no_error_drops_zeros_alone_and_a_large_one_drops_all():
    values = np.array([[0.0], [1.0], [0.0], [-2.0]])
    assert keep_within(values, 0.0).kept == 2
    nothing = keep_within(values, 10.0)
    assert nothing.kept == 0
    np.testing.assert_allclose(nothing.predicted_rms, rms(values), rtol=EXACT)
    np.testing.assert_array_equal(nothing.coefficients, 0.0)


def test_of_equal_magnitudes_the_first_are_kept():
    result = keep_largest(np.array([[1.0], [-1.0], [2.0], [1.0]]), 3)
    np.testing.assert_array_equal(result.coefficients, [[1.0], [-1.0], [2.0], [0.0]])


def test_all_zero_and_more_than_there_are():
    assert keep_fraction(np.zeros((4, 1)), 0.5).kept == 0
    assert keep_largest(np.ones((4, 1)), 9).kept == 4


def test_float32_stays_float32():
    result = keep_fraction(jnp.ones((4, 1), jnp.float32), 0.5)
    assert result.coefficients.dtype == jnp.float32
    assert result.kept == 2


@pytest.mark.parametrize("fraction", [0.0, -0.1, 1.0001, float("nan")])
def test_fractions_outside_are_refused(fraction):
    with pytest.raises(ValueError, match="above 0, at most 1"):
        keep_fraction(np.ones((4, 1)), fraction)


def test_other_misuse_is_refused():
    with pytest.raises(ValueError, match="keep at least one"):
        keep_largest(np.ones((4, 1)), 0)
    for error in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="zero or a positive number"):
            keep_within(np.ones((4, 1)), error)
    with pytest.raises(ValueError, match="1 coefficients are not finite"):
        keep_largest(np.array([[1.0], [np.inf]]), 1)
