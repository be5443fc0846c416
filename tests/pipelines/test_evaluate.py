"""``jaxrender evaluate``: a result against photographs, from files to numbers.

- The photographs of the fit are as near to their prediction as their noise is; those of a wrong
  material are not.  Gains of the exposure do not count unless no scale is free.
- Other photographs in another light are predicted by its panorama.
- A recovered light is compared with a true one; a given light cannot be.
- The folder holds numbers, predictions and pictures, and is replaced only on request.
- Bad input is named.
"""

import json
import shutil

import numpy as np
import pytest
from small_captures import (
    Ball,
    cameras,
    edit_json,
    jaxrender,
    moving_light,
    picture,
    read_result,
    write_json,
)

from jaxrender.io import read_image, write_environment, write_image
from jaxrender.lighting import Environment

NOISE = 0.005


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run under a moving lamp, with its capture beside it."""
    return moving_light(tmp_path_factory)


@pytest.fixture
def changed(finished, tmp_path):
    """A copy of the result, to be spoilt."""
    shutil.copytree(finished / "out", tmp_path / "out")
    return tmp_path / "out"


def numbers(folder):
    return json.loads((folder / "evaluation.json").read_text())


def test_the_fits_own_photographs_are_predicted_to_their_noise(finished, tmp_path, capsys):
    out = tmp_path / "evaluation"
    assert jaxrender("evaluate", finished / "out", "--out", out) == 0
    found = numbers(out)
    assert set(found["photographs"]) == {"0", "1", "2", "3"}
    for one in found["photographs"].values():
        assert one["relative_rms"] == pytest.approx(NOISE, rel=0.3)
        assert one["scale"] == pytest.approx([1, 1, 1], abs=1e-3)
        assert one["psnr_hdr"] > 40
        assert one["ssim"] > 0.99
    printed = capsys.readouterr().out
    mean = found["mean"]
    assert f"{mean['psnr_hdr']:6.2f}  {mean['psnr_ldr']:6.2f}  {mean['ssim']:6.4f}" in printed
    photograph = read_image(finished / "capture/images/2.exr")
    rendered = read_image(out / "2.exr").pixels
    inside = photograph.alpha > 0.5
    left = (rendered - photograph.pixels)[inside]
    assert np.sqrt(np.mean(left**2)) < 0.02 * photograph.pixels[inside].max()
    assert (rendered[~inside] == 0).all()
    assert read_image(out / "2.png").pixels.shape == (32, 96, 3)


def test_a_wrong_material_is_told_and_a_gain_only_on_request(finished, changed, tmp_path):
    def rms(*options):
        out = tmp_path / "evaluation"
        assert jaxrender("evaluate", changed, "--out", out, "--force", *options) == 0
        return numbers(out)["mean"]["relative_rms"]

    found = read_result(changed)
    write_json(changed / "result.json", found | {"scale": 1.1})
    assert rms() == pytest.approx(NOISE, rel=0.3)
    # The pictures are written with the factor that the numbers are of.
    photograph = read_image(finished / "capture/images/0.exr").pixels
    lit = photograph > 0.1 * photograph.max()
    ratio = read_image(tmp_path / "evaluation/0.exr").pixels[lit] / photograph[lit]
    assert np.median(ratio) == pytest.approx(1, abs=1e-3)
    assert rms("--scale", "none") == pytest.approx(0.1, rel=0.1)
    found["brdf"]["sigma"] *= 1.5
    write_json(changed / "result.json", found)
    assert rms() > 0.05


@pytest.mark.parametrize("axes", ["opengl", "opencv"])
def test_other_photographs_in_another_light(changed, tmp_path, capsys, axes):
    """Two lamps where the fit had one: as texels of a panorama, of 1.4 degrees.

    The other cameras are in the axes that the fit's were in.
    """
    config = (changed / "config.yaml").read_text()
    assert "camera_axes: opengl" in config
    (changed / "config.yaml").write_text(config.replace("axes: opengl", f"axes: {axes}"))
    ball = Ball(views=1, size=24)
    rows, radiance, lights = 128, np.zeros((128, 256, 3)), []
    for row, column, irradiance in ((40, 10, 2.0), (60, 30, 1.0)):
        polar, azimuth = (row + 0.5) * np.pi / rows, (column + 0.5) * np.pi / rows
        sine = np.sin(polar)
        towards = (sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar))
        lights.append((towards, (irradiance,) * 3))
        edges = np.cos(row * np.pi / rows) - np.cos((row + 1) * np.pi / rows)
        radiance[row, column] = irradiance / (edges * np.pi / rows)
    (tmp_path / "images").mkdir()
    camera = cameras(ball)[0]
    image, covered = picture(camera, lights)
    write_image(tmp_path / "images/new.exr", np.concatenate([image, covered[..., None]], axis=-1))
    # OpenCV has y down and z ahead.
    pose = camera.world_from_camera * ([1, -1, -1, 1] if axes == "opencv" else 1.0)
    frame = {
        "file_path": "images/new.exr",
        "transform_matrix": pose.tolist(),
        "fl_x": camera.fl_x,
    }
    write_json(tmp_path / "transforms.json", {"w": 24, "h": 24, "frames": [frame]})
    write_environment(tmp_path / "lamps.exr", Environment(radiance))
    other = ("--photographs", tmp_path / "transforms.json")
    assert jaxrender("evaluate", changed, *other) == 2
    assert "new cameras need an --environment" in capsys.readouterr().err
    command = ["evaluate", changed, *other, "--environment", tmp_path / "lamps.exr"]
    assert jaxrender(*command, "--scale", "none", "--out", tmp_path / "evaluation") == 0
    assert numbers(tmp_path / "evaluation")["mean"]["relative_rms"] < 0.02
    # Cameras to render from are in these axes, too.
    new = ("--camera", other[1], "--environment", tmp_path / "lamps.exr")
    assert jaxrender("render", changed, "--out", tmp_path / "rendered", *new) == 0
    seen = read_image(tmp_path / "rendered/new.exr").alpha > 0.5
    np.testing.assert_array_equal(seen, covered)


def test_a_recovered_light_is_compared_and_a_given_one_refused(finished, changed, tmp_path, capsys):
    rng = np.random.default_rng(0)
    true = Environment(rng.uniform(size=(8, 16, 3)))
    write_environment(tmp_path / "true.exr", true)
    light = ("--light", tmp_path / "true.exr")
    assert jaxrender("evaluate", changed, *light) == 2
    assert "the light of this fit was given, not recovered" in capsys.readouterr().err
    # As a recovery of the light would have left it.
    (changed / "config.yaml").write_text(
        f"task: factorize\ncapture: {{transforms: {finished / 'capture/transforms.json'}, "
        "geometry: {sphere: {radius: 1}}}\n"
    )
    write_environment(changed / "lighting.exr", true.scaled(2.0))
    write_environment(changed / "lighting_slow.exr", true.scaled(2.0))
    found = read_result(changed)
    found["lighting"]["directional"] = []
    write_json(changed / "result.json", found | {"task": "factorize"})
    out = tmp_path / "evaluation"
    assert jaxrender("evaluate", changed, *light, "--out", out) == 0
    spheres = numbers(out)["spheres"]
    # The factor of a recovered light belongs to its gauge.
    for one in spheres.values():
        assert one["rms"] == pytest.approx(0, abs=1e-5)
        assert one["angle"] == pytest.approx(0, abs=1e-2)
    assert "matte silver" in capsys.readouterr().out


def test_a_display_that_shows_nothing_is_said(finished, capsys):
    assert jaxrender("evaluate", finished / "out", "--exposure", "1e-3") == 0
    warning = capsys.readouterr().err
    assert "PSNR-L and SSIM mean little; --exposure" in warning
    assert jaxrender("evaluate", finished / "out", "--exposure", "0") == 2
    assert "--exposure 0: it must be positive" in capsys.readouterr().err


def test_the_folder_is_replaced_only_on_request(finished, tmp_path, capsys):
    out = tmp_path / "evaluation"
    command = ["evaluate", finished / "out", "--out", out]
    assert jaxrender(*command) == 0
    assert jaxrender(*command) == 0
    assert jaxrender(*command, "--exposure", "2") == 2
    assert "or give --force" in capsys.readouterr().err
    assert numbers(out)["exposure"] == 1
    assert jaxrender(*command, "--exposure", "2", "--force") == 0
    assert numbers(out)["exposure"] == 2


def test_what_is_missing_is_named(finished, tmp_path, capsys):
    assert jaxrender("evaluate", tmp_path) == 2
    assert "holds no finished result" in capsys.readouterr().err
    for option in ("--photographs", "--environment", "--light"):
        assert jaxrender("evaluate", finished / "out", option, tmp_path / "nope.exr") == 2
        assert "nope.exr: no such file" in capsys.readouterr().err


def test_photographs_of_nothing_are_refused(finished, tmp_path, capsys):
    shutil.copytree(finished / "capture", tmp_path / "capture")
    other = tmp_path / "capture/transforms.json"

    def away(content):
        for frame in content["frames"]:
            frame["transform_matrix"][0][3] += 100

    edit_json(other, away)
    lamp = tmp_path / "lamp.exr"
    write_environment(lamp, Environment(np.ones((4, 8, 3))))
    command = ("evaluate", finished / "out", "--photographs", other, "--environment", lamp)
    assert jaxrender(*command) == 2
    assert "no camera sees the object" in capsys.readouterr().err
