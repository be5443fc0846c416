"""The folder of a batch: marked as ours, and used by one batch at a time."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from jaxrender import __version__
from jaxrender.errors import InputError
from jaxrender.io.jsonfiles import read_json
from jaxrender.pipelines.batch.index import INDEX_STEM
from jaxrender.pipelines.batch.plan import Planned
from jaxrender.pipelines.config.sweep import Sweep
from jaxrender.pipelines.result import write_json

MARKER = "batch.json"
_LOCK = "batch.lock"
_MAKER = "jaxrender"


@contextmanager
def our_folder(sweep: Sweep) -> Iterator[None]:
    """Hold the folder of a batch: mark it as ours, and lock out other batches."""
    folder = sweep.output
    check_ours(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # The marker comes first: a folder with the lock alone would be nobody's.
        marker = {"made_by": _MAKER, "version": __version__, "sweep": str(sweep.path.absolute())}
        write_json(folder / MARKER, marker)
        held = FileLock(folder / _LOCK).acquire(blocking=False)
    except Timeout:
        raise InputError(
            f"{folder}: another batch is at work there; wait for it, or choose another output"
        ) from None
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written to or locked: {error.strerror}; choose another output"
        ) from None
    with held:
        yield


def check_ours(folder: Path) -> None:
    """Refuse a folder with files that a batch did not write."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"{folder}: a file is in the way; choose another output")
    try:
        marker = read_json(folder / MARKER)
    except (OSError, ValueError):
        marker = None
    is_ours = isinstance(marker, dict) and marker.get("made_by") == _MAKER
    if not is_ours and any(folder.iterdir()):
        raise InputError(
            f"{folder}: holds files that are not a batch (no {MARKER} of ours); choose another "
            "output folder, or move the files away"
        )


def sweep_away(plan: Iterable[Planned]) -> None:
    """Remove the remains of killed workers; needs the lock of the batch."""
    names = {run.name for run in plan}
    for folder in {run.folder.parent for run in plan}:
        for left in folder.glob(".*.*-*"):
            if left.name.split(".")[1] in names:
                shutil.rmtree(left, ignore_errors=True)
        for left in folder.glob(f".{INDEX_STEM}.*.unfinished-*"):
            left.unlink(missing_ok=True)
