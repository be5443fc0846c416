"""Environment files: panoramas in, our latitude-longitude image out.

Pinned down: a round trip; scale; convention and resolution handed on; and the messages.  That the
conventions themselves are right is the business of tests/lighting/test_panoramas.py.
"""

from pathlib import Path

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.io.environments import read_environment, write_environment
from jaxrender.io.images import read_image, write_image
from jaxrender.lighting.environment import Environment
from jaxrender.lighting.panoramas import to_latlong

FLOAT32 = 1e-7
PROBES = Path(__file__).parents[3] / "shared" / "data" / "probes"


def test_round_trip(tmp_path):
    radiance = np.random.default_rng(0).random((6, 12, 3)) * 1e5
    write_environment(tmp_path / "e.exr", Environment(radiance))
    found = read_environment(tmp_path / "e.exr").radiance
    np.testing.assert_allclose(found, radiance, rtol=FLOAT32)


def test_scale_convention_and_height(tmp_path):
    pixels = np.random.default_rng(1).random((8, 6, 3)).astype(np.float32)
    write_image(tmp_path / "cross.pfm", pixels)
    found = read_environment(tmp_path / "cross.pfm", "cross", scale=2, height=5).radiance
    np.testing.assert_allclose(found, 2 * to_latlong(pixels, "cross", 5), rtol=FLOAT32)


@pytest.mark.parametrize(
    ("convention", "wanted"),
    [
        ("z-up", "2:1"),
        ("y-up", "2:1"),
        ("angular", "1:1"),
        ("cross", "3:4"),
        ("mirror-ball", "1:1"),
    ],
)
def test_a_wrong_aspect_is_named(tmp_path, convention, wanted):
    write_image(tmp_path / "odd.exr", np.zeros((8, 12, 3)))
    message = rf"odd\.exr: the panorama is 12 x 8 .*'{convention}' wants {wanted}"
    with pytest.raises(InputError, match=message):
        read_environment(tmp_path / "odd.exr", convention)


def test_broken_radiance_is_named(tmp_path):
    write_image(tmp_path / "e.exr", np.full((2, 4, 3), -1.0))
    with pytest.raises(InputError, match=r"e\.exr: channel R, pixel \(row 0, column 0\)"):
        read_environment(tmp_path / "e.exr")


def test_integers_are_no_radiance(tmp_path):
    write_image(tmp_path / "e.png", np.zeros((2, 4, 3)))
    with pytest.raises(InputError, match=r"e\.png: .*not linear radiance; use EXR, HDR or PFM"):
        read_environment(tmp_path / "e.png")


def test_misuse_is_refused_before_reading():
    with pytest.raises(ValueError, match=r"unknown panorama convention 'globe'; known are z-up, y"):
        read_environment("any.exr", "globe")
    with pytest.raises(ValueError, match="scale is -1: it must be positive and finite"):
        read_environment("any.exr", scale=-1)


@pytest.mark.skipif(not PROBES.exists(), reason="the real probes are not on this machine")
def test_a_real_probe():
    environment = read_environment(PROBES / "grace_cross.hdr", "cross", height=32)
    assert environment.radiance.shape == (32, 64, 3)
    pixels = read_image(PROBES / "grace_cross.hdr").pixels
    # The brightest texel is a window; no resampling makes light brighter.
    assert pixels.max() / 100 < np.max(environment.radiance) < pixels.max()
