"""What a package gives that its chapter leaves out, and what is listed that it lacks."""

import inspect
import typing
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

from .page import Chapter


def unlisted(package: ModuleType, chapter: Chapter) -> list[str]:
    """Name what the package gives that is on neither list, and what is listed that it lacks."""
    rows: dict[str, set[str]] = {}
    for row in chapter.rows:
        rows.setdefault(row.function, set()).update(row.arguments)
    missing = []
    for name in package.__all__:
        thing = getattr(package, name)
        if name in chapter.exceptions or not callable(thing):
            continue
        if inspect.isclass(thing):
            missing += _unlisted_methods(name, thing, rows, chapter.exceptions)
        elif name not in rows:
            missing.append(f"{name}: on neither list")
        else:
            left = _array_parameters(thing) - rows[name]
            missing += [
                f"{name}: no row moves {argument}"
                for argument in sorted(left)
                if f"{name}.{argument}" not in chapter.exceptions
            ]
    known = set(package.__all__)
    listed = {*rows, *chapter.exceptions}
    gone = sorted(name for name in listed if name.split(".")[0] not in {*known, "*"})
    both = sorted({*rows} & {*chapter.exceptions})
    return (
        missing
        + [f"{name}: listed, but the package has no such thing" for name in gone]
        + [f"{name}: on both lists" for name in both]
    )


def _unlisted_methods(
    name: str, thing: type, rows: Mapping[str, set[str]], exceptions: Mapping[str, str]
) -> list[str]:
    """Name the public methods of its own that take arrays and are on neither list."""
    wanted = [
        method
        for method, value in vars(thing).items()
        if not method.startswith("_")
        and not isinstance(value, (classmethod, staticmethod, property))
        and inspect.isfunction(getattr(thing, method))
        and _array_parameters(getattr(thing, method))
    ]
    found = [
        f"{name}.{method}: on neither list"
        for method in wanted
        if not {f"{name}.{method}", f"*.{method}"} & {*rows, *exceptions}
    ]
    if not wanted and name not in {row.split(".")[0] for row in rows}:
        found.append(f"{name}: on neither list")
    return found


def _array_parameters(function: Callable) -> set[str]:
    """Name the parameters whose annotation says that they hold floating or complex arrays."""
    hints = getattr(function, "__annotations__", {})
    parameters = inspect.signature(function).parameters
    return {name for name in parameters if _holds_arrays(hints.get(name))}


def _holds_arrays(hint: Any) -> bool:
    if isinstance(hint, str):
        return any(word in hint for word in ("Float[", "Complex[", "Inexact["))
    inner = typing.get_args(hint)
    if typing.get_origin(hint) is not None and "Callable" in str(typing.get_origin(hint)):
        return False
    if inner:
        return any(_holds_arrays(part) for part in inner)
    kinds = getattr(hint, "dtypes", ())
    return any(str(kind).startswith(("float", "complex")) for kind in kinds)
