"""Analytic coefficients of lights.

Pinned down: a source's are its harmonics, on the axis Lambda_l^-1 delta_m0 (T 3.14); a light about
any axis against a sum over the sphere; uniform light of the thesis's L_00 is a radiance of 1 / 4 pi
(ERRATA 15); the skies against sums over a fine hemisphere rule, and T 3.18's m = 0; derivatives in
the sun's direction; the parts of one light add up.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.harmonics import evaluate, orders, real_basis
from jaxrender.lighting import ClearSky, DirectionalSources, OvercastSky
from jaxrender.spectra import (
    HemisphereRule,
    axial_coefficients,
    clear_coefficients,
    directional_coefficients,
    lambertian_transfer,
    light_coefficients,
    overcast_coefficients,
    uniform_coefficients,
    zonal_coefficients,
)

ROUNDING = 1e-12
# The sky's kink at the sun, in a sum whose nodes know nothing of it.
KINK = 2e-4
ZENITH = np.array([0.5, 0.7, 1.0])
AXIS = np.array([0.3, -0.6, 0.5])


def wavelength(band_limit):
    return np.sqrt(4 * np.pi / (2 * np.arange(band_limit + 1) + 1))


def test_a_source_at_the_pole():
    found = np.asarray(directional_coefficients(np.array([0, 0, 2.0]), np.ones(1), 12))[:, 0]
    zonal = orders(12) == 0
    np.testing.assert_allclose(found[zonal], 1 / wavelength(12), rtol=ROUNDING)
    np.testing.assert_allclose(found[~zonal], 0, atol=ROUNDING)


def test_a_source_anywhere_is_the_light_itself():
    found = directional_coefficients(AXIS, ZENITH, 9)
    expected = light_coefficients(DirectionalSources(AXIS[None], ZENITH[None]), 9)
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_a_light_about_an_axis():
    """A cap of 40 degrees: inside the band its sum over the sphere is known to be A_l Y_lm."""
    edge = np.radians(40)
    found = axial_coefficients(lambda x: np.where(x > np.cos(edge), 2.0, 0.0), AXIS, 6, [edge])
    frame = np.linalg.qr(np.stack([AXIS, [1, 0, 0], [0, 1, 0]], axis=1))[0]
    frame[:, 0] *= np.sign(frame[:, 0] @ AXIS)
    x, w = np.polynomial.legendre.leggauss(24)
    cosine = np.cos(edge) + (1 - np.cos(edge)) * (x + 1) / 2
    azimuth = np.arange(32) * np.pi / 16
    sine = np.sqrt(1 - cosine**2)[:, None]
    local = np.stack(
        [np.repeat(cosine[:, None], 32, 1), sine * np.cos(azimuth), sine * np.sin(azimuth)]
    )
    directions = np.einsum("ij,jra->rai", frame, local).reshape(-1, 3)
    weights = np.repeat(w * (1 - np.cos(edge)) / 2, 32) * np.pi / 16
    expected = 2.0 * weights @ np.asarray(real_basis(directions, 6))
    np.testing.assert_allclose(found[:, 0], expected, atol=ROUNDING)


def test_uniform_light_of_the_thesis():
    """ERRATA 15: L_00 = Lambda_0^-1 is 1 / (4 pi) from everywhere, not the printed .282."""
    found = uniform_coefficients(np.full(1, 1 / (4 * np.pi)), 3)
    assert float(found[0, 0]) == pytest.approx(1 / wavelength(0)[0], rel=ROUNDING)
    np.testing.assert_array_equal(found[1:], 0)
    radiance = evaluate(found, np.array([[0.6, 0, 0.8]]))
    assert float(radiance[0, 0]) == pytest.approx(1 / (4 * np.pi), rel=ROUNDING)


def hemisphere_sum(sky, band_limit, rule):
    directions = rule.directions()
    radiance = np.asarray(sky.radiance(directions)) * rule.weights()[:, None]
    return np.asarray(real_basis(directions, band_limit)).T @ radiance


def test_overcast_sky():
    sky = OvercastSky(ZENITH)
    found = np.asarray(overcast_coefficients(sky, 20))
    np.testing.assert_allclose(
        found, hemisphere_sum(sky, 20, HemisphereRule(24, 48)), atol=ROUNDING
    )
    np.testing.assert_allclose(found[orders(20) != 0], 0, atol=ROUNDING)
    np.testing.assert_array_equal(light_coefficients(sky, 20), found)
    # On a horizontal plane it gives 7 pi / 9 of the zenith's radiance.
    irradiance = (lambertian_transfer(20) / wavelength(20)) @ found[orders(20) == 0]
    # Degrees beyond 20 are left out of a sky that stops at the horizon.
    np.testing.assert_allclose(irradiance, 7 * np.pi / 9 * ZENITH, rtol=2e-4)


@pytest.mark.parametrize("sun", [(0.5, -0.7, 0.6), (0, 0, 1.0), (-1.0, 0.2, 0.05)])
def test_clear_sky(sun):
    sky = ClearSky(np.array(sun), ZENITH)
    found = clear_coefficients(sky, 8)
    expected = hemisphere_sum(sky, 8, HemisphereRule(160, 320))
    np.testing.assert_allclose(found, expected, atol=KINK * np.abs(expected).max())
    np.testing.assert_array_equal(light_coefficients(sky, 8), found)


def test_derivative_in_the_suns_direction():
    def coefficients(sun):
        return clear_coefficients(ClearSky(sun, jnp.ones(1)), 6)[:, 0]

    at, step = jnp.asarray([0.5, -0.7, 0.6]), 1e-5
    slope = np.asarray(jax.jit(jax.jacfwd(coefficients))(at))
    for axis in range(3):
        moved = step * np.eye(3)[axis]
        numeric = (coefficients(at + moved) - coefficients(at - moved)) / (2 * step)
        np.testing.assert_allclose(slope[:, axis], numeric, atol=1e-6 * np.abs(slope).max())


def test_derivative_in_a_transfer_and_an_axis():
    transfer = jnp.ones((5, 1))
    slope = jax.jacfwd(zonal_coefficients, 1)(transfer, jnp.asarray(AXIS))
    # The length of the axis does not matter.
    np.testing.assert_allclose(slope[:, 0] @ AXIS, 0, atol=ROUNDING)
    assert np.abs(np.asarray(slope)).max() > 0.1
