"""A sweep from its file to its folder: plan, do the missing runs, keep the index.

``OUT/`` holds a folder for each run, named by its hash.  Beside them lie ``index.nc``,
``index.csv``, the marker ``batch.json`` and a lock.  The folder of a run appears when the run is
done.  After any interrupt the same command continues the batch.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from jaxrender.errors import InputError
from jaxrender.pipelines.batch.folder import check_ours, our_folder, sweep_away
from jaxrender.pipelines.batch.index import INDEX, Row, write_index
from jaxrender.pipelines.batch.plan import Look, Planned, State, plan_of
from jaxrender.pipelines.batch.task import Failure
from jaxrender.pipelines.batch.workers import Opener
from jaxrender.pipelines.caches import capture_folder, is_whole
from jaxrender.pipelines.config import load_recipe
from jaxrender.pipelines.config.sweep import Sweep, shown
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import RESULT

# The index is written anew while runs end, at most so often: a big one takes a while.
_SECONDS_BETWEEN_INDICES = 10.0

# Failed runs that the summary names; the index has them all.
_NAMED = 5


class BatchReport(NamedTuple):
    """The end of a batch: the number of runs by outcome, its folder, and a summary in words."""

    outcomes: dict[str, int]
    folder: Path
    summary: str

    @property
    def all_converged(self) -> bool:
        """Whether every run found its answer."""
        return set(self.outcomes) <= {"converged"}


def list_runs(sweep: Sweep) -> str:
    """List the runs of a batch with their states; changes nothing."""
    plan = plan_of(sweep)
    check_ours(sweep.output)
    states = [run.look().state for run in plan]
    again = {State.PENDING: "to do", State.FAILED: "failed, to do again"}
    lines = [
        f"{run.name}  {again.get(state, state.value):<19}  {shown(run.parameters)}"
        for run, state in zip(plan, states)
    ]
    todo = [run for run, state in zip(plan, states) if state is not State.FINISHED]
    counts = f"{_runs(len(plan))}, {len(plan) - len(todo)} finished, {len(todo)} to do"
    missing = sum(1 for recipe in _recipes(todo) if not _is_rendered(recipe))
    if missing:
        counts += f"; the photographs of {missing} recipe{'s' * (missing > 1)} would be rendered"
    return "\n".join([*lines, f"dry run: {counts}, into {sweep.output}"])


def run_batch(sweep: Sweep, opener: Opener, progress: Progress | None = None) -> BatchReport:
    """Do the unfinished runs of a sweep, and index all runs.

    A failed run keeps its error, and the others continue.  Raises InputError for unreadable input,
    and for an output folder that is not ours or in use.
    """
    progress = progress or SilentProgress()
    plan = plan_of(sweep)
    with our_folder(sweep):
        sweep_away(plan)
        ledger = _Ledger(sweep, plan)
        todo = [run for run in plan if ledger.state(run) is not State.FINISHED]
        if len(todo) < len(plan):
            progress.note(f"{len(plan) - len(todo)} of {_runs(len(plan))} finished before")
        try:
            if todo:
                with progress.stage(f"batch of {_runs(len(todo))}"):
                    _do(todo, opener, ledger, progress)
        except BaseException as error:
            # Some may have ended while the workers stopped.
            for run in todo:
                if (run.folder / RESULT).is_file():
                    ledger.look(run)
            left = ledger.outcomes()[State.PENDING.value]
            kept = f"stopped with {_runs(left)} to do; the same command goes on from here"
            # An interrupt brings it to whoever ends the program.
            if isinstance(error, KeyboardInterrupt):
                error.add_note(kept)
            else:
                progress.note(kept)
            raise
        finally:
            ledger.write()
            sweep_away(plan)
    return BatchReport(dict(ledger.outcomes()), sweep.output, ledger.summary())


class _Ledger:
    """The state of each run, on disk and in memory, and the index made from it."""

    def __init__(self, sweep: Sweep, plan: tuple[Planned, ...]):
        self._keys, self._folder, self._plan = sweep.keys, sweep.output, plan
        self._found: dict[str, Look] = {}
        for run in plan:
            self.look(run)
        self._written = time.monotonic()

    def state(self, run: Planned) -> State:
        """Return the state of a run."""
        return self._found[run.name].state

    def look(self, run: Planned, failure: Failure | None = None) -> str:
        """Look into a run's folder again, and return its outcome."""
        found = run.look()
        if failure is not None and found.state is not State.FAILED:
            # The folder could not store the error; the index does.
            found = Look(State.FAILED, failure._asdict())
        self._found[run.name] = found
        return self._outcome(run)

    def outcomes(self) -> Counter[str]:
        """Count the runs by outcome."""
        return Counter(self._outcome(run) for run in self._plan)

    def write_now_and_then(self) -> None:
        """Write the index, unless it was written a moment ago."""
        if time.monotonic() - self._written < _SECONDS_BETWEEN_INDICES:
            return
        # A disk that is full for a while does not stop the runs; at the end it is an error.
        with suppress(OSError):
            self.write()

    def write(self) -> None:
        """Write the index."""
        write_index(self._folder, self._keys, [self._row(run) for run in self._plan])
        self._written = time.monotonic()

    def summary(self) -> str:
        """Sum up the batch, with the first of the failed runs."""
        counts = ", ".join(f"{count} {name}" for name, count in self.outcomes().most_common())
        failed = [run for run in self._plan if self.state(run) is State.FAILED]
        lines = [f"{_runs(len(self._plan))}: {counts}"]
        lines += [
            f"failed {run.name} ({shown(run.parameters)}): {self._error(run)}"
            for run in failed[:_NAMED]
        ]
        if len(failed) > _NAMED:
            lines.append(f"and {len(failed) - _NAMED} more that failed")
        return "\n".join([*lines, f"index: {self._folder / INDEX}"])

    def _outcome(self, run: Planned) -> str:
        state, found = self._found[run.name]
        return str(found.get("outcome", "unknown")) if state is State.FINISHED else state.value

    def _error(self, run: Planned) -> str:
        state, found = self._found[run.name]
        return str(found.get("message", "unknown")) if state is State.FAILED else ""

    def _row(self, run: Planned) -> Row:
        state, found = self._found[run.name]
        result = found if state is State.FINISHED else {}
        return Row(run.name, run.parameters, self._outcome(run), self._error(run), result)


