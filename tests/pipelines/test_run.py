"""A fit from its config to its folder: the truth comes back, and the folder is kept in order.

- Photographs that the program did not render (T 6.2 in NumPy) give back their material: under a
  moving source without any environment, on a mesh, from 8-bit pictures with saturation, with masks,
  exposure factors and a camera that sees nothing, with unknown exposures, with unknown scale.
- ``synth`` and ``fit`` of its config, and ``fit`` of the recipe itself, give back the recipe's.
- An identical run is reused; another one is refused without --force; a run that is interrupted, or
  dry, writes nothing; --strict tells outcomes by the exit code.

"Gives back" means within four stated standard errors, of fits whose residual is the noise.
"""

import json
import shutil

import numpy as np
import pytest
from small_captures import (
    CONFIG,
    KD,
    KS,
    Ball,
    edit_json,
    jaxrender,
    moving_light,
    read_result,
    standard_errors_off,
    write_ball,
)

from jaxrender.geometry import Mesh
from jaxrender.imaging import SRGB
from jaxrender.io import read_image, write_image, write_mesh
from jaxrender.pipelines.report import front

FAST = ("solve={starts: 2, refine: off}",)
# Four standard errors: with a dozen parameters in all, chance exceeds it in one seed of a thousand.
STANDARD_ERRORS = 4
RECIPE = """\
geometry: {sphere: {}}
brdf: {kd: [0.2, 0.15, 0.1], ks: 0.12, sigma: 0.25, mu: 1.6}
lighting:
  area: [{direction: [0.9, 0.5, 0.4], width_degrees: 40, radiance: [1, 0.97, 0.92]}]
  directional: [{direction: [0.35, 0.8, 0.5], irradiance: [1.2, 1.15, 1.05]}]
views: {count: 4, step_degrees: 50, width: 32, height: 32}
noise: {relative: 0.005}
environment_height: 64
"""


def assert_true_material(result, noise=0.005):
    assert result["outcome"] == "converged"
    off = standard_errors_off(result)
    assert max(off.values()) < STANDARD_ERRORS, off
    # 1,800 residuals tell a standard deviation to 2 %.
    assert result["residual"]["relative_rms"] == pytest.approx(noise, rel=0.1)


def untouched(folder):
    return {path: path.stat().st_mtime_ns for path in sorted(folder.rglob("*"))}


@pytest.fixture
def capture(tmp_path_factory, tmp_path):
    """A copy of the capture under a moving source."""
    shutil.copytree(moving_light(tmp_path_factory) / "capture", tmp_path / "capture")
    return tmp_path / "capture"


def fit(capture, *overrides, code=0):
    out = capture.parent / "out"
    assert jaxrender("fit", capture / "config.yaml", f"output={out}", *overrides) == code
    return read_result(out) if out.exists() else None


# ---------------------------------------------------------------- the truth comes back


@pytest.mark.slow
def test_moving_light_gives_the_material_without_an_environment(tmp_path_factory):
    result = read_result(moving_light(tmp_path_factory) / "out")
    assert_true_material(result)
    assert "environment" not in result["lighting"]
    assert all(result["identifiable"].values())


@pytest.mark.slow
def test_a_messy_capture(capture, capsys):
    """A mask, an exposure factor, broken pixels, and a camera that sees nothing, all at once."""
    picture = read_image(capture / "images/0.exr")
    pixels = np.concatenate([3 * picture.pixels, picture.alpha[..., None]], axis=-1)
    pixels[16, 15, 2] = -1
    write_image(capture / "images/0.exr", pixels)
    # What the mask hides would ruin the fit.
    picture = read_image(capture / "images/1.exr")
    pixels = np.concatenate([picture.pixels, picture.alpha[..., None]], axis=-1)
    pixels[:, 20:, :3] = 7
    write_image(capture / "images/1.exr", pixels)
    mask = np.ones((32, 32, 3))
    mask[:, 20:] = 0
    write_image(capture / "mask.png", mask)

    def change(content):
        content["frames"][0]["exposure"] = 3
        content["frames"][1]["mask_path"] = "mask.png"
        pose = np.array(content["frames"][2]["transform_matrix"])
        pose[:3, [0, 2]] *= -1
        content["frames"][2]["transform_matrix"] = pose.tolist()

    edit_json(capture / "transforms.json", change)
    result = fit(capture, *FAST, "capture.invalid=mask")
    said = capsys.readouterr().err
    assert "0.exr: masked 1 of 1024 pixels" in said
    assert "2.exr: warning: its camera does not see the object; skipped" in said
    assert result["pixels"]["photographs"] == 3
    assert_true_material(result)
    images = capture.parent / "out" / "images"
    assert {path.name for path in images.iterdir()} == {
        f"{name}_{kind}.exr" for name in "013" for kind in ("predicted", "residual")
    }


