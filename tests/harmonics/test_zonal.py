"""Zonal filters.

Pinned down: the clamped cosine's transfer (ERRATA 18 and 19: the printed T 3.32 and 4.11 fail),
the Phong lobe's exact coefficients (ERRATA 20), unit impulse and narrow lobes; a transfer scales
each degree, and doing so is the convolution integral on the sphere.
"""

import jax
import numpy as np
import pytest
from scipy.special import gammaln

from jaxrender.harmonics import (
    LatLongGrid,
    apply_transfer,
    degree_table,
    degrees,
    evaluate,
    transfer_of,
)

QUADRATURE = 1e-12


def clamped(cosine):
    return np.maximum(cosine, 0.0)


def test_clamped_cosine():
    transfer = transfer_of(clamped, 4, breakpoints=(np.pi / 2,))
    expected = [np.pi, 2 * np.pi / 3, np.pi / 4, 0.0, -np.pi / 24]
    np.testing.assert_allclose(transfer, expected, atol=QUADRATURE)


def test_a_breakpoint_is_what_makes_a_kink_exact():
    error = np.abs(transfer_of(clamped, 4)[0] - np.pi)
    assert error > 1e-9


@pytest.mark.parametrize("exponent", [1.0, 8.0, 32.5, 512.0])
def test_phong_lobe(exponent):
    def lobe(cosine):
        return (exponent + 1) / (2 * np.pi) * clamped(cosine) ** exponent

    degree = np.arange(25)
    # ERRATA 20: G(s/2+1) G(s/2+3/2) / (G((s-l)/2+1) G((s+l)/2+3/2)), here where it is positive.
    inside = degree < exponent + 2
    s, low = exponent, degree[inside]
    log = gammaln(s / 2 + 1) + gammaln(s / 2 + 1.5)
    log = log - gammaln((s - low) / 2 + 1) - gammaln((s + low) / 2 + 1.5)
    transfer = transfer_of(lobe, 24, breakpoints=(np.pi / 2,))
    np.testing.assert_allclose(transfer[inside], np.exp(log), atol=1e-10)


def test_narrow_lobe_is_resolved_and_normalised():
    width = 0.03
    kappa = 1.0 / width**2

    def lobe(cosine):
        return kappa / (2 * np.pi) * np.exp(kappa * (cosine - 1.0))

    transfer = transfer_of(lobe, 128)
    # Von Mises-Fisher: A_0 = 1 and A_1 = coth k - 1 / k, both to within exp(-2 k).
    np.testing.assert_allclose(transfer[:2], [1.0, 1.0 - 1.0 / kappa], atol=QUADRATURE)
    # The Bessel recurrence A_{l+1} = A_{l-1} - (2 l + 1) A_l / k.
    degree = np.arange(1, 128)
    expected = transfer[:-2] - (2 * degree + 1) * transfer[1:-1] / kappa
    np.testing.assert_allclose(transfer[2:], expected, atol=QUADRATURE)


def test_transfer_is_the_convolution_integral():
    rng = np.random.default_rng(0)
    light = rng.normal(size=(36, 3))

    def profile(cosine):
        return 0.3 + cosine - 0.7 * cosine**3

    grid = LatLongGrid(12, 12)
    nodes = grid.directions().reshape(-1, 3)
    towards = rng.normal(size=(5, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    kernel = profile(towards @ nodes.T) * grid.weights().ravel()
    expected = kernel @ np.asarray(evaluate(light, nodes))
    filtered = apply_transfer(light, transfer_of(profile, 5))
    np.testing.assert_allclose(evaluate(filtered, towards), expected, atol=QUADRATURE)
    by_degree = np.einsum(
        "pdc,d->pc", np.asarray(degree_table(light, towards)), transfer_of(profile, 5)
    )
    np.testing.assert_allclose(by_degree, expected, atol=QUADRATURE)


def test_apply_transfer_for_all_channels_or_each():
    light = np.random.default_rng(1).normal(size=(16, 2))
    one, each = np.arange(1.0, 5.0), np.arange(8.0).reshape(4, 2)
    np.testing.assert_array_equal(apply_transfer(light, one), light * one[degrees(3)][:, None])
    np.testing.assert_array_equal(apply_transfer(light, each), light * each[degrees(3)])
    gradient = jax.grad(lambda t: apply_transfer(light, t).sum())(one)
    sums = [light[degrees(3) == degree].sum() for degree in range(4)]
    np.testing.assert_allclose(gradient, sums)


def test_misuse_is_refused():
    with pytest.raises(ValueError, match="transfer of 3 degrees for coefficients of 4"):
        apply_transfer(np.zeros((16, 3)), np.zeros(3))
    with pytest.raises(ValueError, match="between 0 and pi"):
        transfer_of(clamped, 2, breakpoints=(4.0,))
    with pytest.raises(ValueError, match="not finite"):
        transfer_of(lambda cosine: np.full_like(cosine, np.nan), 2)
    with pytest.raises(ValueError, match="band_limit is -1"):
        transfer_of(clamped, -1)
