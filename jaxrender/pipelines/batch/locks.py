"""Locks between processes of one machine, by files; the system drops them when a process ends."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

# How often a process that waits looks again.
_SECONDS_BETWEEN_TRIES = 0.1


class Held(Exception):
    """Another process holds the lock."""


@contextmanager
def exclusive(path: Path, wait: bool) -> Iterator[None]:
    """Hold a lock while the block runs; the file stays.

    Raises Held at once if another process holds it and ``wait`` is not given.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as stream:
        while not _taken(stream):
            if not wait:
                raise Held(str(path))
            time.sleep(_SECONDS_BETWEEN_TRIES)
        # Closing the file gives the lock back.
        yield


def _taken(stream: IO[str]) -> bool:
    """Take the lock of a file, unless another has it."""
    if sys.platform == "win32":
        import msvcrt

        try:
            stream.seek(0)
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        # A file system without locks: whoever puts batches there has to keep them apart himself.
        return True
    return True
