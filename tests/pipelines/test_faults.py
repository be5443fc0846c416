"""What is wrong with the capture of a recipe, and what a fit makes of it.

- The files of a capture tell nothing of its faults, ``truth.json`` does; photographs are those of
  T 6.2 under what is wrong; the same recipe makes the same bytes.
- What the light has no room for is refused by its key, and so are contradictions of ``solve.free``.
- A fit that frees exposures states them, and writes cameras that another fit starts from.
- Of ``configs/three_faults.yaml`` all three faults are freed, and the material comes back.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from small_captures import KD, KS, MU, SIGMA, jaxrender, read_result, reflected

from jaxrender.errors import InputError
from jaxrender.geometry import Sphere, observe
from jaxrender.io import read_capture, read_image
from jaxrender.pipelines.config import RecipeConfig, load_run_config
from jaxrender.pipelines.synth import synthesise

SUN = ((0.35, 0.8, 0.5), (1.2, 1.15, 1.05))
LAMP = {"direction": SUN[0], "irradiance": SUN[1]}
VIEWS = {"count": 4, "step_degrees": 40.0, "start_degrees": -84.0, "width": 16, "height": 16}
LOBE = {"direction": [0.9, 0.5, 0.4], "width_degrees": 35.0, "radiance": 1.0}
FLOAT32 = 1e-5


def recipe_of(faults, **given):
    sections = {
        "geometry": {"sphere": {}},
        "brdf": {"kd": KD, "ks": KS, "sigma": SIGMA, "mu": MU},
        "lighting": {"directional": [LAMP]},
        "views": VIEWS,
        "noise": {"relative": 0.0},
    }
    if faults is not None:
        sections["faults"] = faults
    return RecipeConfig.model_validate(sections | given)


def make(recipe, folder):
    return synthesise(recipe, folder.parent / "recipe.yaml", folder)


def planted(folder):
    return json.loads((folder / "truth.json").read_text())["planted"]


def pictures(folder):
    frames = read_capture(folder / "transforms.json").frames
    return [(frame.camera, read_image(frame.image_path)) for frame in frames]


def test_files_tell_nothing_and_the_truth_does(tmp_path):
    faults = {"exposure": 5.0, "camera": 0.5, "nearness": 0.2, "object": 0.0}
    wrong = make(recipe_of(faults), tmp_path / "wrong")
    right = make(recipe_of(None), tmp_path / "right")
    for name in ("transforms.json", "config.yaml"):
        assert (wrong / name).read_bytes() == (right / name).read_bytes()
    files = [{str(p.relative_to(f)) for p in f.rglob("*") if p.is_file()} for f in (wrong, right)]
    assert files[0] == files[1]
    found = planted(wrong)
    assert list(found) == ["exposure", "camera", "nearness"]
    assert [len(found[name]) for name in found] == [4, 12, 1]
    # In percent, degrees, and as it is.
    assert 1 < np.std(found["exposure"]) < 15
    assert 0.1 < np.std(found["camera"]) < 1.5
    assert found["nearness"] == [0.2]
    assert "planted" not in json.loads((right / "truth.json").read_text())


def test_the_same_recipe_makes_the_same_bytes_and_another_seed_does_not(tmp_path):
    recipe = recipe_of({"exposure": 5.0, "black": 1.0}, noise={"relative": 0.01})
    first, second = (make(recipe, tmp_path / name) for name in "ab")
    other = recipe_of({"exposure": 5.0, "black": 1.0}, seed=1)
    assert planted(make(other, tmp_path / "c")) != planted(first)
    for path in first.rglob("*"):
        if path.is_file() and path.name != "run.json":
            assert path.read_bytes() == (second / path.relative_to(first)).read_bytes()


def test_gains_black_levels_and_responses_are_in_the_pixels(tmp_path):
    """(gain x radiance + black) ^ exponent, black levels relative to a radiance of 1."""
    folder = make(recipe_of({"exposure": 5.0, "black": 3.0, "response": 4.0}), tmp_path / "wrong")
    wrong = planted(folder)
    black = np.array(wrong["black"]) / 100
    exponent = np.exp(wrong["response"][0] / 100)
    for (camera, image), gain in zip(pictures(folder), wrong["exposure"]):
        view = observe(camera, Sphere())
        radiance = reflected(view.normals[view.hit], view.outgoing[view.hit], [SUN])
        value = np.maximum(np.exp(gain / 100) * radiance + black, 0) ** exponent
        np.testing.assert_allclose(image.pixels[view.hit], value, rtol=1e-4, atol=FLOAT32)
        assert not image.pixels[~view.hit].any()


def test_blurs_mix_what_is_seen(tmp_path):
    folder = make(recipe_of({"blur": 1.0}), tmp_path / "blurred")
    assert planted(folder) == {"blur": [1.0]}
    for camera, image in pictures(folder):
        view = observe(camera, Sphere())
        sharp, whole = np.zeros((*view.hit.shape, 3)), view.hit.astype(float)
        sharp[view.hit] = reflected(view.normals[view.hit], view.outgoing[view.hit], [SUN])
        mixed = gaussian_filter(sharp, (1, 1, 0)) / gaussian_filter(whole, 1)[..., None]
        np.testing.assert_allclose(image.pixels[view.hit], mixed[view.hit], rtol=1e-4, atol=FLOAT32)
        assert np.abs(mixed - sharp)[view.hit].max() > 0.01


def test_near_sources_light_every_point_from_elsewhere(tmp_path):
    folder = make(recipe_of({"nearness": 0.25}), tmp_path / "near")
    place = 4 * np.array(SUN[0]) / np.linalg.norm(SUN[0])
    for camera, image in pictures(folder):
        view = observe(camera, Sphere())
        points, found = view.points[view.hit], image.pixels[view.hit]
        offset = place - points
        for at in range(0, len(points), 7):
            distance = np.linalg.norm(offset[at])
            sun = (offset[at] / distance, np.array(SUN[1]) * (4 / distance) ** 2)
            one = slice(at, at + 1)
            exact = reflected(view.normals[view.hit][one], view.outgoing[view.hit][one], [sun])
            np.testing.assert_allclose(found[one], exact, rtol=1e-4, atol=FLOAT32)


def test_objects_that_moved_are_seen_so(tmp_path):
    folder = make(recipe_of({"object": 20.0, "scale": 10.0}), tmp_path / "moved")
    wrong = planted(folder)
    shape = Sphere(np.array(wrong["object"]) / 100, float(np.exp(wrong["scale"][0] / 100)))
    assert np.linalg.norm(shape.center) > 0.05
    for camera, image in pictures(folder):
        view = observe(camera, shape)
        np.testing.assert_array_equal(image.alpha > 0.5, view.hit)
        exact = reflected(view.normals[view.hit], view.outgoing[view.hit], [SUN])
        np.testing.assert_allclose(image.pixels[view.hit], exact, rtol=1e-4, atol=FLOAT32)


@pytest.mark.parametrize(
    ("faults", "lighting", "message"),
    [
        ({"nearness": 0.2}, {"area": [LOBE]}, r"faults\.nearness: no source is there; give"),
        ({"lamps": 1.0}, {"area": [LOBE]}, r"faults\.lamps: no source is there; give"),
        ({"environment": 1.0}, {"directional": [LAMP]}, r"faults\.environment turns an image"),
        ({"nearness": 1.5}, {"directional": [LAMP]}, r"faults: a source of nearness 1\.5"),
    ],
)
def test_faults_that_the_light_has_no_room_for_are_refused(tmp_path, faults, lighting, message):
    recipe = recipe_of(faults, lighting=lighting)
    with pytest.raises(InputError, match=message):
        make(recipe, tmp_path / "capture")
    assert list(tmp_path.iterdir()) == []


FIT = """\
task: brdf
capture: {transforms: transforms.json, geometry: {sphere: {}}}
lighting: {directional: [{direction: [0.35, 0.8, 0.5], irradiance: [1.2, 1.15, 1.05]}]}
"""


@pytest.mark.parametrize(
    ("solve", "message"),
    [
        ("{free: auto, diagnose: false}", r"free: auto frees what the diagnosis names"),
        ("{free: [exposure], free_exposure: true}", r"free: \[exposure\] and free_exposure: true"),
        ("{free: [paint]}", r"solve\.free"),
        ("{free: everything}", r"solve\.free"),
    ],
)
def test_contradictions_of_what_is_free_are_refused(tmp_path, solve, message):
    (tmp_path / "config.yaml").write_text(FIT + f"solve: {solve}\n")
    with pytest.raises(InputError, match=message):
        load_run_config(tmp_path / "config.yaml")


def test_a_fit_states_what_it_freed_and_writes_the_mended_cameras(tmp_path):
    noise = {"relative": 0.005, "floor": 0.001}
    capture = make(recipe_of({"exposure": 5.0}, noise=noise), tmp_path / "capture")
    options = ("solve.free=[exposure]", "solve.starts=2", "solve.refine_samples=300")
    options += ("solve.variants=false", "samples.count=600", f"output={tmp_path / 'out'}")
    assert jaxrender("fit", capture / "config.yaml", *options) == 0
    result = read_result(tmp_path / "out")
    calibration, truth = result["calibration"], np.array(planted(capture)["exposure"])
    assert calibration["free"] == ["exposure"]
    assert calibration["settled"]
    exposure = calibration["nuisances"]["exposure"]
    assert exposure["unit"] == ["percent"]
    assert exposure["prior"] == [5.0] * 4
    assert exposure["photographs"] == [f"view_{number:03d}" for number in range(4)]
    value = np.array(exposure["value"])
    # All but the mean, which the material takes.
    np.testing.assert_allclose(value - value.mean(), truth - truth.mean(), atol=0.4)
    assert np.all(np.abs(value - truth) < 4 * np.array(exposure["standard_error"]))
    mended = read_capture(tmp_path / "out/capture.json", images=capture).frames
    told = read_capture(capture / "transforms.json").frames
    for one, before, percent in zip(mended, told, value, strict=True):
        assert one.exposure == pytest.approx(np.exp(percent / 100))
        assert (one.name, one.image_path) == (before.name, before.image_path)
        pose = one.camera.world_from_camera
        np.testing.assert_allclose(pose, before.camera.world_from_camera, atol=1e-12)
    # Another fit from there finds nothing more to mend.
    again = (f"capture.transforms={tmp_path / 'out/capture.json'}", f"capture.images={capture}")
    options = (*options[:-1], *again, f"output={tmp_path / 'again'}")
    assert jaxrender("fit", capture / "config.yaml", *options) == 0
    rest = np.array(
        read_result(tmp_path / "again")["calibration"]["nuisances"]["exposure"]["value"]
    )
    assert np.ptp(rest) < 0.4


@pytest.mark.slow
def test_three_faults_at_once_are_named_and_absorbed(tmp_path):
    """The quick sister, of one decision, is ``tests/inverse/test_what_is_kept_free.py``."""
    root = Path(__file__).parents[2]
    for folder in ("configs", "data_synth"):
        (tmp_path / folder).mkdir()
        for file in (root / folder).glob("three_faults*.yaml"):
            shutil.copy(file, tmp_path / folder)
    assert (
        jaxrender("fit", tmp_path / "configs/three_faults.yaml", f"output={tmp_path / 'out'}") == 0
    )
    result = read_result(tmp_path / "out")
    assert result["outcome"] == "converged"
    assert set(result["calibration"]["free"]) == {"exposure", "camera", "nearness"}
    assert result["calibration"]["nuisances"]["nearness"]["value"][0] == pytest.approx(
        0.2, rel=0.02
    )
    # As the recipe says.
    assert result["brdf"]["sigma"] == pytest.approx(0.12, rel=0.005)
    assert result["brdf"]["mu"] == pytest.approx(1.5, rel=0.01)
    np.testing.assert_allclose(result["brdf"]["ks"], 0.1, rtol=0.05)
