"""The mirror's coefficients.

Pinned down: the kernel that they sum to sends light from the mirror direction, not back where it
came from (ERRATA 17); the half sphere mixes degrees, by the printed T 3.23's own integral (ERRATA
16); a filter by degree is T 3.26; refusal of a filter of the wrong length.
"""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import sph_harm_y

from jaxrender.spectra import clipped_mirror_coefficients, mirror_coefficients, mirror_transfer

INCOMING = (0.7, 0.4)


def kernel(coefficients, polar, azimuth):
    """sum_lpq rho_lpq Y*_lq(i) Y_pq(o) (T 2.53)."""
    total = 0.0
    for (degree, outgoing, order), value in np.ndenumerate(coefficients):
        for q in {order, -order}:
            incoming = sph_harm_y(degree, q, *INCOMING) if order <= degree else 0
            exit_ = sph_harm_y(outgoing, q, polar, azimuth) if order <= outgoing else 0
            total += value * np.conj(incoming) * exit_
    return total.real


def test_the_kernel_peaks_at_the_mirror_direction():
    coefficients = mirror_coefficients(8)
    peak = sum(2 * degree + 1 for degree in range(9)) / (4 * np.pi)
    polar, azimuth = INCOMING
    assert kernel(coefficients, polar, azimuth + np.pi) == pytest.approx(peak, rel=1e-12)
    assert abs(kernel(coefficients, polar, azimuth)) < 0.2 * peak


def test_without_the_sign_it_is_a_retro_reflector():
    """T 3.26 as printed."""
    printed = np.abs(mirror_coefficients(8))
    polar, azimuth = INCOMING
    assert kernel(printed, polar, azimuth) > 5 * abs(kernel(printed, polar, azimuth + np.pi))


def test_the_half_sphere_mixes_degrees():
    """ERRATA 16: the limits that T 3.23 prints give 1/2 and .242 where it says 1 and 0."""
    found = clipped_mirror_coefficients(5)
    assert found[2, 2, 0] == pytest.approx(0.5, abs=1e-12)
    assert found[1, 2, 0] == pytest.approx(0.242, abs=5e-4)
    for degree, outgoing, order in ((3, 4, 1), (4, 4, 3), (5, 2, 2)):
        integral = quad(
            lambda t, n=degree, p=outgoing, q=order: (
                (sph_harm_y(n, q, t, 0) * sph_harm_y(p, q, t, np.pi)).real * np.sin(t)
            ),
            0,
            np.pi / 2,
        )[0]
        assert found[degree, outgoing, order] == pytest.approx(2 * np.pi * integral, abs=1e-10)


def test_a_filter_scales_each_degree():
    strength = np.array([1.0, 0.5, 0.25])
    found = mirror_coefficients(2, strength)
    np.testing.assert_array_equal(found, mirror_coefficients(2) * strength[:, None, None])
    np.testing.assert_array_equal(mirror_transfer(2), np.ones(3))


def test_a_filter_of_another_length_is_refused():
    with pytest.raises(ValueError, match="a filter of 2 degrees for a band limit of 2: give 3"):
        mirror_coefficients(2, np.ones(2))
