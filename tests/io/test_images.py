"""Image files: what is read is what the file stores, and no damage passes in silence.

Pinned down: a round trip through every format to that format's own precision; alpha apart and
colours not multiplied by it; channels by name; metadata; and for each kind of damage the file, the
place, the value and the remedy in the message; a script ends in silence.  The oracle for files of
other programs is OpenImageIO itself, told to write what this project never writes.
"""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from jaxrender.errors import InputError
from jaxrender.io.images import _STORED_AS, _WITHOUT_ALPHA, image_size, read_image, write_image
from jaxrender.shapes import ImageArray

FLOAT32 = 2.0**-24  # half a unit in the last place below 1
EIGHT_BITS = 0.5 / 255 + 1e-6
RGBE = 1 / 128  # a mantissa of 8 bits shared by three channels, rounded down
# JPEG quantises frequencies; on a smooth picture a few grey levels remain.
JPEG = 8 / 255

# Formats that keep less than they store; of any other that is written, what it stores is kept.
LOSSY = {".hdr": RGBE, ".jpg": JPEG, ".jpeg": JPEG}
STORED = {"float": FLOAT32, "uint8": EIGHT_BITS}
PRECISION = {
    suffix: LOSSY.get(suffix, STORED[stored_as]) for suffix, stored_as in _STORED_AS.items()
}
PHOTOS = Path(__file__).parents[3] / "shared" / "data" / "photos"
UNASSOCIATED = {"oiio:UnassociatedAlpha": 1}


def smooth(channels: int) -> ImageArray:
    rows, columns = np.meshgrid(np.linspace(0, 1, 24), np.linspace(0, 1, 40), indexing="ij")
    return np.stack([rows, columns, rows * columns, 1 - rows][:channels], axis=-1)


def write_raw(path: Path, values: np.ndarray, fmt: str, names: str = "", **tags: object) -> None:
    """Write with OpenImageIO directly, free to make what write_image refuses."""
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], fmt)
    if names:
        spec.channelnames = tuple(names)
    for tag, value in tags.items():
        if tag.startswith("full_"):
            setattr(spec, tag, value)
        else:
            spec.attribute(tag, value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(np.ascontiguousarray(values))
    assert out.close()


@pytest.mark.parametrize("suffix", PRECISION)
def test_what_is_written_is_read(tmp_path, suffix):
    path = tmp_path / f"picture{suffix}"
    write_image(path, smooth(3))
    image = read_image(path)
    assert image.pixels.dtype == np.float64
    np.testing.assert_allclose(image.pixels, smooth(3), atol=PRECISION[suffix])
    assert image.alpha is None
    assert not image.invalid.any()
    assert image_size(path) == (40, 24)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [s for s in PRECISION if s not in _WITHOUT_ALPHA])
