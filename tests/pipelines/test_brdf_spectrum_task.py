"""``task: brdf-spectrum`` from config to result folder; photographs in plain NumPy, 1 % noise.

- A diffuse ball under sources: the lobe is kd cos t_i cut at the order, within its error;
  photographs are predicted to the noise; coefficients are written with their covariance and read
  back.
- The result renders again by the integral, without standard deviations of its own.
- Light without degrees: not identifiable, in words.
- Concave shapes, moving light and too few samples are refused in words.
"""

import h5netcdf
import numpy as np
import pytest
from painted_captures import KD, NOISE, Paint, write_config, write_painted
from small_captures import read_result

from jaxrender.errors import InputError
from jaxrender.geometry.sculpture import sculpture
from jaxrender.io import read_image, write_environment, write_mesh
from jaxrender.lighting import Environment
from jaxrender.pipelines import fit, load_run_config
from jaxrender.pipelines.render import render_config
from jaxrender.pipelines.tasks.brdf_spectrum import read_spectrum

TASK = "task: brdf-spectrum\nspectrum: {order: 2}\nsamples: {count: 2000}\n"
PLAIN = Paint(np.tile(KD[:1], (2, 1)), np.zeros(2))
# sum over l of (2 l + 1) / (4 pi) A_l P_l(1): the clamped cosine at its peak, cut at degree 2.
PEAK = 1 / 4 + 1 / 2 + 5 / 16


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    return write_painted(tmp_path_factory.mktemp("plain") / "capture", PLAIN, 4)


@pytest.fixture(scope="module")
def found(ball):
    return run(ball, "spectrum")


def run(capture, name, *overrides, **config):
    path = write_config(capture, TASK, **config)
    out = capture.parent / name
    fit(load_run_config(path, [*overrides, f"output={out}"]))
    return out, read_result(out)


def test_the_lobe_of_a_diffuse_ball(found):
    folder, result = found
    # The clamped cosine has degrees above 2, which 1 % of noise does not hide.
    assert (result["task"], result["outcome"]) == ("brdf-spectrum", "misfit")
    assert [one["cause"] for one in result["diagnosis"]] == ["order"]
    assert result["diagnosis"][0]["free"] == "spectrum.order"
    assert result["residual"]["misfit"]["noise"] == pytest.approx(0.01, rel=0.2)
    said = result["spectrum"]
    assert 0 < said["lobe_relative_error_if_exact"] < said["lobe_relative_error"]
    assert (said["order"], said["reciprocal"], len(said["by_degree"])) == (2, True, 3)
    assert [one["order"] for one in said["orders"]] == [1, 2]
    assert said["orders"][1]["relative_rms"] < said["orders"][0]["relative_rms"]
    spectrum = read_spectrum(folder / "result.nc")
    head_on = np.array([[0.0, 0.0, 1.0]])
    outgoing = np.array([[0.6, 0.0, 0.8]])
    value, error = spectrum.transfer(head_on, outgoing)
    assert value[0] == pytest.approx(PEAK * KD[0], rel=0.1)
    assert (error[0] < 0.05 * value[0]).all()


def test_arrays_and_pictures(found, ball):
    folder, result = found
    with h5netcdf.File(folder / "result.nc") as file:
        group = file["spectrum"]
        count = result["spectrum"]["unknowns"]
        assert group["covariance"].dimensions == ("channel", "unknown", "other_unknown")
        assert group["value"].shape == (count, 3)
        variance = np.einsum("cuu->uc", group["covariance"][:])
        np.testing.assert_allclose(group["standard_error"][:], np.sqrt(variance))
    photograph, predicted = (
        read_image(path).pixels
        for path in (ball / "images/1.exr", folder / "images/1_predicted.exr")
    )
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    # Degrees above 2, which sources have, make some 5 % of what a diffuse surface reflects.
    assert NOISE / 2 < np.median(np.abs(predicted[inside] / photograph[inside] - 1)) < 8 * NOISE
    page = (folder / "report.html").read_text()
    assert "BRDF recovered as coefficients" in page
    assert page.count("Slice of the lobe, order") == 2


def test_the_result_renders_again(found, ball, tmp_path):
    out = render_config(found[0], tmp_path / "again")
    photograph, again = (read_image(p).pixels for p in (ball / "images/1.exr", out / "1.exr"))
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    assert np.median(np.abs(again[inside] / photograph[inside] - 1)) < 0.15
    assert not list(out.glob("*_deviation.exr"))
    with pytest.raises(InputError, match="--model dual needs a lobe about the reflected"):
        render_config(found[0], tmp_path / "dual", model="dual")


def test_light_without_degrees_tells_no_lobe(ball):
    write_environment(ball / "white.exr", Environment(np.ones((16, 32, 3))))
    lighting = "lighting: {environment: {path: white.exr}}\n"
    _, result = run(ball, "white", "spectrum.reciprocal=false", lighting=lighting)
    assert result["outcome"] == "not_identifiable"
    assert result["identifiable"] == {"lobe": False}
    assert any("next to nothing of degree 1, 2" in reason for reason in result["reasons"])
    determined = [one["told"] for one in result["spectrum"]["by_degree"]]
    assert determined[0] > 0.9
    assert max(determined[1:]) < 0.1


def test_bad_input_is_refused_in_words(ball, tmp_path):
    with pytest.raises(InputError, match=r"2000 samples for \d+ coefficients; lower"):
        run(ball, "many", "spectrum.order=24")
    white = "lighting: {environment: {path: white.exr}}\n"
    write_environment(ball / "white.exr", Environment(np.ones((8, 16, 3))))
    with pytest.raises(InputError, match=r"8 rows has degrees to 3: lower the order"):
        run(ball, "coarse", "spectrum.order=4", lighting=white)
    write_mesh(tmp_path / "dents.ply", sculpture(2, 0))
    with pytest.raises(InputError, match="concave, and coefficients are recovered without shadows"):
        run(ball, "dents", shape=f"mesh: {tmp_path / 'dents.ply'}")
    (ball / "lights.json").write_text("[]")
    moving = "lighting: {per_frame: lights.json}\n"
    with pytest.raises(InputError, match="one light for all photographs"):
        run(ball, "moving", lighting=moving)
