"""Error messages of the validator: the value found, what is accepted, the nearest word.

pydantic reports one entry for each branch of a union, with its own names in the path.  This module
maps each entry to its key in the config, and reports it once.
"""

from __future__ import annotations

import difflib
import types
import typing
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Union

from pydantic import BaseModel, ValidationError

from jaxrender.pipelines.config.document import (
    Document,
    Location,
    Place,
    Problem,
    StatedInVain,
)
from jaxrender.pipelines.config.values import Accepts

# Unions name their branches by tags in angle brackets, which no key can be.
_TAG = "<"
_LONGEST_SHOWN = 60


def problems_of(
    error: ValidationError, root: type[BaseModel], document: Document
) -> Iterator[Problem]:
    """Each complaint of the validator as a problem at a place of the document."""
    entries = [(entry, _location(entry, document.data)) for entry in error.errors()]
    unknown = [at for entry, at in entries if entry["type"] == "extra_forbidden"]
    misspelt = {(*at[:-1], _nearest_key(at, root)) for at in unknown}
    for entry, location in entries:
        if location in unknown:
            yield Problem(document.key_place(location), _unknown(location, root))
            continue
        raised = entry.get("ctx", {}).get("error")
        if isinstance(raised, StatedInVain):
            for key, why in raised.reasons.items():
                value = _written(document.data, key)
                place = _place(document, key, value)
                yield Problem(place, stated_in_vain(_dotted(key), value, why))
            continue
        place = _place(document, location, _at(document.data, location))
        if entry["type"] == "missing" and isinstance(_at(document.data, location), dict):
            missing = (*location, entry["loc"][-1])
            if missing not in misspelt:
                yield Problem(place, _missing(missing, root))
        else:
            yield Problem(place, _refused(entry, location, root, document))


def stated_in_vain(key: str, value: Any, why: str) -> str:
    """Say of a key that it has no effect."""
    return f"{key}: found {shown(value)}, but {why}"


def _written(data: Any, location: Location) -> Any:
    """Look up what was written, of a shorthand the whole of it."""
    for part in location:
        data = data.get(part) if isinstance(data, dict) else data
    return data


def _place(document: Document, location: Location, value: Any) -> Place:
    """Point at a section by its key, at a plain value by itself."""
    at_key = isinstance(value, dict)
    return document.key_place(location) if at_key else document.value_place(location)


def _refused(entry: Any, location: Location, root: type[BaseModel], document: Document) -> str:
    name = _dotted(location)
    if entry["type"] == "value_error":
        message = str(entry["ctx"]["error"])
        return f"{name}: {message}" if name else message
    found = _at(document.data, location)
    annotation = _annotation(root, location)
    near = _nearest(found, sorted(_words(annotation))) if isinstance(found, str) else None
    hint = f", did you mean {near!r}?" if near else ""
    return f"{name}: found {shown(found)}, accepted: {_accepted(annotation)}{hint}"


def _missing(location: Location, root: type[BaseModel]) -> str:
    accepted = _accepted(_annotation(root, location))
    return f"missing key {_dotted(location)!r}, accepted: {accepted}"


def _unknown(location: Location, root: type[BaseModel]) -> str:
    near = _nearest_key(location, root)
    known = ", ".join(_known_keys(location, root))
    hint = f", did you mean {near!r}?" if near else f"; known here: {known}"
    return f"unknown key {str(location[-1])!r}{hint}"


def _known_keys(location: Location, root: type[BaseModel]) -> list[str]:
    section = _section(_annotation(root, location[:-1]))
    return list(section.model_fields) if section else []


def _nearest_key(location: Location, root: type[BaseModel]) -> str | None:
    return _nearest(str(location[-1]), _known_keys(location, root))


def _nearest(word: str, known: list[str]) -> str | None:
    lowered = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), list(lowered), n=1)
    return lowered[close[0]] if close else None


def _location(entry: Any, data: Any) -> Location:
    """The key of the config that an entry belongs to, or the section in a list of sections."""
    location: Location = ()
    for part in entry["loc"]:
        if isinstance(part, str) and part.startswith(_TAG):
            continue
        if not _holds(data, part):
            break
        location = (*location, part)
        data = data[part]
    if entry["type"] == "model_type" or isinstance(data, dict):
        return location
    while location and isinstance(location[-1], int):
        location = location[:-1]
    return location


def _holds(data: Any, part: int | str) -> bool:
    if isinstance(data, list):
        return isinstance(part, int) and part < len(data)
    return isinstance(data, dict) and part in data


def _at(data: Any, location: Location) -> Any:
    for part in location:
        data = data[part]
    return data


def _dotted(location: Location) -> str:
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return text.removeprefix(".")


def _annotation(root: type[BaseModel], location: Location) -> Any:
    """The annotation of the field at a location."""
    annotation: Any = root
    for part in location:
        if isinstance(part, int):
            annotation = _element(annotation)
            continue
        section = _section(annotation)
        if section is None or part not in section.model_fields:
            return None
        annotation = typing.get_type_hints(section, include_extras=True)[part]
    return annotation


def _branches(annotation: Any) -> Iterator[Any]:
    """The members of a union, or the annotation itself."""
    if typing.get_origin(annotation) in (Union, types.UnionType):
        for branch in typing.get_args(annotation):
            yield from _branches(branch)
    elif typing.get_origin(annotation) is Annotated:
        yield from _branches(typing.get_args(annotation)[0])
    else:
        yield annotation


def _section(annotation: Any) -> type[BaseModel] | None:
    for branch in _branches(annotation):
        if isinstance(branch, type) and issubclass(branch, BaseModel):
            return branch
    return None


def _element(annotation: Any) -> Any:
    for branch in _branches(annotation):
        if typing.get_origin(branch) is tuple:
            return typing.get_args(branch)[0]
    return None


def _words(annotation: Any) -> Iterator[str]:
    for branch in _branches(annotation):
        if typing.get_origin(branch) is Literal:
            yield from (word for word in typing.get_args(branch) if isinstance(word, str))


def _accepted(annotation: Any) -> str:
    """What an annotation accepts, in words."""
    return joined(list(dict.fromkeys(_phrases(annotation))))


def _phrases(annotation: Any) -> Iterator[str]:
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        said = [extra.text for extra in arguments[1:] if isinstance(extra, Accepts)]
        yield from said or _phrases(arguments[0])
    elif origin in (Union, types.UnionType):
        for branch in arguments:
            yield from _phrases(branch)
    elif origin is Literal:
        yield from (repr(word) for word in arguments)
    elif origin is tuple:
        yield f"a list of {_accepted(arguments[0])}"
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        keys = "{" + ", ".join(annotation.model_fields) + "}"
        yield getattr(annotation, "accepts", keys)
    # None means that the key may be left out, which no one who gave it asks about.


def joined(phrases: Sequence[str]) -> str:
    """Join phrases, the last by "or"."""
    if len(phrases) < 2:
        return "".join(phrases)
    return f"{', '.join(phrases[:-1])} or {phrases[-1]}"


def shown(value: Any) -> str:
    """Write a value as a config would, shortened."""
    if value is None:
        return "nothing"
    text = _flow(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 4]} ..."


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(str(value)) if isinstance(value, str | Path) else str(value)