def test_alpha_stays_apart(tmp_path, suffix):
    # Row 0 has coverage 1, the last row 0: multiplied colours would be black there.
    write_image(tmp_path / f"a{suffix}", smooth(4))
    image = read_image(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(image.pixels, smooth(3), atol=PRECISION[suffix])
    np.testing.assert_allclose(image.alpha, smooth(4)[..., 3], atol=PRECISION[suffix])


# HDR always has three channels.
@pytest.mark.parametrize("suffix", [suffix for suffix in PRECISION if suffix != ".hdr"])
def test_grey_is_repeated(tmp_path, suffix):
    write_image(tmp_path / f"g{suffix}", smooth(1))
    pixels = read_image(tmp_path / f"g{suffix}").pixels
    np.testing.assert_allclose(pixels, np.repeat(smooth(1), 3, -1), atol=PRECISION[suffix])


def test_grey_with_alpha(tmp_path):
    write_raw(tmp_path / "g.png", np.array([[[100, 51]]], np.uint8), "uint8", "YA", **UNASSOCIATED)
    image = read_image(tmp_path / "g.png")
    np.testing.assert_allclose(image.pixels, np.full((1, 1, 3), 100 / 255), rtol=1e-15)
    np.testing.assert_allclose(image.alpha, [[0.2]], rtol=1e-15)


@pytest.mark.parametrize(("fmt", "top"), [("uint8", 255), ("uint16", 65535)])
def test_integers_are_divided_by_their_largest_value(tmp_path, fmt, top):
    values = np.array([[[0, 1, top]]], fmt)
    write_raw(tmp_path / "i.png", values, fmt)
    image = read_image(tmp_path / "i.png")
    np.testing.assert_array_equal(image.pixels, [[[0, 1 / top, 1]]])
    assert image.metadata["is_integer"]
    assert image.metadata["bit_depth"] == values.dtype.itemsize * 8


def test_channels_are_found_by_name(tmp_path):
    """An EXR with a depth channel; alpha and depth are no colours."""
    values = np.arange(5, dtype=np.float32).reshape(1, 1, 5)
    write_raw(tmp_path / "d.exr", values, "float", "ZBGAR")
    image = read_image(tmp_path / "d.exr")
    np.testing.assert_array_equal(image.pixels, [[[4, 2, 1]]])
    np.testing.assert_array_equal(image.alpha, [[3]])


def test_exposure_time_and_depth_are_told(tmp_path):
    write_raw(tmp_path / "e.exr", np.ones((1, 1, 3), np.float32), "half", ExposureTime=0.125)
    metadata = read_image(tmp_path / "e.exr").metadata
    assert metadata == {"is_integer": False, "bit_depth": 16, "exposure_time": 0.125}


def test_radiance_exposure_is_told(tmp_path):
    write_image(tmp_path / "plain.hdr", smooth(3))
    data = (tmp_path / "plain.hdr").read_bytes().replace(b"FORMAT", b"EXPOSURE=4\nFORMAT", 1)
    (tmp_path / "e.hdr").write_bytes(data)
    assert read_image(tmp_path / "e.hdr").metadata["radiance_exposure"] == 4
    np.testing.assert_array_equal(
        read_image(tmp_path / "e.hdr").pixels, read_image(tmp_path / "plain.hdr").pixels
    )


def test_exr_keeps_what_half_precision_would_lose(tmp_path):
    """65504 is the largest half; the colour space is named."""
    write_image(tmp_path / "sun.exr", np.full((2, 4, 3), 1e6))
    assert read_image(tmp_path / "sun.exr").pixels.max() == 1e6
    spec = oiio.ImageInput.open(str(tmp_path / "sun.exr")).spec()
    assert spec.get_string_attribute("oiio:ColorSpace").startswith("lin_rec709")


def test_any_memory_order_can_be_written(tmp_path):
    write_image(tmp_path / "f.exr", np.asfortranarray(smooth(3))[:, ::-1])
    pixels = read_image(tmp_path / "f.exr").pixels
    np.testing.assert_allclose(pixels, smooth(3)[:, ::-1], atol=FLOAT32)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "old.exr"
    write_image(path, smooth(3))
    before = path.read_bytes()

    class Failing:
        @classmethod
        def create(cls, _):
            return cls()

        def open(self, *_):
            return True

        def write_image(self, _):
            return False

        def close(self):
            return True

        def geterror(self):
            return "disk full"

    monkeypatch.setattr(oiio, "ImageOutput", Failing)
    with pytest.raises(InputError, match=r"old\.exr: cannot be written \(disk full\)"):
        write_image(path, smooth(1))
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.skipif(not PHOTOS.exists(), reason="the real photographs are not on this machine")
def test_a_real_photograph():
    """The grey ball is centred at row 144.5, column 244.5, with a radius of 108 pixels."""
    mask = read_image(PHOTOS / "gray" / "gray.mask.tga").pixels[..., 0] > 0.5
    assert mask.shape == (340, 512)
    np.testing.assert_allclose(np.argwhere(mask).mean(axis=0), [144.5, 244.5], atol=1)
    assert np.sqrt(mask.sum() / np.pi) == pytest.approx(108, abs=1)
    photograph = read_image(PHOTOS / "gray" / "gray.0.tga")
    assert photograph.metadata == {"is_integer": True, "bit_depth": 8}
    assert photograph.pixels[mask].mean() > 10 * photograph.pixels[~mask].mean()


@pytest.mark.parametrize(
    ("value", "words"), [(np.nan, "nan"), (np.inf, "inf"), (-0.25, "-0.25")], ids=str
)
def test_broken_pixels_are_refused_by_name(tmp_path, value, words):
    values = smooth(3).astype(np.float32)
    values[5, 7, 1] = values[6, 0, 0] = value
    write_raw(tmp_path / "b.exr", values, "float")
    message = (
        rf"b\.exr: channel G, pixel \(row 5, column 7\): the value is {words}; 2 of 960 pixels"
        r".*`invalid: mask`"
    )
    with pytest.raises(InputError, match=message):
        read_image(tmp_path / "b.exr")


def test_broken_pixels_can_be_masked(tmp_path):
    values = smooth(4).astype(np.float32)
    values[5, 7, 1], values[6, 0, 3] = np.nan, np.inf
    write_raw(tmp_path / "b.exr", values, "float", "RGBA")
    image = read_image(tmp_path / "b.exr", invalid="mask")
    np.testing.assert_array_equal(np.argwhere(image.invalid), [[5, 7], [6, 0]])
    np.testing.assert_array_equal(image.pixels[image.invalid], 0)
    np.testing.assert_array_equal(image.alpha[image.invalid], 0)
    np.testing.assert_allclose(image.pixels[~image.invalid], smooth(3)[~image.invalid], atol=1e-7)


def test_a_broken_alpha_is_named(tmp_path):
    values = np.ones((1, 1, 4), np.float32) * [[[1, 1, 1, np.nan]]]
    write_raw(tmp_path / "b.exr", values.astype(np.float32), "float", "RGBA")
    with pytest.raises(InputError, match=r"channel alpha, pixel \(row 0, column 0\)"):
        read_image(tmp_path / "b.exr")


def test_an_unknown_rule_is_misuse():
    with pytest.raises(ValueError, match="'drop': choose one of refuse, mask"):
        read_image("any.exr", invalid="drop")


def test_a_missing_file_is_named(tmp_path):
    for read in (read_image, image_size):
        with pytest.raises(InputError, match=r"gone\.exr: no such image file"):
            read(tmp_path / "gone.exr")
    with pytest.raises(InputError, match="no such image file"):
        read_image(tmp_path)


@pytest.mark.parametrize("suffix", ["exr", "png", "txt"])
def test_a_file_of_another_kind_is_refused(tmp_path, suffix):
    (tmp_path / f"x.{suffix}").write_bytes(b"no picture at all" * 9)
    with pytest.raises(InputError, match=rf"x\.{suffix}: not a readable image \(.+\)"):
        read_image(tmp_path / f"x.{suffix}")


@pytest.mark.parametrize("suffix", PRECISION)
@pytest.mark.parametrize("kept", [0.5, 0.9])
def test_a_file_cut_short_is_refused(tmp_path, suffix, kept):
    path = tmp_path / f"cut{suffix}"
    # Noise, so that every format needs all its bytes.
    write_image(path, np.random.default_rng(0).random((40, 50, 3)))
    path.write_bytes(path.read_bytes()[: int(kept * path.stat().st_size)])
    with pytest.raises(InputError, match=re.escape(str(path))):
        read_image(path)


@pytest.mark.parametrize("suffix", ["jpg", "tif", "exr"])
def test_a_turned_picture_is_refused(tmp_path, suffix):
    path = tmp_path / f"turned.{suffix}"
    fmt = "float" if suffix == "exr" else "uint8"
    write_raw(
        path, np.zeros((2, 4, 3), np.dtype(fmt.replace("float", "float32"))), fmt, Orientation=6
    )
    with pytest.raises(InputError, match=r"the Orientation tag is 6.*upright"):
        read_image(path)


def test_a_crop_of_a_larger_picture_is_refused(tmp_path):
    path = tmp_path / "crop.exr"
    write_raw(path, np.zeros((2, 4, 3), np.float32), "float", full_width=9)
    with pytest.raises(InputError, match=r"data window \(0, 0, 4, 2\) differs .* \(0, 0, 9, 2\)"):
        read_image(path)


def test_two_colours_are_refused(tmp_path):
    write_raw(tmp_path / "two.exr", np.zeros((1, 1, 2), np.float32), "float", "UV")
    with pytest.raises(InputError, match=r"two\.exr: channels U, V; wanted R, G, B"):
        read_image(tmp_path / "two.exr")


def test_a_header_that_claims_too_much_is_refused(tmp_path, monkeypatch):
    """Before a pixel is read."""
    write_image(tmp_path / "huge.exr", smooth(3))
    monkeypatch.setenv("JAXRENDER_MAX_PIXELS", "959")
    message = (
        r"huge\.exr: the header claims 40 x 24 and 3 channels: 960 pixels, and at most 959 are read"
        r".*set JAXRENDER_MAX_PIXELS to allow more"
    )
    with pytest.raises(InputError, match=message):
        read_image(tmp_path / "huge.exr")


@pytest.mark.parametrize(
    ("name", "pixels", "message"),
    [
        ("x.gif", smooth(3), r"unknown image format '\.gif'; use \.exr, \.hdr"),
        ("no/x.exr", smooth(3), "no such folder .*no; make it first"),
        ("x.exr", np.zeros((2, 2, 2)), r"cannot write shape \(2, 2, 2\).*1 or 3 or 4 channels"),
        ("x.hdr", smooth(4), r"cannot write shape \(24, 40, 4\).*1 or 3 channels"),
        ("x.exr", np.zeros((0, 2, 3)), r"cannot write shape \(0, 2, 3\).*not empty"),
        ("x.exr", smooth(3) * 1e39, r"channel 1, pixel \(row 0, column \d+\): cannot write inf"),
        ("x.exr", smooth(3) * np.nan, r"pixel \(row 0, column 0\): cannot write nan"),
        ("x.hdr", smooth(3) - 0.5, r"cannot write -0\.5; Radiance files hold no negative"),
        ("x.png", smooth(3) * 2, r"; 8 bits hold 0 to 1"),
    ],
)
def test_what_a_format_cannot_hold_is_refused(tmp_path, name, pixels, message):
    with pytest.raises(InputError, match=message):
        write_image(tmp_path / name, pixels)
    assert not list(tmp_path.iterdir())


def test_nothing_of_the_library_outlives_a_script_with_a_class_of_its_own():
    script = """
import equinox
from jaxrender.io import read_image

class Mine(equinox.Module):  # JAX keeps the class, and with it all that its module names
    def method(self):
        return read_image
"""
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")
