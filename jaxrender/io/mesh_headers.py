"""What a mesh file says of its size, held against the file before trimesh takes memory for it.

A .ply counts its elements in its header.  A .glb describes its numbers in JSON: views of bytes,
accessors that look at views, primitives that take accessors; a short text can take the same bytes
a million times.  Of an .obj or an .stl nothing takes more than the file has.
"""

import struct
from pathlib import Path
from typing import Any, BinaryIO

from jaxrender.errors import InputError
from jaxrender.io.jsonfiles import parse_json
from jaxrender.limits import DOCUMENT_BYTES, FACES, MESH_BYTES, REPEATED

ANEW = "export the mesh again"
_PLY_HEADER_BYTES = 2**16


def check_header(path: Path) -> None:
    """Raise InputError for a mesh file that is too large, or too small for what it claims."""
    MESH_BYTES.check(str(path), path.stat().st_size)
    with path.open("rb") as file:
        if path.suffix.lower() == ".ply":
            _check_ply(path, file)
        elif path.suffix.lower() == ".glb":
            _check_glb(path, file)


def check_repeats(path: Path, count: int) -> None:
    """Raise InputError where parts that stand in a file several times are too many faces."""
    FACES.check(f"{path}: all parts together", count, "leave parts out")
    # No format has more than one face in a byte.
    if count > path.stat().st_size:
        REPEATED.check(f"{path}: all parts together", count, "leave repeated parts out")


def _check_ply(path: Path, file: BinaryIO) -> None:
    size = path.stat().st_size
    header = file.read(_PLY_HEADER_BYTES).partition(b"end_header")[0]
    for number, line in enumerate(header.splitlines(), start=1):
        words = line.split()
        if words[:1] != [b"element"]:
            continue
        count = words[-1].decode("latin-1")
        if len(words) != 3 or not count.isdecimal() or len(count) > 18:
            said = line.decode("latin-1")
            raise InputError(f"{path}:{number}: {said!r}; wanted `element NAME COUNT`: {ANEW}")
        place = f"{path}:{number}: {words[1].decode('latin-1')}"
        if int(count) > size:
            raise InputError(
                f"{place}: the header counts {int(count):,}, the file has {size:,} bytes: {ANEW}"
            )
        FACES.check(place, int(count))


def _check_glb(path: Path, file: BinaryIO) -> None:
    head = file.read(20)
    if len(head) < 20 or not head.startswith(b"glTF"):
        raise InputError(f"{path}: not a readable mesh (no glTF header); {ANEW}")
    size, length = path.stat().st_size, struct.unpack_from("<I", head, 12)[0]
    if length > size:
        raise InputError(f"{path}: {length:,} bytes of JSON in a file of {size:,}; {ANEW}")
    DOCUMENT_BYTES.check(f"{path}: the JSON in it", length, "leave parts out")
    header = parse_json(path, file.read(length).decode("utf-8", "replace"))
    views, accessors, meshes = (
        _records(path, header, name) for name in ("bufferViews", "accessors", "meshes")
    )
    lengths = [_count(path, f"bufferView {i}", view, "byteLength") for i, view in enumerate(views)]
    # Views that overlap are copied apart.
    check_repeats(path, sum(lengths) // 8)
    counts = [_count(path, f"accessor {i}", one, "count") for i, one in enumerate(accessors)]
    for i, (one, count) in enumerate(zip(accessors, counts)):
        if "bufferView" not in one and count:
            raise InputError(
                f"{path}: accessor {i} has no numbers of its own (compressed?); export the mesh "
                "without compression"
            )
    taken = 0
    for mesh in meshes:
        for primitive in _records(path, mesh, "primitives"):
            known = primitive.get("attributes")
            numbers = [
                *(known.values() if isinstance(known, dict) else ()),
                primitive.get("indices"),
            ]
            taken += sum(counts[i] for i in numbers if type(i) is int and 0 <= i < len(counts))
    check_repeats(path, taken // 3)


def _records(path: Path, header: Any, name: str) -> list[dict[str, Any]]:
    """Take a list of objects out of an object; an empty one where there is none."""
    found = header.get(name, []) if isinstance(header, dict) else None
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise InputError(f"{path}: `{name}` is no list of objects; {ANEW}")
    return found


def _count(path: Path, place: str, record: dict[str, Any], key: str) -> int:
    found = record.get(key)
    if type(found) is not int or found < 0:
        raise InputError(f"{path}: {place}: `{key}` is {found!r}; wanted a whole number: {ANEW}")
    return found
