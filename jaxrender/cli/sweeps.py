"""The commands about sweeps and configs: ``batch`` and ``schema``."""

from __future__ import annotations

from pathlib import Path

from jaxrender.cli import process
from jaxrender.cli.app import DONE, NOT_CONVERGED, app, examples
from jaxrender.cli.reporting import AS_USUAL, Reporting
from jaxrender.errors import InputError


@app.command(
    help_epilogue=examples(
        "batch configs/sweep_teflon.yaml --dry-run", "batch configs/sweep_teflon.yaml --workers 4"
    )
)
def batch(
    sweep: Path,
    /,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    dry_run: bool = False,
    strict: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Do all fits of a sweep, several at a time.

    Each run has a folder, named by a hash of its config, its data and the version.  Run the same
    command again to continue after an interrupt: it skips finished runs and repeats failed ones.  A
    failed run leaves error.json.  The table of all runs is index.nc for xarray and index.csv.

    Parameters
    ----------
    sweep
        A base config, and the values that replace its own (YAML).
    workers
        Number of processes on this machine; by default as many as it has room for.
    scheduler
        Address of a dask scheduler, such as tcp://host:8786.  Its workers do the fits, and must
        share the file system.
    dry_run
        Check everything and list the runs, but do nothing.
    strict
        Exit with 1 unless every run's outcome is 'converged'.
    """
    from jaxrender.pipelines.config.sweep import load_sweep

    loaded = load_sweep(process.bundled(sweep))
    process.set_up_jax()
    from jaxrender.pipelines import batch as batches

    if dry_run:
        process.say(batches.list_runs(loaded))
        return DONE
    processes = batches.cluster(workers, scheduler, set_up=process.set_up_jax)
    report = batches.run_batch(loaded, processes, progress=reporting.progress())
    process.say(report.summary)
    return DONE if report.all_converged or not strict else NOT_CONVERGED


@app.command(help_epilogue=examples("schema", "schema --recipe"))
def schema(*, recipe: bool = False, sweep: bool = False) -> int:
    """Print the JSON Schema of configs: every key with its meaning, range and tasks.

    Editors that check YAML can read it.

    Parameters
    ----------
    recipe
        Print the schema of recipes.
    sweep
        Print the schema of sweeps.
    """
    import json

    from jaxrender.pipelines.config import RecipeConfig, RunConfig, json_schema
    from jaxrender.pipelines.config.sweep import SweepConfig

    if recipe and sweep:
        raise InputError("--recipe and --sweep are two schemas; ask for one of them")
    root = RecipeConfig if recipe else SweepConfig if sweep else RunConfig
    process.say(json.dumps(json_schema(root), indent=2))
    return DONE
