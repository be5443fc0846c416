"""Response curves: which radiance a stored value stands for, as a table in a text file."""

from pathlib import Path

import numpy as np

from jaxrender.errors import InputError
from jaxrender.imaging import Curve


def read_curve(path: str | Path) -> Curve:
    """Read a response curve: one line ``value radiance`` for each known value, ascending.

    Values are on the image's scale from 0 to 1; ``#`` starts a comment.  Raises InputError for a
    missing file, a line that is not two numbers, and a table that does not ascend.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a response curve: {error}") from None
    rows = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            value, radiance = (float(word) for word in words)
        except ValueError:
            raise InputError(
                f"{path}:{number}: found {line.strip()!r}; each line is two numbers, value radiance"
            ) from None
        rows.append((value, radiance))
    try:
        values, radiances = np.array(rows, float).reshape(-1, 2).T
        return Curve(values, radiances)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
