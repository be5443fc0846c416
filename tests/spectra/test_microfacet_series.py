"""The series of the microfacet lobe at small exit angles (T 3.52, 3.53).

Pinned down: the half angle is that of the vectors to the third power of the angle from R; the
integral is mpmath's; head-on it is exp(-(sigma l)^2) as far as narrow lobes and few degrees go, and
the term in tan^2 t_o is what brings it nearer to the exact transfer.
"""

import mpmath
import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.spectra import exit_cosine_transfer, series_transfer, squared_half_angle


def half_angle_of_vectors(angle, azimuth, exit_angle):
    """N = +Z, R and V at the exit angle; the light at an angle from R, azimuth 0 towards N."""
    mirror = np.array([-np.sin(exit_angle), 0, np.cos(exit_angle)])
    outgoing = mirror * [-1, 1, 1]
    towards_normal = np.array([np.cos(exit_angle), 0, np.sin(exit_angle)])
    around = np.cos(azimuth) * towards_normal + np.sin(azimuth) * np.array([0, 1.0, 0])
    incoming = np.cos(angle) * mirror + np.sin(angle) * around
    half = incoming + outgoing
    return np.arctan2(np.hypot(half[0], half[1]), half[2])


@pytest.mark.parametrize("exit_angle", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("azimuth", [0.0, 0.7, np.pi / 2, 2.5])
def test_the_half_angle_is_that_of_the_vectors_to_first_order(exit_angle, azimuth):
    angles = np.array([0.02, 0.01])
    exact = np.array([half_angle_of_vectors(angle, azimuth, exit_angle) for angle in angles])
    found = squared_half_angle(angles, np.full(2, azimuth), np.full(2, np.cos(exit_angle)))
    off = np.abs(np.sqrt(found) - exact)
    # The error of t_h itself falls as the square of the angle.
    assert np.all(off < 4 * angles**2)
    assert off[1] < 0.3 * off[0] + 1e-12


def test_the_integral_is_that_of_mpmath():
    sigma, cosine, degrees = 0.2, 0.8, (0, 3, 12)

    def integrand(degree):
        squared_tangent = 1 / cosine**2 - 1
        return lambda u: (
            (2 * u * mpmath.exp(-(u**2)) * mpmath.legendre(degree, mpmath.cos(2 * sigma * u)))
            * (1 - u**2 * squared_tangent / 2)
        )

    expected = [float(mpmath.quad(integrand(k), [0, 2, 7])) / cosine for k in degrees]
    found = np.asarray(series_transfer(sigma, np.array([cosine]), 12))[0]
    np.testing.assert_allclose(found[list(degrees)], expected, atol=1e-10)


def test_head_on_it_is_the_gaussian_of_narrow_lobes():
    degree = np.arange(31)
    found = np.asarray(series_transfer(0.02, np.ones(1), 30))[0]
    np.testing.assert_allclose(found, np.exp(-(0.02**2) * degree * (degree + 1)), atol=2e-4)


def test_high_degrees_are_followed():
    """sigma l = 64: nothing is left, and waves that the nodes miss would show."""
    assert np.abs(np.asarray(series_transfer(0.5, np.array([0.9]), 128))[0, 100:]).max() < 1e-3


def test_the_term_in_the_exit_angle_brings_it_nearer_to_the_exact_transfer():
    sigma, cosines = 0.02, np.cos([0.15, 0.3])
    one = np.ones(1)
    exact = np.asarray(exit_cosine_transfer(Microfacet(one, one, sigma, None), cosines, 50))
    found = np.asarray(series_transfer(sigma, cosines, 50))
    head_on = np.asarray(series_transfer(sigma, np.ones(1), 50))
    off, off_without = (np.abs(f - exact).max(axis=1) for f in (found, head_on))
    assert np.all(off < 0.35 * off_without)
    # t_o^4 and sigma^2.
    assert np.all(off < [1.2e-3, 1.2e-2])
