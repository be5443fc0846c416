"""Where a user's caches lie on this platform, and how much is in them."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple


class Contents(NamedTuple):
    """Number of files, and their bytes."""

    files: int
    size: int


def user_cache() -> Path:
    """The platform's folder for a user's caches."""
    configured = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if configured.is_absolute():
        return configured
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    return Path.home() / ".cache"


def contents(folder: Path, before: float = float("inf")) -> Contents:
    """Count the files below a folder that were written before a time (seconds since 1970)."""
    sizes = [status.st_size for status in _files(folder) if status.st_mtime < before]
    return Contents(len(sizes), sum(sizes))


def _files(folder: Path) -> Iterator[os.stat_result]:
    for path in folder.rglob("*"):
        try:
            if path.is_file() and not path.is_symlink():
                yield path.stat()
        except OSError:
            # Another process has taken it away.
            continue
