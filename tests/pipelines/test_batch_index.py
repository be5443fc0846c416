"""The index of a batch, which xarray reads.

- The index has parameters as coordinates, values, intervals, outcomes; it appears whole or not.
"""

import csv

import numpy as np
import pytest
from batch_runs import debris, found, opened

from jaxrender.pipelines.batch import index as index_module
from jaxrender.pipelines.batch.index import Row, write_index


def test_the_index_has_values_intervals_and_text(tmp_path):
    rows = [
        Row(
            "a", {"flag": True, "n": 1, "x": 1, "w": "free", "m": 2}, "converged", "", found(1.4, 0)
        ),
        Row(
            "b",
            {"flag": False, "n": 2, "x": 0.5, "w": {"start": 1}},
            "converged",
            "",
            found(1.6, 1),
        ),
        Row("c", {"flag": True, "n": 3, "x": 2, "w": "é"}, "failed", "no,\n'é'", {}),
    ]
    rows[1].result["brdf"]["ks"] = [0.1, 0.2, 0.3]
    rows[1].result["interval90"]["ks"] = [[0, 1], [0, 2], [0, 3]]
    write_index(tmp_path, ["flag", "n", "x", "w", "m"], rows)
    table = opened(tmp_path)
    assert table.run.values.tolist() == ["a", "b", "c"]
    assert table.flag.dtype == bool
    assert table.n.dtype == np.int64
    assert table.x.values.tolist() == [1, 0.5, 2]
    assert table.w.values.tolist() == ["free", '{"start": 1}', "é"]
    np.testing.assert_array_equal(table.m, [2, np.nan, np.nan])
    assert table.error.values.tolist() == ["", "", "no,\n'é'"]
    assert table.kd.dims == ("run", "channel")
    assert table.kd_interval90.dims == ("run", "channel", "bound")
    np.testing.assert_array_equal(table.ks[:2], [[0, 0, 0], [0.1, 0.2, 0.3]])
    np.testing.assert_array_equal(table.ks_interval90.sel(bound="high")[:2], [[1, 1, 1], [1, 2, 3]])
    assert table.mu_interval90.dims == ("run", "bound")
    np.testing.assert_array_equal(table.mu_interval90[0], [1.4 - 1, np.nan])
    np.testing.assert_array_equal(table.mu_identifiable, [0, 0, np.nan])
    np.testing.assert_array_equal(table.seconds, [2.5, 2.5, np.nan])
    np.testing.assert_array_equal(table.rms, [0.01, 0.01, np.nan])
    assert table.where(table.flag, drop=True).run.values.tolist() == ["a", "c"]
    with (tmp_path / "index.csv").open(newline="", encoding="utf-8") as stream:
        lines = list(csv.DictReader(stream))
    assert [line["kd[1]"] for line in lines] == ["0.2", "0.2", ""]
    assert lines[0]["kd_interval90[2].high"] == "0.4"
    assert lines[2]["error"] == "no,\n'é'"


def test_an_index_of_nothing_yet_is_readable(tmp_path):
    write_index(tmp_path, [], [Row("a", {}, "pending", "", {})])
    assert opened(tmp_path).outcome.values.tolist() == ["pending"]


def test_the_index_is_whole_or_as_it_was(tmp_path, monkeypatch):
    write_index(tmp_path, [], [Row("a", {}, "pending", "", {})])
    before = (tmp_path / "index.csv").read_bytes()

    def half(path, *_):
        path.write_text("half")
        raise OSError("disk full")

    monkeypatch.setattr(index_module, "_write_csv", half)
    with pytest.raises(OSError, match="disk full"):
        write_index(tmp_path, [], [Row("b", {}, "pending", "", {})])
    assert (tmp_path / "index.csv").read_bytes() == before
    assert debris(tmp_path) == []
