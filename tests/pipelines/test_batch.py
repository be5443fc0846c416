"""Batches: every run once, whatever happens to some of them, and an index that xarray reads.

- Names follow config, data and version; a finished run is not done again, a failed one is.
- A failure keeps its message and the others go on; a foreign folder is left alone.
- An interrupt leaves finished runs, an index, no debris, and the same command goes on.
- Photographs that runs share are rendered once, also by two processes at a time.
- The index has parameters as coordinates, values, intervals, outcomes; it appears whole or not.
- One batch at a time in a folder, that of a dead process does not count; exit codes 0, 1 with
  --strict, 2, 130.
- On dask: spawned processes with the caller's precision; the run of a killed one is done again.
"""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import xarray
from small_captures import Ball, jaxrender, write_ball

from jaxrender.errors import InputError
from jaxrender.pipelines.batch import cluster, in_process, run_batch
from jaxrender.pipelines.batch import index as index_module
from jaxrender.pipelines.batch import task as task_module
from jaxrender.pipelines.batch import workers as workers_module
from jaxrender.pipelines.batch.index import Row, write_index
from jaxrender.pipelines.batch.plan import State, plan_of
from jaxrender.pipelines.batch.workers import InProcess
from jaxrender.pipelines.config.sweep import load_sweep
from jaxrender.pipelines.output import result_folder
from jaxrender.pipelines.result import write_json

SWEEP = (
    "base: capture/config.yaml\ngrid: {brdf.mu: [1.4, 1.6], samples.seed: [0, 1]}\noutput: out\n"
)
# Small enough to compile and solve in a second or two.
TINY = (
    "brdf: {model: lambertian}, samples.count: 60, "
    "solve: {starts: 1, refine: 'off', variants: false}"
)
RECIPE = """\
geometry: {sphere: {}}
brdf: {model: lambertian, kd: 0.1}
lighting:
  directional:
    - {direction: [0, 0, 1], irradiance: 1}
    - {direction: [1, 0, 1], irradiance: 1}
views: {count: 1, width: 8, height: 8}
"""


@pytest.fixture(scope="session")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("batch")
    write_ball(folder / "capture", Ball(views=2, size=24))
    return folder


@pytest.fixture
def place(ball, tmp_path, monkeypatch):
    """A working directory with a capture and a sweep; batches run in this process."""
    (tmp_path / "capture").symlink_to(ball / "capture")
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("jaxrender.pipelines.batch.cluster", lambda *_, **__: in_process)
    return tmp_path


class Fits:
    """A stand-in for the fit: writes a small result, after the trouble that a test asks for."""

    def __init__(self):
        self.done: list[tuple[float, int]] = []
        self.trouble = lambda mu, seed: None

    def __call__(self, config, force):
        mu, seed = config.brdf.mu.fixed or 1.5, config.samples.seed
        self.done.append((mu, seed))
        with result_folder(config.output, f"{mu} {seed}", force) as into:
            (into / "half").write_text("written")
            self.trouble(mu, seed)
            write_json(into / "result.json", found(mu, seed))


def found(mu, seed):
    return {
        "outcome": "converged",
        "brdf": {"model": "microfacet", "kd": [0.1, 0.2, 0.3], "ks": 0.1 * seed, "mu": mu},
        "interval90": {
            "kd": [[0.0, 0.2], [0.1, 0.3], [0.2, 0.4]],
            "ks": [0.0, 1.0],
            "mu": [mu - 1, None],
        },
        "identifiable": {"kd": True, "mu": False},
        "residual": {"relative_rms": 0.01},
        "seconds": {"load": 0.1, "total": 2.5},
    }


@pytest.fixture
def fits(monkeypatch):
    fits = Fits()
    monkeypatch.setattr(task_module, "fit", fits)
    return fits


def opened(folder="out"):
    with xarray.open_dataset(Path(folder) / "index.nc", engine="h5netcdf") as file:
        return file.load()


def raising(error, mu, seed):
    def trouble(*run):
        if run == (mu, seed):
            raise error

    return trouble


def debris(folder="out"):
    """What a batch should not leave."""
    return [path.name for path in Path(folder).iterdir() if path.name.startswith(".")]


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

    source = (place / "capture").resolve()
    (place / "capture").unlink()
    shutil.copytree(source, place / "capture")
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
    monkeypatch.setattr("test_batch.found", lambda mu, seed: content)
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


def test_workers_and_scheduler_are_checked():
    with pytest.raises(InputError, match="--workers: found 0"):
        cluster(workers=0)
    with pytest.raises(InputError, match="a scheduler has its own workers"):
        cluster(workers=2, scheduler="tcp://a:1")


def test_a_scheduler_that_is_not_there(place, monkeypatch):
    monkeypatch.setattr(workers_module, "_SECONDS_TO_CONNECT", 0.3)
    for address in ("tcp://127.0.0.1:9", "nonsense"):
        with pytest.raises(InputError, match=f"--scheduler {address}: cannot be reached"):
            run_batch(load_sweep("sweep.yaml"), cluster(scheduler=address))
    assert opened().outcome.values.tolist() == ["pending"] * 4


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


