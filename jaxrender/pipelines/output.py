"""Result folders: they appear whole or not at all, and never replace files that are not ours.

A folder is ours if it holds the marker ``run.json`` with the fingerprint of the run.  Results are
written into a hidden sibling folder, and renamed into place when they are complete.  An error or an
interrupt removes the sibling and leaves an older result unchanged.
"""

from __future__ import annotations

import enum
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from jaxrender import __version__
from jaxrender.errors import InputError
from jaxrender.io.jsonfiles import read_json
from jaxrender.pipelines.config import RecipeConfig, RunConfig, resolved_yaml

MARKER = "run.json"
_MAKER = "jaxrender"


class FolderState(enum.Enum):
    """The state of a result folder before a run."""

    FRESH = "to be written"
    FINISHED = "an identical run has finished here"


def fingerprint(
    config: RunConfig | RecipeConfig, input_files: Iterable[Path], purpose: str = "fit"
) -> str:
    """Make a hexadecimal digest of everything that a result depends on.

    SHA-256 over the purpose, the version, the resolved config without ``output``, and the contents
    of the input files (in the order of their paths).  Raises InputError for a file that cannot be
    read.
    """
    changes = {"output": None} if isinstance(config, RunConfig) else {}
    return fingerprint_of(purpose, resolved_yaml(config.model_copy(update=changes)), input_files)


def fingerprint_of(purpose: str, settings: str, input_files: Iterable[Path]) -> str:
    """Make the digest of a command whose settings are not a config but any text."""
    digest = hashlib.sha256()
    for text in (purpose, __version__, settings):
        digest.update(hashlib.sha256(text.encode()).digest())
    for path in sorted({Path(path) for path in input_files}):
        digest.update(_content_digest(path))
    return digest.hexdigest()


def _content_digest(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").digest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def prepare(output: Path, fingerprint: str, force: bool = False) -> FolderState:
    """Find the state of a result folder; changes nothing.

    FINISHED means that the folder holds the result of an identical run.  Raises InputError if it
    holds the result of another run and ``force`` is not given.  Raises InputError if it holds files
    that are not ours, with or without ``force``.
    """
    if not output.exists() and not output.is_symlink():
        return FolderState.FRESH
    if not output.is_dir():
        raise InputError(f"{output}: a file is in the way; choose another output folder")
    if not any(output.iterdir()):
        return FolderState.FRESH
    found = _marked_fingerprint(output)
    if found is None:
        raise InputError(
            f"{output}: holds files that are not a jaxrender result (no {MARKER} of ours); "
            "choose another output folder, or move the files away"
        )
    if force:
        return FolderState.FRESH
    if found != fingerprint:
        raise InputError(
            f"{output}: holds the result of another run (other config, input or version); "
            "choose another output folder, or give --force to replace it"
        )
    return FolderState.FINISHED


@contextmanager
def result_folder(output: Path, fingerprint: str, force: bool = False) -> Iterator[Path]:
    """Make a folder to write into; it becomes ``output`` when the block ends without an error.

    If an identical run finished there in the meantime, its result stays.  Raises InputError as
    ``prepare`` does, and where the folder cannot be made.
    """
    prepare(output, fingerprint, force)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=f".{output.name}.unfinished-", dir=output.parent))
    except OSError as error:
        raise InputError(
            f"{output}: cannot be made: {error.strerror}; choose another output folder"
        ) from None
    try:
        _open_to_others(folder)
        yield folder
        _mark(folder, fingerprint)
        if prepare(output, fingerprint, force) is FolderState.FRESH:
            _move_into_place(folder, output)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _marked_fingerprint(folder: Path) -> str | None:
    """The fingerprint in the folder's marker; None if the folder is not ours."""
    try:
        marker = read_json(folder / MARKER)
    except (OSError, ValueError):
        return None
    is_ours = isinstance(marker, dict) and marker.get("made_by") == _MAKER
    found = marker.get("fingerprint") if is_ours else None
    return found if isinstance(found, str) else None


def _mark(folder: Path, fingerprint: str) -> None:
    marker = {
        "made_by": _MAKER,
        "version": __version__,
        "fingerprint": fingerprint,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    (folder / MARKER).write_text(json.dumps(marker, indent=2) + "\n", encoding="utf-8")


def _open_to_others(folder: Path) -> None:
    """Give a temporary folder, made for its owner alone, the permissions of an ordinary one."""
    mask = os.umask(0)
    os.umask(mask)
    folder.chmod(0o777 & ~mask)


def _move_into_place(folder: Path, output: Path) -> None:
    """Rename a complete folder to its final name; an older result goes only after that."""
    if not output.exists() or not any(output.iterdir()):
        # POSIX renames onto an empty folder; elsewhere it has to go first.
        with suppress(FileNotFoundError):
            output.rmdir()
        folder.rename(output)
        return
    # A name beside the output that no one else has; the older result waits inside it.
    aside = Path(tempfile.mkdtemp(prefix=f".{output.name}.replaced-", dir=output.parent))
    older = aside / output.name
    try:
        output.rename(older)
        folder.rename(output)
    except BaseException:
        if older.exists() and not output.exists():
            older.rename(output)
        raise
    finally:
        # Never while the older result is the only one.
        if output.exists():
            shutil.rmtree(aside, ignore_errors=True)
