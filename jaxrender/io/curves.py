"""Response curves: which radiance a stored value stands for, as a table in a text file."""

from pathlib import Path

import numpy as np

from jaxrender.errors import InputError
from jaxrender.imaging import Curve
from jaxrender.io.jsonfiles import read_text


def read_curve(path: str | Path) -> Curve:
    """Read a response curve: one line ``value radiance`` for each known value, ascending.

    Values are on the image's scale from 0 to 1; ``#`` starts a comment.  Raises InputError for a
    missing file, a line that is not two numbers, and a table that does not ascend.
    """
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
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
