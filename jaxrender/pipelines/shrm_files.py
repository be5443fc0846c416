"""Spherical harmonic reflection maps as NetCDF files of named arrays, to be used without us.

``maps`` [row, column, outgoing, channel] are B_pq of T 5.10 or 5.11; ``degree`` and ``order`` are p
and q of each outgoing index.  A latitude-longitude map has the ``polar_angle`` of each row and the
``azimuth`` of each column, a cube the ``direction`` of each texel.  All else is attributes, with a
sentence for each convention.  float32 and float64 are kept as they are.
"""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5netcdf
import numpy as np

from jaxrender.errors import InputError
from jaxrender.harmonics import CubeGrid, Grid, LatLongGrid, coefficient_count
from jaxrender.pipelines.shrm_layout import (
    ANGLES,
    AXES,
    CENTRE_MEANING,
    DIMENSIONS,
    FORMAT,
    FRAMES,
    GRIDS,
    VERSION,
    WEIGHTED_MEANING,
    ShrmAbout,
    attributes,
    coordinates,
)
from jaxrender.reflection.shrm import Shrm

_AGAIN = "write it again with `jaxrender prefilter --shrm`"


def write_shrm(path: str | Path, shrm: Shrm, about: ShrmAbout) -> None:
    """Write a map, whole or not at all.

    Raises ``InputError`` where the folder is missing, ``ValueError`` for maps of another type or
    grid than a file holds, for values that are not finite, and for axes or a centre without name.
    """
    path, maps = Path(path), np.asarray(shrm.maps)
    described = attributes(shrm, about)
    if maps.dtype not in (np.float32, np.float64) or not np.isfinite(maps).all():
        raise ValueError(f"{path}: maps of {maps.dtype}: give finite float32 or float64")
    if not path.parent.is_dir():
        raise InputError(f"{path}: no such folder {path.parent}; make it first")
    aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with h5netcdf.File(aside, "w") as file:
            file.attrs.update(described)
            arrays = coordinates(shrm.grid, shrm.order)
            sizes: dict[str, int] = dict(zip(DIMENSIONS, maps.shape))
            for dimensions, values in arrays.values():
                sizes |= zip(dimensions, values.shape)
            file.dimensions = sizes
            file.create_variable("maps", DIMENSIONS, data=maps)
            file["maps"].attrs["units"] = about.units
            file["maps"].attrs["coordinates"] = " ".join(arrays)
            for name, (dimensions, values) in arrays.items():
                file.create_variable(name, dimensions, data=values)
                if name in ANGLES:
                    file[name].attrs["units"] = "radian"
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def read_shrm(path: str | Path) -> tuple[Shrm, ShrmAbout]:
    """Read a map and what it was made from, as ``write_shrm`` wrote them.

    Raises ``InputError`` for a file that is missing, damaged, or something else.
    """
    path = Path(path)
    with _opened(path) as file:
        given = _Attributes(path, dict(file.attrs))
        frame = FRAMES[given.one_of("frame", FRAMES)]
        kind = GRIDS[given.one_of("grid", GRIDS)]
        weighted = given.one_of("weighted", WEIGHTED_MEANING) == 1
        band_limit = given.count("band_limit")
        order = given.count("view_degree")
        about = given.about()
        maps = _array(path, file, "maps", DIMENSIONS)
        grid = _grid(path, kind, maps.shape[:2])
        if maps.shape[2] != coefficient_count(order):
            raise InputError(
                f"{path}: `maps` has {maps.shape[2]} outgoing indices, and `view_degree` {order} "
                f"wants (P + 1)^2 = {coefficient_count(order)}; {_AGAIN}"
            )
        for name, (dimensions, expected) in coordinates(grid, order).items():
            found = _array(path, file, name, dimensions)
            if found.shape != expected.shape or not np.allclose(found, expected, atol=1e-6):
                raise InputError(
                    f"{path}: `{name}` is not that of this program's maps; arrange them in its "
                    f"order, or {_AGAIN}"
                )
    # Whatever the byte order of the machine that wrote it.
    maps = maps.astype(maps.dtype.newbyteorder("="), copy=False)
    if maps.dtype not in (np.float32, np.float64):
        raise InputError(f"{path}: `maps` are {maps.dtype}; wanted float32 or float64; {_AGAIN}")
    wrong = np.argwhere(~np.isfinite(maps))
    if len(wrong):
        place = ", ".join(f"{n} {i}" for n, i in zip(DIMENSIONS, wrong[0]))
        raise InputError(
            f"{path}: `maps` at {place} is {maps[tuple(wrong[0])]}; wanted finite numbers; {_AGAIN}"
        )
    return frame(maps, grid, band_limit, weighted), about


