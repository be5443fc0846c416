"""The workers of a batch: processes of this machine or a cluster, by dask, or this process itself.

Every kind of ``Workers`` gets recipes to render and jobs to do.  It yields each job with its
outcome as it ends, in any order.  Each recipe is rendered once, before its jobs.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any, Protocol

from jaxrender.errors import InputError
from jaxrender.pipelines.batch.task import Failure, Job, SetUp, render_photographs, run_job

Ended = tuple[Job, Failure | None]

# Memory that a fit and its compiled programs need, at most that many workers are started.
_BYTES_PER_WORKER = 2 * 2**30

# A scheduler that does not answer for so long is not there.
_SECONDS_TO_CONNECT = 15

_SETTINGS = {
    # JAX has many threads; a forked copy of it would hang.
    "distributed.worker.multiprocessing-method": "spawn",
    # A worker holds one run at a time, so that its death is counted against that run alone.
    "distributed.scheduler.worker-saturation": 1.0,
    # Compiled programs cannot be spilled, and a paused worker would never go on.  One that grows
    # too big is ended and its run is given to a fresh one.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
}


class Workers(Protocol):
    """Processes that do runs."""

    @property
    def count(self) -> int:
        """The number of runs that go on at the same time."""
        ...

    def run(self, jobs: Sequence[Job]) -> Iterator[Ended]:
        """Do all jobs; a failure is an answer.  Raises only if the workers themselves are lost."""
        ...


# Given how many jobs there are, a context in which workers are there.
Opener = Callable[[int], AbstractContextManager[Workers]]


class InProcess:
    """One run after the other in this process, for reading and debugging."""

    count = 1

    def run(self, jobs: Sequence[Job]) -> Iterator[Ended]:
        """Do the jobs in their order."""
        rendered: dict[Path, Failure | None] = {}
        for job in jobs:
            for recipe in job.recipes:
                if recipe not in rendered:
                    rendered[recipe] = render_photographs(recipe, _nothing)
            yield job, run_job(job, [rendered[recipe] for recipe in job.recipes], _nothing)


def in_process(jobs: int) -> AbstractContextManager[Workers]:
    """An opener of this process itself, whose precision is the caller's."""
    return nullcontext(InProcess())


def cluster(
    workers: int | None = None, scheduler: str | None = None, set_up: SetUp | None = None
) -> Opener:
    """An opener of processes: ``workers`` of them on this machine, or those of a scheduler.

    ``set_up`` is called once in each process, before its first run; it must stand at the top level
    of a module.  Processes are spawned, so a script that uses this needs the usual
    ``if __name__ == "__main__"``.  Raises InputError for settings that make no sense.
    """
    if scheduler is not None and workers is not None:
        raise InputError("--workers: a scheduler has its own workers; leave out one of the two")
    if workers is not None and workers < 1:
        raise InputError(f"--workers: found {workers}, accepted: a whole number of at least 1")
    set_up = set_up or _nothing
    if scheduler is not None:
        return lambda jobs: _remote(scheduler, set_up)
    return lambda jobs: _local(jobs, workers, set_up)


@contextmanager
def _local(jobs: int, workers: int | None, set_up: SetUp) -> Iterator[Workers]:
    import dask.config
    from dask.system import CPU_COUNT
    from distributed import Client, LocalCluster
    from distributed.system import MEMORY_LIMIT

    room = max(MEMORY_LIMIT // _BYTES_PER_WORKER, 1)
    count = min(workers or min(CPU_COUNT, room), jobs)
    environment = {
        # Threads of XLA: the processors are shared out, not fought for.
        "NPROC": str(max(CPU_COUNT // count, 1)),
        # On a GPU no worker may take all memory at once.
        "XLA_PYTHON_CLIENT_PREALLOCATE": "false",
    }
    environment = {name: os.environ.get(name, value) for name, value in environment.items()}
    with (
        _quiet(),
        dask.config.set(_SETTINGS),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            # Any free port, seen by this machine alone: several batches may go on.
            dashboard_address="127.0.0.1:0",
            host="127.0.0.1",
            silence_logs=logging.CRITICAL,
            env=environment,
        ) as local,
        Client(local) as client,
    ):
        yield _Dask(client, set_up)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the log of the cluster; each run reports its own outcome."""
    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)


@contextmanager
def _remote(scheduler: str, set_up: SetUp) -> Iterator[Workers]:
    from distributed import Client

    try:
        client = Client(scheduler, timeout=_SECONDS_TO_CONNECT)
    except (OSError, ValueError, TimeoutError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"--scheduler {scheduler}: cannot be reached ({reason}); "
            "start one with 'dask scheduler', or leave it out to use this machine"
        ) from None
    with _quiet(), client:
        yield _Dask(client, set_up)


class _Dask:
    """The workers of a dask client; the run of a dead worker goes to another one."""

    def __init__(self, client, set_up: SetUp):
        self._client = client
        self._set_up = set_up

    @property
    def count(self) -> int:
        return max(sum(self._client.nthreads().values()), 1)

    def run(self, jobs: Sequence[Job]) -> Iterator[Ended]:
        from distributed import as_completed

        submit, set_up = self._client.submit, self._set_up
        rendered: dict[Path, Any] = {}
        for recipe in {recipe for job in jobs for recipe in job.recipes}:
            rendered[recipe] = submit(render_photographs, recipe, set_up, pure=False)
        futures = {
            submit(run_job, job, [rendered[one] for one in job.recipes], set_up, pure=False): job
            for job in jobs
        }
        for future in as_completed(list(futures)):
            job = futures.pop(future)
            yield job, self._answer(future)
            # Nothing of it is needed any more, here or on a worker.
            future.release()

    def _answer(self, future) -> Failure | None:
        if future.status in ("cancelled", "lost"):
            raise InputError(
                "the scheduler was lost; finished runs are kept, run the batch again to resume"
            )
        if future.status != "error":
            return future.result()
        from distributed import KilledWorker

        error = future.exception()
        if isinstance(error, KilledWorker):
            return Failure(
                "KilledWorker",
                "its worker died again and again, most often for want of memory; "
                "run the batch again with fewer --workers",
            )
        return Failure.of(error)


def _nothing() -> None:
    """Leave the process as it is."""
