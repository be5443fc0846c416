"""Camera RAW made here: a minimal DNG, byte by byte."""

import struct
from pathlib import Path

import numpy as np

BLACK, WHITE = 512, 4095


def write_dng(path: Path, mosaic: np.ndarray) -> None:
    """Write a minimal DNG: one strip of 16-bit counts behind red, green, green and blue filters."""
    rows, columns = mosaic.shape
    short, long, byte, text, ratio, signed = 3, 4, 1, 2, 5, 10
    matrix = [x for v in np.eye(3).ravel() for x in (int(v * 10000), 10000)]
    entries = [
        (254, long, [0]),
        (256, long, [columns]),
        (257, long, [rows]),
        (258, short, [16]),
        (259, short, [1]),
        (262, short, [32803]),
        (271, text, b"made\0"),
        (272, text, b"here\0"),
        (273, long, None),
        (274, short, [1]),
        (277, short, [1]),
        (278, long, [rows]),
        (279, long, [rows * columns * 2]),
        (33421, short, [2, 2]),
        (33422, byte, bytes([0, 1, 1, 2])),
        (50706, byte, bytes([1, 4, 0, 0])),
        (50708, text, b"made here\0"),
        (50714, short, [BLACK]),
        (50717, long, [WHITE]),
        (50721, signed, matrix),
        (50728, ratio, [1, 2, 1, 1, 2, 3]),
        (50778, short, [21]),
    ]
    sizes = {short: "H", long: "I", ratio: "I", signed: "i"}
    start = 8 + 2 + 12 * len(entries) + 4
    extra, directory = b"", struct.pack("<H", len(entries))
    length = sum(0 if v is None or isinstance(v, bytes) else 4 * len(v) for _, _, v in entries)
    strip = start + length + 64
    for tag, kind, values in entries:
        values = [strip] if values is None else values
        if isinstance(values, bytes):
            data, count = values, len(values)
        else:
            data = struct.pack(f"<{len(values)}{sizes[kind]}", *values)
            count = len(values) // 2 if kind in (ratio, signed) else len(values)
        if len(data) > 4:
            place, extra = start + len(extra), extra + data + b"\0" * (len(data) % 2)
            data = struct.pack("<I", place)
        directory += struct.pack("<HHI", tag, kind, count) + data.ljust(4, b"\0")
    whole = b"II*\0" + struct.pack("<I", 8) + directory + struct.pack("<I", 0) + extra
    path.write_bytes(whole.ljust(strip, b"\0") + mosaic.astype("<u2").tobytes())


def even_dng(path: Path, linear: tuple[float, ...] = (0.25, 0.5, 0.125)) -> None:
    """Write a picture of one colour, so that whatever fills in the mosaic gives it back."""
    rows, columns = np.indices((64, 96))
    counts = np.round(BLACK + np.array(linear) * (WHITE - BLACK))
    write_dng(path, counts[(rows % 2) + (columns % 2)])
