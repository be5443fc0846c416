"""The Lambertian BRDF.

Pinned down: its value is kd, which is albedo / pi and not the albedo (ERRATA 43); what it reflects
of uniform light is the albedo; nothing below the horizon on either side.
"""

import numpy as np
import pytest

from jaxrender.brdf import Lambertian

ROUNDING = 1e-14
KD = np.array([0.1, 0.2, 0.3])


def test_value_is_kd_in_every_direction():
    directions = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [0, -0.8, 0.6]])
    values = Lambertian(KD).evaluate(directions, directions[::-1])
    np.testing.assert_allclose(values, np.tile(KD, (3, 1)), rtol=ROUNDING)


def test_the_albedo_is_what_comes_back_of_uniform_light():
    """int rho cos t dw = 2 pi int_0^1 rho c dc, exact with a few Gauss nodes."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    cosines, weights = (nodes + 1) / 2, weights / 2
    incoming = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=-1)
    outgoing = np.tile([0.6, 0, 0.8], (4, 1))
    values = Lambertian(KD).evaluate(incoming, outgoing)
    reflected = 2 * np.pi * (weights * cosines) @ np.asarray(values)
    np.testing.assert_allclose(reflected, Lambertian(KD).albedo, rtol=ROUNDING)
    assert Lambertian(np.full(1, 1 / np.pi)).albedo[0] == pytest.approx(1, rel=ROUNDING)


@pytest.mark.parametrize(
    ("incoming", "outgoing"), [([0.6, 0, -0.8], [0, 0, 1]), ([0, 0, 1], [0.6, 0, -0.8])]
)
def test_nothing_below_the_horizon(incoming, outgoing):
    values = Lambertian(KD).evaluate(np.array(incoming, float), np.array(outgoing, float))
    np.testing.assert_array_equal(values, np.zeros(3))
