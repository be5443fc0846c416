"""What a package offers at its door, by the module that holds it, as directives of autodoc."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import textwrap
from collections import defaultdict
from types import ModuleType
from typing import Any


def door_of(package: str) -> dict[str, list[str]]:
    """List the public names of a package by the module below it that defines them."""
    module = importlib.import_module(f"jaxrender.{package}")
    nouns: dict[str, list[str]] = defaultdict(list)
    for name in sorted(module.__all__, key=str.lower):
        home = getattr(getattr(module, name), "__module__", "")
        noun = home.removeprefix(f"jaxrender.{package}").strip(".")
        nouns[noun if home.startswith(f"jaxrender.{package}") else ""].append(name)
    return dict(sorted(nouns.items(), key=lambda item: (item[0] == "", item[0])))


def map_of(package: str) -> str:
    """Take the map of a package, which is its docstring."""
    return inspect.getdoc(importlib.import_module(f"jaxrender.{package}")) or ""


def page_of(package: str) -> str:
    """Write the page of a package in MyST: a section for each noun."""
    module = importlib.import_module(f"jaxrender.{package}")
    parts: list[str] = []
    for noun, names in door_of(package).items():
        parts += [f"## {noun or 'values'}", ""]
        if noun:
            parts += [_first_line(f"jaxrender.{package}.{noun}"), ""]
        parts += ["```{eval-rst}"]
        for name in names:
            parts += _directive(module, package, name)
        parts += ["```", ""]
    return "\n".join(parts)


def _first_line(name: str) -> str:
    text = (inspect.getdoc(importlib.import_module(name)) or "").split("\n\n")[0]
    return re.sub(r"([_*<$|\[\]])", r"\\\1", " ".join(text.replace("``", "`").split()))


def _directive(module: ModuleType, package: str, name: str) -> list[str]:
    value = getattr(module, name)
    full = f"jaxrender.{package}.{name}"
    if inspect.isclass(value):
        return [f".. autoclass:: {full}", "   :members:", ""]
    if callable(value):
        return [f".. autofunction:: {full}", ""]
    return [f".. py:data:: {full}", f"   :type: {type(value).__name__}", ""]


def signature_of(value: Any) -> str | None:
    """Write a signature as the source has it, with the axes of its arrays; None if it has none."""
    value = inspect.unwrap(value)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(value))).body[0]
    except (OSError, TypeError, SyntaxError, IndentationError):
        return None
    if isinstance(tree, ast.FunctionDef):
        own = tree.args
        if own.args and own.args[0].arg in ("self", "cls"):
            own.args = own.args[1:]
        returned = f" -> {ast.unparse(tree.returns)}" if tree.returns else ""
        return f"({ast.unparse(own)}){returned}"
    if isinstance(tree, ast.ClassDef) and not any(
        isinstance(part, ast.FunctionDef) and part.name == "__init__" for part in tree.body
    ):
        fields = [part for part in tree.body if isinstance(part, ast.AnnAssign)]
        own = [
            ast.unparse(part)
            for part in fields
            if "ClassVar" not in ast.unparse(part.annotation)
            and not ast.unparse(part.target).startswith("_")
        ]
        return f"({', '.join(own)})" if own else None
    return None


def guarded(lines: list[str]) -> list[str]:
    """Make a docstring plain text to docutils: equations hold stars, bars and underscores."""
    found: list[str] = []
    # A literal that is broken over two lines is put together.
    for line in _whole_literals(lines):
        indented = line[: len(line) - len(line.lstrip())]
        before = found[-1] if found else ""
        was = before[: len(before) - len(before.lstrip())]
        if line.strip() and before.strip() and indented != was:
            found.append("")
        found.append(_plain(line))
    return found


def _whole_literals(lines: list[str]) -> list[str]:
    joined: list[str] = []
    for line in lines:
        if joined and joined[-1].count("``") % 2:
            joined[-1] = f"{joined[-1]} {line.strip()}"
        else:
            joined.append(line)
    return joined


def _plain(line: str) -> str:
    parts = re.split(r"(``[^`]*``)", line)
    parts[::2] = [re.sub(r"([*|\\`])|(_)(?=\W|$)", _escaped, part) for part in parts[::2]]
    # A literal ends only where something other than a word follows.
    for at in range(2, len(parts), 2):
        if re.match(r"[\w^]", parts[at]):
            parts[at] = f"\\ {parts[at]}"
    return "".join(parts)


def _escaped(found: re.Match[str]) -> str:
    return "\\" + found.group(0)
