"""JSON documents from other programs: syntax errors by line, values that are not numbers by key."""

import json
import math
from pathlib import Path
from typing import Any

from jaxrender.errors import InputError


def read_json(path: str | Path) -> Any:
    """Parse a file; InputError names line and column, or the key that occurs twice."""
    text = read_text(path)

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        for key in keys:
            if keys.count(key) > 1:
                raise InputError(f"{path}: the key `{key}` occurs twice in one object")
        return dict(pairs)

    try:
        return json.loads(text, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}:{error.lineno}:{error.colno}: {error.msg}; mend the JSON there"
        ) from None
    except RecursionError:
        raise InputError(f"{path}: nested too deeply") from None


def read_text(path: str | Path) -> str:
    """Read a text file in UTF-8; InputError if it is missing or something else."""
    if Path(path).is_dir():
        raise InputError(f"{path}: a folder; give the path of the file inside it")
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; mend the path")
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8 (byte {error.start})") from None


def number(place: str, keys: dict[str, Any], key: str) -> float:
    """Take a finite number out of an object; ``place`` opens the message otherwise."""
    value = keys[key]
    # JSON's true is Python's 1; nobody means that as a length.
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{place}: `{key}` is {value!r}; wanted a finite number")
    return float(value)
