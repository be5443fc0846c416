"""Luminaires: the IES file, IESNA LM-63 of 1986, 1991, 1995 and 2002.

The first line names the standard, from 1991 on; then come ``[KEYWORD] text`` lines (1986: any
text) up to ``TILT=NONE``, ``TILT=INCLUDE`` or ``TILT=file``.  INCLUDE, and such a file, have: how
the lamp lies in the luminaire (1 to 3), a count, that many angles of tilt, as many factors; they
are kept and not applied, as the luminaire is taken to hang as it was measured.  Then numbers:

    lamps, lumens of each (-1: unknown), multiplier, vertical and horizontal angles (counts),
    type (1: C), units (1: feet, 2: metres), width (along Y), length (X), height (Z),
    ballast factor, ballast-lamp factor (1986 and 1991; later no factor), watts,
    vertical angles, horizontal angles (degrees), candela by horizontal, then by vertical angle.

The intensity is candela times multiplier times ballast factors.  Horizontal angles of type C say
their symmetry: 0 alone (about the axis), 0 to 90 (all quadrants alike), 0 to 180 (mirrored in the
plane of X and Z), 90 to 270 (of Y and Z), 0 to 360 (none; the last may be left out).  Angles and
frame are those of ``AngularIntensity``.  Types A and B, whose angles have other axes, are refused.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.io.numbered_words import NumberedLine, NumberedWords, read_maker_lines
from jaxrender.lighting.photometric import AngularIntensity
from jaxrender.shapes import Array, Directions, Float

_STANDARDS = {
    "IESNA91": "LM-63-1991",
    "IESNA:LM-63-1995": "LM-63-1995",
    "IESNA:LM-63-2002": "LM-63-2002",
    "IES:LM-63-2019": "LM-63-2019",
}
# The first has no line of its own.
_FIRST_STANDARD = "LM-63-1986"
# Whose thirteenth number is a factor on the light.
_WITH_LAMP_FACTOR = (_FIRST_STANDARD, "LM-63-1991")
_FOOT = 0.3048


class Tilt(NamedTuple):
    """How a lamp's light depends on the tilt of its luminaire: factors at angles in degrees."""

    geometry: int
    angles: Float[np.ndarray, "tilt"]
    factors: Float[np.ndarray, "tilt"]


class Photometry(NamedTuple):
    """A luminaire: angles in degrees as the file has them, candela with all factors applied.

    ``dimensions`` of the luminous opening are in metres along X, Y and Z (length, width, height);
    negative ones are the standard's way to say that it is round.  ``stated_lumens`` is what the
    lamps emit together, before the luminaire takes its share; None where the file does not know.
    """

    standard: str
    labels: tuple[str, ...]
    keywords: tuple[tuple[str, str], ...]
    tilt: Tilt | None
    stated_lumens: float | None
    watts: float
    dimensions: Float[np.ndarray, "3"]
    vertical: Float[np.ndarray, "vertical"]
    horizontal: Float[np.ndarray, "horizontal"]
    candela: Float[np.ndarray, "horizontal vertical"]

    def light(self) -> AngularIntensity:
        """Complete the table by its symmetry: one channel, in cd."""
        horizontal, rows = _completed(self.horizontal)
        return AngularIntensity(
            np.radians(horizontal), np.radians(self.vertical), self.candela[rows][..., None]
        )

    def intensity(self, directions: Directions) -> Float[Array, "*batch"]:
        """Interpolate along unit directions away from the luminaire, in cd."""
        return self.light().intensity(directions)[..., 0]

    def flux(self) -> float:
        """Integrate the intensity: the lumens that leave the luminaire."""
        return float(self.light().flux()[0])


def read_ies(path: str | Path) -> Photometry:
    """Read a luminaire.

    Raises InputError, with file and line, for a file that is missing, empty, binary, cut short or
    too long, without a TILT line or with a tilt file outside the file's own folder, photometry
    of type A or B, units, counts, angles or factors that mean nothing, and negative candela.
    """
    path = Path(path)
    lines = read_maker_lines(path)
    at = next((i for i, line in enumerate(lines) if line.text.startswith("TILT=")), None)
    if at is None:
        raise InputError(f"{path}: no line TILT=...; this is no IES file, or it is cut short")
    head = [line.text.strip() for line in lines[:at]]
    standard = _STANDARDS.get(head[0] if head else "", _FIRST_STANDARD)
    labels = head if standard == _FIRST_STANDARD else head[1:]
    numbers = NumberedWords(path, lines[at + 1 :])
    tilt = _tilt(path, lines[at], numbers)
    start = numbers.place()
    numbers_of_lamps, lumens, multiplier = numbers.take(3, "lamps, lumens and multiplier")
    counts = [numbers.count(f"the number of {k} angles", 1) for k in ("vertical", "horizontal")]
    kind, units, *sizes = numbers.take(5, "type, units and dimensions")
    ballast, lamp_factor, watts = numbers.take(3, "ballast factors and watts")
    _refuse_head(start, kind, units, multiplier, ballast)
    vertical = numbers.take(counts[0], "vertical angles")
    horizontal = numbers.take(counts[1], "horizontal angles")
    _refuse_angles(path, vertical, horizontal)
    candela = numbers.take(counts[0] * counts[1], "candela").reshape(counts[::-1])
    numbers.finish()
    if np.any(candela < 0):
        row, column = (int(i) for i in np.argwhere(candela < 0)[0])
        raise InputError(
            f"{path}: {candela[row, column]:g} cd at vertical angle {vertical[column]:g}, "
            f"horizontal {horizontal[row]:g}; intensities are not negative"
        )
    with np.errstate(over="ignore", invalid="ignore"):
        factor = multiplier * ballast * (lamp_factor if standard in _WITH_LAMP_FACTOR else 1)
        intensity, stated = candela * factor, numbers_of_lamps * lumens
    if not (np.isfinite(intensity).all() and np.isfinite(stated)):
        raise InputError(
            f"{start}: lamps, lumens, factors and candela multiply to no finite number; mend them"
        )
    width, length, height = np.array(sizes) * (_FOOT if units == 1 else 1)
    return Photometry(
        standard=standard,
        labels=tuple(line for line in labels if not line.startswith("[")),
        keywords=_keywords(labels),
        tilt=tilt,
        stated_lumens=float(stated) if lumens >= 0 else None,
        watts=float(watts),
        dimensions=np.array([length, width, height]),
        vertical=vertical,
        horizontal=horizontal,
        candela=intensity,
    )


