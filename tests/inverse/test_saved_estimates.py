"""An estimate as a picture and as files.

- The JSON holds values, errors, intervals and the account as they are; what is not finite is null.
- Sources and coefficients are numbers; a sky and an environment are panoramas that read back.
- The ball is bright where a source is mirrored, and lit even where the light itself is dark.
- What stands in the way of the folder is named.
"""

import io
import json

import numpy as np
import pytest
from PIL import Image

from jaxrender.brdf import brdf_named
from jaxrender.errors import InputError
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Estimate, Outcome
from jaxrender.io import read_environment
from jaxrender.lighting import DirectionalSources, Environment, HarmonicLight, OvercastSky

EYE = np.array([2.0, -3.0, 1.2])
TOWARDS = EYE / np.linalg.norm(EYE)
SOURCE = DirectionalSources(TOWARDS[None], np.array([[2.0, 1.0, 0.5]]))
SKY = OvercastSky(np.array([0.3, 0.3, 0.4]))
PROBE = Environment(np.random.default_rng(0).uniform(0, 1, (16, 32, 3)))
PAINT = brdf_named("phong", kd=np.array([0.2, 0.1, 0.1]), ks=np.full(3, 0.3), exponent=60.0)
SMOOTH = HarmonicLight(np.random.default_rng(1).normal(size=(9, 3)) + np.eye(9, 3) * 9)


def estimate(light):
    numbers = {"kd": np.array([0.2, 0.1, 0.1]), "exponent": np.array(60.0)}
    errors = {"kd": np.full(3, 0.01), "exponent": np.array(np.inf)}
    intervals = {"kd": np.array([[0.1, 0.3]] * 3), "exponent": np.array([1.0, np.inf])}
    identifiable, noise = {"kd": True, "exponent": False}, NoiseModel(0.01, 0.002)
    end = (Outcome.NOT_IDENTIFIABLE, ("exponent is lost",), noise, 0.02, None)
    return Estimate("phong", PAINT, light, numbers, errors, intervals, identifiable, *end)


def saved(light, folder):
    assert estimate(light).save(folder / "fit") == folder / "fit"
    return json.loads((folder / "fit/estimate.json").read_text())


def test_numbers_are_saved_as_they_are(tmp_path):
    found = saved(SOURCE, tmp_path)
    assert found["model"] == "phong"
    assert found["values"] == {"kd": [0.2, 0.1, 0.1], "exponent": 60.0}
    assert found["standard_error"]["exponent"] is None
    assert found["interval90"]["exponent"] == [1.0, None]
    assert found["identifiable"] == {"kd": True, "exponent": False}
    assert (found["outcome"], found["reasons"]) == ("not_identifiable", ["exponent is lost"])
    assert found["noise"] == {"relative": 0.01, "floor": 0.002}


def test_every_light_is_saved(tmp_path, monkeypatch):
    # Under so much light the picture takes long, and it is tested by itself.
    monkeypatch.setattr(Estimate, "_repr_png_", lambda self: b"")
    found = saved(SOURCE + SMOOTH + SKY + PROBE, tmp_path)["light"]
    np.testing.assert_allclose(found[0]["directions"], SOURCE.directions)
    np.testing.assert_allclose(found[0]["irradiance"], SOURCE.irradiance)
    np.testing.assert_allclose(found[1]["coefficients"], SMOOTH.coefficients)
    sky, probe = (
        read_environment(tmp_path / "fit" / one["environment"], "z-up") for one in found[2:]
    )
    np.testing.assert_allclose(probe.radiance, PROBE.radiance, rtol=1e-6)
    np.testing.assert_allclose(sky.radiance, SKY.to_environment(128).radiance, rtol=1e-6)


@pytest.mark.parametrize("light", [SOURCE, DirectionalSources.none(3)])
def test_the_ball_shows_the_source(light):
    found = estimate(light)
    ball = found.ball(64)
    assert ball.shape == (64, 64, 3)
    row, column = np.unravel_index(np.argmax(ball.sum(axis=-1)), (64, 64))
    if light is SOURCE:
        # The source stands behind the camera: it is mirrored in the middle.
        assert abs(row - 31.5) <= 2
        assert abs(column - 31.5) <= 2
    assert ball.max() > 0
    assert not ball[0, 0].any()
    picture = np.asarray(Image.open(io.BytesIO(found._repr_png_())))
    assert picture.shape == (192, 192, 3)
    assert picture.max() > 200


def test_what_is_in_the_way_is_named(tmp_path):
    (tmp_path / "fit").write_text("a file")
    with pytest.raises(InputError, match="fit: cannot be written to: File exists"):
        estimate(SOURCE).save(tmp_path / "fit")
    assert (tmp_path / "fit").read_text() == "a file"
