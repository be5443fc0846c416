"""Spherical harmonic reflection maps as NetCDF files of named arrays, to be used without us.

``maps`` [row, column, outgoing, channel] are B_pq of T 5.10 or 5.11; ``degree`` and ``order`` are p
and q of each outgoing index.  A latitude-longitude map has the ``polar_angle`` of each row and the
``azimuth`` of each column, a cube the ``direction`` of each texel.  All else is attributes, with a
sentence for each convention.  float32 and float64 are kept as they are.
"""

from pathlib import Path

import numpy as np

from jaxrender.harmonics import CubeGrid, Grid, LatLongGrid, coefficient_count
from jaxrender.io.netcdf import Group, Reader, Variable, opened, write
from jaxrender.pipelines.shrm_layout import (
    AXES,
    CENTRE_MEANING,
    DIMENSIONS,
    FORMAT,
    FRAMES,
    GRIDS,
    WEIGHTED_MEANING,
    ReflectionMap,
    ShrmAbout,
    attributes,
    coordinates,
)
from jaxrender.reflection.shrm import Shrm

_PRECISIONS = (np.float32, np.float64)


def write_shrm(path: str | Path, shrm: Shrm, about: ShrmAbout) -> None:
    """Write a map, whole or not at all.

    Raises ``InputError`` where the folder is missing, ``ValueError`` for maps of another type or
    grid than a file holds, for values that are not finite, and for axes or a centre without name.
    """
    maps, described = np.asarray(shrm.maps), attributes(shrm, about)
    if maps.dtype not in _PRECISIONS or not np.isfinite(maps).all():
        raise ValueError(f"{path}: maps of {maps.dtype}: give finite float32 or float64")
    labels = coordinates(shrm.grid, shrm.order)
    variable = Variable(DIMENSIONS, maps, about.units, "B_pq of each texel", tuple(labels))
    write(path, FORMAT, Group({"maps": variable, **labels}, described))


def read_shrm(path: str | Path) -> ReflectionMap:
    """Read a map with its description.

    Raises ``InputError`` for a file that is missing, damaged, or something else.
    """
    with opened(path, FORMAT) as file:
        frame = FRAMES[file.one_of("frame", FRAMES)]
        kind = GRIDS[file.one_of("grid", GRIDS)]
        weighted = file.one_of("weighted", WEIGHTED_MEANING) == 1
        band_limit, order = (_count(file, name) for name in ("band_limit", "view_degree"))
        about = _about(file)
        maps = file.array("maps", DIMENSIONS, _PRECISIONS, finite=True)
        grid = _grid(file, kind, maps.shape[:2])
        if maps.shape[2] != coefficient_count(order):
            file.refuse(
                f"`maps` has {maps.shape[2]} outgoing indices, and `view_degree` {order} wants "
                f"(P + 1)^2 = {coefficient_count(order)}"
            )
        for name, label in coordinates(grid, order).items():
            found = file.array(name, label.dimensions)
            expected = label.values
            if found.shape != expected.shape or not np.allclose(found, expected, atol=1e-6):
                words = f"`{name}` is not that of this program's maps"
                file.refuse(words, "arrange them in its order")
    return ReflectionMap(frame(maps, grid, band_limit, weighted), about)


def read_about(path: str | Path) -> ShrmAbout:
    """Read what a map was made from without the map; raises as ``read_shrm`` does."""
    with opened(path, FORMAT) as file:
        return _about(file)


def _about(file: Reader) -> ShrmAbout:
    named = {"central_direction": CENTRE_MEANING, "axes": AXES}
    chosen = {name: file.one_of(name, allowed) for name, allowed in named.items()}
    return file.record(ShrmAbout, **chosen)


def _count(file: Reader, name: str) -> int:
    found = file.attribute(name, int)
    if found < 0:
        file.refuse(f"`{name}` is {found}; wanted a whole number from 0")
    return found


def _grid(file: Reader, kind: type[Grid], shape: tuple[int, ...]) -> Grid:
    rows, columns = shape
    if kind is CubeGrid:
        if rows != 6 * columns:
            file.refuse(
                f"`maps` of {rows} rows and {columns} columns are no cube, whose six faces below "
                "each other are 6 n x n"
            )
        return CubeGrid(columns)
    if columns % 2:
        file.refuse(
            f"`maps` of {columns} columns cannot be looked up over the poles, which takes an even "
            "number"
        )
    return LatLongGrid(rows, columns)
