"""A sweep: one base config, and values that replace its own; one run for each set of values.

Keys are dotted as on the command line (``brdf.mu``), and what they are given is checked as a config
is: every run's config is built and validated before anything is started.  All errors of the sweep,
and of its base, are raised together as one ``InputError``, one a line, sorted by place::

    sweep.yaml:4:3: unknown key 'm', did you mean 'mu'?

Relative paths resolve against the folder of the file that names them, base or sweep; ``output``
against the working directory.
"""

from __future__ import annotations

import copy
import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import ValidationError, WithJsonSchema

from jaxrender.pipelines.config.document import Document, Location, Place, Problem, raise_if_any
from jaxrender.pipelines.config.loader import read_document, with_absolute_paths
from jaxrender.pipelines.config.overrides import open_section, step_into
from jaxrender.pipelines.config.run import RunConfig
from jaxrender.pipelines.config.values import Accepts, ConfigPath, Section
from jaxrender.pipelines.config.wording import problems_of

_KEY = re.compile(r"[^\s.=]+(\.[^\s.=]+)*")

# Places in the sweep sort after those in its base (0) and are told from them by this number.
_SWEEP = 2

# More runs than any cluster does overnight: a slip of the pen, and a product that fills memory.
_MOST_RUNS = 100_000

_Grid = Annotated[
    dict[str, Any],
    Accepts("{key: [values], ...}, such as {brdf.mu: [1.3, 1.5]}"),
    WithJsonSchema({"type": "object", "additionalProperties": {"type": "array", "minItems": 1}}),
]
_List = Annotated[
    tuple[dict[str, Any], ...],
    Accepts("a list of {key: value, ...}, such as [{brdf.mu: 1.3}, {samples.seed: 1}]"),
]


class SweepConfig(Section):
    """Many fits: a base config, and exactly one of ``grid`` and ``list``."""

    base: ConfigPath
    """Config that every run starts from.  Its output is ignored."""
    grid: _Grid | None = None
    """Values for each key.  The runs are all combinations."""
    list: _List | None = None
    """The runs one by one, each as the keys and values that it changes."""
    output: ConfigPath | None = None
    """Folder of the batch; taken relative to the working directory."""


class SweepRun(NamedTuple):
    """One run: its changes, as written in the sweep, and its whole config."""

    parameters: dict[str, Any]
    config: RunConfig


class Sweep(NamedTuple):
    """A sweep whose runs are all valid and all different; ``keys`` are the changed keys."""

    path: Path
    output: Path
    keys: tuple[str, ...]
    runs: tuple[SweepRun, ...]


# The dotted keys that a run assigns, each with the place of its value in the sweep.
_Assignment = dict[str, Location]


def load_sweep(path: str | Path) -> Sweep:
    """Read a sweep and the config of each of its runs, with paths absolute.

    Raises InputError with every error of the sweep and its base.
    """
    path = Path(path)
    sweep = read_document(path, SweepConfig)
    config = _validated(sweep, SweepConfig, sweep.problems)
    raise_if_any([*sweep.problems, *_shape_problems(sweep)])
    folder = path.absolute().parent
    base_path = (folder / config.base.expanduser()).resolve()
    base = read_document(base_path, RunConfig)
    base.data.pop("output", None)
    folders = {0: base_path.parent, _SWEEP: folder}
    output = (Path.cwd() / (config.output or Path("runs") / path.stem).expanduser()).resolve()
    assignments = _assignments(sweep.data)
    runs, problems = [], []
    for assignment in assignments:
        document = _assigned(base, sweep, assignment)
        run = _validated(document, RunConfig, problems)
        if run is not None and not document.problems:
            parameters = {key: _at(sweep.data, at) for key, at in assignment.items()}
            runs.append(SweepRun(parameters, with_absolute_paths(run, document, folders)))
        problems += document.problems
    raise_if_any(problems)
    raise_if_any(_duplicates(sweep, assignments, runs))
    keys = dict.fromkeys(key for assignment in assignments for key in assignment)
    return Sweep(path, output, tuple(keys), tuple(runs))


def shown(parameters: Mapping[str, Any]) -> str:
    """Write the changes of a run as ``key=value`` words."""
    words = (f"{key}={as_text(value)}" for key, value in parameters.items())
    return " ".join(words) or "the base itself"


