"""Prefiltered maps.

Pinned down: a map is the sum over the light's texels, lobe by lobe (the twin); any grid may receive
it; uniform light stays uniform at A_0 times its radiance; degrees that the image does not carry are
refused by name.
"""

import numpy as np
import pytest

from jaxrender.harmonics import LatLongGrid
from jaxrender.reflection import reflection_map_by_sum, reflection_maps
from jaxrender.spectra import lambertian_transfer, phong_transfer

ROUNDING = 1e-11
ONTO = LatLongGrid(10, 20)


def light(rows=64, seed=0):
    return np.random.default_rng(seed).uniform(size=(rows, 2 * rows, 3))


@pytest.mark.parametrize("exponent", [4.0, 16.0])
def test_a_map_is_the_sum_over_the_lights_texels(exponent):
    """An even Phong lobe, cos^s on both sides, has only degrees up to s: nothing is cut."""
    degrees = np.arange(17)
    transfer = 2 * np.asarray(phong_transfer(np.asarray(exponent), 16)) * (degrees % 2 == 0)
    found = reflection_maps(light(), transfer[None], ONTO)[0]
    expected = reflection_map_by_sum(
        light(), lambda c: (exponent + 1) / (2 * np.pi) * c**exponent, ONTO
    )
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_several_lobes_at_once_are_each_alone():
    transfers = np.stack([np.asarray(phong_transfer(np.asarray(s), 20)) for s in (4.0, 9.5, 33.0)])
    together = reflection_maps(light(), transfers, ONTO)
    assert together.shape == (3, 10, 20, 3)
    for one, transfer in zip(together, transfers):
        np.testing.assert_allclose(one, reflection_maps(light(), transfer[None], ONTO)[0])


def test_uniform_light_stays_uniform():
    transfer = np.asarray(lambertian_transfer(8))
    found = reflection_maps(np.full((20, 40, 2), 0.5), transfer[None], ONTO)
    np.testing.assert_allclose(found, np.pi / 2, rtol=ROUNDING)


def test_more_degrees_than_the_image_carries():
    with pytest.raises(ValueError, match="lobes to degree 8, and 16 x 32 texels carry degree 7"):
        reflection_maps(light(16), np.ones((1, 9)), ONTO)
    one_row = np.ones((1, 2, 3))
    np.testing.assert_allclose(reflection_maps(one_row, np.ones((1, 1)), ONTO), 1, rtol=ROUNDING)
