"""Directional lights of each photograph, from files.

JSON: a list with one entry for each photograph, or an object ``{frame name: entry}``; an entry is a
list of ``{"direction": [x, y, z], "irradiance": 1 or [r, g, b]}``, empty for no light.  Irradiance
is that on a plane facing the source.

Text: the number of photographs on the first line, then one direction ``x y z`` a line: one source
of unit irradiance for each photograph, as photometric stereo data sets have it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.errors import InputError
from jaxrender.io.jsonfiles import read_json, read_text
from jaxrender.lighting.directional import DirectionalSources


def read_per_frame_lights(
    path: str | Path, frame_names: Sequence[str]
) -> tuple[DirectionalSources, ...]:
    """Read the sources of each photograph, in the order of ``frame_names``.

    A file whose name ends in .json is read as JSON, any other as text.  Raises InputError with
    line or entry when the file is malformed or does not match the photographs.
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        return _from_json(path, list(frame_names))
    return _from_text(path, len(frame_names))


def _from_json(path: Path, names: list[str]) -> tuple[DirectionalSources, ...]:
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


def _sources(place: str, entry: Any) -> DirectionalSources:
    if not isinstance(entry, list):
        raise InputError(f"{place}: wanted a list of sources, found {entry!r}")
    if not entry:
        return DirectionalSources.none()
    pairs = [_source(f"{place}, source {i}", source) for i, source in enumerate(entry)]
    directions, irradiance = (np.stack(part) for part in zip(*pairs, strict=True))
    return DirectionalSources(directions, irradiance)


def _source(place: str, source: Any) -> tuple[np.ndarray, np.ndarray]:
    keys = {"direction", "irradiance"}
    if not isinstance(source, dict) or set(source) != keys:
        raise InputError(f"{place}: wanted the keys direction and irradiance, found {source!r}")
    direction = _vector(place, "direction", source["direction"])
    value = source["irradiance"]
    irradiance = _vector(place, "irradiance", value if isinstance(value, list) else [value] * 3)
    if not direction.any():
        raise InputError(f"{place}: the direction is zero")
    if (irradiance < 0).any():
        raise InputError(f"{place}: the irradiance {irradiance.tolist()} is negative")
    return direction, irradiance


def _vector(place: str, key: str, value: Any) -> np.ndarray:
    numbers = value if isinstance(value, list) else [value]
    plain = [isinstance(x, int | float) and not isinstance(x, bool) for x in numbers]
    vector = np.array(numbers, np.float64) if all(plain) else np.full(1, np.nan)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{place}: `{key}` is {value!r}; wanted three finite numbers")
    return vector


def _from_text(path: Path, frames: int) -> tuple[DirectionalSources, ...]:
    lines = [
        (i, line.split()) for i, line in enumerate(read_text(path).splitlines(), 1) if line.strip()
    ]
    if not lines or len(lines[0][1]) != 1 or not lines[0][1][0].isdigit():
        raise InputError(f"{path}:1: wanted the number of photographs on the first line")
    stated = int(lines[0][1][0])
    if stated != len(lines) - 1:
        raise InputError(
            f"{path}:{lines[0][0]}: {stated} directions announced, but {len(lines) - 1} follow"
        )
    _check_count(path, stated, frames)
    unit = np.ones((1, 3))
    return tuple(
        DirectionalSources(_direction(f"{path}:{i}", words)[None], unit) for i, words in lines[1:]
    )


def _direction(place: str, words: list[str]) -> np.ndarray:
    try:
        direction = np.array([float(word) for word in words])
    except ValueError:
        direction = np.full(1, np.nan)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError(
            f"{place}: wanted a direction as three finite numbers, not all zero; "
            f"found {' '.join(words)!r}"
        )
    return direction


def _check_count(path: Path, found: int, wanted: int) -> None:
    if found != wanted:
        raise InputError(
            f"{path}: lights for {found} photographs, but the capture has {wanted}; one entry each"
        )
