"""YAML text as plain data, with the place in the file of every key and value.

YAML 1.2: ``1e-6`` is a number, ``no`` and ``off`` are words.  Keys are words; a key given twice,
a tag, and a merge key are problems.  Problems are collected, so that all errors of a file show at
once.  Only text that is not YAML raises, as ``NotYaml``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode
from ruamel.yaml.reader import ReaderError

from jaxrender.errors import InputError
from jaxrender.limits import CONFIG_VALUES, DEPTH, Limit

Location = tuple[str | int, ...]

_PREFIX = "tag:yaml.org,2002:"
_NUMBERS_AND_WORDS = {_PREFIX + kind for kind in ("int", "float", "bool", "null", "str")}
# YAML would turn a bare 2024-01-01 into a date; a config has no dates, but folders named so.
_KEPT_AS_WRITTEN = {_PREFIX + "timestamp"}
_WRITE_OUT = "write the values out without `*`"
_COLLECTIONS = {_PREFIX + "map", _PREFIX + "seq"}


class Place(NamedTuple):
    """Where something was written; places sort as a person reads them."""

    order: tuple[int, int, int]
    text: str

    @classmethod
    def in_file(cls, name: str, line: int, column: int) -> Place:
        """A place in a file; line and column count from 1."""
        return cls((0, line, column), f"{name}:{line}:{column}")

    @classmethod
    def on_command_line(cls, argument: str, index: int) -> Place:
        """A place in the index-th ``key=value`` argument; these sort after the file."""
        return cls((1, index, 0), f"command line: {argument}")


class Problem(NamedTuple):
    """One thing that is wrong, and where."""

    place: Place
    message: str

    def __str__(self) -> str:
        return f"{self.place.text}: {self.message}"


class NotYaml(Exception):
    """Text that is no YAML; line and column count from 1."""

    def __init__(self, line: int, column: int, message: str):
        super().__init__(message)
        self.line = line
        self.column = column
        self.message = message


class StatedInVain(ValueError):
    """Keys that have no effect; ``reasons`` are by their locations."""

    def __init__(self, message: str, reasons: dict[Location, str]):
        super().__init__(message)
        self.reasons = reasons


@dataclass
class Document:
    """Plain data; the place of each key and of each value, by location; problems met so far."""

    data: Any = None
    keys: dict[Location, Place] = field(default_factory=dict)
    values: dict[Location, Place] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def value_place(self, location: Location) -> Place:
        """The place of the value at a location, or of the nearest section around it."""
        while location not in self.values:
            location = location[:-1]
        return self.values[location]

    def key_place(self, location: Location) -> Place:
        """The place of the key at a location."""
        return self.keys.get(location) or self.value_place(location)


def raise_if_any(problems: Iterable[Problem]) -> None:
    """Raise all problems as one InputError, one a line, in the order of their places."""
    lines = [str(problem) for problem in sorted(set(problems))]
    if lines:
        raise InputError("\n".join(lines))


class _Shallow(Composer):
    """Composes no more nodes, and no deeper, than ``limits`` allows.

    The composer calls itself for each level.
    """

    _depth = _nodes = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._depth += 1
        self._nodes += 1
        self._check(self._depth, DEPTH)
        # Each value may have a key.
        self._check(self._nodes // 2, CONFIG_VALUES)
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def _check(self, found: int, limit: Limit) -> None:
        if found > limit.most:
            mark = self.parser.peek_event().start_mark
            message = (
                f"more than {limit.most:,} {limit.unit}; take some out, or set {limit.variable} to "
                "allow more"
            )
            raise NotYaml(mark.line + 1, mark.column + 1, message)


def compose(text: str) -> Node | None:
    """Parse text into YAML nodes; None if it holds nothing.

    Raises NotYaml where the text is no YAML, or is nested too deeply.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer = _Shallow
    try:
        return yaml.compose(text)
    except ReaderError as error:
        before = text[: error.position]
        column = len(before) - (before.rfind("\n") + 1) + 1
        message = f"character {chr(error.character)!r} is not allowed in YAML"
        raise NotYaml(before.count("\n") + 1, column, message) from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        raise NotYaml(line, column, _syntax_message(error)) from None
    except YAMLError as error:
        raise NotYaml(1, 1, str(error)) from None


def _syntax_message(error: MarkedYAMLError) -> str:
    problem = error.problem or "not understood"
    if "'\\t'" in problem:
        return "found a tab; indent with spaces"
    if "another document" in problem:
        return "found a second document; a config is one document, remove '---'"
    start = f" (which starts at line {error.context_mark.line + 1})" if error.context_mark else ""
    context = f"{error.context}{start}: " if error.context else ""
    return f"not valid YAML: {context}{problem}"


class Reader:
    """Turns nodes into plain data and writes down places and problems.

    ``place_of`` maps line and column, counted from 1, to a Place.
    """

    def __init__(self, document: Document, place_of):
        self._document = document
        self._place_of = place_of
        self._open: list[int] = []
        self._values = 0
        self._constructor = YAML(typ="safe", pure=True).constructor

    def read(self, node: Node | None, location: Location = ()) -> Any:
        """The plain data of a node that stands at a location of the document."""
        if node is None:
            self._document.values[location] = self._place_of(1, 1)
            return None
        self._document.values[location] = self._place(node)
        self._values += 1
        # Aliases within what aliases name would multiply a short text.
        CONFIG_VALUES.check(f"{self._place(node).text}: aliases counted", self._values, _WRITE_OUT)
        if id(node) in self._open:
            return self._refuse(
                node, "an alias inside the value that it names; write the value out"
            )
        if isinstance(node, ScalarNode):
            return self._scalar(node)
        if node.tag not in _COLLECTIONS:
            return self._refuse(node, f"tags such as {_tag(node)} are not accepted; remove it")
        self._open.append(id(node))
        try:
            if isinstance(node, MappingNode):
                return self._mapping(node, location)
            return [self.read(item, (*location, i)) for i, item in enumerate(node.value)]
        finally:
            self._open.pop()

    def _scalar(self, node: ScalarNode) -> Any:
        if node.tag in _NUMBERS_AND_WORDS:
            try:
                return self._constructor.construct_object(node)
            except ValueError:
                return self._refuse(node, f"{node.value!r} is not a value of {_tag(node)}")
        if node.tag in _KEPT_AS_WRITTEN:
            return node.value
        return self._refuse(node, f"tags such as {_tag(node)} are not accepted; remove it")

    def _mapping(self, node: MappingNode, location: Location) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, ScalarNode):
                self._refuse(key_node, "a key must be a plain word")
                continue
            key, inner = key_node.value, (*location, key_node.value)
            if key_node.tag == _PREFIX + "merge":
                self._refuse(key_node, "merge keys '<<' are not accepted; write the keys out")
            elif key in data:
                first = self._document.keys[inner].order[1]
                self._refuse(key_node, f"duplicate key {key!r}, first given at line {first}")
            else:
                self._document.keys[inner] = self._place(key_node)
                data[key] = self.read(value_node, inner)
        return data

    def _place(self, node: Node) -> Place:
        mark = node.start_mark
        return self._place_of(mark.line + 1, mark.column + 1)

    def _refuse(self, node: Node, message: str) -> None:
        self._document.problems.append(Problem(self._place(node), message))


def _tag(node: Node) -> str:
    return str(node.tag).replace(_PREFIX, "!!")