def as_text(value: Any) -> str:
    """A value of a sweep on one line; a word as it is, everything else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)


def _validated(document: Document, root: type, problems: list[Problem]) -> Any:
    """The validated config of a document; None if it has problems, which then join the others."""
    try:
        return root.model_validate(document.data)
    except ValidationError as error:
        # A value that could not be read is a problem already; what follows from it is noise.
        known = {problem.place for problem in document.problems}
        found = [p for p in problems_of(error, root, document) if p.place not in known]
        problems += found
        if root is SweepConfig:
            raise_if_any(problems)
        return None


def _shape_problems(sweep: Document) -> Iterator[Problem]:
    """What is wrong with grid and list before any run is looked at."""
    grid, runs = sweep.data.get("grid"), sweep.data.get("list")
    if grid is not None and runs is not None:
        yield Problem(
            sweep.key_place(("list",)), "found grid and list; give one of them, or write two sweeps"
        )
    elif grid is None and runs is None:
        message = "no runs given; a sweep needs grid: {key: [values]} or list: [{key: value}]"
        yield Problem(sweep.key_place(("base",)), message)
    for name, given in (("grid", grid), ("list", runs)):
        if given is not None and not given:
            yield Problem(sweep.value_place((name,)), f"{name} is empty; it needs at least one run")
    for key, values in (grid or {}).items():
        at = ("grid", key)
        yield from _key_problems(sweep, at)
        if not isinstance(values, list):
            message = f"grid.{key}: found {as_text(values)}, accepted: a list of values"
            yield Problem(sweep.value_place(at), message)
        elif not values:
            yield Problem(sweep.value_place(at), f"grid.{key}: the list is empty; give values")
    for number, entry in enumerate(runs or []):
        for key in entry:
            yield from _key_problems(sweep, ("list", number, key))
    if grid and all(isinstance(values, list) for values in grid.values()):
        count = math.prod(map(len, grid.values()))
        if count > _MOST_RUNS:
            message = f"grid: {count} combinations; at most {_MOST_RUNS} runs make a sweep"
            yield Problem(sweep.key_place(("grid",)), message)


def _key_problems(sweep: Document, at: Location) -> Iterator[Problem]:
    key = str(at[-1])
    if not _KEY.fullmatch(key):
        message = f"found the key {key!r}, accepted: words joined by dots, such as brdf.mu"
        yield Problem(sweep.key_place(at), message)
    elif key.split(".")[0] == "output":
        message = "each run's folder is named by its hash; remove output here"
        yield Problem(sweep.key_place(at), message)


def _assignments(data: Mapping[str, Any]) -> list[_Assignment]:
    """What each run assigns: all combinations of a grid (the last key fastest), or a list."""
    if data.get("list") is not None:
        return [{key: ("list", i, key) for key in run} for i, run in enumerate(data["list"])]
    grid = data["grid"]
    indices = itertools.product(*(range(len(values)) for values in grid.values()))
    return [{key: ("grid", key, i) for key, i in zip(grid, several)} for several in indices]


def _assigned(base: Document, sweep: Document, assignment: _Assignment) -> Document:
    """The base with a run's values written over it, and their places."""
    document = Document(
        copy.deepcopy(base.data), dict(base.keys), dict(base.values), list(base.problems)
    )
    for key, at in assignment.items():
        parts = tuple(key.split("."))
        place = _marked(sweep.key_place(at if at[0] == "list" else at[:-1]))
        try:
            parent, location = open_section(document, parts[:-1], place)
            last = step_into(parent, parts[-1], location)
        except LookupError as error:
            document.problems.append(Problem(place, str(error.args[0])))
            continue
        parent[last] = copy.deepcopy(_at(sweep.data, at))
        document.keys[(*location, last)] = place
        _carry_places(document, (*location, last), sweep, at)
    return document


def _carry_places(document: Document, location: Location, sweep: Document, at: Location) -> None:
    """Copy the places of a value and of all that lies in it from the sweep to a run's document."""
    document.values[location] = _marked(sweep.value_place(at))
    value = _at(sweep.data, at)
    parts: list[str | int] = []
    if isinstance(value, list):
        parts += range(len(value))
    elif isinstance(value, dict):
        parts += value
        for key in value:
            document.keys[(*location, key)] = _marked(sweep.key_place((*at, key)))
    for part in parts:
        _carry_places(document, (*location, part), sweep, (*at, part))


def _marked(place: Place) -> Place:
    return Place((_SWEEP, *place.order[1:]), place.text)


def _at(data: Any, location: Location) -> Any:
    for part in location:
        data = data[part]
    return data


def _duplicates(
    sweep: Document, assignments: list[_Assignment], runs: list[SweepRun]
) -> Iterator[Problem]:
    """Runs whose configs are the same, however they are written."""
    first: dict[str, int] = {}
    for number, run in enumerate(runs):
        earlier = first.setdefault(run.config.model_dump_json(), number)
        if earlier == number:
            continue
        other = assignments[earlier]
        differing = [at for key, at in assignments[number].items() if other.get(key) != at]
        at = differing[0] if differing and differing[0][0] == "grid" else ("list", number)
        before = shown(runs[earlier].parameters)
        message = f"{shown(run.parameters)} is the same run as {before}; remove one of them"
        yield Problem(sweep.value_place(at), message)
