"""What a finished fit says, as data and as pictures rendered again.

- result.json has every key that is promised, of its type, and is strict JSON; result.nc opens and
  names its dimensions; the report, the resolved config and the pictures are beside it.
- Both models render a result's photographs again, to the noise that they were made with.
- Damaged and missing results are named.
"""

import json
import shutil

import h5netcdf
import numpy as np
import pytest
from small_captures import jaxrender, moving_light, read_result

from jaxrender.brdf import material_named
from jaxrender.errors import InputError
from jaxrender.harmonics import degrees
from jaxrender.imaging import erode
from jaxrender.io import read_image
from jaxrender.pipelines.config import load_run_config
from jaxrender.pipelines.render import render_config
from jaxrender.pipelines.result import read_result as read_finished
from jaxrender.pipelines.summary import summary_of

NOISE = 0.005
MATERIAL = ("kd", "ks", "sigma", "mu")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run, with its capture beside it."""
    return moving_light(tmp_path_factory)


@pytest.fixture
def result(finished):
    return read_result(finished / "out")


# ---------------------------------------------------------------- result.json


def test_every_promised_key_is_there(result):
    assert result["task"] == "brdf"
    assert result["outcome"] in ("converged", "not_converged", "at_bound", "not_identifiable")
    assert result["brdf"]["model"] == "microfacet"
    for section in (result["brdf"], result["standard_error"]):
        assert [type(value) for value in section["kd"]] == [float] * 3
        assert all(isinstance(section[name], float) for name in ("ks", "sigma", "mu"))
    assert all(isinstance(result["identifiable"][name], bool) for name in MATERIAL)
    assert set(result["residual"]) == {"relative_rms", "samples", "misfit"}
    assert set(result["residual"]["misfit"]) == {"rms", "share", "correlation", "noise"}
    assert result["diagnosis"] == []
    for name, exact in result["interval90_if_exact"].items():
        assert np.all(np.ptp(exact, axis=-1) <= np.ptp(result["interval90"][name], axis=-1) + 1e-12)
    # Under one source the refinement takes every usable pixel: fewer would not be quicker.
    assert result["residual"]["samples"] == result["pixels"]["usable"] > 300
    assert {"gauge", "directional"} <= set(result["lighting"])
    assert result["lighting"]["gauge"] == "given"
    assert {"relative", "floor", "rounding"} == set(result["noise"])
    stages = {"load", "trace", "compile", "solve", "refine", "total"}
    assert stages <= set(result["seconds"])
    assert all(seconds >= 0 for seconds in result["seconds"].values())


def test_intervals_are_pairs_about_the_values(result):
    interval, value = result["interval90"], result["brdf"]
    assert np.shape(interval["kd"]) == (3, 2)
    for name in MATERIAL:
        pairs = np.reshape(interval[name], (-1, 2))
        assert (pairs[:, 0] < np.ravel(value[name])).all()
        assert (pairs[:, 1] > np.ravel(value[name])).all()
        # 90 % of a Gaussian lie within 1.645 standard deviations (mu's are those of its logarithm).
        widths = (pairs[:, 1] - pairs[:, 0]) / 2
        assert widths == pytest.approx(1.645 * np.ravel(result["standard_error"][name]), rel=0.15)


def test_bias_is_where_the_refinement_came_from(result):
    before, after = result["frequency"]["brdf"], result["brdf"]
    for name in MATERIAL:
        moved = np.array(before[name]) / np.array(after[name]) - 1
        np.testing.assert_allclose(result["frequency"]["bias"][name], moved, atol=1e-12)
    assert result["frequency"]["residual"]["samples"] == 600


def test_the_noise_is_found(result):
    # 900 residuals tell a standard deviation to 2.4 %.
    assert result["noise"]["relative"] == pytest.approx(NOISE, rel=0.1)
    assert result["residual"]["relative_rms"] == pytest.approx(NOISE, rel=0.1)


def test_the_pixels_add_up(result, finished):
    pixels = result["pixels"]
    covered = sum(
        int(read_image(finished / f"capture/images/{k}.exr").alpha.sum()) for k in range(4)
    )
    assert pixels["photographs"] == 4
    assert pixels["usable"] + sum(pixels["removed"].values()) == covered


def test_provenance(result, finished):
    provenance = result["provenance"]
    assert {"jaxrender", "python", "libraries", "seed", "inputs"} <= set(provenance)
    assert {"0.exr", "3.exr", "transforms.json", "lights.json"} <= set(provenance["inputs"])
    assert all(len(digest) == 64 for digest in provenance["inputs"].values())


def test_the_summary_says_what_the_file_says(result):
    text = summary_of(result)
    refined = result["residual"]["samples"]
    assert text.startswith("outcome: converged")
    for name in MATERIAL:
        assert f"\n{name} " in text
    assert f"{100 * result['residual']['relative_rms']:.2f} % rms of {refined} samples" in text
    result["identifiable"]["mu"] = False
    result["scale"] = 2.5
    del result["identifiable"]["ks"]
    lines = summary_of(result).splitlines()
    assert next(line for line in lines if line.startswith("mu ")).endswith("not identifiable")
    assert next(line for line in lines if line.startswith("ks ")).endswith("fixed")
    assert any(line.startswith("scale of the light 2.5") for line in lines)


def test_null_stands_for_what_json_has_no_number_for(result):
    text = summary_of(result | {"frequency": {"bias": {"mu": None}}})
    assert "mu n/a" in text


def test_an_interval_that_nothing_bounds_is_said_so(result):
    ends = {"mu": [1.0, None], "sigma": [None, None]}
    lines = summary_of(result | {"interval90": result["interval90"] | ends}).splitlines()
    assert "at least 1" in next(line for line in lines if line.startswith("mu "))
    assert "n/a-n/a" in next(line for line in lines if line.startswith("sigma "))


# ---------------------------------------------------------------- the files beside it


def test_arrays_have_named_dimensions(finished, result):
    with h5netcdf.File(finished / "out/result.nc") as file:
        assert set(file.groups) == {"frequency", "exact", "light", "covariance"}
        for name, samples in (("frequency", 600), ("exact", result["residual"]["samples"])):
            group = file[name]
            assert group["radiance"].dimensions == ("sample", "channel")
            assert group["normal"].dimensions == ("sample", "component")
            assert group["radiance"].shape == (samples, 3)
            assert set(np.unique(group["frame"])) == {0, 1, 2, 3}
            np.testing.assert_allclose(np.linalg.norm(group["normal"][:], axis=1), 1)
            squares = (group["radiance"][:] - group["predicted"][:]) ** 2
            energy = group["pixels"][:] @ group["radiance"][:] ** 2
            rms = np.sqrt(np.sum(group["pixels"][:] @ squares) / np.sum(energy))
            stated = result if name == "exact" else result["frequency"]
            assert rms == pytest.approx(stated["residual"]["relative_rms"])
        light = file["light"]
        assert light["slow"].dimensions == ("coefficient", "channel")
        np.testing.assert_array_equal(light["degree"], degrees(0))


def test_the_resolved_config_loads_again(finished):
    config = load_run_config(finished / "out/config.yaml")
    assert config.samples.count == 600
    assert config.capture.transforms == finished / "capture/transforms.json"


def test_report_and_pictures(finished):
    out = finished / "out"
    assert "<html" in (out / "report.html").read_text()[:200].lower()
    for number in range(4):
        photograph = read_image(finished / f"capture/images/{number}.exr")
        predicted = read_image(out / f"images/{number}_predicted.exr").pixels
        assert_agrees(photograph, predicted)
    assert not list(out.glob("lighting*.exr"))


def assert_agrees(photograph, rendered):
    """Relative rms over the inside of the ball is the noise (1,300 values tell it to 2 %)."""
    inside = erode(photograph.alpha > 0.5, 2)
    residual = (photograph.pixels - rendered)[inside]
    rms = np.sqrt(np.sum(residual**2) / np.sum(photograph.pixels[inside] ** 2))
    assert rms == pytest.approx(NOISE, rel=0.2)


# ---------------------------------------------------------------- rendered again


@pytest.mark.parametrize("model", ["integral", "dual"])
def test_both_models_give_the_photographs_back(finished, tmp_path, capsys, model):
    command = ["render", finished / "out", "--out", tmp_path / "again", "--model", model]
    assert jaxrender(*command) == 0
    for number in range(4):
        photograph = read_image(finished / f"capture/images/{number}.exr")
        rendered = read_image(tmp_path / f"again/{number}.exr")
        np.testing.assert_array_equal(rendered.alpha, photograph.alpha)
        assert_agrees(photograph, rendered.pixels)
    capsys.readouterr()
    before = (tmp_path / "again/0.exr").stat().st_mtime_ns
    assert jaxrender(*command) == 0
    assert "rendered before; reused" in capsys.readouterr().err
    assert (tmp_path / "again/0.exr").stat().st_mtime_ns == before


def test_another_model_is_another_rendering(finished, tmp_path, capsys):
    command = ["render", finished / "out", "--out", tmp_path / "again", "--model"]
    assert jaxrender(*command, "dual") == 0
    assert jaxrender(*command, "integral") == 2
    assert "or give --force" in capsys.readouterr().err
    assert jaxrender(*command, "integral", "--force") == 0


def test_gains_and_scale_are_rendered(finished, tmp_path):
    shutil.copytree(finished / "out", tmp_path / "out")
    found = read_result(tmp_path / "out")
    found |= {"gains": {"0": 1.0, "1": 2.0, "2": 1.0, "3": 1.0}, "scale": 3.0}
    (tmp_path / "out/result.json").write_text(json.dumps(found))
    assert jaxrender("render", tmp_path / "out", "--out", tmp_path / "again") == 0
    for number, factor in enumerate((3, 6, 3, 3)):
        photograph = read_image(finished / f"capture/images/{number}.exr")
        assert_agrees(photograph, read_image(tmp_path / f"again/{number}.exr").pixels / factor)


def test_what_is_missing_or_damaged_is_named(finished, tmp_path):
    with pytest.raises(InputError, match=r"nope: holds no finished result \(no result\.json\)"):
        render_config(tmp_path / "nope", tmp_path / "again")
    with pytest.raises(ValueError, match=r"model='both': choose one of integral, dual"):
        render_config(finished / "out", tmp_path / "again", model="both")
    with pytest.raises(InputError, match=r"holds no finished result \(no result\.json\); run fit"):
        read_finished(tmp_path)
    (tmp_path / "result.json").write_text("{")
    with pytest.raises(InputError, match=r"result\.json:1:2: Expecting.*fit --force"):
        read_finished(tmp_path)


def test_materials_from_their_summary():
    metal = material_named(
        "microfacet",
        {
            "kd": [0.1, 0.2, 0.3],
            "ks": [0.3, 0.2, 0.1],
            "sigma": 0.2,
            "mu": "none",
            "fresnel": "half",
            "masking": "smith",
        },
    )
    assert metal.mu is None
    assert (metal.fresnel, metal.masking) == ("half", "smith")
    np.testing.assert_allclose(metal.ks, [0.3, 0.2, 0.1])
    diffuse = material_named("lambertian", {"kd": [0.1, 0.2, 0.3]})
    np.testing.assert_allclose(diffuse.kd, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(diffuse.ks, 0)
