"""Batches: every run once, whatever happens to some of them.

- Names follow config, data and version; a finished run is not done again, a failed one is.
- A failure keeps its message and the others go on; a foreign folder is left alone.
- An interrupt leaves finished runs, an index, no debris, and the same command goes on.
- One batch at a time in a folder, that of a dead process does not count; exit codes 0, 1 with
  --strict, 2, 130.
"""

import json
import os
import subprocess
import sys
from contextlib import nullcontext

import numpy as np
import pytest
from batch_runs import SWEEP, Fits, debris, found, opened, raising, working_directory
from small_captures import jaxrender

from jaxrender.errors import InputError
from jaxrender.pipelines.batch import run_batch
from jaxrender.pipelines.batch.plan import plan_of
from jaxrender.pipelines.batch.workers import InProcess
from jaxrender.pipelines.config.sweep import load_sweep
from jaxrender.pipelines.result import write_json


@pytest.fixture
def place(tmp_path, monkeypatch):
    return working_directory(tmp_path, monkeypatch)


@pytest.fixture
def fits(monkeypatch):
    return Fits(monkeypatch)


# ---------------------------------------------------------------- each run once


def test_every_run_is_done_once_and_indexed(place, fits, capsys):
    assert jaxrender("batch", "sweep.yaml", "--strict") == 0
    out, err = capsys.readouterr()
    assert out == f"4 runs: 4 converged\nindex: {place / 'out' / 'index.nc'}\n"
    assert "4 of 4 done, 0 running, 0 failed: " in err
    every = [(mu, seed) for mu in (1.4, 1.6) for seed in (0, 1)]
    assert fits.done == every
    table = opened()
    assert set(table.coords) == {"run", "brdf.mu", "samples.seed", "bound"}
    assert list(zip(table["brdf.mu"].values, table["samples.seed"].values)) == every
    for run in table.run.values:
        assert (place / "out" / run / "result.json").is_file()
    assert debris() == []
    assert jaxrender("batch", "sweep.yaml") == 0
    assert fits.done == every
    assert "4 of 4 runs finished before" in capsys.readouterr().err


def test_a_sweep_that_grows_does_what_is_new(place, fits):
    assert jaxrender("batch", "sweep.yaml") == 0
    (place / "sweep.yaml").write_text(SWEEP.replace("[0, 1]", "[1, 2]"))
    assert jaxrender("batch", "sweep.yaml") == 0
    assert fits.done[4:] == [(1.4, 2), (1.6, 2)]
    assert opened()["samples.seed"].values.tolist() == [1, 2, 1, 2]


def test_names_follow_config_data_and_version(place, monkeypatch):
    def names():
        return [run.name for run in plan_of(load_sweep("sweep.yaml"))]

    first = names()
    assert len({*first}) == 4
    assert names() == first
    image = place / "capture/images/1.exr"
    image.write_bytes(image.read_bytes() + b" ")
    changed = names()
    assert not {*first} & {*changed}
    monkeypatch.setattr("jaxrender.pipelines.output.__version__", "0.0.0")
    assert not {*changed} & {*names()}


def test_a_damaged_result_is_made_again(place, fits):
    assert jaxrender("batch", "sweep.yaml") == 0
    run = opened().run.values[1]
    (place / "out" / run / "result.json").write_text("{")
    assert jaxrender("batch", "sweep.yaml") == 0
    assert fits.done[4:] == [(1.4, 1)]
    assert opened().outcome.values.tolist() == ["converged"] * 4


def test_the_index_follows_the_runs_as_they_end(place, fits, monkeypatch):
    monkeypatch.setattr("jaxrender.pipelines.batch.batch._SECONDS_BETWEEN_INDICES", 0.0)
    seen = []

    def look(mu, seed):
        if fits.done[1:]:
            seen.append(opened().outcome.values.tolist().count("converged"))

    fits.trouble = look
    assert jaxrender("batch", "sweep.yaml") == 0
    assert seen == [1, 2, 3]


# ---------------------------------------------------------------- failures


@pytest.mark.parametrize(
    ("error", "kind"), [(InputError("a.exr: too dark"), "InputError"), (KeyError("x"), "KeyError")]
)
def test_a_failure_keeps_its_error_and_the_others_go_on(place, fits, capsys, error, kind):
    fits.trouble = raising(error, 1.4, 1)
    assert jaxrender("batch", "sweep.yaml") == 0
    out = capsys.readouterr().out
    assert out.startswith("4 runs: 3 converged, 1 failed\n")
    assert f"(brdf.mu=1.4 samples.seed=1): {error}" in out
    table = opened()
    assert table.outcome.values.tolist() == ["converged", "failed", "converged", "converged"]
    assert table.error.values.tolist() == ["", str(error), "", ""]
    assert np.isnan(table.kd.values[1]).all()
    assert not np.isnan(table.kd.values[[0, 2, 3]]).any()
    folder = place / "out" / table.run.values[1]
    kept = json.loads((folder / "error.json").read_text())
    assert (kept["kind"], kept["message"]) == (kind, str(error))
    assert kept["parameters"] == {"brdf.mu": 1.4, "samples.seed": 1}
    assert ("Traceback" in kept["traceback"]) == (kind != "InputError")
    assert debris() == []
    # The same again, then mended.
    assert jaxrender("batch", "sweep.yaml", "--strict") == 1
    fits.trouble = lambda mu, seed: None
    assert jaxrender("batch", "sweep.yaml", "--strict") == 0
    assert fits.done[4:] == [(1.4, 1)] * 2
    assert sorted(path.name for path in folder.iterdir()) == ["half", "result.json", "run.json"]


