"""Arrays as text in a page: base64 of little-endian numbers, with their kind and shape."""

import base64
import binascii
from collections.abc import Mapping
from typing import Any

import numpy as np

# The kinds of numbers that a browser can make an array of; float16 is read as its 16 bits.
KINDS = ("uint8", "uint16", "int16", "uint32", "float16", "float32")


def packed(array: np.ndarray) -> dict[str, Any]:
    """Write an array as text."""
    kind = array.dtype.name
    if kind not in KINDS:
        raise ValueError(f"an array of {kind}: a page holds {', '.join(KINDS)}")
    numbers = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    text = base64.b64encode(numbers.tobytes()).decode("ascii")
    return {"kind": kind, "shape": list(array.shape), "data": text}


def unpacked(stored: Mapping[str, Any]) -> np.ndarray:
    """Read an array again; ``ValueError`` where the text is none."""
    try:
        content = base64.b64decode(stored["data"], validate=True)
    except binascii.Error as error:
        raise ValueError(f"not base64: {error}") from error
    kind = np.dtype(stored["kind"]).newbyteorder("<")
    return np.frombuffer(content, kind).reshape(stored["shape"]).astype(stored["kind"])


def octahedral(directions: np.ndarray) -> np.ndarray:
    """Fold unit directions [row, 3] onto a square, as int16 [row, 2]."""
    folded = directions / np.abs(directions).sum(axis=1, keepdims=True)
    sign = np.where(folded[:, :2] >= 0, 1.0, -1.0)
    square = np.where(folded[:, 2:] >= 0, folded[:, :2], (1 - np.abs(folded[:, 1::-1])) * sign)
    return np.rint(square * 32767).astype(np.int16)


def from_octahedral(square: np.ndarray) -> np.ndarray:
    """Unfold unit directions."""
    x, y = square.astype(float).T / 32767
    z = 1 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0)
    unfolded = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=-1)
    return unfolded / np.linalg.norm(unfolded, axis=1, keepdims=True)