def test_a_photograph_in_the_dark(capture):
    """A frame without any light is a measurement of nothing, and no reason to stop."""
    edit_json(capture / "lights.json", lambda lights: lights[2].clear())
    picture = read_image(capture / "images/2.exr")
    pixels = np.concatenate([0 * picture.pixels, picture.alpha[..., None]], axis=-1)
    write_image(capture / "images/2.exr", pixels)
    result = fit(capture, *FAST, "solve.noise={relative: 0.005, floor: 0.001}")
    assert max(standard_errors_off(result).values()) < STANDARD_ERRORS
    predicted = read_image(capture.parent / "out/images/2_predicted.exr")
    np.testing.assert_array_equal(predicted.pixels, 0)
    again = capture.parent / "again"
    for model in ("integral", "dual"):
        command = ["render", capture.parent / "out", "--out", again, "--model", model, "--force"]
        assert jaxrender(*command) == 0
        np.testing.assert_array_equal(read_image(again / "2.exr").pixels, 0)
        assert read_image(again / "1.exr").pixels.max() > 0.1


def test_8_bit_pictures_with_saturation(capture):
    """Rounding to 8 bits is noise of its own; clipped highlights are left out."""
    for number in range(4):
        picture = read_image(capture / f"images/{number}.exr")
        exposure = 1.2 / picture.pixels.max()
        values = SRGB().encode(exposure * picture.pixels).clip(0, 1)
        write_image(
            capture / f"images/{number}.png",
            np.concatenate([values, picture.alpha[..., None]], axis=-1),
        )
        keys = {"file_path": f"images/{number}.png", "exposure": exposure}
        edit_json(
            capture / "transforms.json",
            lambda content, number=number, keys=keys: content["frames"][number].update(keys),
        )
    result = fit(capture, *FAST, "capture.response=srgb", "capture.saturation=auto")
    assert result["pixels"]["removed"]["saturated"] > 20
    assert result["pixels"]["saturation"] == [0.998] * 4
    # Steps of 1 / 255, through a slope of about 1, over sqrt(12).
    assert result["noise"]["floor"] >= result["noise"]["rounding"] > 1e-4
    assert result["outcome"] == "converged"
    assert max(standard_errors_off(result).values()) < STANDARD_ERRORS
    assert result["residual"]["relative_rms"] < 0.01


def test_a_mesh(tmp_path, monkeypatch):
    """An ellipsoid as a mesh file, under the same lights; the report knows its faces."""
    told = []
    gap = front.gap_among
    monkeypatch.setattr(front, "gap_among", lambda *seen: told.append(seen) or gap(*seen))
    mesh = Mesh.ellipsoid(np.array([1.1, 0.9, 0.8]), 4)
    write_ball(tmp_path / "capture", Ball(shape=mesh))
    write_mesh(tmp_path / "capture" / "shape.ply", mesh)
    result = fit(
        tmp_path / "capture",
        *FAST,
        "capture.geometry={mesh: " + f"{tmp_path}/capture/shape.ply" + "}",
    )
    assert_true_material(result)
    [(views, faces)] = told
    assert len(views) == 4
    np.testing.assert_allclose(faces, mesh.face_normals(), atol=1e-5)


@pytest.mark.slow
def test_unknown_exposures(tmp_path):
    """Pictures scaled by factors that nobody tells: the material, and the factors, come back."""
    factors = (1.0, 2.0, 0.5, 1.3)
    write_ball(tmp_path / "capture", Ball(gains=factors))
    result = fit(tmp_path / "capture", *FAST, "solve.free_exposure=true")
    assert_true_material(result)
    # Hundreds of pixels of .5 % noise a photograph.
    np.testing.assert_allclose([result["gains"][name] for name in "0123"], factors, rtol=2e-3)


def test_unknown_scale(tmp_path):
    """Lights of unknown strength: the gauge is stated, and scale x material is what was seen."""
    write_ball(tmp_path / "capture", Ball(gains=(5.0,) * 4))
    result = fit(tmp_path / "capture", *FAST, "lighting.free_scale=true")
    brdf, scale = result["brdf"], result["scale"]
    assert np.mean(np.array(brdf["kd"]) + brdf["ks"]) == pytest.approx(1)
    assert result["lighting"]["gauge"].startswith("mean of kd + ks is 1")
    np.testing.assert_allclose(scale * np.array(brdf["kd"]), 5 * np.array(KD), rtol=3e-3)
    assert scale * brdf["ks"] == pytest.approx(5 * KS, rel=1e-2)
    off = standard_errors_off(result)
    assert max(off["sigma"], off["mu"]) < STANDARD_ERRORS


