"""The index of a batch: ``index.nc`` for xarray, ``index.csv`` for people, a row for each run.

The names of the runs, which are their folders, label the dimension ``run``.  The varied keys are
coordinates (``brdf.mu``).  Found values (``kd``, ``sigma``, ...) have a dimension ``channel`` if
any run has one value for each channel.  ``kd_interval90`` has a last dimension ``bound``.  Missing
values are NaN.  Each file is written aside and then renamed, so that it is always whole.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.io.atomic import replacing
from jaxrender.io.netcdf import Format, Group, Variable, write
from jaxrender.pipelines.config.sweep import as_text

INDEX_STEM = "index"
INDEX = f"{INDEX_STEM}.nc"
TABLE = f"{INDEX_STEM}.csv"
FORMAT = Format("jaxrender batch index", 1, "jaxrender batch")
_RUN = ("run",)


class Row(NamedTuple):
    """One run: its changes, its outcome, and its result where it has one."""

    name: str
    parameters: dict[str, Any]
    outcome: str
    error: str
    result: dict[str, Any]


def write_index(folder: Path, keys: Sequence[str], rows: Sequence[Row]) -> None:
    """Write both files of the index; ``keys`` are the keys that the sweep varies."""
    coordinates = {key: _coordinate(key, [row.parameters.get(key) for row in rows]) for key in keys}
    found = _found(rows)
    columns = {**coordinates, **found}
    labels = {"run": _texts([row.name for row in rows], "name of the run and of its folder")}
    if any("bound" in column.dimensions for column in columns.values()):
        labels["bound"] = Variable(("bound",), ["low", "high"], "", "which end of an interval")
    # What xarray and CF take coordinates from.
    named = {name: column._replace(coordinates=tuple(keys)) for name, column in found.items()}
    write(folder / INDEX, FORMAT, Group({**labels, **coordinates, **named}))
    with replacing(folder / TABLE) as path:
        _write_csv(path, rows, columns)


def _coordinate(key: str, values: list[Any]) -> Variable:
    """Lay out numbers as numbers, anything else as text; absent is the value of the base."""
    words = f"{key} as the sweep sets it"
    given = [value for value in values if value is not None]
    if all(isinstance(value, bool) for value in given) and len(given) == len(values):
        return Variable(_RUN, np.array(values, bool), "", words)
    numbers = [isinstance(v, int | float) and not isinstance(v, bool) for v in given]
    if not given or not all(numbers):
        return _texts(["" if value is None else as_text(value) for value in values], words)
    if all(isinstance(value, int) for value in values):
        with_range = np.array(values)
        whole = with_range if with_range.dtype == np.int64 else with_range * 1.0
        return Variable(_RUN, whole, "", words)
    return _numbers(values, "", words)


def _found(rows: Sequence[Row]) -> dict[str, Variable]:
    """Lay out the found values by name."""
    results = [row.result for row in rows]
    seconds = [r.get("seconds", {}).get("total") for r in results]
    rms = [r.get("residual", {}).get("relative_rms") for r in results]
    columns = {
        "outcome": _texts([row.outcome for row in rows], "how the run ended"),
        "error": _texts([row.error for row in rows], "why the run failed"),
        "seconds": _numbers(seconds, "s", "duration of the run"),
        "rms": _numbers(rms, "1", "rms of the residual over that of the radiance"),
    }
    values = [_mapping(result, "brdf") for result in results]
    intervals = [_mapping(result, "interval90") for result in results]
    known = [_mapping(result, "identifiable") for result in results]
    for name in _names(values):
        channels = _channels(run.get(name) for run in values)
        own, bounds = ([run.get(name) for run in each] for each in (values, intervals))
        columns[name] = _values(own, channels, f"{name} that the fit found")
        words = f"90 % interval of {name}"
        columns[f"{name}_interval90"] = _values(bounds, channels, words, ("bound",))
        identifiable = [run.get(name) for run in known]
        words = f"whether {name} is identifiable"
        columns[f"{name}_identifiable"] = _numbers(identifiable, "1", words)
    return columns


def _mapping(result: dict[str, Any], key: str) -> dict[str, Any]:
    found = result.get(key)
    return found if isinstance(found, dict) else {}


def _names(values: Iterable[dict[str, Any]]) -> list[str]:
    """Every parameter that some run has a number for, in the order of the results."""
    names = dict.fromkeys(
        name for run in values for name, value in run.items() if _is_number(value)
    )
    return list(names)


def _is_number(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(_is_number(item) for item in value)
    return isinstance(value, int | float) and not isinstance(value, bool)


def _channels(values: Iterable[Any]) -> int | None:
    """How many channels a parameter has; None if it is one number in all runs."""
    return max((len(value) for value in values if isinstance(value, list)), default=None)


def _values(
    values: list[Any], channels: int | None, words: str, inner: tuple[str, ...] = ()
) -> Variable:
    """Numbers of all runs; one number for all channels is repeated for each."""
    shape = (() if channels is None else (channels,)) + ((2,) if inner else ())
    table = np.full((len(values), *shape), np.nan)
    for row, value in enumerate(values):
        if value is None or isinstance(value, str):
            continue
        numbers = np.array(value, float)
        if channels is not None and numbers.ndim == len(inner):
            numbers = numbers[None]
        table[row] = numbers
    named = () if channels is None else ("channel" if channels == 3 else f"channel_{channels}",)
    return Variable((*_RUN, *named, *inner), table, "", words)


def _numbers(values: list[Any], units: str, words: str) -> Variable:
    numbers = [np.nan if value is None else float(value) for value in values]
    return Variable(_RUN, np.array(numbers, float), units, words)


def _texts(values: list[str], words: str) -> Variable:
    return Variable(_RUN, np.array(values, object), "", words)


def _write_csv(path: Path, rows: Sequence[Row], columns: dict[str, Variable]) -> None:
    flat = {name: values for key, one in columns.items() for name, values in _flat(key, one)}
    with path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(["run", *flat])
        for number, row in enumerate(rows):
            table.writerow([row.name, *(_cell(values[number]) for values in flat.values())])


def _flat(name: str, column: Variable) -> Iterable[tuple[str, np.ndarray]]:
    """A column for each channel and bound, such as kd[0] and kd_interval90[0].low."""
    for inner in np.ndindex(column.values.shape[1:]):
        words = ""
        for dimension, index in zip(column.dimensions[1:], inner):
            words += (".low", ".high")[index] if dimension == "bound" else f"[{index}]"
        yield name + words, column.values[(slice(None), *inner)]


def _cell(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else f"{value:.8g}"
    return value
