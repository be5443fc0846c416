"""``key=value`` arguments of the command line, written over the data of a config file.

Keys are dotted (``brdf.mu=1.5``, ``lighting.directional.0.irradiance=2``), and values are YAML.
Missing sections are made.
"""

from __future__ import annotations

import re
from typing import Any

from jaxrender.pipelines.config.document import (
    Document,
    Location,
    NotYaml,
    Place,
    Problem,
    Reader,
    compose,
)

_KEY = re.compile(r"[^\s.=]+(\.[^\s.=]+)*")


def apply_override(document: Document, argument: str, index: int) -> None:
    """Write one argument over a document; its problems join those of the document."""
    place = Place.on_command_line(argument, index)

    def refuse(message: str) -> None:
        document.problems.append(Problem(place, message))

    key, separator, text = argument.partition("=")
    if not separator:
        return refuse("expected key=value, such as brdf.mu=1.5")
    if not _KEY.fullmatch(key):
        return refuse("the key before '=' must be words joined by dots, such as brdf.mu")
    try:
        node = compose(text)
    except NotYaml as error:
        return refuse(f"the value is not understood: {error.message}")
    parts = tuple(key.split("."))
    try:
        parent, location = open_section(document, parts[:-1], place)
        last = step_into(parent, parts[-1], location)
    except LookupError as error:
        return refuse(str(error.args[0]))
    location = (*location, last)
    document.keys[location] = place
    value = Reader(document, lambda line, column: place).read(node, location)
    parent[last] = value
    return None


def open_section(document: Document, parts: tuple[str, ...], place: Place) -> tuple[Any, Location]:
    """Walk down to the section of a key, and make missing sections."""
    section: Any = document.data
    location: Location = ()
    for part in parts:
        step = step_into(section, part, location)
        location = (*location, step)
        if not isinstance(_inner(section, step), dict | list):
            # 'brdf.mu.fixed=1.5' over 'mu: free': the argument says what it should be instead.
            section[step] = {}
            document.keys.setdefault(location, place)
            document.values[location] = place
        section = _inner(section, step)
    return section, location


def _inner(section: Any, step: str | int) -> Any:
    return section.get(step) if isinstance(section, dict) else section[step]


def step_into(section: dict | list, part: str, location: Location) -> str | int:
    """One part of a dotted key as a key of a section or an index into a list."""
    if isinstance(section, dict):
        return part
    if part.isdecimal() and int(part) < len(section):
        return int(part)
    name = ".".join(map(str, location))
    entries = "one entry" if len(section) == 1 else f"{len(section)} entries"
    raise LookupError(f"{name} has no entry {part!r}; it is a list of {entries}, counted from 0")
