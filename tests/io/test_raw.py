"""Camera RAW: a DNG made here is read as the very numbers of its sensor, black subtracted.

- Linear, full scale 1, no white balance applied; the camera's balance and black level are stated.
- It is a picture, and a photograph of a capture, whose import says what was read.
- Without rawpy the message names the extra; what is no RAW file is refused.
"""

import json
import struct
import sys

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.geometry import Sphere
from jaxrender.inverse.photographs import Listener
from jaxrender.io import read_image, read_raw
from jaxrender.io.captures import StatedSphere
from jaxrender.io.images import image_size
from jaxrender.pipelines.captures import captures_of
from jaxrender.pipelines.config import load_run_config
from jaxrender.pipelines.importing import ImportOptions, import_capture

BLACK, WHITE = 512, 4095


def write_dng(path, mosaic):
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


def test_the_numbers_of_the_sensor(tmp_path):
    pytest.importorskip("rawpy")
    # Each channel even, so that whatever fills in the mosaic gives back the same number.
    linear = np.array([0.25, 0.5, 0.125])
    rows, columns = np.indices((64, 96))
    channel = (rows % 2) + (columns % 2)
    counts = np.round(BLACK + linear * (WHITE - BLACK))
    write_dng(tmp_path / "a.dng", counts[channel])
    found = read_raw(tmp_path / "a.dng")
    assert found.values.shape == (64, 96, 3)
    np.testing.assert_allclose(found.values[8:-8, 8:-8].mean(axis=(0, 1)), linear, atol=2e-3)
    assert found.black_level == BLACK
    assert found.white_level == WHITE
    np.testing.assert_allclose(found.camera_white, [2, 1, 1.5], rtol=1e-3)


def even_dng(path, linear=(0.25, 0.5, 0.125)):
    rows, columns = np.indices((64, 96))
    counts = np.round(BLACK + np.array(linear) * (WHITE - BLACK))
    write_dng(path, counts[(rows % 2) + (columns % 2)])


def test_it_is_a_picture(tmp_path):
    pytest.importorskip("rawpy")
    even_dng(tmp_path / "a.dng")
    image = read_image(tmp_path / "a.dng")
    np.testing.assert_array_equal(image.pixels, read_raw(tmp_path / "a.dng").values)
    assert image_size(tmp_path / "a.dng") == (96, 64)
    # 3584 values are 11 bits and a half.
    assert (image.encoding, image.metadata["bit_depth"]) == ("linear", 11)
    assert image.metadata["white_red"] == pytest.approx(2, rel=1e-3)
    assert image.metadata["white_blue"] == pytest.approx(1.5, rel=1e-3)


def test_it_is_a_photograph_of_a_capture(tmp_path):
    pytest.importorskip("rawpy")
    even_dng(tmp_path / "a.dng")
    # A camera RAW without its suffix in the file of cameras is found, too.
    frames = [{"file_path": "a", "transform_matrix": np.eye(4).tolist()}]
    keys = {"w": 96, "h": 64, "fl_x": 100.0, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(keys))
    sphere = StatedSphere((0.0, 0.0, -5.0), 1.0)
    import_capture(tmp_path, tmp_path / "ours", ImportOptions(sphere=sphere))
    config = load_run_config(tmp_path / "ours/capture.yaml")
    assert config.capture.response == "linear"
    text = (tmp_path / "ours/capture.yaml").read_text().replace("\n#   ", " ")
    assert "camera RAW: linear, the black level 512 taken off, white at 4095" in text
    assert "white balance would be 2, 1, 1.5" in text
    (capture,) = captures_of(config)
    (photograph,) = capture.traced(
        capture.images(Listener()), Sphere(np.array([0.0, 0, -5]), 1.0), Listener()
    )
    usable = photograph.selection.usable
    np.testing.assert_allclose(photograph.radiance[usable].mean(axis=0), [0.25, 0.5, 0.125], 0.01)
    assert photograph.rounding == pytest.approx(1 / (2**11 - 1) / 12**0.5)


def test_what_is_no_raw_file(tmp_path):
    pytest.importorskip("rawpy")
    (tmp_path / "a.dng").write_bytes(b"nothing of the kind")
    with pytest.raises(InputError, match=r"a\.dng: not a readable RAW file"):
        read_raw(tmp_path / "a.dng")


def test_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rawpy", None)
    (tmp_path / "a.dng").write_bytes(b"")
    for read in (read_raw, read_image, image_size):
        with pytest.raises(InputError, match=r"a\.dng.*pip install 'jaxrender\[raw\]'"):
            read(tmp_path / "a.dng")
    with pytest.raises(InputError, match="no such image file"):
        read_raw(tmp_path / "b.dng")
