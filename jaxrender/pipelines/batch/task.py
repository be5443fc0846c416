"""The work of a worker: the photographs of a recipe, or one run.  An error is a return value.

All functions stand at the top level and take paths and small data, so that other processes and
machines can call them.  ``set_up`` sets precision and compilation cache, once in each process.
"""

from __future__ import annotations

import functools
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from filelock import FileLock

from jaxrender.errors import InputError
from jaxrender.pipelines.caches import capture_folder, is_whole
from jaxrender.pipelines.config import RunConfig, load_recipe
from jaxrender.pipelines.run import fit
from jaxrender.pipelines.synth import synthesise

SetUp = Callable[[], None]


class Job(NamedTuple):
    """A run to do; ``replaces`` says that its folder holds an earlier failure."""

    name: str
    folder: Path
    config: RunConfig
    replaces: bool

    @property
    def recipes(self) -> tuple[Path, ...]:
        """The recipes whose photographs are fitted."""
        return self.config.recipes


class Failure(NamedTuple):
    """Why a run has no result."""

    kind: str
    message: str
    traceback: str = ""

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """Make data of an exception: the message of bad input, the traceback of anything else."""
        kind, message = type(error).__name__, str(error) or type(error).__name__
        if isinstance(error, InputError):
            return cls(kind, message)
        return cls(kind, message, "".join(traceback.format_exception(error)))


def render_photographs(recipe: Path, set_up: SetUp) -> Failure | None:
    """Render a recipe's photographs into the cache, unless they are there."""
    return _attempted(set_up, _photographs, recipe)


def run_job(job: Job, rendered: Sequence[Failure | None], set_up: SetUp) -> Failure | None:
    """Do one run; ``rendered`` are the outcomes of rendering its photographs."""
    failed = next((failure for failure in rendered if failure is not None), None)
    return failed or _attempted(set_up, _fitted, job)


def _attempted(set_up: SetUp, action: Callable, *arguments) -> Failure | None:
    try:
        _once(set_up)
        action(*arguments)
    except Exception as error:
        return Failure.of(error)
    return None


@functools.cache
def _once(set_up: SetUp) -> None:
    set_up()


def _fitted(job: Job) -> None:
    for recipe in job.recipes:
        # Only where this machine has another cache than the one that they were rendered into.
        _photographs(recipe)
    fit(job.config.model_copy(update={"output": job.folder}), force=job.replaces)


def _photographs(path: Path) -> None:
    recipe = load_recipe(path)
    place = capture_folder(recipe, path)
    if is_whole(recipe, place):
        return
    place.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(place.with_name(f"{place.name}.lock")):
        if not is_whole(recipe, place):
            synthesise(recipe, path, place, force=True)
