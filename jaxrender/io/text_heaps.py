"""Heaps of texts in an HDF5 file, checked before its library reads them.

A heap opens with ``GCOL``, version 1 and its size; each object has a number, its size and its
bytes, and number 0 is the free room up to the heap's end.  Where free room ends before that, the
library goes round without end (2.0 does).
"""

import mmap
import struct
from pathlib import Path

_OPENING = b"GCOL\1\0\0\0"
_HEAD, _ALIGNED = 16, 8


def damaged_heap(path: Path) -> int | None:
    """Find the byte at which the first damaged heap of a file lies; None where all are whole."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = content.find(_OPENING)
        while start >= 0:
            if not _is_whole(content, start):
                return start
            start = content.find(_OPENING, start + len(_OPENING))
    return None


def _is_whole(content: mmap.mmap, start: int) -> bool:
    if start + _HEAD > len(content):
        return False
    end = start + struct.unpack_from("<Q", content, start + len(_OPENING))[0]
    if end > len(content):
        return False
    at = start + _HEAD
    while at + _HEAD <= end:
        number, size = struct.unpack_from("<H6xQ", content, at)
        if number == 0:
            return at + size == end
        at += _HEAD + -(-size // _ALIGNED) * _ALIGNED
    return at <= end
