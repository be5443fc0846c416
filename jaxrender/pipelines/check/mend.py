"""What was found, written into a config: in memory, and into its file with its comments kept."""

import io
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError

from jaxrender.errors import InputError
from jaxrender.io.atomic import replacing
from jaxrender.pipelines.config import RunConfig, load_run_config

Place = tuple[str | int, ...]
Changes = Mapping[Place, Any]
Model = TypeVar("Model", bound=BaseModel)
# Long enough that no line is ever folded.
_WIDTH = 1 << 16


def place_in_words(place: Place) -> str:
    """Name a key as the messages about configs do."""
    words = [f"[{part}]" if isinstance(part, int) else f".{part}" for part in place]
    return "".join(words).lstrip(".")


def with_changes(config: Model, changes: Changes) -> Model:
    """Put values into a config at their places."""
    for place, value in changes.items():
        config = _put(config, place, value)
    return config


def _put(section: Any, place: Place, value: Any) -> Any:
    if not place:
        return value
    first, rest = place[0], place[1:]
    if isinstance(first, int):
        parts = list(section)
        parts[first] = _put(parts[first], rest, value)
        return tuple(parts)
    return section.model_copy(update={first: _put(getattr(section, first), rest, value)})


def write_changes(path: Path, changes: Changes) -> RunConfig:
    """Write values into a config file at their places; comments and all else stay.

    The file is replaced once the new one has been read back.  Raises ``InputError`` where the file
    cannot be written so, and leaves it as it was.
    """
    path = path.resolve()
    text = path.read_text(encoding="utf-8-sig")
    wanted = with_changes(load_run_config(path), changes)
    with replacing(path) as aside:
        try:
            aside.write_text(changed_text(text, changes), encoding="utf-8")
            shutil.copymode(path, aside)
        except (OSError, YAMLError) as error:
            raise InputError(f"{path}: cannot be mended: {error}") from None
        found = load_run_config(aside)
        if found != wanted:
            said = ", ".join(f"{place_in_words(p)}: {v}" for p, v in changes.items())
            raise InputError(f"{path}: cannot be mended by a program; write {said} yourself")
    return found


def changed_text(text: str, changes: Changes) -> str:
    """Change a YAML text at places; sections that are missing are added."""
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = _WIDTH
    if re.search(r"^(\s*)[^\s#-].*:\s*\n(?:\s*(?:#.*)?\n)*\1\s+- ", text, re.MULTILINE):
        yaml.indent(mapping=2, sequence=4, offset=2)
    document = yaml.load(text)
    for place, value in changes.items():
        *sections, last = place
        here = document
        for part in sections:
            if not isinstance(part, int) and here.get(part) is None:
                here[part] = CommentedMap()
            here = here[part]
        here[last] = _plain(value)
    stream = io.StringIO()
    yaml.dump(document, stream)
    return stream.getvalue()


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        items = CommentedSeq(_plain(item) for item in value)
        items.fa.set_flow_style()
        return items
    return value