# ---------------------------------------------------------------- photographs of recipes


@pytest.fixture
def recipes(place, monkeypatch):
    """A sweep over two recipes and two seeds, with the synthesis counted."""
    made = []
    synthesise = task_module.synthesise

    def counted(recipe, path, *arguments, **named):
        made.append(path.name)
        return synthesise(recipe, path, *arguments, **named)

    monkeypatch.setattr(task_module, "synthesise", counted)
    (place / "a.yaml").write_text(RECIPE)
    (place / "b.yaml").write_text(RECIPE.replace("kd: 0.1", "kd: 0.2"))
    (place / "base.yaml").write_text("task: brdf\ncapture: {recipe: a.yaml}\n")
    grid = "grid: {samples.seed: [0, 1], capture.recipe: [a.yaml, b.yaml]}"
    (place / "sweep.yaml").write_text(f"base: base.yaml\n{grid}\noutput: out\n")
    return made


def test_photographs_are_rendered_once(place, fits, recipes, capsys):
    assert jaxrender("batch", "sweep.yaml", "--dry-run") == 0
    assert "the photographs of 2 recipes would be rendered" in capsys.readouterr().out
    assert recipes == []
    assert jaxrender("batch", "sweep.yaml") == 0
    assert sorted(recipes) == ["a.yaml", "b.yaml"]
    assert len(fits.done) == 4
    # A recipe is what it says, not where or how it is written; its name may follow its words.
    names = opened().run.values.tolist()
    (place / "a.yaml").write_text(f"# the same\n{RECIPE}")
    assert [run.name for run in plan_of(load_sweep("sweep.yaml"))] == names
    (place / "a.yaml").write_text(RECIPE.replace("kd: 0.1", "kd: 0.3"))
    assert jaxrender("batch", "sweep.yaml") == 0
    assert len(fits.done) == 6
    assert len(recipes) == 3


def test_photographs_that_fail_are_the_error_of_their_runs(place, fits, recipes):
    (place / "a.yaml").write_text(RECIPE.replace("irradiance: 1", "irradiance: 0"))
    assert jaxrender("batch", "sweep.yaml") == 0
    assert recipes == ["a.yaml", "b.yaml"]
    assert opened().outcome.values.tolist() == ["failed", "converged"] * 2
    assert "the light is zero" in opened().error.values[2]


def test_photographs_are_rendered_once_by_two_at_a_time(place, recipes):
    def render(_):
        return task_module.render_photographs(place / "a.yaml", print)

    with ThreadPoolExecutor(2) as both:
        assert list(both.map(render, range(2))) == [None, None]
    assert recipes == ["a.yaml"]


# ---------------------------------------------------------------- the index


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


def test_the_index_follows_the_runs_as_they_end(place, fits, monkeypatch):
    monkeypatch.setattr("jaxrender.pipelines.batch.batch._SECONDS_BETWEEN_INDICES", 0.0)
    seen = []

    def look(mu, seed):
        if fits.done[1:]:
            seen.append(opened().outcome.values.tolist().count("converged"))

    fits.trouble = look
    assert jaxrender("batch", "sweep.yaml") == 0
    assert seen == [1, 2, 3]


# ---------------------------------------------------------------- dask


def die_once() -> None:
    """Set up a worker as the command line does; the first of them is killed."""
    from jaxrender.cli import process

    process.set_up_jax()
    try:
        Path(os.environ["BATCH_TEST_DEAD"]).touch(exist_ok=False)
    except FileExistsError:
        return
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
def test_spawned_workers_fit_and_a_killed_ones_run_is_done_again(place, monkeypatch):
    monkeypatch.setenv("BATCH_TEST_DEAD", str(place / "dead"))
    # The second leaves no samples.
    entries = [f"{{{TINY}, samples.min_cosine: {cosine}}}" for cosine in (0.15, 0.99999)]
    text = "base: capture/config.yaml\nlist:\n" + "".join(f"  - {one}\n" for one in entries)
    (place / "sweep.yaml").write_text(f"{text}output: out\n")
    report = run_batch(load_sweep("sweep.yaml"), cluster(workers=1, set_up=die_once))
    assert report.outcomes == {"converged": 1, "failed": 1}
    assert not report.all_converged
    assert (place / "dead").exists()
    table = opened()
    assert "InputError" in (place / "out" / table.run.values[1] / "error.json").read_text()
    # The truth is (.2, .15, .1) and a specular lobe, which a diffuse material takes as its own.
    assert np.all((table.kd.values[0] > 0.08) & (table.kd.values[0] < 0.4))
    # Float64, which the command line's set-up turns on.
    arrays = place / "out" / table.run.values[0] / "result.nc"
    with xarray.open_dataset(arrays, group="frequency", engine="h5netcdf") as file:
        assert file["predicted"].dtype == np.float64
    assert debris() == []
    assert plan_of(load_sweep("sweep.yaml"))[0].look()[0] is State.FINISHED
