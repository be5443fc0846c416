"""Nuisances found with material and light: a ball under smooth light and one lamp, both unknown.

- With ``auto`` the diagnosis names exposures that differ, and they are found within their errors.
  What all of them share is the light's.  Samples, weights and errors follow.
- A camera that is turned is found by name, and material and light with it.
- What is of a light that is told cannot be freed.
"""

import numpy as np
import pytest
from ball_problems import BRDF, CLEAN, ENERGY, LAMP, PHOTOGRAPHS, VIEWS, cameras, photographed, seen
from factored_balls import factored, off

from jaxrender.inverse import Outcome

GAINS = 1 + 0.03 * np.array([1.2, -0.7, 0.4, -1.3, 0.9, -0.5])
AXIS, TURN = np.array([0.6, -0.64, 0.48]), np.radians(1.0)


@pytest.mark.slow
def test_auto_frees_exposures():
    found = factored(PHOTOGRAPHS * GAINS[CLEAN.frame][:, None], free="auto")
    assert found.outcome is Outcome.CONVERGED
    assert not found.diagnosis
    calibration = found.calibration
    assert calibration.free == ("exposure",)
    assert calibration.settled
    assert not calibration.sentences
    assert calibration.absorbed > 0.9
    gains = np.log(GAINS)
    exposure = calibration.corrections.exposure
    assert np.mean(exposure) == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(exposure, gains - gains.mean(), atol=0.005)
    # No photograph tells the mean: its prior is 5 percent, over so many photographs.
    mean = 0.05 / np.sqrt(VIEWS)
    np.testing.assert_allclose(calibration.errors["exposure"], mean, rtol=0.1)
    assert off(found) < 4
    scene = found.scene
    assert np.all(scene.slow_error[0] / scene.slow[0] > 0.9 * mean)
    assert np.all(scene.energy_error[0] / scene.sources.irradiance[0] > 0.9 * mean)
    np.testing.assert_array_equal(found.observations.radiance, calibration.observations.radiance)
    assert found.predicted.shape == found.observations.radiance.shape


@pytest.mark.slow
def test_a_turned_camera_is_found_with_material_and_light():
    turned = photographed(seen(cameras(TURN, AXIS)))
    without = factored(turned, free=(), diagnose=False)
    found = factored(turned, free=("camera",))
    assert found.outcome is Outcome.CONVERGED
    assert found.relative_rms < 0.6 * without.relative_rms
    camera, error = found.calibration.corrections.camera, found.calibration.errors["camera"]
    true = np.zeros((VIEWS, 3))
    true[0] = TURN * AXIS
    assert np.all(np.abs(camera - true) < 4 * error.reshape(-1, 3))
    # Along the line of sight a camera's turn about itself shows little; across it shows much.
    assert np.linalg.norm(camera[0] - true[0]) < 0.3 * TURN
    assert off(found) < 4
    aside = np.arccos(np.clip(found.scene.sources.directions[0] @ LAMP[0], -1, 1))
    assert aside < 3 * found.scene.direction_error[0]
    energy = np.mean(BRDF.kd + BRDF.ks) * ENERGY[0]
    np.testing.assert_allclose(found.scene.sources.irradiance[0], energy, rtol=0.02)


@pytest.mark.parametrize("name", ["environment", "lamps", "nearness"])
def test_what_is_of_a_light_that_is_told_cannot_be_freed(name):
    with pytest.raises(ValueError, match=f"{name} cannot be freed: the light is not told"):
        factored(PHOTOGRAPHS, free=(name,))
