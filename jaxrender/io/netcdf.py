"""NetCDF-4 files of named arrays; no other module knows the library.

``write`` writes a ``Group`` of ``Variable`` arrays and attributes as a file of a stated ``Format``,
whole or not at all.  ``opened`` opens one as a ``Reader``, which reads what it is asked for by
name.  In every file ``format``, ``format_version`` and ``program`` say what wrote it, an array has
its ``units`` and ``long_name``, and many numbers are compressed without loss.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar

import h5netcdf
import h5py
import numpy as np

from jaxrender import __version__
from jaxrender.errors import InputError
from jaxrender.io.atomic import replacing
from jaxrender.io.text_heaps import damaged_heap
from jaxrender.limits import NUMBERS, check_packing

_HEAD = ("format", "format_version", "program")
_HDF5, _CLASSIC = b"\x89HDF\r\n\x1a\n", b"CDF"
# Below so many bytes the bookkeeping of a packed array takes more than packing saves.
_LARGE = 4096
_PACKED: dict[str, Any] = {"compression": "gzip", "shuffle": True}
_WORDS = {int: "a whole number", float: "a number", str: "a text"}
_Record = TypeVar("_Record")


class Format(NamedTuple):
    """A kind of file: its name and version, which stand in it, and the command that writes it."""

    name: str
    version: int
    written_by: str

    @property
    def again(self) -> str:
        """The remedy for a file that cannot be mended."""
        return f"write it again with `{self.written_by}`"


class Variable(NamedTuple):
    """Numbers, truth values or text under named dimensions.

    ``units`` is "1" for numbers that have none, "" for text and for a mixture.  ``coordinates`` are
    the variables that label the array's places.
    """

    dimensions: tuple[str, ...]
    values: Any
    units: str
    long_name: str
    coordinates: tuple[str, ...] = ()


class Group(NamedTuple):
    """What a file holds, or a named part of it."""

    variables: Mapping[str, Variable] = {}
    attributes: Mapping[str, str | int | float] = {}
    groups: Mapping[str, "Group"] = {}


def write(path: str | Path, format: Format, content: Group) -> None:
    """Write a file, whole or not at all.

    Raises ``InputError`` where the folder is missing, ``ValueError`` for an empty array and for
    arrays that disagree about the size of a dimension.
    """
    head = dict(zip(_HEAD, (format.name, format.version, f"jaxrender {__version__}")))
    attributes = {**head, **content.attributes, **head}
    with replacing(Path(path)) as aside, h5netcdf.File(aside, "w") as file:
        _fill(file, content._replace(attributes=attributes))


def _fill(group: h5netcdf.Group, content: Group) -> None:
    group.attrs.update(content.attributes)
    group.dimensions = _sizes(content.variables)
    for name, variable in content.variables.items():
        values = np.asarray(variable.values)
        if values.dtype.kind in "OU":
            texts = values.astype(object)
            made = group.create_variable(name, variable.dimensions, h5py.string_dtype(), texts)
        else:
            # NetCDF has no truth values; this is how xarray writes and reads them.
            is_truth = values.dtype == bool
            numbers = values.astype(np.int8) if is_truth else values
            packed = _PACKED if numbers.nbytes > _LARGE else {}
            made = group.create_variable(name, variable.dimensions, data=numbers, **packed)
            made.attrs.update({"dtype": "bool"} if is_truth else {})
        words = (variable.units, variable.long_name, " ".join(variable.coordinates))
        named = zip(("units", "long_name", "coordinates"), words)
        made.attrs.update({attribute: text for attribute, text in named if text})
    for name, inner in content.groups.items():
        _fill(group.create_group(name), inner)


def _sizes(variables: Mapping[str, Variable]) -> dict[str, int]:
    sizes: dict[str, int] = {}
    for name, variable in variables.items():
        shape = np.shape(variable.values)
        # A dimension of nothing would be one without limit.
        if len(shape) != len(variable.dimensions) or 0 in shape:
            raise ValueError(
                f"{name}: shape {shape} for ({', '.join(variable.dimensions)}); give a size from 1 "
                "for each dimension"
            )
        for dimension, size in zip(variable.dimensions, shape):
            if sizes.setdefault(dimension, size) != size:
                raise ValueError(f"{name}: {dimension} is {size}, and {sizes[dimension]} elsewhere")
    return sizes


@contextmanager
def opened(path: str | Path, *formats: Format) -> "Iterator[Reader]":
    """Open a file that ``write`` wrote in one of these formats.

    Raises ``InputError`` for a file that is missing, damaged, cut short or something else.
    """
    path, again = Path(path), formats[0].again
    if path.is_dir():
        raise InputError(f"{path}: a folder; give the path of the file inside it")
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path, or {again}")
    commands = " or ".join(f"`{one.written_by}`" for one in formats)
    with path.open("rb") as stream:
        start = stream.read(len(_HDF5))
    if start.startswith(_CLASSIC):
        raise InputError(f"{path}: a NetCDF file of the classic format; convert it to NetCDF-4")
    if start != _HDF5:
        raise InputError(f"{path}: not a NetCDF-4 file; give one that {commands} wrote")
    heap = damaged_heap(path)
    if heap is not None:
        raise InputError(
            f"{path}: damaged or cut short (texts at byte {heap}); fetch the file again, or {again}"
        )
    with _undamaged(path, again):
        file = _File(path, "r", decode_vlen_strings=True)
    with file:
        with _undamaged(path, again):
            found = {name: _plain(file.attrs[name]) for name in _HEAD if name in file.attrs}
        format = next((one for one in formats if one.name == found.get("format")), None)
        if format is None:
            wanted = " or ".join(repr(one.name) for one in formats)
            raise InputError(
                f"{path}: `format` is {found.get('format')!r}; wanted {wanted}: give a file that "
                f"{commands} wrote"
            )
        if found.get("format_version") != format.version:
            raise InputError(
                f"{path}: `format_version` is {found.get('format_version')}; this program reads "
                f"version {format.version}: take the program that wrote it, or {format.again}"
            )
        yield Reader(path, format, file)


class _File(h5netcdf.File):
    """One whose opening may fail: closing it then asks for these, which are not yet set."""

    _writable, _filename = False, ""


class Reader:
    """A group of an open file, whose attributes, arrays and groups are read by name.

    Every method raises ``InputError`` for what is missing, damaged or not as it is asked for; the
    error names the file, the part, what is wanted and the remedy.
    """

    def __init__(self, path: Path, format: Format, group: h5netcdf.Group, place: str = ""):
        self.path, self.format, self._group, self._place = path, format, group, place
        with _undamaged(path, format.again):
            attributes = {name: _plain(value) for name, value in group.attrs.items()}
        self.attributes = {name: found for name, found in attributes.items() if name not in _HEAD}

    def __contains__(self, name: str) -> bool:
        with _undamaged(self.path, self.format.again):
            return name in self._group.variables or name in self._group.groups

    def refuse(self, what: str, remedy: str = "") -> NoReturn:
        """Raise the error that ``what`` is wrong; ``remedy`` comes before writing it again."""
        first = f"{remedy}, or " if remedy else ""
        raise InputError(f"{self.path}: {what}; {first}{self.format.again}")

    def group(self, name: str) -> "Reader":
        """Read a group of this one."""
        with _undamaged(self.path, self.format.again):
            inner = self._group.groups.get(name)
        if inner is None:
            self.refuse(f"no group `{self._place}{name}`")
        return Reader(self.path, self.format, inner, f"{self._place}{name}/")

    def array(
        self,
        name: str,
        dimensions: tuple[str, ...] | None = None,
        types: Collection[type] = (),
        most: int | None = None,
        finite: bool = False,
    ) -> np.ndarray:
        """Read an array, with its own dimensions and any type where nothing else is asked for.

        Of more than ``most`` numbers nothing is read, nor of more than the file can hold or
        ``limits`` allows; ``finite`` refuses infinities and NaN.
        """
        place = f"`{self._place}{name}`"
        with _undamaged(self.path, self.format.again):
            variable = self._group.variables.get(name)
        if variable is None:
            self.refuse(f"no array {place}")
        with _undamaged(self.path, self.format.again):
            given = tuple(variable.dimensions)
            # The array's own size: what the library tells is that of its dimensions.
            count = math.prod(variable._h5ds.shape)
            # Whatever the byte order of the machine that wrote it.
            dtype = np.dtype(variable.dtype).newbyteorder("=")
            is_truth = variable.attrs.get("dtype") == "bool"
        if dimensions is not None and given != dimensions:
            self.refuse(
                f"{place} has the dimensions ({', '.join(given)}); wanted ({', '.join(dimensions)})"
            )
        if count < 1 or (most is not None and count > most):
            wanted = "1 or more" if most is None else f"1 to {most:,}"
            self.refuse(f"{place} has {count:,} numbers; wanted {wanted}")
        NUMBERS.check(f"{self.path}: {place}", count, self.format.again)
        self._refuse_foreign(place, variable, count)
        if types and dtype not in types:
            self.refuse(f"{place} is {dtype}; wanted {' or '.join(one.__name__ for one in types)}")
        with _undamaged(self.path, self.format.again):
            values = np.asarray(variable[...])
        found = values if values.dtype == object else values.astype(dtype, copy=False)
        if finite and not np.isfinite(found).all():
            wrong = tuple(np.argwhere(~np.isfinite(found))[0])
            index = ", ".join(f"{n} {i}" for n, i in zip(given, wrong))
            self.refuse(f"{place} at {index} is {found[wrong]}; wanted finite numbers")
        return found.astype(bool) if is_truth else found

    def _refuse_foreign(self, place: str, variable: h5netcdf.Variable, count: int) -> None:
        """Refuse an array whose numbers lie in another file, or are more than the file can pack."""
        with _undamaged(self.path, self.format.again):
            dataset = variable._h5ds
            away = bool(dataset.external or dataset.is_virtual)
            away = away or not self.path.samefile(dataset.file.filename)
            # Of an array that was never written the library tells the size that it would have.
            packed = min(dataset.id.get_storage_size(), self.path.stat().st_size)
            width = dataset.dtype.itemsize
            chunk = math.prod(dataset.chunks or (1,))
        if away:
            self.refuse(f"{place} has its numbers in another file")
        # A piece is unpacked as a whole.
        largest = max(count, chunk)
        check_packing(f"{self.path}: {place}", largest, largest * width, packed)

    def attribute(self, name: str, kind: type = str) -> Any:
        """Read an attribute that is a text, an int or a float."""
        if name not in self.attributes:
            self.refuse(f"no attribute `{self._place}{name}`")
        found = self.attributes[name]
        if type(found) is not kind:
            self.refuse(f"`{self._place}{name}` is {found!r}; wanted {_WORDS[kind]}")
        return found

    def one_of(self, name: str, allowed: Collection[Any]) -> Any:
        """Read an attribute that has one of a few values of one type."""
        found = self.attribute(name, type(next(iter(allowed))))
        if found not in allowed:
            wanted = ", ".join(map(str, allowed))
            self.refuse(f"`{self._place}{name}` is {found!r}; wanted one of {wanted}")
        return found

    def record(self, kind: Callable[..., _Record], **given: Any) -> _Record:
        """Read a named tuple, each field an attribute of its default's type (text: no default)."""
        for name, field in signature(kind).parameters.items():
            if name not in given:
                default = "" if field.default is field.empty else field.default
                given[name] = self.attribute(name, type(default))
        return kind(**given)


@contextmanager
def _undamaged(path: Path, again: str) -> Iterator[None]:
    """Say that a file is damaged, in whatever way the library stumbles over it."""
    try:
        yield
    except Exception as error:
        raise InputError(
            f"{path}: damaged or cut short ({error}); fetch the file again, or {again}"
        ) from None


def _plain(value: Any) -> Any:
    if not isinstance(value, np.generic | np.ndarray):
        return value
    return value.item() if value.size == 1 else value.tolist()
