"""What came of reading a file: it was read, refused in clear words, or something else."""

import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jaxrender.errors import InputError

READ, REFUSED = "read", "refused"
# Longer messages are no help to anybody.
_LONGEST = 20_000


def judged(read: Callable[[Path], object], path: Path) -> str:
    """Read a file; ``READ``, ``REFUSED``, or what else has happened.

    A warning, and an error that Python prints and ignores, are something else.
    """
    ignored: list[str] = []

    def keep(said: Any) -> None:
        ignored.append(f"ignored {type(said.exc_value).__name__}: {said.exc_value}")

    before, sys.unraisablehook = sys.unraisablehook, keep
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = _outcome(read, path)
    finally:
        sys.unraisablehook = before
    return ignored[0] if ignored else found


def _outcome(read: Callable[[Path], object], path: Path) -> str:
    try:
        read(path)
    except InputError as error:
        return _fault_of(str(error), path) or REFUSED
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    return READ


def _fault_of(message: str, path: Path) -> str:
    """Say what is unclear about a message."""
    # Some name others, which lie beside them.
    if str(path.parent) not in message:
        return f"the file is not named: {message}"
    if len(message) > _LONGEST:
        return f"a message of {len(message)} letters: {message[:200]}"
    if not message.replace("\n", "").isprintable():
        return f"a message that cannot be printed: {message!r}"
    return ""
