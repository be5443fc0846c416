"""``brdf.table`` from its config to its folder.

- The table of a facet ball that was fitted as another model leaves less than that; result.json says
  so, and the arrays and the MERL file hold the table.
- The photographs are predicted with it, and rendered again from the folder with it.
- The folder is read as one BRDF.  A damaged table is named.
- A table needs two photographs; it is refused beside what it cannot use.
"""

import shutil
from unittest import mock

import numpy as np
import pytest
from small_captures import CONFIG, MOVING, Ball, jaxrender, read_result, write_ball

from jaxrender.brdf import CorrectedBRDF, IsotropicTable
from jaxrender.imaging import erode
from jaxrender.inverse.brdf_table import Correction
from jaxrender.io import read_image
from jaxrender.io.merl import read_merl
from jaxrender.io.netcdf import opened
from jaxrender.pipelines.brdf_sources import source_of
from jaxrender.pipelines.result import ARRAYS_FORMAT
from jaxrender.pipelines.summary import summary_of

TASK = CONFIG.replace("samples: {count: 600}", "samples: {count: 900}")
TABLE = ("brdf.model=phong", "brdf.table=true")
NOISE = 0.005


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("table") / "capture"
    write_ball(folder, Ball(size=48)).write_text(TASK)
    return folder


@pytest.fixture(scope="module")
def finished(ball):
    out = ball.parent / "out"
    assert jaxrender("fit", str(ball / "config.yaml"), *TABLE, f"output={out}") == 0
    return out, read_result(out)


def inside(image):
    """Where the ball is lit, but for pixels that it only touches."""
    return erode(np.min(image, axis=-1) > 0.01, 1)


def test_the_result_says_what_the_table_leaves(finished):
    out, result = finished
    found = result["table"]
    assert result["outcome"] == "misfit"
    assert found["residual"]["of_the_model"] > 2 * NOISE
    # T 6.2 is not reciprocal, and the table is: towards grazing exit something is left.
    assert found["residual"]["relative_rms"] < 0.8 * found["residual"]["of_the_model"]
    assert 0 < found["seen"] < 1
    assert "of the radiance unexplained" in found["sentence"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert found["sentence"] in page
    assert "table-factor" in page
    assert found["sentence"] in summary_of(result)


def test_what_no_material_explains_is_said(finished):
    _, result = finished
    assert "times the noise" not in result["table"]["sentence"]
    correction = mock.NonCallableMock(
        Correction, before=0.4, after=0.3, seen=np.ones(4, bool), settled=False, unexplained=18.0
    )
    said = Correction.sentence.fget(correction)
    assert "18 times the noise" in said
    assert "not come to an end" in said


def test_the_arrays_hold_the_table(finished):
    out, result = finished
    nodes = result["table"]["nodes"]
    with opened(out / "result.nc", ARRAYS_FORMAT) as file:
        axes = ("theta_h", "theta_d", "phi_d")
        group = file.group("table")
        factor, error = (group.array(name, (*axes, "channel")) for name in ("factor", "log_error"))
        seen = group.array("seen", axes)
    assert factor.shape == error.shape == (*nodes, 3)
    assert np.mean(seen) == pytest.approx(result["table"]["seen"])
    assert np.all(factor > 0)


def test_the_folder_is_one_brdf_and_a_merl_file(finished):
    out, _ = finished
    brdf = source_of(str(out)).brdf
    assert isinstance(brdf, CorrectedBRDF)
    wanted = IsotropicTable.of(brdf, (90, 90, 180)).values
    there = ~read_merl(out / "table.binary").invalid
    found = read_merl(out / "table.binary").brdf().values
    np.testing.assert_allclose(np.asarray(found)[there], np.asarray(wanted)[there], rtol=1e-6)


def test_photographs_are_predicted_and_rendered_with_it(finished, ball):
    out, _ = finished
    again = ball.parent / "again"
    assert jaxrender("render", str(out), "--model", "integral", "--out", str(again)) == 0
    for number in range(4):
        photograph = read_image(ball / f"images/{number}.exr").pixels
        predicted = read_image(out / f"images/{number}_predicted.exr").pixels
        rendered = read_image(again / f"{number}.exr").pixels
        true, found, anew = (
            image[inside(photograph)] for image in (photograph, predicted, rendered)
        )
        assert np.sqrt(np.sum((found - true) ** 2) / np.sum(true**2)) < 2.5 * NOISE
        np.testing.assert_allclose(anew, found, rtol=1e-3, atol=1e-5)


def test_rendered_pictures_have_their_deviation(finished, ball):
    again = ball.parent / "again"
    for number in range(4):
        rendered = read_image(again / f"{number}.exr").pixels
        deviation = read_image(again / f"{number}_deviation.exr").pixels
        photograph = read_image(ball / f"images/{number}.exr").pixels
        seen = inside(photograph)
        off = np.abs(rendered - photograph)[seen]
        told = off / np.hypot(deviation, NOISE * photograph)[seen]
        assert 0.6 < np.median(told) < 1.5


def test_a_table_that_has_gone_is_named(finished, tmp_path, capsys):
    out, _ = finished
    copy = tmp_path / "copy"
    shutil.copytree(out, copy)
    (copy / "result.nc").unlink()
    assert jaxrender("render", str(copy), "--out", str(tmp_path / "again")) == 2
    assert "result.nc" in capsys.readouterr().err


def test_one_photograph_is_too_few(tmp_path, capsys):
    config = write_ball(tmp_path / "capture", Ball(views=1, lights=MOVING[:1]))
    config.write_text(TASK)
    assert jaxrender("fit", str(config), *TABLE) == 2
    said = capsys.readouterr().err
    assert "brdf.table" in said
    assert "two photographs" in said
    # Before the fit.
    assert "degrees" not in said
    assert "refine" not in said


@pytest.mark.parametrize(
    ("also", "why"),
    [
        ("solve.free=auto", "takes the capture as it is told"),
        ("solve.interreflection=true", "knows no bounced light"),
        ("task=texture", "a few directions are seen"),
    ],
)
def test_what_it_cannot_use_is_refused(ball, capsys, also, why):
    assert jaxrender("fit", str(ball / "config.yaml"), *TABLE, also) == 2
    assert why in capsys.readouterr().err
