"""Ways to spoil cameras, and the shapes that they look at, and what is said of each."""

import numpy as np
from small_captures import edit_json
from spoilt_captures import (
    frame,
    nothing,
    removed,
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
