"""The UTIA database's ``.bin``: Filip and Vavra, Template-Based Sampling of Anisotropic BRDFs.

Little-endian float64 and nothing else, [red, green, blue][theta_i][phi_i][theta_v][phi_v]: polar
angles 0, 15, ... 75 degrees and azimuths 0, 7.5, ... 352.5 of the light (i) and of the view (v), at
the nodes of ``PolarNodesTable``.  RGB is linear.  Noise makes some entries negative; the table has
0 in their place, and they are counted.  The numbers are taken to be in 1/sr as they stand, which
their description does not say: look at ``max_albedo``, and give a scale where it matters.  Beyond
75 degrees nothing was measured: the value there is held.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf.tables.polar_nodes import PolarNodesTable
from jaxrender.errors import InputError
from jaxrender.shapes import Float

N_POLAR, N_AZIMUTH = 6, 48
LARGEST_POLAR = float(np.radians(75))

_NUMBER = np.dtype("<f8")
_SHAPE = (3, N_POLAR, N_AZIMUTH, N_POLAR, N_AZIMUTH)
_FILE_BYTES = int(np.prod(_SHAPE)) * _NUMBER.itemsize


class UtiaTable(NamedTuple):
    """The file's own numbers [channel, theta_i, phi_i, theta_v, phi_v]."""

    raw: Float[np.ndarray, "3 6 48 6 48"]

    @property
    def negative(self) -> int:
        """How many entries are below zero."""
        return int(np.sum(self.raw < 0))

    def brdf(self, scale: float = 1.0) -> PolarNodesTable:
        """Make the table in 1/sr, 0 where the file is negative.

        Raises ``ValueError`` for a scale that is not positive.
        """
        if not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"scale={scale}: give a positive number")
        return PolarNodesTable(np.moveaxis(np.maximum(self.raw, 0) * scale, 0, -1), LARGEST_POLAR)


def read_utia(path: str | Path) -> UtiaTable:
    """Read a UTIA file.

    Raises InputError for a file that is missing or of another size, and a number that is not finite
    (with its offset in bytes).
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    size = path.stat().st_size
    if size != _FILE_BYTES:
        raise InputError(
            f"{path}: {size} bytes; a UTIA .bin of 3 x 288 x 288 numbers has {_FILE_BYTES}: fetch "
            "the file again"
        )
    raw = np.fromfile(path, _NUMBER)
    finite = np.isfinite(raw)
    if not finite.all():
        first = int(np.argmin(finite))
        raise InputError(
            f"{path}: {raw[first]} at byte {first * _NUMBER.itemsize}; wanted a finite number: "
            "fetch the file again"
        )
    return UtiaTable(raw.astype(float, copy=False).reshape(_SHAPE))
