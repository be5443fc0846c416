"""ALTA's text files of measured reflectance: one pair of directions and its values a line.

``#`` and a word open a line of the header, ``#`` and a blank a comment.  ``#DIM x y`` counts the
coordinates and the values of a row, ``#PARAM_IN`` names the coordinates, ``#PARAM_OUT`` the values;
``#VS`` (a number, or one for each value) says that 1 or 2 numbers on the error of each value
follow, which are read past.  ``alta_parametrisations`` has the coordinates that are known; ALTA's
other ones and its binary files are refused.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.errors import InputError
from jaxrender.io.alta_parametrisations import COORDINATES, PARAMETRISATIONS, meaningless
from jaxrender.io.atomic import replacing
from jaxrender.io.jsonfiles import is_count, read_text
from jaxrender.shapes import Float

_LOOKED_AT = 4096
_COSINE_WEIGHTED = "INV_STERADIAN_COSINE_FACTOR"
_QUANTITIES = ("INV_STERADIAN", _COSINE_WEIGHTED, "RGB_COLOR")


class AltaMeasurements(NamedTuple):
    """Local unit directions above the horizon (+Z the normal) and the BRDF there in 1/sr.

    Negative values stay as they are.  ``below_horizon`` counts the rows that were left out because
    a direction of theirs is not above the surface: grids over half angles have such.
    """

    incoming: Float[np.ndarray, "measurement 3"]
    outgoing: Float[np.ndarray, "measurement 3"]
    values: Float[np.ndarray, "measurement channel"]
    below_horizon: int = 0

    @classmethod
    def of(
        cls,
        brdf: BRDF,
        incoming: Float[np.ndarray, "measurement 3"],
        outgoing: Float[np.ndarray, "measurement 3"],
    ) -> "AltaMeasurements":
        """Sample any BRDF at pairs of unit directions.

        Raises ``ValueError`` for a direction that is not above the horizon.
        """
        for name, directions in (("incoming", incoming), ("outgoing", outgoing)):
            if not np.all(directions[:, 2] > 0):
                row = int(np.argmin(directions[:, 2] > 0))
                raise ValueError(f"{name}[{row}] is {directions[row]}: give directions with z > 0")
        return cls(incoming, outgoing, np.asarray(brdf.evaluate(incoming, outgoing), float))


def read_alta(path: str | Path) -> AltaMeasurements:
    """Read measurements.

    Raises InputError, with file and line, for a file that is missing, empty, binary or cut short,
    a header without what is needed, a parametrisation or a quantity that is not listed above, rows
    of another length than the header says, numbers that are not finite, and coordinates that
    stand for no pair of directions.
    """
    path = Path(path)
    header, lines = _sections(path)
    name = _listed(path, header, "PARAM_IN", tuple(PARAMETRISATIONS))
    quantity = _listed(path, header, "PARAM_OUT", _QUANTITIES)
    coordinates, channels = _dimensions(path, header)
    width, pair_of = PARAMETRISATIONS[name]
    if coordinates != width:
        raise InputError(f"{path}: #DIM says {coordinates} coordinates; {name} has {width}")
    if quantity == "RGB_COLOR" and channels != 3:
        raise InputError(f"{path}: #DIM says {channels} values; RGB_COLOR has 3")
    length = width + channels + _extra_columns(path, header, channels)
    table = np.array([_numbers(path, *line, length) for line in lines])
    wrong, wanted = meaningless(name, table[:, :width])
    if wrong.any():
        row = int(np.argmax(wrong))
        found = table[row, :width]
        raise InputError(f"{path}:{lines[row][0]}: {found}; {name} wants {wanted}")
    outgoing, incoming = pair_of(table[:, :width])
    above = (incoming[:, 2] > 0) & (outgoing[:, 2] > 0)
    if not above.any():
        raise InputError(f"{path}: no row has both directions above the surface; check #PARAM_IN")
    values = table[above, width : width + channels]
    if quantity == _COSINE_WEIGHTED:
        values = values / outgoing[above, 2:]
    return AltaMeasurements(incoming[above], outgoing[above], values, int(np.sum(~above)))


def write_alta(
    path: str | Path,
    measurements: AltaMeasurements,
    parametrisation: str = "SPHERICAL_TL_PL_TV_PV",
) -> None:
    """Write measurements with 17 significant digits, whole or not at all.

    Three channels are called ``RGB_COLOR``, any other number ``INV_STERADIAN``.  Raises
    ``ValueError`` for a parametrisation but the default and ``CARTESIAN``, and for values that are
    not finite; InputError where the folder is missing.
    """
    path = Path(path)
    if parametrisation not in COORDINATES:
        raise ValueError(f"parametrisation={parametrisation!r}: choose of {', '.join(COORDINATES)}")
    coordinates = COORDINATES[parametrisation](measurements.outgoing, measurements.incoming)
    table = np.concatenate([coordinates, measurements.values], axis=1)
    if not np.isfinite(table).all():
        row = int(np.argmin(np.isfinite(table).all(axis=1)))
        raise ValueError(f"measurement {row} is {table[row]}: only finite numbers can be written")
    channels = measurements.values.shape[1]
    header = (
        f"#ALTA HEADER BEGIN\n#DIM {coordinates.shape[1]} {channels}\n"
        f"#PARAM_IN {parametrisation}\n"
        f"#PARAM_OUT {'RGB_COLOR' if channels == 3 else 'INV_STERADIAN'}\n"
        "#VS 0\n#ALTA HEADER END\n"
    )
    with replacing(path) as aside, aside.open("w", encoding="ascii", newline="\n") as file:
        file.write(header)
        np.savetxt(file, table, "%.17g")


def _sections(path: Path) -> tuple[dict[str, list[str]], list[tuple[int, list[str]]]]:
    """Part a file into the words after each key of its header, and the words of each row."""
    if path.is_file():
        with path.open("rb") as file:
            start = file.read(_LOOKED_AT)
        if b"\0" in start or b"#FORMAT binary" in start:
            raise InputError(f"{path}: a binary file; save it as text, which is ALTA's default")
    header: dict[str, list[str]] = {}
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split()
        if line.startswith("#"):
            if words[0] != "#" and not rows:
                header[words[0][1:]] = words[1:]
        elif words:
            rows.append((number, words))
    if not header:
        raise InputError(f"{path}: no header; an ALTA file opens with lines like `#DIM 4 3`")
    if not rows:
        raise InputError(f"{path}: no row after the header; the file is cut short")
    return header, rows


def _listed(path: Path, header: dict[str, list[str]], key: str, choices: tuple[str, ...]) -> str:
    found = header.get(key, [])
    if len(found) != 1 or found[0] not in choices:
        said = " ".join(found) or "nothing"
        raise InputError(f"{path}: #{key} says {said}; known are {', '.join(choices)}")
    return found[0]


def _dimensions(path: Path, header: dict[str, list[str]]) -> tuple[int, int]:
    words = header.get("DIM", [])
    if len(words) != 2 or not all(map(is_count, words)):
        said = " ".join(words) or "nothing"
        raise InputError(f"{path}: #DIM says {said}; wanted two counts, coordinates and values")
    return int(words[0]), int(words[1])


def _extra_columns(path: Path, header: dict[str, list[str]], channels: int) -> int:
    """Count the numbers on errors in a row: one kind for every value, or one for each."""
    words = header.get("VS", ["0"])
    if len(words) not in (1, channels) or not set(words) <= {"0", "1", "2"}:
        raise InputError(
            f"{path}: #VS says {' '.join(words)}; wanted 0, 1 or 2, once or for each value"
        )
    return sum(int(word) for word in words) * (channels if len(words) == 1 else 1)


def _numbers(path: Path, number: int, words: list[str], length: int) -> list[float]:
    if len(words) != length:
        raise InputError(
            f"{path}:{number}: {len(words)} numbers; a row has {length} by #DIM and #VS"
        )
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = [np.nan]
    if not np.isfinite(found).all():
        raise InputError(f"{path}:{number}: {' '.join(words)!r}; wanted finite numbers")
    return found
