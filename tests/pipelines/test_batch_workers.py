"""Batches on dask: workers of this machine, and those of a scheduler.

- Spawned processes have the caller's precision; the run of a killed one is done again.
- Numbers of workers that cannot be, and a scheduler that is not there, are refused.
"""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
import xarray
from batch_runs import debris, opened, working_directory

from jaxrender.errors import InputError
from jaxrender.pipelines.batch import cluster, run_batch
from jaxrender.pipelines.batch import workers as workers_module
from jaxrender.pipelines.batch.plan import State, plan_of
from jaxrender.pipelines.config.sweep import load_sweep

# Small enough to compile and solve in a second or two.
TINY = (
    "brdf: {model: lambertian}, samples.count: 60, "
    "solve: {starts: 1, refine: 'off', variants: false}"
)


@pytest.fixture
def place(tmp_path, monkeypatch):
    return working_directory(tmp_path, monkeypatch)


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
