"""What may be wrong with pixels: corrections are what photographs that are really wrong would be.

- Pixels and radiance undo each other.
"""

import numpy as np
import pytest
from nuisance_problems import TOLD, VIEWS, some

from jaxrender.inverse.nuisances import Softening

WRONG_PIXELS = {"exposure": [0.1, -0.2, 0.05], "black": [0.02, -0.01, 0.1], "response": [-0.2]}


@pytest.mark.parametrize("names", [("exposure",), ("black",), ("response",), tuple(WRONG_PIXELS)])
def test_pixels_are_gain_and_black_to_a_power_and_are_undone(names):
    corrections = some(**{name: WRONG_PIXELS[name] for name in names})
    told = TOLD.observations
    zero = {name: 0 * np.array(numbers) for name, numbers in WRONG_PIXELS.items()}
    wrong = zero | {name: np.array(WRONG_PIXELS[name]) for name in names}
    gains = np.exp(wrong["exposure"])[told.frame][:, None]
    level = np.sqrt(np.mean(told.radiance**2))
    pixels = (told.radiance * gains + level * wrong["black"]) ** np.exp(wrong["response"])
    for number in range(VIEWS):
        mine = told.frame == number
        made = corrections.photographed(told.radiance[mine], number)
        np.testing.assert_allclose(made, pixels[mine])
    mended = corrections.observations(TOLD._replace(observations=told._replace(radiance=pixels)))
    np.testing.assert_allclose(mended.radiance, told.radiance)


def test_a_blur_mixes_what_is_seen_and_is_taken_off_inside():
    rng = np.random.default_rng(5)
    image, seen = rng.uniform(1, 2, (24, 24, 3)), np.zeros((24, 24), bool)
    seen[4:, 6:] = True
    corrections = some(blur=[0.8])
    # What is seen is as bright everywhere: it stays so up to its rim.
    even = corrections.photographed(np.where(seen[..., None], np.ones(3), 9), 0, seen)
    np.testing.assert_allclose(even[seen], 1)
    made = corrections.photographed(image, 0)
    assert np.var(made[8:16, 8:16]) < 0.3 * np.var(image)
    # One photograph, some of whose samples lie beside the rim.
    told, inside = TOLD.observations, np.arange(TOLD.observations.count) % 3 > 0
    added = rng.normal(size=told.radiance.shape)
    soft = told._replace(radiance=told.radiance + 0.8 * added)
    mended = corrections.observations(
        TOLD._replace(observations=soft, softening=Softening(added, inside))
    )
    np.testing.assert_allclose(mended.radiance, told.radiance)
    np.testing.assert_array_equal(mended.pixels, told.pixels * inside)


def test_pixels_below_black_are_of_no_light():
    corrections = some(black=[-0.5, -0.5, -0.5], response=[0.1])
    assert not corrections.photographed(np.full((1, 3), 0.01), 0).any()
