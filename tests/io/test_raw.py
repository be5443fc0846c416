"""Camera RAW: a DNG made here is read as the very numbers of its sensor, black subtracted.

- Linear, full scale 1, no white balance applied; the camera's balance and black level are stated.
- It is a picture, and a photograph of a capture, whose import says what was read.
- Without rawpy the message names the extra; what is no RAW file is refused.
"""

import json
import sys

import numpy as np
import pytest
from raw_files import BLACK, WHITE, even_dng, write_dng

from jaxrender.errors import InputError
from jaxrender.geometry import Sphere
from jaxrender.inverse.photographs import Listener
from jaxrender.io import read_image, read_raw
from jaxrender.io.captures import StatedSphere
from jaxrender.io.images import image_size
from jaxrender.pipelines.captures import captures_of
from jaxrender.pipelines.config import load_run_config
from jaxrender.pipelines.importing import ImportOptions, import_capture


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