def test_a_recipe_and_its_capture(tmp_path, monkeypatch, capsys):
    """Photographs by the exact integral under an area light; the fit is given its image."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recipe.yaml").write_text(RECIPE)
    few = [
        "samples.count=600",
        "solve.starts=2",
        "solve.variants=false",
        "solve.refine_samples=300",
    ]
    assert jaxrender("synth", "recipe.yaml", "--out", "capture", cache=tmp_path / "cache") == 0
    assert jaxrender("fit", "capture/config.yaml", *few, cache=tmp_path / "cache") == 0
    result = read_result(tmp_path / "runs" / "recipe")
    assert_true_material(result)
    assert result["evidence"]["sentence"].startswith("sigma rests on")
    # The recipe as a config's capture: the same photographs, kept in the cache.
    (tmp_path / "fit.yaml").write_text("task: brdf\ncapture: {recipe: recipe.yaml}\n")
    command = ["fit", "fit.yaml", "output=again", *few]
    capsys.readouterr()
    assert jaxrender(*command, "--dry-run", cache=tmp_path / "cache") == 0
    assert "would render 4 photographs of 32 x 32 pixels" in capsys.readouterr().out
    assert not (tmp_path / "cache").exists()
    assert jaxrender(*command, cache=tmp_path / "cache") == 0
    assert read_result(tmp_path / "again")["brdf"] == result["brdf"]
    [photographs] = (tmp_path / "cache" / "jaxrender" / "captures").iterdir()
    before = untouched(photographs)
    assert jaxrender(*command, cache=tmp_path / "cache") == 0
    assert untouched(photographs) == before
    # Caches are swept by others: what is missing is rendered again.
    (photographs / "images" / "view_002.exr").unlink()
    assert jaxrender(*command, cache=tmp_path / "cache") == 0
    assert (photographs / "images" / "view_002.exr").is_file()


def test_a_recipe_whose_light_leaves_no_room_for_a_key(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recipe.yaml").write_text(
        "geometry: {sphere: {}}\nbrdf: {model: lambertian, kd: 0.1}\n"
        "lighting: {directional: [{direction: [0, 0, 1], irradiance: 1}]}\n"
        "views: {count: 1, width: 8, height: 8}\n"
    )
    (tmp_path / "fit.yaml").write_text("task: brdf\ncapture: {recipe: recipe.yaml}\n")
    assert jaxrender("fit", "fit.yaml", "lighting.split=off", cache=tmp_path / "cache") == 2
    assert (
        f"the light of {tmp_path}/recipe.yaml: lighting.split: found 'off', but light of sources "
        "alone has nothing to split; remove it, or give lighting.environment"
    ) in capsys.readouterr().err


@pytest.mark.slow
def test_a_diffuse_material_and_strict_exit_codes(capture, capsys):
    """Bounds that exclude the answer: ends at one of them, says so, and fails only if strict."""
    overrides = [*FAST, "brdf={model: lambertian, kd: {bounds: [0.3, 0.5]}}"]
    result = fit(capture, *overrides)
    assert result["outcome"] == "at_bound"
    assert result["brdf"] == {"model": "lambertian", "kd": [0.3, 0.3, 0.3]}
    assert result["identifiable"] == {"kd": False}
    assert "kd is at a bound of its range" in result["reasons"]
    assert result["residual"]["misfit"]["share"] > 0.9
    assert not {"variants", "evidence", "frequency"} & set(result) - {"variants"}
    fit(capture, *overrides, "--strict", code=1)
    assert "at_bound" in capsys.readouterr().out


# ---------------------------------------------------------------- the folder


def test_an_identical_run_is_reused(tmp_path_factory, capsys):
    folder = moving_light(tmp_path_factory)
    before = untouched(folder / "out")
    capsys.readouterr()
    command = ["fit", folder / "capture/config.yaml", f"output={folder / 'out'}"]
    for flags in ([], ["--dry-run"], ["--strict"]):
        assert jaxrender(*command, *flags) == 0
        out, err = capsys.readouterr()
        assert "an identical run has finished here; reused" in err
        assert out.startswith("outcome: converged")
        assert untouched(folder / "out") == before


def test_another_run_is_refused_and_forced(capture, tmp_path, capsys):
    lambertian = [*FAST, "brdf={model: lambertian}"]
    fit(capture, *lambertian)
    before = untouched(tmp_path / "out")
    fit(capture, *lambertian, "samples.seed=1", code=2)
    assert "or give --force" in capsys.readouterr().err
    assert untouched(tmp_path / "out") == before
    result = fit(capture, *lambertian, "samples.seed=1", "--force")
    assert result["provenance"]["seed"] == 1
    assert {path.name for path in tmp_path.iterdir()} == {"capture", "out"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_an_interrupted_run_leaves_nothing(capture, tmp_path, monkeypatch, error):
    def interrupted(*_):
        raise error

    monkeypatch.setattr("jaxrender.pipelines.run.write_json", interrupted)
    command = ["fit", capture / "config.yaml", f"output={tmp_path / 'out'}", *FAST]
    command += ["brdf={model: lambertian}"]
    if error is KeyboardInterrupt:
        assert jaxrender(*command) == 130
    else:
        with pytest.raises(OSError):  # noqa: PT011
            jaxrender(*command)
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]


def test_a_dry_run_writes_nothing(capture, tmp_path, capsys):
    fit(capture, "brdf.mu=1.5", "--dry-run")
    assert capsys.readouterr().out == (
        "dry run: would fit kd, ks, sigma to 600 samples of 4 photographs\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]


def test_without_output_the_folder_is_named_for_the_capture(capture, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = capture / "config.yaml"
    assert jaxrender("fit", config, *FAST, "brdf={model: lambertian}") == 0
    assert json.loads((tmp_path / "runs/capture/result.json").read_text())["task"] == "brdf"
    assert config.read_text() == CONFIG
