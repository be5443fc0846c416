"""Sources of light of each photograph, from files.

JSON: a list with one entry for each photograph, or an object ``{frame name: entry}``; an entry is a
list of ``{"direction": [x, y, z], "irradiance": 1 or [r, g, b]}``, empty for no light.  Irradiance
is that on a plane facing the source.  A source that is near has ``{"position": [x, y, z],
"intensity": 1 or [r, g, b]}``: its place, and the irradiance on a plane that faces it at the
distance 1.

Text: one direction ``x y z`` a line, one source for each photograph, as photometric stereo data
sets have it; a first line may state their number.  The irradiance is 1, or that of a second file
with one or three numbers a line.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.errors import InputError
from jaxrender.io.jsonfiles import is_count, read_json, read_text
from jaxrender.lighting.base import Light, LightSum
from jaxrender.lighting.directional import DirectionalSources
from jaxrender.lighting.point_sources import PointSources

# Squares of directions up to this length are numbers, also in single precision.
_LONGEST = 1e18


def read_per_frame_lights(
    path: str | Path, frame_names: Sequence[str], irradiance: str | Path | None = None
) -> tuple[Light, ...]:
    """Read the sources of each photograph, in the order of ``frame_names``.

    A file whose name ends in .json is read as JSON, any other as text.  ``irradiance`` is the
    second file of directions that are given as text.  Raises InputError with line or entry when a
    file is malformed or does not match the photographs.
    """
    path = Path(path)
    if path.suffix.lower() != ".json":
        return _from_text(path, len(frame_names), None if irradiance is None else Path(irradiance))
    if irradiance is not None:
        raise InputError(f"{path}: JSON states its own irradiance; leave {irradiance} out")
    return _from_json(path, list(frame_names))


def _from_json(path: Path, names: list[str]) -> tuple[Light, ...]:
    document = read_json(path)
    if isinstance(document, dict):
        entries = _by_name(path, document, names)
    elif isinstance(document, list):
        _check_count(path, len(document), len(names))
        entries = document
    else:
        raise InputError(
            f"{path}: wanted a list with one entry for each photograph, or an object with "
            "the names of the photographs as keys"
        )
    return tuple(
        _sources(f"{path}: entry {i} ({name})", entry)
        for i, (name, entry) in enumerate(zip(names, entries, strict=True))
    )


def _by_name(path: Path, document: dict[str, Any], names: list[str]) -> list[Any]:
    for kind, some in (
        ("no photograph is named", [key for key in document if key not in names]),
        ("no lights are given for", [name for name in names if name not in document]),
    ):
        if some:
            known = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
            raise InputError(f"{path}: {kind} {some[0]!r}; the photographs are {known}")
    return [document[name] for name in names]


# How a source is stated: where it is, how strong it is, and what it then is.
_KINDS = (
    ("direction", "irradiance", DirectionalSources),
    ("position", "intensity", PointSources),
)


def _sources(place: str, entry: Any) -> Light:
    if not isinstance(entry, list):
        raise InputError(f"{place}: wanted a list of sources, found {entry!r}")
    if not entry:
        return DirectionalSources.none()
    rows: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for i, source in enumerate(entry):
        where, vector, strength = _source(f"{place}, source {i}", source)
        rows.setdefault(where, []).append((vector, strength))
    found = [
        kind(*(np.stack(part) for part in zip(*rows[where], strict=True)))
        for where, _, kind in _KINDS
        if where in rows
    ]
    return found[0] if len(found) == 1 else LightSum(tuple(found))


def _source(place: str, source: Any) -> tuple[str, np.ndarray, np.ndarray]:
    pairs = [(where, strength) for where, strength, _ in _KINDS]
    pair = next((p for p in pairs if isinstance(source, dict) and set(source) == {*p}), None)
    if pair is None:
        raise InputError(
            f"{place}: wanted the keys direction and irradiance, or position and intensity; "
            f"found {source!r}"
        )
    where, strength = pair
    vector, value = _vector(place, where, source[where]), source[strength]
    strengths = _vector(place, strength, value if isinstance(value, list) else [value] * 3)
    if where == "direction":
        if not vector.any():
            raise InputError(f"{place}: the direction is zero")
        _check_length(place, vector)
    if (strengths < 0).any():
        raise InputError(f"{place}: the {strength} {strengths.tolist()} is negative")
    return where, vector, strengths


def _vector(place: str, key: str, value: Any) -> np.ndarray:
    numbers = value if isinstance(value, list) else [value]
    plain = [isinstance(x, int | float) and not isinstance(x, bool) for x in numbers]
    vector = np.array(numbers, np.float64) if all(plain) else np.full(1, np.nan)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{place}: `{key}` is {value!r}; wanted three finite numbers")
    return vector


def _from_text(path: Path, frames: int, irradiance: Path | None) -> tuple[DirectionalSources, ...]:
    rows = _rows(path, "direction")
    _check_count(path, len(rows), frames)
    directions = [_direction(f"{path}:{i}", words) for i, words in rows]
    lit = [np.ones(3)] * frames
    if irradiance is not None:
        rows = _rows(irradiance, "irradiance")
        _check_count(irradiance, len(rows), frames)
        lit = [_irradiance(f"{irradiance}:{i}", words) for i, words in rows]
    return tuple(
        DirectionalSources(direction[None], energy[None])
        for direction, energy in zip(directions, lit, strict=True)
    )


def _rows(path: Path, noun: str) -> list[tuple[int, list[str]]]:
    """List the lines that are not empty, numbered; one that states their count is left out."""
    lines = [
        (i, line.split()) for i, line in enumerate(read_text(path).splitlines(), 1) if line.strip()
    ]
    if not lines:
        raise InputError(f"{path}:1: the file is empty; wanted one {noun} a line")
    first, words = lines[0]
    # One number before rows of three is how many there are.
    counted = len(words) == 1 and len(lines) > 1 and len(lines[1][1]) == 3 and is_count(words[0])
    if not counted:
        return lines
    if int(words[0]) != len(lines) - 1:
        raise InputError(
            f"{path}:{first}: {words[0]} {noun}s announced, but {len(lines) - 1} follow"
        )
    return lines[1:]


def _direction(place: str, words: list[str]) -> np.ndarray:
    direction = _numbers(words)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError(
            f"{place}: wanted a direction as three finite numbers, not all zero; "
            f"found {' '.join(words)!r}"
        )
    _check_length(place, direction)
    return direction


def _check_length(place: str, direction: np.ndarray) -> None:
    """Refuse what has no length in floating point, where squares are 0 or infinite."""
    largest = np.abs(direction).max()
    if not 1 / _LONGEST <= largest <= _LONGEST:
        raise InputError(
            f"{place}: the direction {direction.tolist()} is too long or too short; give a unit "
            "vector"
        )


def _irradiance(place: str, words: list[str]) -> np.ndarray:
    values = _numbers(words)
    if values.size not in (1, 3) or not np.isfinite(values).all() or (values < 0).any():
        raise InputError(
            f"{place}: wanted an irradiance as one or three numbers, 0 or more; "
            f"found {' '.join(words)!r}"
        )
    return np.broadcast_to(values, (3,))


def _numbers(words: list[str]) -> np.ndarray:
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        return np.full(1, np.nan)


def _check_count(path: Path, found: int, wanted: int) -> None:
    if found != wanted:
        raise InputError(
            f"{path}: lights for {found} photographs, but the capture has {wanted}; one entry each"
        )
