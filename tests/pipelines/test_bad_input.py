"""Bad input through the command line: exit code 2, a message that helps, and nothing written.

- Every message names the file (or the key), the place, the value and what to do about it.
- No traceback, nothing on stdout, and no file that was not there before.
- All errors of a config are said at once; folders that hold something else are left alone.
- What can be lived with is a warning: broken pixels that are masked, a camera that sees nothing.
"""

import re
import shutil

import numpy as np
import pytest
import spoilt_cameras
import spoilt_lights
import spoilt_photographs
from small_captures import jaxrender, write_json
from spoilt_cameras import pose
from spoilt_captures import (
    assert_refused,
    contents,
    fit,
    nothing,
    refused,
    working_directory,
    written,
)
from spoilt_photographs import pixel


def append(text):
    def change(folder):
        with (folder / "config.yaml").open("a") as stream:
            stream.write(text)

    return change


CASES = {
    **spoilt_photographs.CASES,
    **spoilt_cameras.CASES,
    **spoilt_lights.CASES,
    # The config itself.
    "unknown key": (
        append("ligting: {}\n"),
        [],
        r"^cap/config\.yaml:6:1: unknown key 'ligting', did you mean 'lighting'\?$",
    ),
    "duplicate key": (
        append("task: brdf\n"),
        [],
        r"^cap/config\.yaml:6:1: duplicate key 'task', first given at line 1$",
    ),
    "mistyped value": (
        nothing,
        ["samples.count=many"],
        r"samples\.count: found 'many', accepted: a whole number of at least 1$",
    ),
    "sigma 0": (nothing, ["brdf.sigma=0"], r"brdf\.sigma: found 0; .* must be above 0$"),
    "sigma negative": (nothing, ["brdf.sigma=-1"], r"brdf\.sigma: found -1; .* must be above 0$"),
    "mu 1": (nothing, ["brdf.mu=1"], r"brdf\.mu: found 1; .* must be above 1$"),
    "mu bounds": (nothing, ["brdf.mu={bounds: [0.5, 2]}"], r"brdf\.mu: found 0\.5; .* above 1$"),
    "start out of reach": (
        nothing,
        ["brdf.sigma={start: 2.0}"],
        r"^brdf\.sigma: start 2\.0 is outside \[0\.01, 1\.0\]$",
    ),
    "nothing free": (
        nothing,
        [
            "brdf={kd: {fixed: 0.2}, ks: {fixed: 0.1}, sigma: {fixed: 0.2}, mu: {fixed: 1.5}}",
        ],
        r"^brdf: all numbers are fixed, and nothing is left to find: free one of them$",
    ),
    "no light": (nothing, ["lighting={}"], r"no light given; lighting needs one of environment"),
    # Samples.
    "fewer samples than unknowns": (
        nothing,
        ["samples.count=3"],
        r"^samples\.count is 3, and 204 pixels are usable: 3 samples cannot determine 6 unknowns",
    ),
    "fewer refined samples than unknowns": (
        nothing,
        ["solve.refine_samples=2"],
        r"^solve\.refine_samples is 2; give more, or refine: off: 2 samples cannot determine",
    ),
    # A recipe in place of photographs.
    "missing recipe": (
        nothing,
        ["capture={recipe: r.yaml}"],
        r"work/r\.yaml: no such file; mend the path$",
    ),
    "broken recipe": (
        written("r.yaml", "geometry: {sphere: {}}\nbrdf: {kd: .1, ks: .1, sigma: 0, mu: 1}\n"),
        ["capture={recipe: cap/r.yaml}"],
        r"r\.yaml:1:1: missing key 'lighting', .*\n.*r\.yaml:2:31: brdf\.sigma: found 0, .*\n"
        r".*r\.yaml:2:38: brdf\.mu: found 1, accepted: 'none' or a number above 1$",
    ),
}


@pytest.fixture
def work(tmp_path, monkeypatch):
    return working_directory(tmp_path, monkeypatch)


@pytest.mark.parametrize("name", CASES)
def test_refused(work, capsys, name):
    assert_refused(work, capsys, CASES[name])


