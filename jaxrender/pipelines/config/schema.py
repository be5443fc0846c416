"""The JSON Schema of a config, in which each key of a run names the tasks that use it."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from jaxrender.pipelines.config.honoured import honouring
from jaxrender.pipelines.config.run import RunConfig
from jaxrender.pipelines.config.tasks import UNUSED


def json_schema(root: type[BaseModel] = RunConfig) -> dict[str, Any]:
    """Make the JSON Schema of a config, for editors.

    Where some tasks have no use for a key of a run, its description ends with those that use it.
    """
    schema = root.model_json_schema()
    if root is RunConfig:
        # A key comes before what is inside it.
        for key in sorted({key for keys in UNUSED.values() for key in keys}):
            entry, inner = _entry(schema, key)
            what = f"Tasks that use {inner}" if inner else "Tasks"
            entry["description"] += f"\n{what}: {', '.join(honouring(key))}."
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _entry(schema: dict[str, Any], key: str) -> tuple[dict[str, Any], str]:
    """Find the entry of a dotted key, and what is left of the key inside a value of many forms."""
    section, _, rest = key.partition(".")
    entry = schema["properties"][section]
    if not rest:
        return entry, ""
    name, _, inner = rest.partition(".")
    branches = entry.get("anyOf", [entry])
    reference = next(one["$ref"] for one in branches if "$ref" in one)
    return schema["$defs"][reference.rpartition("/")[2]]["properties"][name], inner
