"""Isotropy and separability as numbers.

Pinned down: rho = 1 + a x_i and 1 + a x_i x_r, whose numbers are known in closed form because x has
mean square 1/4 over projected solid angle; isotropic models have no error and products none; tables
have the same numbers as their models, and as the nearest tables say; black is no exception.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import BRDF, Lambertian, TorranceSparrow, Ward
from jaxrender.brdf.properties import isotropy_error, separability_error
from jaxrender.brdf.tables.nearest import nearest_isotropic, nearest_separable
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.geometry import POLAR

KD, KS = np.array([0.1, 0.05]), np.array([0.2, 0.4])


class Wave(BRDF):
    """1 + a x_i, or 1 + a x_i x_r."""

    strength: float
    paired: bool

    amplitudes = np.ones((1, 1))
    reciprocal = conserves_energy = isotropic = False

    def transfer(self, incoming, outgoing):
        factor = outgoing.x if self.paired else jnp.ones_like(outgoing.x)
        return ((1 + self.strength * incoming.x * factor) * incoming.z,)


@pytest.mark.parametrize("strength", [0.0, 0.5, 1.0])
def test_isotropy_of_a_wave(strength):
    square = strength**2 / 4
    expected = np.sqrt(square / (1 + square))
    assert isotropy_error(Wave(strength, False)) == pytest.approx(expected, abs=1e-12)


def test_a_product_of_two_waves_turns_with_both():
    """x_i x_r is half the cosine of the azimuths' difference and half that of their sum."""
    square = (1 / 4) ** 2
    expected = np.sqrt(square / 2 / (1 + square))
    assert isotropy_error(Wave(1.0, True)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("strength", [0.0, 0.5, 1.0])
def test_separability_of_a_wave(strength):
    square = strength**2 / 16
    expected = square / (1 + square)
    assert separability_error(Wave(strength, True)) == pytest.approx(expected, abs=1e-12)
    assert separability_error(Wave(strength, False)) == pytest.approx(0, abs=1e-12)


def test_models():
    assert isotropy_error(TorranceSparrow(KD, KS, 0.2)) < 1e-9
    assert isotropy_error(Ward(KD, KS, 0.2, 0.4)) > 0.1
    assert separability_error(Lambertian(KD)) < 1e-12
    broad, narrow = (separability_error(Ward(KD, KS, width)) for width in (0.5, 0.2))
    assert 0.01 < broad < narrow < 1


def test_a_table_has_its_models_numbers():
    ward = Ward(KD, KS, 0.4, 0.7)
    table = TabulatedBRDF.of(ward, (12, 24, 12, 24), POLAR, "cubic")
    assert isotropy_error(table) == pytest.approx(isotropy_error(ward), rel=0.05)
    assert separability_error(table) == pytest.approx(separability_error(ward), rel=0.05)
    whole = isotropy_error(ward)
    assert nearest_isotropic(table).change == pytest.approx(whole, rel=0.05)
    assert nearest_separable(table).change ** 2 == pytest.approx(separability_error(ward), rel=0.05)


def test_black():
    black = Lambertian(np.zeros(1))
    assert isotropy_error(black) == 0
    assert separability_error(black) == 0
