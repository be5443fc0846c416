"""The layouts of Stanford-ORB and Objects With Lighting become captures.

- Cameras, pixels and masks are those that were written, to 1e-9; the light comes from where it was
  put, for each photograph in the axes of its own camera, or in those of a panorama that is turned.
- The tone curve of Objects With Lighting is undone.
- Photographs of the training, which have no panorama, are a capture without light.
- A fit finds the true paint, and what one of a plain capture finds (slow).
- Damage is named.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_captures import jaxrender, read_result

import jaxrender as jr
from jaxrender.brdf import Lambertian
from jaxrender.errors import InputError
from jaxrender.geometry import Sphere
from jaxrender.harmonics import LatLongGrid
from jaxrender.inverse.photographs import read_photographs
from jaxrender.io import read_mask
from jaxrender.io.captures import Looking, StatedSphere, read_contents, recognise
from jaxrender.lighting import Environment
from jaxrender.pipelines.captures import captures_of
from jaxrender.pipelines.config import load_run_config
from jaxrender.pipelines.importing import ImportOptions, import_capture
from jaxrender.pipelines.scene import environment_of

sys.path.append(str(Path(__file__).parents[1] / "io"))
from benchmark_folders import (
    EXPOSURE,
    MASK,
    PICTURES,
    objects_with_lighting,
    shine,
    stanford_orb,
)
from capture_formats import Written, cameras, poses

BALL = StatedSphere((0.0, 0.0, 0.0), 1.0)
WANTED = cameras(Written(stanford_orb, lens=False))
TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
# EXR holds float32; shared exponents hold 8 bits.
FLOAT32, RADIANCE_HDR = 1e-6, 0.01


def imported(place, out):
    import_capture(place, out, ImportOptions(sphere=BALL))
    return load_run_config(out / "capture.yaml"), (out / "capture.yaml").read_text()


def same_cameras(frames, wanted):
    for frame, camera in zip(frames, wanted, strict=True):
        for mine, theirs in zip(frame.camera.rays(), camera.rays()):
            np.testing.assert_allclose(mine, theirs, atol=1e-9)


def lit_as_written(capture, rtol):
    """The light of a capture is the lobe that was written, but for what resampling smooths."""
    directions, irradiance = environment_of(capture.lighting.environment).nodes()
    directions, irradiance = np.asarray(directions), np.asarray(irradiance)
    weights = irradiance.sum(axis=1)
    solid = np.sqrt(1 - directions[:, 2] ** 2)
    wanted = shine(directions) * solid[:, None]
    wanted *= irradiance.sum() / wanted.sum()
    # The first moment, and the whole picture.
    moment = weights @ directions / weights.sum()
    np.testing.assert_allclose(moment, wanted.sum(1) @ directions / wanted.sum(), atol=0.01)
    assert np.linalg.norm(irradiance - wanted) < rtol * np.linalg.norm(wanted)


def test_each_photograph_of_stanford_orb_has_the_light_of_its_camera(tmp_path):
    config, text = imported(stanford_orb(tmp_path / "data"), tmp_path / "ours")
    captures = captures_of(config)
    assert config.task == "brdf"
    same_cameras([one.capture.frames[0] for one in captures], WANTED[:2])
    for number, one in enumerate(captures):
        (image,) = read_photographs(one.capture, one.reading)
        np.testing.assert_allclose(image.pixels, PICTURES[number], atol=FLOAT32)
        np.testing.assert_array_equal(read_mask(one.capture.frames[0]), MASK[..., 0] > 0.5)
        lit_as_written(one, 0.05)
    assert "in the frame of its camera" in text
    assert "lighting.free_scale: true" in text
    assert "solve.free: [exposure, environment]" in " ".join(text.replace("#", "").split())


def test_the_training_of_stanford_orb_has_no_light(tmp_path):
    folder = stanford_orb(tmp_path / "data")
    config, text = imported(folder / "transforms_train.json", tmp_path / "ours")
    (capture,) = captures_of(config)
    same_cameras(capture.capture.frames, WANTED[2:])
    assert config.task == "factorize"
    assert capture.capture.frames[0].mask_path == folder / "train_mask/0002.png"
    assert "1 photographs without a panorama" in text
    assert recognise(folder).path.name == "transforms_test.json"


@pytest.mark.parametrize("rotated", [True, False])
def test_objects_with_lighting(tmp_path, rotated):
    folder = objects_with_lighting(tmp_path / "cat/test", TURN, rotated)
    config, text = imported(folder, tmp_path / "ours")
    (capture,) = captures_of(config)
    same_cameras(capture.capture.frames, WANTED)
    lit_as_written(capture, 0.06)
    images = read_photographs(capture.capture, capture.reading)
    for image, picture in zip(images, PICTURES, strict=True):
        radiance = capture.reading.response.linearise(image.pixels)
        codes = np.round(255 * (picture * 2**EXPOSURE) ** (1 / 2.2))
        np.testing.assert_allclose(radiance, (codes / 255) ** 2.2 / 2**EXPOSURE, rtol=1e-9)
    np.testing.assert_array_equal(read_mask(capture.capture.frames[1]), MASK[..., 0] > 0.5)
    assert "task: factorize" in text
    inputs = read_contents(recognise(folder / "inputs"), Looking(folder / "inputs"))
    same_cameras(inputs.capture.frames, WANTED)


MISTAKES = {
    "numbers": ("camera_0001.txt", "1 2 3", r"camera_0001\.txt: wanted 24 finite numbers"),
    "large": ("camera_0001.txt", "1e300 " * 24, r"24 finite numbers, none above 1e\+12"),
    "rotation": ("camera_0001.txt", "1 " * 24, r"camera_0001\.txt: .* (skew|no rotation)"),
    "exposure": ("exposure.txt", "nan", r"exposure\.txt: wanted 1 finite"),
    "stops": ("exposure.txt", "1000", r"an exposure of 1000 stops"),
    "panorama": ("../world_to_env.txt", "2 0 0 0 0 2 0 0 0 0 2 0", r"are no rotation"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named(tmp_path, mistake):
    name, text, message = MISTAKES[mistake]
    folder = objects_with_lighting(tmp_path / "test", TURN, rotated=False)
    (folder / "inputs" / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_contents(recognise(folder), Looking(folder))


@pytest.mark.slow
def test_a_fit_of_stanford_orb_finds_what_a_plain_capture_does(tmp_path):
    """A ball in the exact integral: the true paint, and the same values by either way to 1e-9."""
    paint, ball = Lambertian(np.array([0.2, 0.1, 0.05])), Sphere(np.zeros(3), 1.0)
    light = Environment(shine(LatLongGrid(64, 128).directions()))
    pictures = [np.asarray(jr.render(paint, light, ball, camera), float) for camera in WANTED]
    folder = stanford_orb(tmp_path / "data", pictures=pictures)
    for path in folder.rglob("*_mask/*.png"):
        path.unlink()
    found = {}
    for name, place in (("theirs", folder), ("plain", None)):
        out = tmp_path / name
        if place is None:
            plain_capture(tmp_path / "theirs", out)
        else:
            import_capture(place, out, ImportOptions(sphere=BALL))
        path = out / "capture.yaml"
        text = path.read_text().replace("{model: ggx}", "{model: lambertian}")
        path.write_text(text.replace("output: runs", f"output: {out}/runs"))
        options = ("samples.count=300", "samples.min_cosine=0.1")
        assert jaxrender("fit", path, *options) == 0
        found[name] = read_result(next((out / "runs").iterdir()))["brdf"]["kd"]
    np.testing.assert_allclose(found["theirs"], paint.kd, rtol=0.01)
    np.testing.assert_allclose(found["theirs"], found["plain"], rtol=1e-9)


def plain_capture(imported_folder, out):
    """The photographs and panoramas of an import, with cameras written anew by hand."""
    out.mkdir()
    text = (imported_folder / "capture.yaml").read_text()
    for i in (0, 1):
        cameras_of = imported_folder / f"transforms_{i:04d}.json"
        (frame,) = json.loads(cameras_of.read_text())["frames"]
        frame["transform_matrix"] = poses()[i].tolist()
        (out / cameras_of.name).write_text(json.dumps({"frames": [frame]}))
    text = text.replace('path: "environments', f'path: "{imported_folder}/environments')
    (out / "capture.yaml").write_text(text.replace(f"{imported_folder}/runs", "runs"))
