"""Measured reflectance at scattered pairs of directions: the Cornell text format.

``#`` opens a comment.  A number n, then n wavelengths in nm; then one line for each measurement:
theta_i phi_i theta_s phi_s (radians; s is the reflected direction), n values of the BRDF in 1/sr.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.io.jsonfiles import is_count, read_text
from jaxrender.shapes import Float

_HALF_PI = math.pi / 2
# Bytes by which a binary file is known.
_LOOKED_AT = 4096
# Azimuths are written from -pi to pi or from 0 to 2 pi, with as many digits as a file has.
_LARGEST_AZIMUTH = 2 * math.pi + 1e-4


class ScatteredMeasurements(NamedTuple):
    """Local unit directions (+Z the normal) and the BRDF there in 1/sr at ``wavelengths`` in nm."""

    incoming: Float[np.ndarray, "measurement 3"]
    outgoing: Float[np.ndarray, "measurement 3"]
    wavelengths: Float[np.ndarray, "wavelength"]
    values: Float[np.ndarray, "measurement wavelength"]


class _Line(NamedTuple):
    """Where a line stands in its file, and its words."""

    place: str
    words: list[str]


def read_cornell(path: str | Path) -> ScatteredMeasurements:
    """Read measurements; values that are negative stay as they are.

    Raises InputError, with file and line, for a file that is missing, empty, binary or cut short,
    a row with too few or too many numbers, one that is not finite, wavelengths that do not ascend,
    and polar angles outside [0, pi/2) or azimuths beyond 2 pi.
    """
    lines = _lines(Path(path))
    wavelengths, rows = _header(Path(path), lines)
    if not rows:
        raise InputError(f"{path}: no measurement after the wavelengths; the file is cut short")
    width = 4 + len(wavelengths)
    for place, words in rows:
        if len(words) != width:
            raise InputError(
                f"{place}: {len(words)} numbers; a row has {width}, four angles and "
                f"{len(wavelengths)} values"
            )
    table = np.array([_numbers(row) for row in rows])
    _refuse_angles(rows, table[:, :4])
    return ScatteredMeasurements(
        _directions(table[:, 0], table[:, 1]),
        _directions(table[:, 2], table[:, 3]),
        wavelengths,
        table[:, 4:],
    )


def _lines(path: Path) -> list[_Line]:
    """Split a text into the lines that have words."""
    start = b""
    if path.is_file():
        with path.open("rb") as file:
            start = file.read(_LOOKED_AT)
    if b"\0" in start:
        raise InputError(
            f"{path}: a binary file where text is expected (byte {start.index(0)} is 0); "
            "MERL's .binary files have a reader of their own, read_merl"
        )
    text = read_text(path)
    numbered = enumerate((line.split("#")[0].split() for line in text.splitlines()), start=1)
    lines = [_Line(f"{path}:{number}", words) for number, words in numbered if words]
    if not lines:
        raise InputError(f"{path}: no number in it; give a file of measurements")
    return lines


def _header(path: Path, lines: list[_Line]) -> tuple[Float[np.ndarray, "wavelength"], list[_Line]]:
    """Take the wavelengths off the top, which may be split over lines anywhere."""
    first = lines[0]
    if not is_count(first.words[0]):
        raise InputError(
            f"{first.place}: found {first.words[0]!r}; the first number counts the wavelengths"
        )
    count, found = int(first.words[0]), list(_numbers(first)[1:])
    following = 1
    while len(found) < count:
        if following == len(lines):
            raise InputError(
                f"{path}: {len(found)} wavelengths where the first number says {count}; "
                "the file is cut short"
            )
        found += _numbers(lines[following])
        following += 1
    last = lines[following - 1].place
    if len(found) > count:
        raise InputError(
            f"{last}: the wavelengths end within this line, after {count}; start the rows on a "
            "line of their own"
        )
    if not (found[0] > 0 and np.all(np.diff(found) > 0)):
        raise InputError(f"{last}: wavelengths {found[0]:g} to {found[-1]:g} nm; they must ascend")
    return np.array(found), lines[following:]


def _numbers(line: _Line) -> list[float]:
    found = []
    for word in line.words:
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise InputError(
                f"{line.place}: found {word!r}; wanted a finite number. Take the row out, or mark "
                "the value as missing by a negative one"
            )
        found.append(value)
    return found


def _refuse_angles(rows: list[_Line], angles: Float[np.ndarray, "row 4"]) -> None:
    polar, azimuth = angles[:, [0, 2]], angles[:, [1, 3]]
    outside = {
        "theta": (polar, (polar < 0) | (polar >= _HALF_PI), "[0, pi/2)"),
        "phi": (azimuth, np.abs(azimuth) > _LARGEST_AZIMUTH, "[-2 pi, 2 pi]"),
    }
    for name, (values, wrong, interval) in outside.items():
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            raise InputError(
                f"{rows[row].place}: {name}_{'is'[column]} is {values[row, column]:g}; it lies in "
                f"{interval}: angles are in radians, from the normal, above the surface"
            )


def _directions(
    polar: Float[np.ndarray, "row"], azimuth: Float[np.ndarray, "row"]
) -> Float[np.ndarray, "row 3"]:
    sine = np.sin(polar)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=-1)
