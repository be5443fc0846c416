"""RGL's measured materials (``.bsdf``) and the container that they come in (Dupuy and Jakob, 2018).

The container, little-endian: ``tensor_file`` and a zero byte; two bytes, version 1.0; uint32, the
number of fields.  Each field: uint16 and that many letters, its name; uint16, its rank; uint8, its
type; uint64, where in the file its numbers start; that many uint64, its shape.

A material has the incoming directions' ``theta_i`` and ``phi_i``, ``ndf`` and ``sigma`` [azimuth,
polar], ``vndf`` and ``luminance`` [phi_i, theta_i, row, column], ``rgb`` or ``spectra`` [phi_i,
theta_i, channel, row, column] with their ``wavelengths`` in nm, ``description`` (letters) and
``jacobian`` (whether samples are scaled).  ``RglBRDF`` says what they mean; the luminance is for
drawing samples alone: it is written, and not read.
"""

import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from jaxrender.brdf.tables.rgl import RglBRDF, RglTables
from jaxrender.errors import InputError
from jaxrender.io.atomic import replacing
from jaxrender.shapes import Float

_MAGIC = b"tensor_file\0"
_VERSION = (1, 0)
# By the number that stands for the type, from 1 on.
_TYPES = tuple(
    np.dtype(name)
    for name in ("<u1", "<i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
)
# No numpy array has more axes.
_LARGEST_RANK = 32
# Nor one of so many numbers, were it not empty.
_LARGEST_SIZE = 2**59


class RglMaterial(NamedTuple):
    """A measured BRDF, the wavelengths of its channels in nm (None: RGB), and what it is.

    ``negative`` counts samples below zero, which the BRDF has as 0.
    """

    brdf: RglBRDF
    wavelengths: Float[np.ndarray, "channel"] | None
    description: str
    negative: int


class _Field(NamedTuple):
    name: str
    dtype: np.dtype
    offset: int
    shape: tuple[int, ...]

    @property
    def end(self) -> int:
        return self.offset + math.prod(self.shape) * self.dtype.itemsize


def read_tensors(path: str | Path) -> dict[str, np.ndarray]:
    """Read every array of a container, by name.

    Raises InputError for a file that is missing, of another kind or version, cut short, with a
    field of an unknown type, a name that occurs twice, or numbers beyond the end of the file.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    size = path.stat().st_size
    with path.open("rb") as file:
        magic = file.read(len(_MAGIC))
        if magic != _MAGIC:
            raise InputError(
                f"{path}: opens with {magic!r}; wanted {_MAGIC!r}: this is no tensor file"
            )
        version = _unpack(path, file, "<BB")
        if version != _VERSION:
            raise InputError(f"{path}: version {version[0]}.{version[1]}; only 1.0 is known")
        (count,) = _unpack(path, file, "<I")
        fields: dict[str, _Field] = {}
        for _ in range(count):
            field = _field(path, file, size)
            if field.name in fields:
                raise InputError(f"{path}: the field {field.name!r} occurs twice")
            fields[field.name] = field
        # Fields that share their numbers would multiply a small file in memory.
        total = sum(field.end - field.offset for field in fields.values())
        if total > size:
            raise InputError(f"{path}: {size} bytes for fields of {total}; they overlap")
        return {field.name: _array(file, field) for field in fields.values()}


def read_rgl(path: str | Path) -> RglMaterial:
    """Read a material; RGB where the file has it, else spectra.

    Raises InputError as ``read_tensors``, for fields that are missing or do not fit each other, and
    numbers that mean nothing.
    """
    path = Path(path)
    fields = read_tensors(path)
    kind = "rgb" if "rgb" in fields else "spectra"
    wanted = {"phi_i": 1, "theta_i": 1, "ndf": 2, "sigma": 2, "vndf": 4, kind: 5, "jacobian": 1}
    if kind == "spectra":
        wanted["wavelengths"] = 1
    for name, rank in wanted.items():
        if name not in fields:
            raise InputError(f"{path}: no field {name!r}; a material has {', '.join(wanted)}")
        if fields[name].ndim != rank or not fields[name].size:
            raise InputError(
                f"{path}: {name!r} has shape {fields[name].shape}; wanted {rank} axes, none empty"
            )
    tables = [fields[name] for name in ("phi_i", "theta_i", "ndf", "sigma", "vndf", kind)]
    for name, table in zip(RglTables._fields, tables, strict=True):
        if table.dtype.kind != "f":
            raise InputError(f"{path}: {name!r} holds {table.dtype}; wanted floating point")
    wavelengths = fields["wavelengths"].astype(float) if kind == "spectra" else None
    _refuse_shapes(path, fields, kind, 3 if wavelengths is None else len(wavelengths))
    try:
        brdf = RglBRDF.of(RglTables(*tables), bool(fields["jacobian"][0]))
    except ValueError as error:
        raise InputError(f"{path}: {error}; fetch the file again") from None
    described = fields.get("description", np.zeros(0, np.uint8))
    return RglMaterial(
        brdf,
        wavelengths,
        described.tobytes().decode("utf-8", "replace"),
        int(np.sum(fields[kind] < 0)),
    )


def write_tensors(path: str | Path, fields: Mapping[str, np.ndarray]) -> None:
    """Write arrays as a container, whole or not at all.

    Raises InputError where the folder is missing, ``ValueError`` for a type that it has none for.
    """
    arrays = {name: _stored(name, array) for name, array in fields.items()}
    names = {name: name.encode() for name in arrays}
    head = len(_MAGIC) + struct.calcsize("<BBI")
    start = head + sum(
        struct.calcsize(f"<H{len(names[name])}sHBQ{array.ndim}Q") for name, array in arrays.items()
    )
    with replacing(Path(path)) as aside, aside.open("wb") as file:
        file.write(_MAGIC + struct.pack("<BBI", *_VERSION, len(arrays)))
        for name, array in arrays.items():
            kind = _TYPES.index(array.dtype) + 1
            file.write(struct.pack(f"<H{len(names[name])}s", len(names[name]), names[name]))
            file.write(struct.pack(f"<HBQ{array.ndim}Q", array.ndim, kind, start, *array.shape))
            start += array.nbytes
        for array in arrays.values():
            file.write(array.tobytes())


def write_rgl(path: str | Path, tables: RglTables, description: str = "") -> None:
    """Write an RGB material, with samples scaled as ``RglBRDF.of`` takes them.

    Raises InputError where the folder is missing, ``ValueError`` for samples without three
    channels.
    """
    channels = tables.samples.shape[2]
    if channels != 3:
        raise ValueError(f"the tables have {channels} channels; give three, RGB")
    luminance = tables.samples.mean(axis=2)
    # Every sample must be drawn now and then.
    least = 1e-3 * luminance.max(axis=(2, 3), keepdims=True)
    fields = {
        "theta_i": tables.theta_i,
        "phi_i": tables.phi_i,
        "ndf": tables.ndf,
        "sigma": tables.sigma,
        "vndf": tables.vndf,
        "luminance": np.maximum(luminance, np.maximum(least, np.finfo(np.float32).tiny)),
        "rgb": tables.samples,
    }
    letters = np.frombuffer(description.encode() or b" ", np.uint8)
    write_tensors(
        path,
        {name: np.asarray(array, np.float32) for name, array in fields.items()}
        | {"description": letters, "jacobian": np.ones(1, np.uint8)},
    )


def _stored(name: str, array: np.ndarray) -> np.ndarray:
    """Bring an array into the file's order of bytes and numbers."""
    found = np.asarray(array)
    own = found.dtype.newbyteorder("<")
    if own not in _TYPES:
        raise ValueError(f"{name!r} holds {found.dtype}; a container has no type for it")
    return found.astype(own, order="C")


def _refuse_shapes(path: Path, fields: dict[str, np.ndarray], kind: str, channels: int) -> None:
    incoming = (fields["phi_i"].size, fields["theta_i"].size)
    for name, expected in (("vndf", incoming), (kind, (*incoming, channels))):
        found = fields[name].shape[: len(expected)]
        if found != expected:
            raise InputError(
                f"{path}: {name!r} is for {found} where phi_i, theta_i and the channels are "
                f"{expected}; the file is no material"
            )


def _field(path: Path, file: BinaryIO, size: int) -> _Field:
    """Read the description of a field, and check that its numbers are there."""
    (length,) = _unpack(path, file, "<H")
    name = _bytes(path, file, length).decode("utf-8", "replace")
    rank, kind, offset = _unpack(path, file, "<HBQ")
    if not 1 <= kind <= len(_TYPES):
        raise InputError(
            f"{path}: the field {name!r} has type {kind}; known are 1 to {len(_TYPES)}"
        )
    if rank > _LARGEST_RANK:
        raise InputError(f"{path}: the field {name!r} has {rank} axes; that is no array")
    shape = _unpack(path, file, f"<{rank}Q")
    field = _Field(name, _TYPES[kind - 1], offset, shape)
    if field.end > size:
        raise InputError(
            f"{path}: {size} bytes, but the field {name!r} of shape {shape} ends at {field.end}; "
            "the file is cut short"
        )
    if math.prod(max(n, 1) for n in shape) >= _LARGEST_SIZE:
        raise InputError(f"{path}: the field {name!r} has the shape {shape}; that is no array")
    return field


def _array(file: BinaryIO, field: _Field) -> np.ndarray:
    file.seek(field.offset)
    found = np.fromfile(file, field.dtype, math.prod(field.shape))
    return found.astype(field.dtype.newbyteorder("="), copy=False).reshape(field.shape)


def _unpack(path: Path, file: BinaryIO, form: str) -> tuple[int, ...]:
    return struct.unpack(form, _bytes(path, file, struct.calcsize(form)))


def _bytes(path: Path, file: BinaryIO, count: int) -> bytes:
    found = file.read(count)
    if len(found) < count:
        raise InputError(f"{path}: ends within its header; the file is cut short")
    return found
