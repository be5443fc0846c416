"""Files that appear whole or not at all, whatever ends the program."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxrender.errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Name a file to write to, which takes the place of ``path`` if the block ends without error.

    Raises ``InputError`` where the folder is missing.
    """
    if not path.parent.is_dir():
        raise InputError(f"{path}: no such folder {path.parent}; make it first")
    # Some libraries choose a format by the suffix.
    aside = path.with_name(f".{path.name}.unfinished-{uuid.uuid4().hex}{path.suffix}")
    try:
        yield aside
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)
