"""Every key of a config as rows of a table, from the JSON Schema of configs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

# Values of the material that may be stated in several ways.
_PARAMETER = "number, `free`, bounds or a prior"
_KINDS = {"boolean": "true or false", "integer": "whole number", "null": "nothing"}


class Key(NamedTuple):
    """A key by its dotted name, what may stand there, what it is by default, and its meaning."""

    name: str
    kind: str
    default: str
    meaning: str
    tasks: str

    @property
    def stands(self) -> str:
        """What may stand there, and what is taken where nothing does."""
        if self.default in ("none", "required"):
            return f"{self.kind}; {self.default}" if self.default == "required" else self.kind
        return f"{self.kind}; else {self.default}"


def keys_of(schema: dict[str, Any]) -> list[Key]:
    """List the keys of a schema, sections before what is inside them."""
    return list(_inside(schema, schema, ""))


def _inside(schema: dict[str, Any], section: dict[str, Any], before: str) -> Iterator[Key]:
    required = section.get("required", [])
    for name, entry in section.get("properties", {}).items():
        yield _key(schema, entry, before + name, name in required)
        inner, many = _section_of(schema, entry)
        if inner is not None:
            yield from _inside(schema, inner, f"{before}{name}{'[]' if many else ''}.")


def _key(schema: dict[str, Any], entry: dict[str, Any], name: str, required: bool) -> Key:
    meaning, tasks = _without_tasks(entry.get("description", ""))
    default = "required" if required else _shown(entry.get("default"))
    return Key(name, _kind(schema, entry), default, meaning, tasks)


def _without_tasks(description: str) -> tuple[str, str]:
    """Part the meaning from the tasks, which stand in lines of their own."""
    lines = description.splitlines()
    of_tasks = [line for line in lines if line.startswith("Tasks")]
    meaning = " ".join(line.strip() for line in lines if line not in of_tasks)
    return meaning, " ".join(line.removeprefix("Tasks: ").rstrip(".") for line in of_tasks)


def _branches(entry: dict[str, Any]) -> list[dict[str, Any]]:
    return entry.get("anyOf") or entry.get("oneOf") or [entry]


def _section_of(schema: dict[str, Any], entry: dict[str, Any]) -> tuple[dict | None, bool]:
    """Find the section that a key holds, or a list of; None where it holds a value."""
    for branch in _branches(entry):
        many = branch.get("type") == "array"
        inner = branch.get("items", {}) if many else branch
        found = schema.get("$defs", {}).get(inner.get("$ref", "").rpartition("/")[2], inner)
        if "properties" in found:
            return found, many
    return None, False


def _kind(schema: dict[str, Any], entry: dict[str, Any]) -> str:
    kinds = [_one_kind(schema, branch) for branch in _branches(entry)]
    return " or ".join(dict.fromkeys(kind for kind in kinds if kind != "nothing"))


def _one_kind(schema: dict[str, Any], branch: dict[str, Any]) -> str:
    if "$ref" in branch:
        name = branch["$ref"].rpartition("/")[2]
        return _PARAMETER if name == "Parameter" else _kind_of_found(schema["$defs"][name])
    if "enum" in branch:
        return " or ".join(f"`{word}`" for word in branch["enum"])
    if "const" in branch:
        return f"`{branch['const']}`"
    if branch.get("type") == "array":
        count = branch.get("minItems")
        if "prefixItems" in branch:
            return f"{count} numbers"
        return f"a list: {_kind(schema, branch.get('items', {}))}"
    if branch.get("format") == "path":
        return "a path"
    if branch.get("type") == "number":
        return f"number{_range(branch)}"
    if branch.get("type") == "integer":
        return f"whole number{_range(branch)}"
    return _KINDS.get(branch.get("type", ""), branch.get("type", "a value"))


def _kind_of_found(found: dict[str, Any]) -> str:
    return "a section" if "properties" in found else "a value"


def _range(branch: dict[str, Any]) -> str:
    words = {
        "exclusiveMinimum": "above",
        "minimum": "from",
        "maximum": "to",
        "exclusiveMaximum": "below",
    }
    told = [f"{word} {branch[key]:g}" for key, word in words.items() if key in branch]
    return f" {' '.join(told)}" if told else ""


def _shown(default: Any) -> str:
    if default is None or default == []:
        return "none"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return f"`{default}`"


def table_of(keys: list[Key]) -> str:
    """Lay the keys out as a table in MyST."""
    head = "| key | what may stand there | meaning | tasks |\n|---|---|---|---|"
    rows = (
        f"| `{key.name}` | {_cell(key.stands)} | {_cell(key.meaning)} "
        f"| {_cell(key.tasks or 'all')} |"
        for key in keys
    )
    return "\n".join([head, *rows])


def _cell(text: str) -> str:
    """Guard what a table or a paragraph would read as its own signs."""
    plain = text.replace("|", "\\|").replace("$", "\\$").replace("<", "&lt;")
    parts = plain.split("`")
    # Underscores and stars outside of code are letters.
    parts[::2] = [part.replace("_", "\\_").replace("*", "\\*") for part in parts[::2]]
    return "`".join(parts)