@pytest.mark.parametrize(
    "name", ["truncated image", "missing mesh", "aspect", "fewer samples than unknowns"]
)
def test_a_dry_run_refuses_the_same(work, capsys, name):
    assert_refused(work, capsys, CASES[name], "--dry-run")


def test_all_errors_of_a_config_are_said_at_once(work, capsys):
    append("ligting: {}\n")(work / "cap")
    said = refused(work, capsys, fit("brdf.sigma=0", "samples.cuont=1"))
    assert said.splitlines() == [
        "cap/config.yaml:6:1: unknown key 'ligting', did you mean 'lighting'?",
        "command line: brdf.sigma=0: brdf.sigma: found 0; every value here must be above 0",
        "command line: samples.cuont=1: unknown key 'cuont', did you mean 'count'?",
    ]


def test_an_exposure_that_no_sample_tells(work, capsys):
    for number in (0, 2):
        pixel((slice(0, 12), ..., 3), 0, f"images/{number}.exr")(work / "cap")
    overrides = ["solve.free_exposure=true", "capture.erode=1", "samples.count=10"]
    said = refused(work, capsys, fit(*overrides, "brdf={ks: 0.1, sigma: 0.2, mu: 1.5}"))
    assert re.search(
        r"images/[02]\.exr: none of its pixels is among the 10 samples drawn, so "
        r"solve\.free_exposure cannot fit its exposure; raise samples\.count$",
        said,
    )


def test_masked_pixels_are_counted(work, capsys):
    pixel((8, slice(7, 9), 0), np.nan)(work / "cap")
    assert jaxrender(*fit("--dry-run", "capture.invalid=mask")) == 0
    out, err = capsys.readouterr()
    assert re.search(r"images/1\.exr: masked 2 of 256 pixels that are negative or not finite", err)
    good = int(re.search(r"to (\d+) samples", out).group(1))
    assert jaxrender(*fit("--dry-run", "capture.invalid=refuse", "capture.erode=1")) == 2
    assert 0 < good < 204


def test_a_camera_that_sees_nothing_is_a_warning(work, capsys):
    pose(1, [[-1, 1, -1, 1]] * 3 + [[1, 1, 1, 1]])(work / "cap")
    before = contents(work)
    assert jaxrender(*fit("--dry-run")) == 0
    out, err = capsys.readouterr()
    assert re.search(r"images/1\.exr: warning: its camera does not see the object; skipped\n", err)
    assert "samples of 2 photographs" in out
    assert contents(work) == before


# ---------------------------------------------------------------- output folders


def test_a_folder_that_holds_other_files(work, capsys):
    (work / "out").mkdir()
    (work / "out" / "thesis.tex").write_text("mine")
    for flags in ([], ["--force"], ["--dry-run"]):
        said = refused(work, capsys, fit(*flags))
        assert re.search(r"work/out: holds files that are not a jaxrender result .* choose", said)


def test_a_folder_that_another_run_filled(work, capsys):
    marker = {"made_by": "jaxrender", "version": "0", "fingerprint": "another"}
    (work / "out").mkdir()
    write_json(work / "out" / "run.json", marker)
    for flags in ([], ["--dry-run"]):
        said = refused(work, capsys, fit(*flags))
        assert re.search(r"out: holds the result of another run .* or give --force", said)


def test_a_file_in_the_way(work, capsys):
    (work / "out").write_text("mine")
    assert "out: a file is in the way; choose" in refused(work, capsys, fit())


def test_a_finished_result_that_was_damaged_is_named(work, capsys):
    """What is reused, or rendered again, must still be there."""
    for text in (None, "{"):
        (work / "out").mkdir()
        (work / "out" / "config.yaml").write_text((work / "cap/config.yaml").read_text())
        if text is not None:
            (work / "out" / "result.json").write_text(text)
        said = refused(work, capsys, ["render", "out", "--out", "again"])
        wanted = "holds no finished result (no result.json); run fit" if text is None else "cannot"
        assert wanted in said
        shutil.rmtree(work / "out")
