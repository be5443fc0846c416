"""Text files and JSON documents from other programs: what is wrong is told by line, byte or key."""

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

from jaxrender.errors import InputError
from jaxrender.limits import DEPTH, DOCUMENT_BYTES, TEXT_BYTES, Limit

# Longer whole numbers are no floats.
_MOST_DIGITS = 300


def read_json(path: str | Path) -> Any:
    """Parse a file; raises InputError as ``read_text`` and ``parse_json`` do."""
    return parse_json(path, read_text(path, DOCUMENT_BYTES))


def parse_json(path: str | Path, text: str) -> Any:
    """Parse the JSON of a file.

    Raises InputError with line and column, the key that occurs twice, or the limit that is passed:
    digits of a whole number, objects and lists within each other.
    """

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            key = Counter(key for key, _ in pairs).most_common(1)[0][0]
            raise InputError(f"{path}: the key `{key}` occurs twice in one object")
        return found

    def whole(digits: str) -> int:
        if len(digits) > _MOST_DIGITS:
            raise InputError(
                f"{path}: a whole number of {len(digits)} digits, {digits[:20]}...; wanted at most "
                f"{_MOST_DIGITS}: mend the number"
            )
        return int(digits)

    try:
        found = json.loads(text, object_pairs_hook=unique, parse_int=whole)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}:{error.lineno}:{error.colno}: {error.msg}; mend the JSON there"
        ) from None
    except RecursionError:
        raise InputError(f"{path}: nested too deeply; take brackets out") from None
    _refuse_deep(path, found)
    return found


def _refuse_deep(path: str | Path, document: Any) -> None:
    """Go down level by level, which takes no stack."""
    level, depth = [document] if isinstance(document, dict | list) else [], 0
    while level:
        inner = [one.values() if isinstance(one, dict) else one for one in level]
        level = [value for one in inner for value in one if isinstance(value, dict | list)]
        depth += 1
        DEPTH.check(str(path), depth, "take brackets out")


def read_text(path: str | Path, limit: Limit = TEXT_BYTES) -> str:
    """Read a text file in UTF-8.

    Raises InputError if it is missing, too large or something else.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: a folder; give the path of the file inside it")
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    limit.check(str(path), path.stat().st_size, "give a smaller file")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror}; mend its permissions"
        ) from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}:{line}: not a text in UTF-8 (byte {error.start} is "
            f"0x{content[error.start]:02x}); if it is a text in Latin-1 or of another encoding, "
            "save it as UTF-8"
        ) from None


def is_count(word: str) -> bool:
    """Whether a word of a text is a whole number from 1, of no absurd number of digits."""
    return word.isdecimal() and len(word) <= _MOST_DIGITS and int(word) > 0


def number(place: str, keys: dict[str, Any], key: str) -> float:
    """Take a finite number out of an object; ``place`` opens the message otherwise."""
    value = keys[key]
    # JSON's true is Python's 1; nobody means that as a length.
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{place}: `{key}` is {value!r}; wanted a finite number")
    return float(value)
