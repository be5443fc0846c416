"""The index of a batch: ``index.nc`` for xarray, ``index.csv`` for people, a row for each run.

Dimension ``run``, labelled by the runs' names, which are their folders; what the sweep varies is
coordinates (``brdf.mu``).  Found values (``kd``, ``sigma``, ...) have a dimension ``channel`` where
any run has one value for each; ``kd_interval90`` has a last dimension ``bound``; a parameter that a
run does not have, or that failed, is NaN.  Each file is written aside and renamed: whole, or as it
was.
"""

from __future__ import annotations

import csv
import os
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5netcdf
import h5py
import numpy as np

from jaxrender.pipelines.config.sweep import as_text

INDEX_STEM = "index"
INDEX = f"{INDEX_STEM}.nc"
TABLE = f"{INDEX_STEM}.csv"


class Row(NamedTuple):
    """One run: what it differs by, how it ended, and its result where it has one."""

    name: str
    parameters: dict[str, Any]
    outcome: str
    error: str
    result: dict[str, Any]


class Column(NamedTuple):
    """Values of all runs with their dimensions; the first is ``run``."""

    dimensions: tuple[str, ...]
    values: np.ndarray
    units: str = ""


def write_index(folder: Path, keys: Sequence[str], rows: Sequence[Row]) -> None:
    """Write both files of the index; ``keys`` are what the sweep varies."""
    coordinates = {key: _coordinate([row.parameters.get(key) for row in rows]) for key in keys}
    found = _found(rows)
    with _aside(folder / INDEX) as path:
        _write_netcdf(path, rows, coordinates, found)
    with _aside(folder / TABLE) as path:
        _write_csv(path, rows, {**coordinates, **found})


def _coordinate(values: list[Any]) -> Column:
    """Numbers as numbers, anything else as text; absent means the base's own value."""
    given = [value for value in values if value is not None]
    if all(isinstance(value, bool) for value in given) and len(given) == len(values):
        return Column(("run",), np.array(values, bool))
    numbers = [isinstance(v, int | float) and not isinstance(v, bool) for v in given]
    if not given or not all(numbers):
        return _texts(["" if value is None else as_text(value) for value in values])
    if all(isinstance(value, int) for value in values):
        with_range = np.array(values)
        return Column(("run",), with_range if with_range.dtype == np.int64 else with_range * 1.0)
    return Column(("run",), np.array([np.nan if v is None else float(v) for v in values]))


def _found(rows: Sequence[Row]) -> dict[str, Column]:
    """What the runs found, by name."""
    results = [row.result for row in rows]
    columns = {
        "outcome": _texts([row.outcome for row in rows]),
        "error": _texts([row.error for row in rows]),
        "seconds": _numbers([r.get("seconds", {}).get("total") for r in results], "s"),
        "rms": _numbers([r.get("residual", {}).get("relative_rms") for r in results]),
    }
    values = [_mapping(result, "brdf") for result in results]
    intervals = [_mapping(result, "interval90") for result in results]
    known = [_mapping(result, "identifiable") for result in results]
    for name in _names(values):
        channels = _channels(run.get(name) for run in values)
        columns[name] = _values([run.get(name) for run in values], channels)
        columns[f"{name}_interval90"] = _values(
            [run.get(name) for run in intervals], channels, ("bound",)
        )
        columns[f"{name}_identifiable"] = _numbers([run.get(name) for run in known])
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


def _values(values: list[Any], channels: int | None, inner: tuple[str, ...] = ()) -> Column:
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
    return Column(("run", *named, *inner), table)


def _numbers(values: list[Any], units: str = "") -> Column:
    numbers = [np.nan if value is None else float(value) for value in values]
    return Column(("run",), np.array(numbers, float), units)


def _texts(values: list[str]) -> Column:
    return Column(("run",), np.array(values, object))


def _write_netcdf(
    path: Path, rows: Sequence[Row], coordinates: dict[str, Column], found: dict[str, Column]
) -> None:
    with h5netcdf.File(path, "w") as file:
        for column in (_texts([row.name for row in rows]), *found.values()):
            for name, length in zip(column.dimensions, column.values.shape):
                if name not in file.dimensions:
                    file.dimensions[name] = length
        _write(file, "run", _texts([row.name for row in rows]))
        if "bound" in file.dimensions:
            _write(file, "bound", Column(("bound",), np.array(["low", "high"], object)))
        for name, column in {**coordinates, **found}.items():
            variable = _write(file, name, column)
            if name in found and coordinates:
                # What xarray and CF take coordinates from.
                variable.attrs["coordinates"] = " ".join(coordinates)
            if column.units:
                variable.attrs["units"] = column.units


def _write(file: h5netcdf.File, name: str, column: Column):
    values = column.values
    if values.dtype == bool:
        # NetCDF has no truth values; this is how xarray writes and reads them.
        variable = file.create_variable(name, column.dimensions, data=values.astype(np.int8))
        variable.attrs["dtype"] = "bool"
        return variable
    kind = h5py.string_dtype() if values.dtype == object else values.dtype
    return file.create_variable(name, column.dimensions, kind, data=values)


def _write_csv(path: Path, rows: Sequence[Row], columns: dict[str, Column]) -> None:
    flat = {name: values for key, one in columns.items() for name, values in _flat(key, one)}
    with path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(["run", *flat])
        for number, row in enumerate(rows):
            table.writerow([row.name, *(_cell(values[number]) for values in flat.values())])


def _flat(name: str, column: Column) -> Iterable[tuple[str, np.ndarray]]:
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


@contextmanager
def _aside(path: Path):
    """A file to write to, which takes its name when the block ends without an error."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.unfinished-", dir=path.parent)
    os.close(handle)
    aside = Path(name)
    try:
        yield aside
        mask = os.umask(0)
        os.umask(mask)
        aside.chmod(0o666 & ~mask)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)
