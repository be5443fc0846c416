"""Runs of several captures: one object, each set of photographs in its own light.

- Photographs of a ball under a sky and under a lamp, fitted together, give back the material.  The
  result names each photograph by its capture, keeps each environment once, and predicts all.
- The result is rendered again under each photograph's light.
- ``analyze`` knows all captures before there are photographs.
- Names are those of each capture's own file; mended cameras are written capture by capture.
- What is no capture of the object, or has no light, is refused by its place.
"""

import json

import numpy as np
import pytest
from small_captures import jaxrender, read_result, standard_errors_off, write_ball, write_json

from jaxrender.geometry import Sphere
from jaxrender.inverse.calibration import Calibration
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.photographs import SILENT, observations_of
from jaxrender.io import read_capture, read_image
from jaxrender.pipelines.calibration import write_cameras
from jaxrender.pipelines.captures import captures_of
from jaxrender.pipelines.config import load_run_config

BALL = Sphere()
MATERIAL = "brdf: {kd: [0.2, 0.15, 0.1], ks: 0.12, sigma: 0.25, mu: 1.6}\n"
VIEWS = "views: {count: 3, step_degrees: 60, width: 32, height: 32}\n"
REST = MATERIAL + VIEWS + "noise: {relative: 0.005}\n"
LIGHTS = {
    "sky": "{overcast_sky: {zenith: 0.5}, area: [{direction: [0.9, 0.5, 0.4], width_degrees: 40, "
    "radiance: 2}]}",
    "sun": "{clear_sky: {sun: [0, 1, 1], zenith: 0.3}, directional: [{direction: [0, 1, 1], "
    "irradiance: 3}]}",
    "lamp": "{directional: [{direction: [0.35, 0.8, 0.5], irradiance: 1.2}]}",
}
RUN = """\
task: brdf
capture: {recipe: sky.yaml}
captures: [{recipe: sun.yaml}, {recipe: lamp.yaml}]
solve: {starts: 2, variants: false, refine_samples: 600, diagnose: false}
output: out
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("captures")
    for name, light in LIGHTS.items():
        text = f"geometry: {{sphere: {{}}}}\nlighting: {light}\n{REST}"
        text += "" if name == "lamp" else "environment_height: 64\n"
        (place / f"{name}.yaml").write_text(text)
    (place / "large.yaml").write_text(
        f"geometry: {{sphere: {{radius: 2}}}}\nlighting: {LIGHTS['lamp']}\n{REST}"
    )
    (place / "run.yaml").write_text(RUN)
    return place


@pytest.fixture(scope="module")
def result(folder):
    assert jaxrender("fit", folder / "run.yaml", f"output={folder / 'out'}") == 0
    return folder / "out"


def test_the_material_comes_back(result):
    found = read_result(result)
    assert found["outcome"] == "converged"
    # Each capture is refined with as many.
    assert found["residual"]["samples"] == 3 * 600
    off = standard_errors_off(found)
    assert max(off.values()) < 4, off
    names = [photograph["name"] for photograph in found["photographs"]]
    assert names == [f"{capture}-view_{k:03d}" for capture in (1, 2, 3) for k in range(3)]
    images = found["lighting"]["environments"]
    assert [one["photographs"] for one in images] == [names[:3], names[3:6]]
    assert all((result / one["file"]).is_file() for one in images)
    # One photograph shows the dark side of the lamp.
    rms = [photograph["relative_rms"] for photograph in found["photographs"]]
    lit = [value for value in rms if value is not None]
    assert len(lit) >= 8
    np.testing.assert_allclose(lit, 0.005, rtol=0.5)
    report = (result / "report.html").read_text()
    assert "The environment of photographs 1 to 3." in report
    assert "The environment of photographs 4 to 6." in report


def test_every_photograph_is_predicted(result):
    for path in (result / "images").glob("*_residual.exr"):
        left = read_image(path, invalid="mask").pixels
        whole = read_image(path.with_name(path.name.replace("residual", "predicted"))).pixels
        seen = whole > 0
        assert np.std(left[seen]) < 0.02 * np.sqrt(np.mean(whole[seen] ** 2))


@pytest.mark.slow
def test_it_is_rendered_again_in_each_light(result, folder):
    assert jaxrender("render", result, f"--out={folder / 'again'}") == 0
    for path in (result / "images").glob("*_predicted.exr"):
        expected = read_image(path).pixels
        again = read_image(folder / "again" / path.name.replace("_predicted", "")).pixels
        assert np.sqrt(np.mean((again - expected) ** 2)) < 0.03 * np.sqrt(np.mean(expected**2))


def test_all_captures_are_foreseen(folder, capsys):
    assert jaxrender("analyze", folder / "run.yaml") == 0
    said = capsys.readouterr().out
    assert said.startswith("9 photographs, not read")
    assert "an environment of 64 x 128 and an environment of 64 x 128 and sources of single" in said
    assert "every free parameter will be identifiable" in said


def test_photographs_are_named_as_in_their_own_file(folder, capsys):
    """Lights by name are those of the capture that has the name."""
    place = folder / "moving"
    write_ball(place)
    lights = json.loads((place / "lights.json").read_text())
    write_json(place / "named.json", {str(at): own for at, own in enumerate(lights)})
    further = "{transforms: moving/transforms.json, lighting: {per_frame: moving/named.json}}"
    (folder / "named.yaml").write_text(f"{TASK}captures: [{further}]\n")
    assert jaxrender("fit", folder / "named.yaml", "--dry-run") == 0
    assert "of 7 photographs" in capsys.readouterr().out
    assert jaxrender("analyze", folder / "named.yaml") == 0
    assert capsys.readouterr().out.startswith("7 photographs, not read")


def test_mended_cameras_are_written_capture_by_capture(tmp_path):
    for name in ("first", "second"):
        write_ball(tmp_path / name)
    further = "{transforms: second/transforms.json, lighting: {per_frame: second/lights.json}}"
    (tmp_path / "run.yaml").write_text(
        "task: brdf\ncapture: {transforms: first/transforms.json, geometry: {sphere: {}}}\n"
        f"lighting: {{per_frame: first/lights.json}}\ncaptures: [{further}]\n"
    )
    photographs = [
        photograph
        for one in captures_of(load_run_config(tmp_path / "run.yaml"))
        for photograph in one.traced(one.images(SILENT), BALL, SILENT)
    ]
    told = Told(observations_of(photographs), None, BALL)
    gains = 1 + 0.1 * np.arange(len(photographs))
    corrections = Corrections.none(told)._replace(exposure=np.log(gains))
    freed = Calibration(told, corrections, ("exposure",), {}, np.zeros((0, 0)), True, ())
    write_cameras(tmp_path, freed, photographs, BALL)
    found = [
        read_capture(tmp_path / f"capture_{at}.json", images=tmp_path / name).frames
        for at, name in enumerate(("first", "second"), 1)
    ]
    exposures = [frame.exposure or 1.0 for frames in found for frame in frames]
    np.testing.assert_allclose(exposures, gains)
    assert [frame.name for frame in found[1]] == ["0", "1", "2", "3"]


@pytest.mark.parametrize("task", ["factorize", "texture", "brdf-spectrum", "lighting"])
def test_one_recipe_is_no_list_of_captures(folder, result, task):
    """Tasks that take one capture take the photographs of a recipe, which are there."""
    more = ", brdf: {kd: 0.2, ks: 0.1, sigma: 0.2, mu: 1.5}" if task == "lighting" else ""
    text = f"{{task: {task}, capture: {{recipe: sky.yaml}}{more}}}\n"
    (folder / "one.yaml").write_text(text)
    assert jaxrender("fit", folder / "one.yaml", "--dry-run") == 0


TASK = "task: brdf\ncapture: {recipe: sky.yaml}\n"
WRONG = {
    "captures: [{transforms: none.json}]\n": "wrong.yaml:3:12: captures[0]: missing key 'lighting'",
    "captures: [{recipe: sun.yaml, images: .}]\n": "images: a recipe has photographs of its own",
    "captures: [{recipe: large.yaml}]\n": "has another geometry than",
    "captures: [{recipe: sun.yaml}]\nlighting: {split: off}\n": "lighting.split: found 'off', but "
    "captures whose environments differ are fitted by the integral; remove it",
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_captures_are_refused(folder, capsys, text, result):
    (folder / "wrong.yaml").write_text(TASK + text)
    assert jaxrender("fit", folder / "wrong.yaml", f"output={folder / 'wrong'}") == 2
    assert WRONG[text] in capsys.readouterr().err
    assert not (folder / "wrong").exists()
