"""The convolution theorem in flatland.

Pinned down: random band-limited light and BRDF against a sum over the circle (T 2.6, 2.24); the
series at a fixed exit (T 2.25); a Lambertian line's coefficients in closed form; refusal.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.harmonics import circle_angles, circle_basis
from jaxrender.reflection.convolution_flatland import (
    convolve_flatland,
    evaluate_flatland,
    flatland_coefficients,
)

EXACT = 1e-10
INCOMING, OUTGOING, POINTS = 5, 3, 9
RNG = np.random.default_rng(0)


def complex_normal(*shape):
    return RNG.normal(size=shape) + 1j * RNG.normal(size=shape)


LIGHT = complex_normal(2 * INCOMING + 1)
TRANSFER = complex_normal(2 * INCOMING + 1, 2 * OUTGOING + 1)
ALPHA, EXITS = RNG.uniform(-np.pi, np.pi, (2, POINTS))


def test_against_the_sum_over_the_circle():
    angles = circle_angles(4 * INCOMING)
    light = circle_basis(ALPHA[:, None] + angles[None, :], INCOMING) @ LIGHT
    first, second = circle_basis(angles, INCOMING).conj(), circle_basis(EXITS, OUTGOING)
    rho = np.einsum("kl,lp,xp->xk", first, TRANSFER, second)
    expected = np.sum(np.asarray(light) * rho, axis=1) * 2 * np.pi / len(angles)
    found = evaluate_flatland(convolve_flatland(LIGHT, TRANSFER), ALPHA, EXITS)
    np.testing.assert_allclose(found, expected, atol=EXACT)


def test_at_a_fixed_exit():
    by_exit = TRANSFER @ np.asarray(circle_basis(EXITS, OUTGOING)).T
    field = convolve_flatland(LIGHT, by_exit)
    found = np.einsum("xl,lx->x", circle_basis(ALPHA, INCOMING), field)
    expected = evaluate_flatland(convolve_flatland(LIGHT, TRANSFER), ALPHA, EXITS)
    np.testing.assert_allclose(found, expected, atol=EXACT)


def test_coefficients_of_a_lambertian_line():
    """int_-pi/2^pi/2 cos t e^(ilt) dt = 2 cos(l pi / 2) / (1 - l^2), pi / 2 for |l| = 1."""
    found = flatland_coefficients(lambda incoming, outgoing: jnp.cos(incoming), (6, 0))[:, 0]
    order = np.arange(-6, 7)
    unit = np.abs(order) == 1
    integral = np.where(
        unit, np.pi / 2, 2 * np.cos(order * np.pi / 2) / np.where(unit, 1, 1 - order**2)
    )
    # The other factor: int F_0 over the visible half circle, pi / sqrt(2 pi).
    np.testing.assert_allclose(
        found, integral / np.sqrt(2 * np.pi) * np.sqrt(np.pi / 2), atol=EXACT
    )


def test_different_degrees_are_refused():
    with pytest.raises(ValueError, match="9 coefficients and a transfer of 11"):
        convolve_flatland(LIGHT[1:-1], TRANSFER)