def _do(todo: list[Planned], opener: Opener, ledger: _Ledger, progress: Progress) -> None:
    """Give the runs to the workers, and report each as it ends."""
    by_name = {run.name: run for run in todo}
    failed = 0
    with opener(len(todo)) as workers:
        progress.note(f"{_runs(len(todo))} for {workers.count} at a time")
        ended = workers.run([run.job() for run in todo])
        for done, (job, failure) in enumerate(ended, start=1):
            run = by_name[job.name]
            if failure is not None:
                failed += 1
                _keep(run, failure)
            outcome = ledger.look(run, failure)
            running = min(workers.count, len(todo) - done)
            progress.note(
                f"{done} of {len(todo)} done, {running} running, {failed} failed: "
                f"{run.name} {outcome} ({shown(run.parameters)})"
            )
            progress.advance(done / len(todo))
            ledger.write_now_and_then()


def _keep(run: Planned, failure: Failure) -> None:
    """Keep an error on disk if possible; the index has it in any case."""
    with suppress(InputError, OSError):
        run.keep_error(failure)


def _recipes(runs: Iterable[Planned]) -> list[Path]:
    return list(dict.fromkeys(path for run in runs for path in run.config.recipes))


def _is_rendered(path: Path) -> bool:
    recipe = load_recipe(path)
    return is_whole(recipe, capture_folder(recipe, path))


def _runs(count: int) -> str:
    return "1 run" if count == 1 else f"{count} runs"