def _keywords(labels: list[str]) -> tuple[tuple[str, str], ...]:
    """Part ``[KEYWORD] text``; [MORE] goes on with the keyword before it."""
    found: list[tuple[str, str]] = []
    for line in labels:
        if not line.startswith("[") or "]" not in line:
            continue
        keyword, text = (part.strip() for part in line[1:].split("]", 1))
        if keyword == "MORE" and found:
            found[-1] = (found[-1][0], f"{found[-1][1]}\n{text}")
        else:
            found.append((keyword, text))
    return tuple(found)


def _tilt(path: Path, line: NumberedLine, numbers: NumberedWords) -> Tilt | None:
    said = line.text.removeprefix("TILT=").strip()
    if said == "NONE":
        return None
    if said == "INCLUDE":
        return _tilt_from(numbers)
    wanted = path.parent / said
    try:
        is_beside = bool(said) and wanted.resolve().is_relative_to(path.parent.resolve())
        wanted.is_file()
    except (OSError, ValueError):
        # A zero byte, or more letters than a name may have.
        is_beside = False
    if not is_beside:
        raise InputError(
            f"{path}:{line.number}: TILT={said} leads outside {path.parent}; put that file beside "
            "this one, or write TILT=NONE"
        )
    found = NumberedWords(wanted, read_maker_lines(wanted))
    tilt = _tilt_from(found)
    found.finish()
    return tilt


def _tilt_from(numbers: NumberedWords) -> Tilt:
    geometry = numbers.count("the lamp's place in the luminaire", 1)
    count = numbers.count("the number of tilts", 1)
    return Tilt(geometry, numbers.take(count, "tilts"), numbers.take(count, "tilt factors"))


def _refuse_head(place: str, kind: float, units: float, multiplier: float, ballast: float) -> None:
    if kind in (2, 3):
        raise InputError(
            f"{place}: photometry of type {'B' if kind == 2 else 'A'}; only type C is read: "
            "convert the file with the maker's tools"
        )
    if kind != 1:
        raise InputError(f"{place}: photometric type {kind:g}; wanted 1 (C)")
    if units not in (1, 2):
        raise InputError(f"{place}: units {units:g}; wanted 1 (feet) or 2 (metres)")
    if min(multiplier, ballast) <= 0:
        raise InputError(
            f"{place}: multiplier {multiplier:g} and ballast factor {ballast:g}; both are positive"
        )


def _refuse_angles(
    path: Path, vertical: Float[np.ndarray, "vertical"], horizontal: Float[np.ndarray, "horizontal"]
) -> None:
    if len(vertical) < 2 or vertical[0] < 0 or vertical[-1] > 180 or np.any(np.diff(vertical) <= 0):
        raise InputError(
            f"{path}: vertical angles {vertical}; type C has at least two, ascending from the "
            "nadir, 0, to at most 180"
        )
    if np.any(np.diff(horizontal) <= 0) or _symmetry(horizontal) is None:
        raise InputError(
            f"{path}: horizontal angles {horizontal}; type C has 0 alone, 0 to 90, 0 to 180, 90 "
            "to 270 or 0 to 360, ascending"
        )


def _symmetry(horizontal: Float[np.ndarray, "horizontal"]) -> tuple[int, ...] | None:
    """Find s for which the intensity at s - h is that at h; nothing for an unknown range."""
    first, last = horizontal[0], horizontal[-1]
    if first == 0 and (last == 0 or 180 < last <= 360):
        return ()
    return {(0, 90): (180, 360), (0, 180): (360,), (90, 270): (180,)}.get((first, last))


def _completed(
    horizontal: Float[np.ndarray, "horizontal"],
) -> tuple[Float[np.ndarray, "all"], np.ndarray]:
    """Go once around: ascending angles in [0, 360), and the row that each is taken from."""
    angles, rows = horizontal, np.arange(len(horizontal))
    for mirror in _symmetry(horizontal) or ():
        angles, rows = np.concatenate([angles, mirror - angles]), np.concatenate([rows, rows])
    angles, first = np.unique(angles % 360, return_index=True)
    return angles, rows[first]