def read_about(path: str | Path) -> ShrmAbout:
    """Read what a map was made from without the map; raises as ``read_shrm`` does."""
    with _opened(Path(path)) as file:
        return _Attributes(Path(path), dict(file.attrs)).about()


class _Attributes(NamedTuple):
    """The attributes of a file, each asked for by name."""

    path: Path
    values: dict[str, Any]

    def value(self, name: str) -> Any:
        if name not in self.values:
            raise InputError(f"{self.path}: no attribute `{name}`; {_AGAIN}")
        found = self.values[name]
        if not isinstance(found, np.generic | np.ndarray):
            return found
        return found.item() if found.size == 1 else found.tolist()

    def one_of(self, name: str, allowed: Any) -> Any:
        found = self.value(name)
        if found not in list(allowed):
            raise InputError(
                f"{self.path}: `{name}` is {found!r}; wanted one of "
                f"{', '.join(map(str, allowed))}; {_AGAIN}"
            )
        return found

    def count(self, name: str) -> int:
        found = self.value(name)
        if isinstance(found, bool) or not isinstance(found, int) or found < 0:
            raise InputError(
                f"{self.path}: `{name}` is {found!r}; wanted a whole number from 0; {_AGAIN}"
            )
        return found

    def about(self) -> ShrmAbout:
        given = {name: self.value(name) for name in ShrmAbout._fields}
        for name, value in given.items():
            is_number = isinstance(ShrmAbout._field_defaults.get(name), float)
            if not isinstance(value, float if is_number else str):
                raise InputError(
                    f"{self.path}: `{name}` is {value!r}; wanted a "
                    f"{'number' if is_number else 'text'}; {_AGAIN}"
                )
        self.one_of("central_direction", CENTRE_MEANING)
        self.one_of("axes", AXES)
        return ShrmAbout(**given)


@contextmanager
def _opened(path: Path) -> Iterator[h5netcdf.File]:
    """Open a file of this format and version, and say what else it is."""
    if path.is_dir():
        raise InputError(f"{path}: a folder; give the path of the file inside it")
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    with path.open("rb") as stream:
        head = stream.read(8)
    if head[:3] == b"CDF":
        raise InputError(f"{path}: a NetCDF file of the classic format; convert it to NetCDF-4")
    if head != b"\x89HDF\r\n\x1a\n":
        raise InputError(f"{path}: not a NetCDF-4 file; give one that holds a reflection map")
    try:
        with h5netcdf.File(path, "r") as file:
            kind, version = file.attrs.get("format"), file.attrs.get("format_version")
            if kind != FORMAT:
                raise InputError(
                    f"{path}: `format` is {kind!r}; wanted {FORMAT!r}: give a file that "
                    "`jaxrender prefilter --shrm` wrote"
                )
            if version != VERSION:
                raise InputError(
                    f"{path}: `format_version` is {version}; this program reads version {VERSION}: "
                    f"take the program that wrote it, or {_AGAIN}"
                )
            yield file
    except InputError:
        raise
    except (OSError, KeyError, RuntimeError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: damaged or cut short ({error}); fetch the file again, or {_AGAIN}"
        ) from None


def _array(path: Path, file: h5netcdf.File, name: str, dimensions: tuple[str, ...]) -> np.ndarray:
    if name not in file.variables:
        raise InputError(f"{path}: no array `{name}`; {_AGAIN}")
    variable = file.variables[name]
    if tuple(variable.dimensions) != dimensions:
        raise InputError(
            f"{path}: `{name}` has the dimensions ({', '.join(variable.dimensions)}); wanted "
            f"({', '.join(dimensions)}); transpose it, or {_AGAIN}"
        )
    return np.asarray(variable[...])


def _grid(path: Path, kind: type[Grid], shape: tuple[int, ...]) -> Grid:
    rows, columns = shape
    if kind is CubeGrid:
        if rows != 6 * columns:
            raise InputError(
                f"{path}: `maps` of {rows} rows and {columns} columns are no cube, whose six faces "
                f"below each other are 6 n x n; {_AGAIN}"
            )
        return CubeGrid(columns)
    if columns % 2:
        raise InputError(
            f"{path}: `maps` of {columns} columns cannot be looked up over the poles, which takes "
            f"an even number; {_AGAIN}"
        )
    return LatLongGrid(rows, columns)
