"""XML documents from other programs, without what makes XML dangerous.

A document type, which may define entities that multiply or name other files, is refused.  Depth and
size are limited.
"""

import contextlib
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from jaxrender.errors import InputError
from jaxrender.limits import DEPTH, DOCUMENT_BYTES

Element = ElementTree.Element


def read_xml(path: Path) -> Element:
    """Parse a file; raises InputError with line and column, or the limit that is passed."""
    return _parsed(path, _content(path))


def root_name(path: Path) -> str | None:
    """Name the first element of a file; None if it is no XML."""
    try:
        with path.open("rb") as file:
            start = file.read(4096)
    except OSError:
        return None
    names: list[str] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, _: names.append(name)
    with contextlib.suppress(expat.ExpatError, ValueError, LookupError):
        parser.Parse(start, False)
    return names[0] if names else None


def _content(path: Path) -> bytes:
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    DOCUMENT_BYTES.check(str(path), path.stat().st_size, "give a smaller file")
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror}; mend its permissions"
        ) from None


def _parsed(path: Path, content: bytes) -> Element:
    builder, depth = ElementTree.TreeBuilder(), [0]
    parser = expat.ParserCreate()

    def refuse(*_: object) -> NoReturn:
        raise InputError(
            f"{path}:{parser.CurrentLineNumber}: a document type (<!DOCTYPE>); remove it"
        )

    def start(name: str, attributes: dict[str, str]) -> None:
        depth[0] += 1
        DEPTH.check(f"{path}:{parser.CurrentLineNumber}", depth[0], "take elements out")
        builder.start(name, attributes)

    def end(name: str) -> None:
        depth[0] -= 1
        builder.end(name)

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        said = expat.ErrorString(error.code)
        raise InputError(
            f"{path}:{error.lineno}:{error.offset + 1}: {said}; mend the XML there"
        ) from None
    except (ValueError, LookupError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: an XML of an unknown encoding; save it as UTF-8") from None
    return builder.close()
