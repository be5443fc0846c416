"""Response curves: which radiance a stored value stands for, as a table in a text file.

# value radiance            or        # value red green blue
0 0                                   0 0 0 0
0.5 0.2                               0.5 0.21 0.2 0.19
1 1                                   1 1 1 1
"""

from pathlib import Path

import numpy as np

from jaxrender.errors import InputError
from jaxrender.imaging import Curve
from jaxrender.io.atomic import replacing
from jaxrender.io.jsonfiles import read_text

_COLUMNS = (2, 4)
# Digits that bring back the very number.
_DIGITS = 17


def read_curve(path: str | Path) -> Curve:
    """Read a response curve: one line ``value radiance`` for each known value, ascending.

    A line may have a radiance for each of red, green and blue.  Values are on the image's scale
    from 0 to 1; ``#`` starts a comment.  Raises InputError for a missing file, a line that is not
    two or four numbers, lines of unlike length, and a table that does not ascend.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) not in _COLUMNS:
            raise InputError(
                f"{path}:{number}: found {line.strip()!r}; each line is two numbers, value "
                "radiance, or four, value red green blue"
            )
        if rows and len(row) != len(rows[0]):
            raise InputError(
                f"{path}:{number}: {len(row)} numbers, after lines of {len(rows[0])}: give all "
                "lines as many"
            )
        rows.append(row)
    try:
        table = np.array(rows, float).reshape(len(rows), -1) if rows else np.empty((0, 2))
        columns = table[:, 1:] if table.shape[1] > _COLUMNS[0] else table[:, 1]
        return Curve(table[:, 0], columns)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def write_curve(path: str | Path, curve: Curve, comment: str = "") -> None:
    """Write a curve as ``read_curve`` reads it, each line of the comment after a ``#``.

    Raises InputError where the folder is missing, and ValueError for a curve of two channels, or of
    more than three.
    """
    columns = curve.radiance.reshape(len(curve.values), -1)
    if 1 + columns.shape[1] not in _COLUMNS:
        raise ValueError(f"a curve of {columns.shape[1]} channels: a file holds one or three")
    names = "value radiance" if columns.shape[1] == 1 else "value red green blue"
    lines = [f"# {line}" for line in [*comment.splitlines(), names]]
    for row in np.column_stack([curve.values, columns]).tolist():
        lines.append(" ".join(f"{number:.{_DIGITS}g}" for number in row))
    with replacing(Path(path)) as aside:
        aside.write_text("\n".join(lines) + "\n", encoding="utf-8")