def test_strict_means_converged(place, fits, monkeypatch):
    content = {**found(1.5, 0), "outcome": "at_bound"}
    monkeypatch.setattr("batch_runs.found", lambda mu, seed: content)
    assert jaxrender("batch", "sweep.yaml") == 0
    assert jaxrender("batch", "sweep.yaml", "--strict") == 1


def test_someone_elses_files_stay(place, fits):
    run = plan_of(load_sweep("sweep.yaml"))[2]
    (place / "out").mkdir()
    write_json(place / "out/batch.json", {"made_by": "jaxrender"})
    run.folder.mkdir()
    (run.folder / "thesis.tex").write_text("years of work")
    assert jaxrender("batch", "sweep.yaml") == 0
    assert opened().outcome.values.tolist() == ["converged"] * 2 + ["failed", "converged"]
    assert "holds files that are not a jaxrender result" in opened().error.values[2]
    assert [path.name for path in run.folder.iterdir()] == ["thesis.tex"]


def test_an_interrupt_leaves_what_is_finished(place, fits, capsys):
    fits.trouble = raising(KeyboardInterrupt(), 1.6, 0)
    assert jaxrender("batch", "sweep.yaml") == 130
    assert "stopped with 2 runs to do; the same command goes on" in capsys.readouterr().err
    assert opened().outcome.values.tolist() == ["converged"] * 2 + ["pending"] * 2
    assert debris() == []
    fits.trouble = lambda mu, seed: None
    assert jaxrender("batch", "sweep.yaml") == 0
    assert fits.done[3:] == [(1.6, 0), (1.6, 1)]


def test_a_run_that_ends_as_the_batch_stops_is_indexed(place, fits):
    class Stopped(InProcess):
        def run(self, jobs):
            next(super().run(jobs))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(load_sweep("sweep.yaml"), lambda jobs: nullcontext(Stopped()))
    assert opened().outcome.values.tolist() == ["converged"] + ["pending"] * 3


def test_what_a_killed_worker_left_is_swept_away(place, fits):
    run = plan_of(load_sweep("sweep.yaml"))[0]
    (place / "out").mkdir()
    write_json(place / "out/batch.json", {"made_by": "jaxrender"})
    (place / "out" / f".{run.name}.unfinished-abc").mkdir()
    (place / "out/.mine.unfinished-abc").mkdir()
    (place / "out/.index.nc.unfinished-abc").write_text("half")
    assert jaxrender("batch", "sweep.yaml") == 0
    assert debris() == [".mine.unfinished-abc"]


# ---------------------------------------------------------------- bad input, dry run


def refused(capsys, *arguments):
    assert jaxrender("batch", "sweep.yaml", *arguments) == 2
    return capsys.readouterr().err


def test_a_folder_that_is_not_ours(place, fits, capsys):
    (place / "out").mkdir()
    (place / "out/index.csv").write_text("mine")
    for flags in ([], ["--dry-run"]):
        assert "holds files that are not a batch" in refused(capsys, *flags)
    assert os.listdir(place / "out") == ["index.csv"]
    (place / "out/index.csv").unlink()
    (place / "out").rmdir()
    (place / "out").write_text("mine")
    assert "out: a file is in the way" in refused(capsys)
    assert fits.done == []


def test_one_batch_at_a_time(place, fits, capsys):
    assert jaxrender("batch", "sweep.yaml") == 0
    hold = "import filelock; held = filelock.FileLock('out/batch.lock').acquire(); print(); input()"
    command, pipe = [sys.executable, "-c", hold], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe) as other:
        assert other.stdout is not None
        other.stdout.readline()
        assert "out: another batch is at work there" in refused(capsys)
        other.kill()
        other.wait()
        assert jaxrender("batch", "sweep.yaml") == 0


def test_a_folder_that_cannot_be_locked(place, fits, capsys):
    (place / "out/batch.lock").mkdir(parents=True)
    write_json(place / "out/batch.json", {"made_by": "jaxrender"})
    assert "out: cannot be written to or locked: Is a directory; choose" in refused(capsys)
    assert fits.done == []


def test_data_that_cannot_be_read_is_said_before_anything_runs(place, fits, capsys):
    (place / "sweep.yaml").write_text(
        "base: capture/config.yaml\nlist: [{}, {capture.transforms: no.json}]\noutput: out\n"
    )
    assert f"{place}/no.json" in refused(capsys)
    assert not (place / "out").exists()


def test_a_dry_run_lists_the_runs_and_writes_nothing(place, fits, capsys):
    fits.trouble = raising(InputError("no"), 1.4, 1)
    (place / "sweep.yaml").write_text(SWEEP.replace("[1.4, 1.6]", "[1.4]"))
    assert jaxrender("batch", "sweep.yaml", "--dry-run") == 0
    assert not (place / "out").exists()
    assert jaxrender("batch", "sweep.yaml") == 0
    (place / "sweep.yaml").write_text(SWEEP)
    capsys.readouterr()
    assert jaxrender("batch", "sweep.yaml", "--dry-run") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line[18:] for line in lines[:-1]] == [
        "finished             brdf.mu=1.4 samples.seed=0",
        "failed, to do again  brdf.mu=1.4 samples.seed=1",
        "to do                brdf.mu=1.6 samples.seed=0",
        "to do                brdf.mu=1.6 samples.seed=1",
    ]
    assert lines[-1] == f"dry run: 4 runs, 1 finished, 3 to do, into {place / 'out'}"
    assert len(fits.done) == 2
