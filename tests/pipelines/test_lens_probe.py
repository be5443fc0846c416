"""Light from photographs through a fisheye, or of a panorama, by the command and from Python.

- Two views of a fisheye, each at three exposures with noise: the light to degree 10 within 2 %, a
  lamp within .3 degrees, nothing to be filled.
- One view: what it does not see has no confidence, and is filled; a mask takes more away.
- A panorama is the light itself, without a seam, and its deviations are of the size of its errors.
- Options that contradict one another are named.
"""

import json

import numpy as np
import pytest
from small_captures import jaxrender

from jaxrender.errors import InputError
from jaxrender.geometry import EquirectangularLens, FisheyeLens, Pinhole, look_at
from jaxrender.harmonics import LatLongGrid
from jaxrender.imaging import SRGB
from jaxrender.io import Capture, Frame, read_image, write_capture, write_image
from jaxrender.lighting import Environment, Evidence, SmoothLobes, view_of_lens
from jaxrender.pipelines.light_probe import ProbeOptions, light_probe
from jaxrender.pipelines.probe_views import POSE, Reading
from jaxrender.spectra import light_coefficients

RNG = np.random.default_rng(3)
LAMP = np.array([0.36, -0.48, 0.8])
_middles = RNG.normal(size=(8, 3))
_middles /= np.linalg.norm(_middles, axis=1, keepdims=True)
LIGHT = SmoothLobes(
    np.concatenate([_middles, LAMP[None]]),
    np.append(np.radians(RNG.uniform(25, 60, 8)), np.radians(6.0)),
    np.concatenate([RNG.uniform(0.1, 0.5, (8, 3)), [[8.0, 6.0, 5.0]]]),
)
ROWS, EXPOSURES = 32, (1.0, 0.25, 0.06)


def radiance_of(directions):
    return np.asarray(LIGHT.radiance(directions.reshape(-1, 3))).reshape(directions.shape)


def photographed(camera):
    """The radiance that each pixel sees; 0 where it sees nothing."""
    along = camera.rays().directions
    seen = np.isfinite(along).all(axis=-1)
    return np.where(seen[..., None], radiance_of(np.where(seen[..., None], along, LAMP)), 0)


def stored(radiance, exposure, rng):
    linear = exposure * radiance
    linear = linear + np.sqrt(2.5e-5 * linear + 2.5e-7) * rng.normal(size=linear.shape)
    return SRGB().encode(np.clip(linear, 0, 1)).clip(0, 1)


def fisheye(towards, degrees=200.0, size=160):
    pose = look_at(np.zeros(3), np.array(towards, float), np.array([0.0, 0, 1]))
    length = size / np.radians(degrees)
    return Pinhole(size, size, pose, fl_x=length, lens=FisheyeLens(()))


def truth(rows=ROWS):
    fine = radiance_of(LatLongGrid(4 * rows, 8 * rows).directions())
    return fine.reshape(rows, 4, 2 * rows, 4, 3).mean(axis=(1, 3))


def off(found, wanted):
    own, true = (np.asarray(light_coefficients(Environment(one), 10)) for one in (found, wanted))
    return np.linalg.norm(own - true) / np.linalg.norm(true)


def write_views(folder, cameras, mask=None):
    frames = []
    for number, camera in enumerate(cameras):
        picture = photographed(camera)
        for exposure in EXPOSURES:
            path = folder / f"{number}_{exposure}.png"
            write_image(path, stored(picture, exposure, RNG))
            frames.append(Frame(path.stem, camera, path, mask, exposure))
    write_capture(folder / "transforms.json", Capture(tuple(frames), folder / "transforms.json"))
    return folder / "transforms.json"


def test_two_views_of_a_fisheye_see_the_whole_light(tmp_path):
    capture = write_views(tmp_path, [fisheye([1, 0.2, 0.1]), fisheye([-1, -0.2, -0.1])])
    reading = Reading("srgb", lens="fisheye", field=200.0)
    light_probe([capture], tmp_path / "probe", ProbeOptions(reading, height=ROWS))
    about = json.loads((tmp_path / "probe/light.json").read_text())
    found = read_image(tmp_path / "probe/probe.exr").pixels
    assert off(found, truth()) < 0.02
    assert about["filled_part"] == 0
    assert about["seen"] == "fisheye"
    assert np.array(about["lamps"][0]["direction"]) @ LAMP > np.cos(np.radians(0.3))


