"""``task: texture`` of photographs whose exposures differ.

- Exposures that differ are named, and found with the paint where they are freed.
- So are they with paint and light.
- What a texture cannot free is refused in words.
"""

import json

import numpy as np
import pytest
from painted_captures import CHECKER, DIFFUSE, SOURCES, soft_light, write_config, write_painted
from small_captures import MU, SIGMA
from texture_runs import DIFFUSE_TASK, TASK, arrays, run

from jaxrender.errors import InputError
from jaxrender.io import read_image, write_image
from jaxrender.pipelines import load_run_config

PAINTS = {"ball": CHECKER, "diffuse": DIFFUSE}
GAINS = np.exp(0.08 * np.random.default_rng(1).normal(size=9))
# The light is not told.
SOFT_TASK = "task: texture\ntexture: {size: 16}\nsolve: {free: auto}\n"


def with_gains(paint, folder, sources=SOURCES):
    """Write a capture, and let its exposures differ."""
    write_painted(folder, paint, sources=sources)
    for path, gain in zip(sorted((folder / "images").iterdir()), GAINS):
        image = read_image(path)
        colour = gain * image.pixels
        write_image(path, np.concatenate([colour, image.alpha[..., None]], axis=-1))
    return folder


@pytest.mark.slow
def test_exposures_that_differ_are_named(tmp_path):
    capture = with_gains(CHECKER, tmp_path / "capture")
    out, result = run(capture, TASK)
    assert result["outcome"] == "misfit"
    assert result["diagnosis"][0]["cause"] == "exposure"
    assert result["diagnosis"][0]["free"] == "solve.free: [exposure]"
    assert "exposures differ" in (out / "report.html").read_text(encoding="utf-8")
    names = arrays(out)
    assert (names["kd_error"] >= names["kd_exact_error"]).all()
    _, silent = run(capture, TASK, "solve.diagnose=false")
    assert silent["diagnosis"] == []
    assert silent["outcome"] == "misfit"


@pytest.mark.parametrize(
    ("paint", "text"),
    [
        pytest.param("ball", TASK.replace("refine: off", "free: auto"), marks=pytest.mark.slow),
        ("diffuse", DIFFUSE_TASK + "solve: {free: [exposure]}\n"),
    ],
)
def test_exposures_are_found_with_the_paint(paint, text, tmp_path):
    capture = with_gains(PAINTS[paint], tmp_path / "capture")
    folder, result = run(capture, text)
    assert result["outcome"] == "converged"
    exposure = np.array(result["calibration"]["nuisances"]["exposure"]["value"]) / 100
    np.testing.assert_allclose(
        exposure - exposure.mean(), np.log(GAINS) - np.log(GAINS).mean(), atol=0.01
    )
    # Predicted are the photographs as they were taken.
    photograph, predicted = (
        read_image(path).pixels
        for path in (capture / "images/2.exr", folder / "images/2_predicted.exr")
    )
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    assert np.median(predicted[inside] / photograph[inside]) == pytest.approx(1, abs=0.01)
    frames = json.loads((folder / "capture.json").read_text(encoding="utf-8"))["frames"]
    np.testing.assert_allclose([frame["exposure"] for frame in frames], np.exp(exposure))
    assert "What was freed" in (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_exposures_are_found_with_paint_and_light(tmp_path):
    capture = with_gains(CHECKER, tmp_path / "capture", soft_light())
    folder, result = run(capture, SOFT_TASK, lighting="")
    assert (result["outcome"], result["diagnosis"]) == ("converged", [])
    assert result["calibration"]["free"] == ["exposure"]
    exposure = np.array(result["calibration"]["nuisances"]["exposure"]["value"]) / 100
    # What all of them share is the light's.
    np.testing.assert_allclose(exposure, np.log(GAINS) - np.log(GAINS).mean(), atol=0.015)
    for name, truth in (("sigma", SIGMA), ("mu", MU)):
        assert abs(result["brdf"][name] - truth) < 3.5 * result["standard_error"][name]
        assert result["standard_error"][name] < 0.05 * truth
    frames = json.loads((folder / "capture.json").read_text(encoding="utf-8"))["frames"]
    np.testing.assert_allclose([frame["exposure"] for frame in frames], np.exp(exposure))
    photograph, predicted = (
        read_image(path).pixels
        for path in (capture / "images/2.exr", folder / "images/2_predicted.exr")
    )
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    assert np.median(predicted[inside] / photograph[inside]) == pytest.approx(1, abs=0.015)
    assert "What was freed" in (folder / "report.html").read_text(encoding="utf-8")


def test_what_a_texture_cannot_free_is_refused(tmp_path):
    path = write_config(tmp_path, "task: texture\n")
    with pytest.raises(InputError, match=r"solve\.free: blur cannot be freed"):
        load_run_config(path, ["solve.free=[exposure,blur]"])
    with pytest.raises(InputError, match=r"but texture\.regions has several"):
        load_run_config(path, ["solve.free=[exposure]", "texture.regions=mask.png"])
