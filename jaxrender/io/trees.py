"""Coefficient trees as NetCDF files of named arrays, to be used without us.

``child_mask`` and ``value_mask`` [node] are 16 bits each, ``values`` [value, channel] and ``root``
[channel] the coefficients; levels and places follow from the masks.  All else is attributes, with a
sentence for each convention (``tree_layout``).
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
from jaxrender.io.tree_layout import (
    FORMAT,
    MOST_BITS,
    MOST_CHANNELS,
    MOST_NODES,
    MOST_NUMBERS,
    NODE_ARRAYS,
    VERSION,
    TreeAbout,
    attributes,
    fault_of,
    wavelet_of,
)
from jaxrender.wavelets import CoefficientTree, Wavelet

_AGAIN = "write it again with `jaxrender compress`"
_PRECISIONS = (np.float32, np.float64)


def write_tree(
    path: str | Path, tree: CoefficientTree, about: TreeAbout, precision: type = np.float32
) -> None:
    """Write a tree, whole or not at all; its numbers in float32 unless asked for float64.

    Raises ``InputError`` where the folder is missing, ``ValueError`` for another precision, numbers
    that are not finite in it, more than a file may hold, a wavelet that files have no name for and
    a description that does not go with the tree.
    """
    path = Path(path)
    if precision not in _PRECISIONS:
        raise ValueError(f"precision={precision}: choose numpy.float32 or numpy.float64")
    with np.errstate(over="ignore"):
        root, values = (np.asarray(a).astype(precision) for a in (tree.root, tree.values))
    if not (np.isfinite(root).all() and np.isfinite(values).all()):
        raise ValueError(f"{path}: coefficients are not finite as {precision.__name__}")
    if len(tree.child_masks) > MOST_NODES or values.size > MOST_NUMBERS:
        raise ValueError(
            f"{len(tree.child_masks):,} nodes, {values.size:,} numbers: threshold more"
        )
    if wavelet_of(tree.wavelet.name) != tree.wavelet:
        raise ValueError(f"wavelet {tree.wavelet.name!r} has no name in files; use one that has")
    fault = fault_of(about, tree)
    if fault is not None:
        raise ValueError(f"{path}: {fault}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: no such folder {path.parent}; make it first")
    aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with h5netcdf.File(aside, "w") as file:
            file.attrs.update(attributes(tree, about))
            file.dimensions = {"node": len(tree.child_masks), "channel": len(root)}
            for name, masks in zip(NODE_ARRAYS, (tree.child_masks, tree.value_masks)):
                _write(file, name, ("node",), masks.astype(np.uint16))
            _write(file, "root", ("channel",), root)
            if len(values):
                # A dimension of nothing would be one without limit.
                file.dimensions["value"] = len(values)
                _write(file, "values", ("value", "channel"), values)
            if about.wavelengths:
                _write(file, "wavelength", ("channel",), np.array(about.wavelengths, float))
                file["wavelength"].attrs["units"] = "nm"
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def read_tree(path: str | Path) -> tuple[CoefficientTree, TreeAbout]:
    """Read a tree and what it was made from, as ``write_tree`` wrote them.

    Raises ``InputError`` for a file that is missing, damaged, too large, or something else.
    """
    path = Path(path)
    with _opened(path) as file:
        given = _Attributes(path, dict(file.attrs))
        wavelet, size, axes = _cube(given)
        root = _numbers(path, file, "root", ("channel",), MOST_CHANNELS)
        masks = [_masks(path, file, name) for name in NODE_ARRAYS]
        _refuse_deeper(path, masks[0], size.bit_length() - 1)
        values = np.zeros((0, len(root)), root.dtype)
        if "values" in file.variables:
            values = _numbers(path, file, "values", ("value", "channel"), MOST_NUMBERS)
        wavelengths = ()
        if "wavelength" in file.variables:
            found = _numbers(path, file, "wavelength", ("channel",), MOST_CHANNELS)
            wavelengths = tuple(found.tolist())
        about = given.about(wavelengths)
        offset = given.of_type("offset", float, "a number from 0 to 1")
        if not 0 <= offset <= 1:
            raise InputError(f"{path}: `offset` is {offset}; wanted 0 to 1; {_AGAIN}")
    if root.dtype != values.dtype:
        raise InputError(f"{path}: `root` is {root.dtype}, `values` {values.dtype}; {_AGAIN}")
    try:
        tree = CoefficientTree(wavelet, size, axes, root, masks[0], masks[1], values, offset)
    except ValueError as error:
        raise InputError(f"{path}: {error}; {_AGAIN}") from None
    fault = fault_of(about, tree)
    if fault is not None:
        raise InputError(f"{path}: {fault}; {_AGAIN}")
    return tree, about


class _Attributes(NamedTuple):
    """The attributes of a file, each asked for by name."""

    path: Path
    values: dict[str, Any]

    def of_type(self, name: str, kind: type, wanted: str) -> Any:
        if name not in self.values:
            raise InputError(f"{self.path}: no attribute `{name}`; {_AGAIN}")
        found = self.values[name]
        if isinstance(found, np.generic | np.ndarray) and np.size(found) == 1:
            found = found.item()
        if type(found) is not kind:
            raise InputError(f"{self.path}: `{name}` is {found!r}; wanted {wanted}; {_AGAIN}")
        return found

    def about(self, wavelengths: tuple[float, ...]) -> TreeAbout:
        words = {"float": "a number", "int": "a whole number", "str": "a text"}
        found: dict[str, Any] = {"wavelengths": wavelengths}
        for name in TreeAbout._fields:
            if name not in found:
                kind = type(TreeAbout._field_defaults.get(name, ""))
                kind = str if kind is tuple else kind
                found[name] = self.of_type(name, kind, words[kind.__name__])
        found["axis_names"] = tuple(found["axis_names"].split())
        return TreeAbout(**found)


def _cube(given: _Attributes) -> tuple[Wavelet, int, int]:
    """Find wavelet, size and number of axes, before anything of that size is made."""
    name = given.of_type("wavelet", str, "the name of a wavelet")
    wavelet = wavelet_of(name)
    if wavelet is None:
        raise InputError(f"{given.path}: no wavelet is named {name!r}; {_AGAIN}")
    size, axes = (given.of_type(word, int, "a whole number") for word in ("size", "axes"))
    if size < 1 or size & (size - 1):
        raise InputError(f"{given.path}: `size` is {size}, no power of two; {_AGAIN}")
    if not 1 <= axes <= 4:
        raise InputError(f"{given.path}: `axes` is {axes}; wanted 1 to 4; {_AGAIN}")
    if axes * size.bit_length() > MOST_BITS:
        raise InputError(
            f"{given.path}: `size` is {size} along {axes} axes, and {MOST_BITS} bits tell a place; "
            f"{_AGAIN}, with fewer samples"
        )
    return wavelet, size, axes


@contextmanager
def _opened(path: Path) -> Iterator[h5netcdf.File]:
    """Open a file of this format and version, and say what else it is."""
    if path.is_dir():
        raise InputError(f"{path}: a folder; give the path of the file inside it")
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    with path.open("rb") as stream:
        if stream.read(8) != b"\x89HDF\r\n\x1a\n":
            raise InputError(f"{path}: not a NetCDF-4 file; give one that holds a tree")
    try:
        with h5netcdf.File(path, "r") as file:
            kind, version = file.attrs.get("format"), file.attrs.get("format_version")
            if kind != FORMAT or version != VERSION:
                raise InputError(
                    f"{path}: `format` is {kind!r}, version {version}; wanted {FORMAT!r}, version "
                    f"{VERSION}: give a file that `jaxrender compress` wrote"
                )
            yield file
    except InputError:
        raise
    except (OSError, KeyError, RuntimeError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: damaged or cut short ({error}); fetch the file again, or {_AGAIN}"
        ) from None


def _array(
    path: Path, file: h5netcdf.File, name: str, dimensions: tuple[str, ...], most: int
) -> np.ndarray:
    if name not in file.variables:
        raise InputError(f"{path}: no array `{name}`; {_AGAIN}")
    variable = file.variables[name]
    if tuple(variable.dimensions) != dimensions:
        raise InputError(
            f"{path}: `{name}` has the dimensions ({', '.join(variable.dimensions)}); wanted "
            f"({', '.join(dimensions)}); {_AGAIN}"
        )
    count = int(np.prod(np.array(variable.shape, object)))
    if not 1 <= count <= most:
        raise InputError(f"{path}: `{name}` has {count:,} numbers; wanted 1 to {most:,}; {_AGAIN}")
    found = np.asarray(variable[...])
    # Whatever the byte order of the machine that wrote it.
    return found.astype(found.dtype.newbyteorder("="), copy=False)


def _numbers(
    path: Path, file: h5netcdf.File, name: str, dimensions: tuple[str, ...], most: int
) -> np.ndarray:
    found = _array(path, file, name, dimensions, most)
    if found.dtype not in _PRECISIONS:
        raise InputError(f"{path}: `{name}` is {found.dtype}; wanted float32 or float64; {_AGAIN}")
    wrong = np.argwhere(~np.isfinite(found))
    if len(wrong):
        place = ", ".join(f"{n} {i}" for n, i in zip(dimensions, wrong[0]))
        value = found[tuple(wrong[0])]
        raise InputError(f"{path}: `{name}` at {place} is {value}; wanted finite numbers; {_AGAIN}")
    return found


def _masks(path: Path, file: h5netcdf.File, name: str) -> np.ndarray:
    found = _array(path, file, name, ("node",), MOST_NODES)
    if found.dtype != np.uint16:
        raise InputError(f"{path}: `{name}` is {found.dtype}; wanted uint16; {_AGAIN}")
    return found.astype(np.int64)


def _refuse_deeper(path: Path, child_masks: np.ndarray, levels: int) -> None:
    """Go down level by level, no further than there are levels, whatever the masks say."""
    counts = np.bitwise_count(child_masks).astype(np.int64)
    start, stop = 0, 1
    for _ in range(max(levels, 1)):
        start, stop = stop, stop + int(counts[start:stop].sum())
    if stop > start and stop <= len(counts):
        raise InputError(
            f"{path}: `child_mask` of node {start} is at level {max(levels, 1)}, and the size has "
            f"{levels}; {_AGAIN}"
        )


def _write(file: h5netcdf.File, name: str, dimensions: tuple[str, ...], values: np.ndarray) -> None:
    file.create_variable(name, dimensions, data=values, compression="gzip", shuffle=True)
