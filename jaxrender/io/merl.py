"""The MERL database's ``.binary``: Matusik et al., A Data-Driven Reflectance Model (2003).

Little-endian: three int32, the nodes 90 of theta_h, 90 of theta_d and 180 of phi_d; then float64
[red, green, blue][theta_h][theta_d][phi_d].  The BRDF in 1/sr is the number times 1/1500,
1.15/1500 and 1.66/1500; a negative number is no measurement.  An entry is the value at its node of
``IsotropicTable``, the lower corner of the cell that a look-up without interpolation takes it for.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, IsotropicTable
from jaxrender.brdf.tables.isotropic import nearest_known
from jaxrender.errors import InputError
from jaxrender.io.atomic import replacing
from jaxrender.shapes import Bool, Float

DIMENSIONS = (90, 90, 180)
# 1/sr for each unit of red, green and blue.
SCALES = np.array([1.0, 1.15, 1.66]) / 1500

_HEADER = np.dtype("<i4")
_NUMBER = np.dtype("<f8")
_HEADER_BYTES = 3 * _HEADER.itemsize
_FILE_BYTES = _HEADER_BYTES + 3 * int(np.prod(DIMENSIONS)) * _NUMBER.itemsize
_MISSING = -1.0


class MerlTable(NamedTuple):
    """The file's own numbers, so that they can be written back bit for bit."""

    raw: Float[np.ndarray, "3 90 90 180"]

    @classmethod
    def of(cls, brdf: BRDF) -> "MerlTable":
        """Tabulate an isotropic BRDF of three channels; nodes below the horizon are negative.

        Raises ``ValueError`` for another number of channels and for an anisotropic BRDF.
        """
        channels = brdf.amplitudes.shape[1]
        if channels != 3:
            raise ValueError(f"the BRDF has {channels} channels; a MERL file has three, RGB")
        values = np.asarray(IsotropicTable.of(brdf, DIMENSIONS).values, float)
        raw = np.moveaxis(values / SCALES, -1, 0)
        return cls(np.where(_above_horizon(), raw, _MISSING))

    @property
    def invalid(self) -> Bool[np.ndarray, "90 90 180"]:
        """Where any channel is not a measurement."""
        return np.any(self.raw < 0, axis=0)

    def brdf(self) -> IsotropicTable:
        """Make the table in 1/sr, what is missing filled in from measured neighbours.

        They are the next at a smaller theta_d, else the next at a larger one, else those at the
        nearest smaller or larger theta_h; zero in a file without any.
        """
        invalid = self.invalid
        values = np.moveaxis(np.where(invalid, 0, self.raw), 0, -1) * SCALES
        return IsotropicTable(values.reshape(-1, 3)[nearest_known(~invalid)])


def read_merl(path: str | Path) -> MerlTable:
    """Read a MERL file.

    Raises InputError for a file that is missing or too short, another size than its header's, other
    dimensions, and a number that is not finite (with its offset in bytes).
    """
    return MerlTable(np.array(map_merl(path)))


def map_merl(path: str | Path) -> Float[np.ndarray, "3 90 90 180"]:
    """Map the numbers of a MERL file into memory, which takes none until they are looked at.

    Raises ``InputError`` as :func:`read_merl` does.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    size = path.stat().st_size
    if size < _HEADER_BYTES:
        raise InputError(
            f"{path}: {size} bytes; the header alone has {_HEADER_BYTES}: the file is cut short"
        )
    with path.open("rb") as file:
        dimensions = tuple(int(n) for n in np.frombuffer(file.read(_HEADER_BYTES), _HEADER))
        if dimensions != DIMENSIONS:
            raise InputError(
                f"{path}: bytes 0 to {_HEADER_BYTES - 1} say {dimensions} nodes; a MERL .binary "
                f"says {DIMENSIONS}. For text files of measurements use read_cornell"
            )
        if size != _FILE_BYTES:
            raise InputError(
                f"{path}: {size} bytes where the header makes {_FILE_BYTES}; fetch the file again"
            )
    raw = np.memmap(path, _NUMBER, "r", _HEADER_BYTES)
    finite = np.isfinite(raw)
    if not finite.all():
        first = int(np.argmin(finite))
        raise InputError(
            f"{path}: {raw[first]} at byte {_HEADER_BYTES + first * _NUMBER.itemsize}; wanted a "
            "finite number: fetch the file again, or mark the entry as missing by -1"
        )
    return raw.reshape(3, *DIMENSIONS)


def write_merl(path: str | Path, table: MerlTable) -> None:
    """Write a MERL file, whole or not at all.

    Raises InputError where the folder is missing.
    """
    with replacing(Path(path)) as aside, aside.open("wb") as file:
        np.array(DIMENSIONS, _HEADER).tofile(file)
        np.ascontiguousarray(table.raw, _NUMBER).tofile(file)


def _above_horizon() -> Bool[np.ndarray, "90 90 180"]:
    """Say at which nodes both directions are: tan t_h tan t_d |cos p_d| < 1."""
    i, j, k = (np.arange(n) / n for n in DIMENSIONS)
    theta_h, theta_d, phi_d = np.pi / 2 * i**2, np.pi / 2 * j, np.pi * k
    steepness = np.outer(np.tan(theta_h), np.tan(theta_d))
    return steepness[:, :, None] * np.abs(np.cos(phi_d)) < 1
