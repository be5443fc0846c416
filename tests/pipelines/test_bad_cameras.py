"""Bad cameras, and bad shapes that they look at.

- Files, poses and vertices that cannot be are named, with the frame or the vertex.
- What can be lived with is a warning: a camera that sees nothing.
"""

import re

import numpy as np
import pytest
from small_captures import edit_json, jaxrender
from spoilt_captures import (
    assert_refused,
    contents,
    fit,
    frame,
    nothing,
    removed,
    working_directory,
    written,
)


def pose(number, factors):
    """Multiply the columns of a pose."""

    def change(content):
        matrix = np.array(content["frames"][number]["transform_matrix"]) * factors
        content["frames"][number]["transform_matrix"] = matrix.tolist()

    return lambda folder: edit_json(folder / "transforms.json", change)


MESH = "capture.geometry={mesh: cap/m.obj}"
TRIANGLE = "v 0 0 0\nv {} 0 0\nv 0 1 0\n"
CASES = {
    # Cameras.
    "missing transforms": (
        removed("transforms.json"),
        [],
        r"cap/transforms\.json: no such file; mend the path$",
    ),
    "a folder for transforms": (
        nothing,
        ["capture.transforms=cap"],
        r"cap: a folder; give the path of the file inside it$",
    ),
    "broken transforms": (
        written("transforms.json", '{"frames": [1,'),
        [],
        r"transforms\.json:1:15: Expecting value; mend the JSON there$",
    ),
    "no frames": (
        written("transforms.json", "{}"),
        [],
        r"transforms\.json: `frames` must be a list with at least one frame$",
    ),
    "scaled pose": (
        pose(1, [2, 2, 2, 1]),
        [],
        r"frame 1 \(images/1\.exr\): transform_matrix's 3 x 3 part deviates from a rotation by 3 ",
    ),
    "reflected pose": (
        pose(1, [-1, 1, 1, 1]),
        [],
        r"frame 1 \(images/1\.exr\): transform_matrix's 3 x 3 part is a reflection",
    ),
    "no camera sees it": (
        nothing,
        ["capture.geometry={sphere: {center: [0, 0, 50]}}"],
        r"transforms\.json: no camera sees the object: check the poses .* capture\.geometry$",
    ),
    "path outside": (
        frame(0, file_path="../other.exr"),
        [],
        r"frame 0 \(\.\./other\.exr\): `file_path` leads outside .*cap; move the file",
    ),
    # Shape.
    "mesh vertex": (
        written("m.obj", TRIANGLE.format("nan") + "f 1 2 3\n"),
        [MESH],
        r"m\.obj: vertex 1 \(counted from 0\) is \[nan  0\.  0\.\]; 1 of 3 are not finite: mend",
    ),
    "mesh without faces": (
        written("m.obj", TRIANGLE.format("1")),
        [MESH],
        r"m\.obj: the file has no faces; export triangles$",
    ),
    "missing mesh": (nothing, [MESH], r"cap/m\.obj: no such mesh file; mend the path$"),
}


@pytest.fixture
def work(tmp_path, monkeypatch):
    return working_directory(tmp_path, monkeypatch)


@pytest.mark.parametrize("name", CASES)
def test_refused(work, capsys, name):
    assert_refused(work, capsys, CASES[name])


@pytest.mark.parametrize("name", ["missing mesh"])
def test_a_dry_run_refuses_the_same(work, capsys, name):
    assert_refused(work, capsys, CASES[name], "--dry-run")


def test_a_camera_that_sees_nothing_is_a_warning(work, capsys):
    pose(1, [[-1, 1, -1, 1]] * 3 + [[1, 1, 1, 1]])(work / "cap")
    before = contents(work)
    assert jaxrender(*fit("--dry-run")) == 0
    out, err = capsys.readouterr()
    assert re.search(r"images/1\.exr: warning: its camera does not see the object; skipped\n", err)
    assert "samples of 2 photographs" in out
    assert contents(work) == before