def test_one_view_by_the_command(tmp_path, capsys):
    """It looks along +Y; half of the light is behind it."""
    towards = fisheye([0, 1, 0], 180.0)
    paths = []
    for exposure in EXPOSURES:
        paths.append(tmp_path / f"{exposure}.png")
        write_image(paths[-1], stored(photographed(towards), exposure, RNG))
    times = [word for t in EXPOSURES for word in ("--exposures", str(t))]
    options = ["--fisheye", "180", "--response", "srgb", "--height", str(ROWS)]
    assert jaxrender("light", *paths, "--out", tmp_path / "probe", *times, *options) == 0
    assert "% of all directions were not seen: filled" in capsys.readouterr().out
    about = json.loads((tmp_path / "probe/light.json").read_text())
    assert about["filled_part"] == pytest.approx(0.5, abs=0.03)
    found, sure = (read_image(tmp_path / f"probe/{n}.exr").pixels for n in ("probe", "confidence"))
    seen = sure[..., 0] > 0.99
    np.testing.assert_array_equal(seen & (LatLongGrid(ROWS, 2 * ROWS).directions()[..., 1] < 0), 0)
    assert np.median(np.abs(found / truth() - 1)[seen]) < 0.01


def panorama(columns=128):
    return Pinhole(
        columns, columns // 2, POSE, fl_x=columns / (2 * np.pi), lens=EquirectangularLens()
    )


def test_a_panorama_has_no_seam_and_true_deviations():
    camera, noise = panorama(), 0.02
    picture = photographed(camera)
    noisy = picture + noise * np.random.default_rng(4).normal(size=picture.shape)
    view = view_of_lens(noisy, camera, ROWS, Evidence(np.full(picture.shape, noise)))
    np.testing.assert_allclose(view.confidence, 1, atol=1e-12)
    left = (view.radiance - truth())[truth().max(axis=-1) < 1.5]
    spread = view.deviation[truth().max(axis=-1) < 1.5]
    assert 0.5 < np.sqrt(np.mean((left / spread) ** 2)) < 1.5
    even = view_of_lens(np.full(picture.shape, 0.7), camera, ROWS)
    np.testing.assert_allclose(even.radiance, 0.7, rtol=1e-12)


def test_a_panorama_by_the_command(tmp_path):
    write_image(tmp_path / "a.exr", photographed(panorama()))
    out = tmp_path / "probe"
    assert jaxrender("light", tmp_path / "a.exr", "--panorama", "--out", out) == 0
    found = read_image(out / "probe.exr").pixels
    assert found.shape == (64, 128, 3)
    assert off(found, truth(64)) < 0.01


def test_a_mask_and_the_field_take_directions_away():
    camera, usable = fisheye([0, 1, 0], 220.0), np.ones((160, 160), bool)
    usable[:80] = False
    picture = photographed(camera)
    up = LatLongGrid(ROWS, 2 * ROWS).directions()[..., 2] > 0.1
    view = view_of_lens(picture, camera, ROWS, Evidence(None, usable))
    np.testing.assert_array_equal(view.confidence[up], 0)
    ahead = LatLongGrid(ROWS, 2 * ROWS).directions()[..., 1]
    narrow = view_of_lens(picture, camera, ROWS, field=np.radians(60))
    np.testing.assert_array_equal(narrow.confidence[ahead < 0.8], 0)
    np.testing.assert_allclose(narrow.confidence[ahead > 0.92], 1)
    with pytest.raises(ValueError, match="no usable pixel shows a direction"):
        view_of_lens(picture, camera, ROWS, Evidence(None, np.zeros_like(usable)))
    with pytest.raises(ValueError, match="a photograph of 160 x 9 pixels"):
        view_of_lens(picture[:9], camera, ROWS)


def test_contradictions_are_named(tmp_path, capsys):
    write_image(tmp_path / "a.exr", np.ones((20, 30, 3)))
    for options, message in (
        (["--fisheye", "180", "--panorama"], "give one of them"),
        (["--fisheye", "180", "--ball", "1", "2", "3"], "shows no ball"),
        (["--panorama", "--reflectance", "0.5"], "leave out --reflectance"),
        (["--fisheye", "0"], "give 1 to 360 degrees"),
        (["--panorama"], "twice as wide as high"),
        (["--fisheye", "180", "--focal", "100"], "leave out --focal"),
    ):
        assert jaxrender("light", tmp_path / "a.exr", "--out", tmp_path / "out", *options) == 2
        assert message in capsys.readouterr().err
    capture = write_views(tmp_path, [fisheye([1, 0, 0])])
    with pytest.raises(InputError, match="its camera is no panorama"):
        light_probe([capture], tmp_path / "out", ProbeOptions(Reading("srgb", lens="panorama")))
