"""What a fit has freed, and what it says of each photograph: two tables."""

import math
from typing import Any, NamedTuple

from jaxrender.pipelines.report.contents import Contents
from jaxrender.pipelines.report.wording import percent, shown

# So many numbers of a nuisance are listed; of more, their root mean square and the largest.
_LISTED = 3
# A nuisance is a fault of the capture where one of its numbers is so many standard errors from 0.
_STANDS_OUT = 4.0


class Freed(NamedTuple):
    """One nuisance, in one unit: its numbers, or how large they are, their errors and the prior."""

    name: str
    meaning: str
    unit: str
    value: str
    error: str
    prior: str


class FreedTable(NamedTuple):
    """All that was freed, and what is to be said of it."""

    rows: tuple[Freed, ...]
    sentences: tuple[str, ...]


def freed(contents: Contents) -> FreedTable | None:
    """List what was freed; None where nothing was."""
    calibration = contents.result.get("calibration")
    if not calibration:
        return None
    rows = [
        row for name, nuisance in calibration["nuisances"].items() for row in _rows(name, nuisance)
    ]
    return FreedTable(tuple(rows), tuple(calibration["sentences"]))


def _rows(name: str, nuisance: dict[str, Any]) -> list[Freed]:
    """Sort the numbers of a nuisance by their units."""
    units, found = nuisance["unit"], []
    for unit in dict.fromkeys(units):
        values, errors, priors = (
            [number for k, number in enumerate(nuisance[key]) if units[k % len(units)] == unit]
            for key in ("value", "standard_error", "prior")
        )
        value = ", ".join(shown(number, 3) for number in values)
        if len(values) > _LISTED:
            largest = max(values, key=abs)
            value = f"{shown(_rms(values), 3)} rms of {len(values)}, at most {shown(largest, 3)}"
        error, prior = shown(_rms(errors), 2), shown(_rms(priors), 2)
        found.append(Freed(name, nuisance["meaning"], unit, value, error, prior))
    return found


def faults_absorbed(contents: Contents) -> list[str]:
    """Say in plain words which faults of the capture the fit has found and allowed for."""
    calibration = contents.result.get("calibration") or {"nuisances": {}}
    said = []
    for nuisance in calibration["nuisances"].values():
        units = nuisance["unit"]
        largest: dict[str, float] = {}
        stands_out = False
        for k, (value, error) in enumerate(zip(nuisance["value"], nuisance["standard_error"])):
            unit = units[k % len(units)]
            largest[unit] = max(largest.get(unit, 0.0), abs(value))
            stands_out |= abs(value) > _STANDS_OUT * error
        if stands_out:
            most = " and ".join(f"{shown(v, 2)} {u}".strip() for u, v in largest.items())
            said.append(f"Found and allowed for: {nuisance['meaning']}, up to {most}.")
    return said


def _rms(numbers: list[float]) -> float:
    return math.sqrt(sum(number**2 for number in numbers) / len(numbers))


class PhotographRow(NamedTuple):
    """One photograph; ``width`` is its residual as a part of the largest in per cent."""

    name: str
    rms: str
    width: float
    gain: str
    turned: str


def photograph_rows(contents: Contents) -> tuple[PhotographRow, ...]:
    """List the residual of each photograph, its gain, and how far its camera was turned."""
    rows = contents.result.get("photographs", [])
    largest = max((row["relative_rms"] or 0 for row in rows), default=0) or 1
    return tuple(
        PhotographRow(
            row["name"],
            percent(row["relative_rms"]),
            100 * (row["relative_rms"] or 0) / largest,
            shown(row.get("gain")),
            shown(row.get("turned_degrees"), 2),
        )
        for row in rows
    )
