"""Config files to validated configs, and back.

All errors of a file are raised together as one ``InputError``, one a line, sorted by place::

    bad.yaml:6:3: unknown key 'ligting', did you mean 'lighting'?
    command line: brdf.m=2: unknown key 'm', did you mean 'mu'?

Relative paths resolve against the folder of the file that names them; ``output``, and paths given
on the command line, against the working directory.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from jaxrender.errors import InputError
from jaxrender.limits import CONFIG_BYTES
from jaxrender.pipelines.config.document import (
    Document,
    Location,
    NotYaml,
    Place,
    Problem,
    Reader,
    compose,
    raise_if_any,
)
from jaxrender.pipelines.config.overrides import apply_override
from jaxrender.pipelines.config.recipe import RecipeConfig
from jaxrender.pipelines.config.run import RunConfig
from jaxrender.pipelines.config.wording import problems_of

Root = TypeVar("Root", RunConfig, RecipeConfig)

# The keys whose relative paths are the user's place to put things, not a file's neighbours.
_FROM_WORKING_DIRECTORY = {("output",)}


def load_run_config(path: str | Path, overrides: Sequence[str] = ()) -> RunConfig:
    """The config of a run, with ``key=value`` overrides written over it and its paths absolute.

    Raises InputError with every error of the file and the overrides.
    """
    return _load(Path(path), overrides, RunConfig)


def load_recipe(path: str | Path) -> RecipeConfig:
    """A recipe, its paths absolute.

    Raises InputError with every error of the file.
    """
    return _load(Path(path), (), RecipeConfig)


def resolved_yaml(config: RunConfig | RecipeConfig) -> str:
    """The whole config, defaults included, as YAML that the loader reads back to an equal one."""
    yaml = YAML()
    # Long enough that no path is ever folded.
    yaml.width = 4096
    stream = io.StringIO()
    yaml.dump(_laid_out(config.written_out()), stream)
    return stream.getvalue()


def _load(path: Path, overrides: Sequence[str], root: type[Root]) -> Root:
    document = read_document(path, root)
    for index, argument in enumerate(overrides):
        apply_override(document, argument, index)
    problems = list(document.problems)
    try:
        config = root.model_validate(document.data)
    except ValidationError as error:
        # A value that could not be read is a problem already; what follows from it is noise.
        known = {problem.place for problem in problems}
        found = problems_of(error, root, document)
        problems += [problem for problem in found if problem.place not in known]
        raise_if_any(problems)
        raise
    raise_if_any(problems)
    return with_absolute_paths(config, document, {0: path.absolute().parent})


def read_document(path: Path, root: type[BaseModel]) -> Document:
    """The plain data of a config file, with its places; other roots have other keys to name.

    Raises InputError for what is no file, no YAML or no mapping.
    """
    document = Document()
    text = _text(path)

    def place(line: int, column: int) -> Place:
        return Place.in_file(str(path), line, column)

    try:
        node = compose(text)
    except NotYaml as error:
        raise InputError(str(Problem(place(error.line, error.column), error.message))) from None
    document.data = Reader(document, place).read(node)
    keys = ", ".join(root.model_fields)
    if document.data is None:
        raise_if_any(
            [*document.problems, Problem(place(1, 1), f"the file is empty; keys are {keys}")]
        )
    if not isinstance(document.data, dict):
        found = "a list" if isinstance(document.data, list) else f"{document.data!r}"
        message = f"found {found}, accepted: a mapping with the keys {keys}"
        raise_if_any([Problem(document.value_place(()), message)])
    _drop_empty_sections(document, root)
    return document


def _text(path: Path) -> str:
    try:
        CONFIG_BYTES.check(str(path), path.stat().st_size, "give a smaller file")
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; mend the path") from None
    except IsADirectoryError:
        raise InputError(f"{path}: a folder; give the config file inside it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(f"{path}:{line}: not UTF-8 text; save the file as UTF-8") from None


def _drop_empty_sections(document: Document, root: type[BaseModel]) -> None:
    """A section whose keys are all commented out counts as left out."""
    for key, value in list(document.data.items()):
        if value is None and key in root.model_fields:
            del document.data[key]


def with_absolute_paths(config: Root, document: Document, folders: Mapping[int, Path]) -> Root:
    """Resolve each path against the folder of the file that names it.

    ``folders`` are by the first number of a place's order; what was typed on the command line, and
    ``output``, are taken from the working directory.
    """

    def absolute(section: BaseModel, location: Location) -> BaseModel:
        updates: dict[str, Any] = {}
        for name in type(section).model_fields:
            value, inner = getattr(section, name), (*location, name)
            if isinstance(value, Path):
                folder = folders.get(document.value_place(inner).order[0], Path.cwd())
                base = Path.cwd() if inner in _FROM_WORKING_DIRECTORY else folder
                updates[name] = _resolved(base, value, document.value_place(inner))
            elif isinstance(value, BaseModel):
                updates[name] = absolute(value, inner)
            elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
                updates[name] = tuple(absolute(one, (*inner, k)) for k, one in enumerate(value))
        # Only what changed is written back, so that 'given' keys stay told from defaults.
        changed = {
            name: value for name, value in updates.items() if value != getattr(section, name)
        }
        return section.model_copy(update=changed)

    return absolute(config, ())  # pyright: ignore[reportReturnType]


def _resolved(base: Path, path: Path, place: Place) -> Path:
    try:
        return (base / path.expanduser()).resolve()
    except (OSError, ValueError, RuntimeError):
        # A zero byte, half a surrogate pair, a user who is not there.
        message = f"{str(path)!r} names no file; mend the path"
        raise InputError(str(Problem(place, message))) from None


def _laid_out(value: Any) -> Any:
    """Sections one key a line, lists of numbers on one line."""
    if isinstance(value, dict):
        return CommentedMap((key, _laid_out(item)) for key, item in value.items())
    if isinstance(value, list):
        items = CommentedSeq(_laid_out(item) for item in value)
        if not any(isinstance(item, CommentedMap) for item in items):
            items.fa.set_flow_style()
        return items
    return value
