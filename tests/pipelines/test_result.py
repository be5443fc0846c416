"""What every task says of its result.

- The head has the keys of the contract in one order; what a task adds comes after it.
- It is strict JSON: null stands for what JSON has no number for.
"""

import json
from types import SimpleNamespace
from unittest import mock

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Outcome
from jaxrender.inverse.photographs import Photograph
from jaxrender.pipelines.result import Result, read_result, write_json

HEAD = ("task", "outcome", "meaning", "reasons", "brdf", "interval90", "standard_error")
HEAD += ("identifiable", "residual", "noise", "lighting", "pixels")


def a_photograph(removed):
    selection = SimpleNamespace(usable=np.array([True, False, True]), removed=removed)
    told = {"saturation": np.array([0.9, np.inf, np.inf]), "rounding": 0.001}
    return mock.Mock(spec=Photograph, selection=selection, **told)


FOUND = Result(
    task="brdf",
    outcome=Outcome.AT_BOUND,
    reasons=("mu is at 3",),
    brdf={"model": "phong", "kd": [0.1, np.float64("nan")]},
    interval90={"kd": [(0.0, np.inf)]},
    standard_error={"kd": [0.1]},
    identifiable={"kd": np.bool_(True)},
    relative_rms=0.25,
    samples=7,
    noise=NoiseModel(0.01, 0.5),
    lighting={"gauge": "given"},
    photographs=[a_photograph({"dark": 2}), a_photograph({"dark": np.int64(1), "edge": 3})],
    own={"scale": 2.5},
)


def test_the_head_and_what_a_task_adds(tmp_path):
    document = FOUND.document({"seed": 3}, {"total": 1.5})
    assert list(document) == [*HEAD, "scale", "provenance", "seconds"]
    write_json(tmp_path / "result.json", document)
    found = read_result(tmp_path)
    assert (found["outcome"], found["meaning"]) == ("at_bound", Outcome.AT_BOUND.sentence)
    assert found["residual"] == {"relative_rms": 0.25, "samples": 7}
    assert found["noise"] == {"relative": 0.01, "floor": 0.5, "rounding": 0.001}
    removed = {"dark": 3, "edge": 3}
    counted = {"photographs": 2, "usable": 4, "removed": removed}
    assert found["pixels"] == {**counted, "saturation": [0.9, 0.9]}
    assert (found["provenance"], found["seconds"]) == ({"seed": 3}, {"total": 1.5})


def test_null_stands_for_what_json_has_no_number_for():
    document = FOUND.document({}, {})
    json.dumps(document, allow_nan=False)
    assert document["brdf"]["kd"] == [0.1, None]
    assert document["interval90"]["kd"] == [[0.0, None]]
    assert document["identifiable"] == {"kd": True}
