"""Tables of a BRDF over two directions as NetCDF files of named arrays, to be used without us.

``brdf`` [kappa_i, lambda_i, kappa_r, lambda_r, channel] is rho in 1/sr at the centres of the cells
of an ``embedding`` of the hemisphere, ``standard_error`` of the same shape where there is one; all
else is attributes, with a sentence for each convention.  A number that is negative or not finite is
no measurement: reading makes it zero and counts it.
"""

import os
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import h5netcdf
import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import EMBEDDINGS, NUSSELT, Embedding
from jaxrender.shapes import Float

FORMAT, VERSION = "jaxrender BRDF table", 1
DIMENSIONS = ("kappa_i", "lambda_i", "kappa_r", "lambda_r", "channel")

_MEANING = {
    "nusselt": "direction (x, y, z): kappa = (x + 1) / 2, lambda = (y + 1) / 2; cells whose centre "
    "lies outside the disc are no directions",
    "polar": "kappa = polar angle / (pi / 2), lambda = azimuth / (2 pi)",
}
_CONVENTION = (
    "radiance into direction r over irradiance from direction i; local frame, +Z the normal, both "
    "directions away from the surface; sample j of n lies at (j + 1/2) / n"
)
# Numbers in a table that is read: 32^4 pairs in RGB are 3 million.
_MOST_NUMBERS = 2**31
_REMEDY = "write the file again with `jaxrender measure`"

Values = Float[np.ndarray, "kappa_i lambda_i kappa_r lambda_r channel"]


class BRDFTable(NamedTuple):
    """What a file holds."""

    values: Values
    standard_errors: Values | None
    embedding: Embedding = NUSSELT
    masked: int = 0
    """How many numbers were no measurements, and are zero."""
    about: Mapping[str, str | int | float] = {}
    """All other attributes: where the table comes from."""


def write_table(path: str | Path, table: BRDFTable) -> None:
    """Write a table, whole or not at all.

    Raises ``InputError`` where the folder is missing, ``ValueError`` for an empty table and for
    errors of another shape.
    """
    path, values, errors = Path(path), np.asarray(table.values), table.standard_errors
    shapes = {array.shape for array in (values, errors) if array is not None}
    if len(shapes) > 1 or min(values.shape) < 1:
        raise ValueError(
            f"values and standard errors of {sorted(shapes)}: give two tables of one shape, no "
            "axis of them empty"
        )
    if not path.parent.is_dir():
        raise InputError(f"{path}: no such folder {path.parent}; make it first")
    aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with h5netcdf.File(aside, "w") as file:
            file.attrs.update({**table.about, "format": FORMAT, "format_version": VERSION})
            file.attrs["embedding"] = table.embedding.name
            file.attrs["embedding_meaning"] = _MEANING[table.embedding.name]
            file.attrs["convention"] = _CONVENTION
            file.dimensions = dict(zip(DIMENSIONS, values.shape))
            for name, array in (("brdf", values), ("standard_error", errors)):
                if array is not None:
                    file.create_variable(name, DIMENSIONS, data=array)
                    file[name].attrs["units"] = "1/sr"
            for name, count in zip(DIMENSIONS[:4], values.shape):
                file.create_variable(name, (name,), data=(np.arange(count) + 0.5) / count)
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def read_table(path: str | Path) -> BRDFTable:
    """Read a table as ``write_table`` wrote it.

    Raises ``InputError`` for a file that is missing, damaged, too large or something else.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    try:
        with h5netcdf.File(path, "r") as file:
            return _table(path, file)
    except InputError:
        raise
    except (OSError, KeyError, RuntimeError, TypeError, ValueError) as error:
        raise InputError(f"{path}: not NetCDF-4, or damaged ({error}); {_REMEDY}") from None


def _table(path: Path, file: h5netcdf.File) -> BRDFTable:
    about = {name: _plain(value) for name, value in file.attrs.items()}
    found = about.pop("format", None), about.pop("format_version", None)
    if found != (FORMAT, VERSION):
        raise InputError(
            f"{path}: `format` and `format_version` are {found}; wanted {(FORMAT, VERSION)}: give "
            "a file that `jaxrender measure` wrote"
        )
    name = about.pop("embedding", None)
    if name not in EMBEDDINGS:
        raise InputError(
            f"{path}: `embedding` is {name!r}; wanted one of {', '.join(EMBEDDINGS)}; {_REMEDY}"
        )
    for known in ("embedding_meaning", "convention"):
        about.pop(known, None)
    values = _array(path, file, "brdf")
    errors = _array(path, file, "standard_error") if "standard_error" in file.variables else None
    if errors is not None and errors.shape != values.shape:
        raise InputError(f"{path}: `standard_error` has another shape than `brdf`; {_REMEDY}")
    broken = ~(np.isfinite(values) & (values >= 0))
    values[broken] = 0
    return BRDFTable(values, errors, EMBEDDINGS[name], int(broken.sum()), about)


def _array(path: Path, file: h5netcdf.File, name: str) -> np.ndarray:
    if name not in file.variables:
        raise InputError(f"{path}: no array `{name}`; {_REMEDY}")
    variable = file.variables[name]
    if tuple(variable.dimensions) != DIMENSIONS or min(variable.shape) < 1:
        raise InputError(
            f"{path}: `{name}` has the dimensions ({', '.join(variable.dimensions)}) of "
            f"{variable.shape}; wanted ({', '.join(DIMENSIONS)}), none empty; {_REMEDY}"
        )
    if np.prod(variable.shape, dtype=float) > _MOST_NUMBERS:
        raise InputError(
            f"{path}: `{name}` has {variable.shape} numbers, and {_MOST_NUMBERS} are read at most; "
            "give a coarser table"
        )
    array = np.array(variable[...])
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"{path}: `{name}` is {array.dtype}; wanted floating point; {_REMEDY}")
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def _plain(value: object) -> str | int | float:
    if isinstance(value, np.generic | np.ndarray):
        return value.item() if value.size == 1 else str(value.tolist())
    return value if isinstance(value, str | int | float) else str(value)
