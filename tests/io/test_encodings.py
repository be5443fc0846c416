"""What files state about their values: told apart, and said where it contradicts the response.

Pillow and hand-made PNG chunks write what OpenImageIO reads.
"""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image, ImageCms

from jaxrender.geometry import Orthographic
from jaxrender.imaging import SRGB, Curve, Linear
from jaxrender.inverse.photographs import Listener, Reading, read_photographs
from jaxrender.io import Capture, Frame, contradiction, read_image, write_image

GREY = np.full((4, 4, 3), 128, np.uint8)
SRGB_PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def with_chunk(path, name, data):
    """Put a chunk behind the header of a PNG file."""
    whole = path.read_bytes()
    chunk = struct.pack(">I", len(data)) + name + data
    chunk += struct.pack(">I", zlib.crc32(name + data))
    path.write_bytes(whole[:33] + chunk + whole[33:])


def png_of_gamma(path, gamma):
    Image.fromarray(GREY).save(path)
    with_chunk(path, b"gAMA", struct.pack(">I", gamma))


def exif(path):
    stated = Image.Exif()
    stated[0x8769] = {0xA001: 1}
    Image.fromarray(GREY).save(path, exif=stated)


def profile(path):
    Image.fromarray(GREY).save(path, icc_profile=SRGB_PROFILE)


def profile_of_p3(path):
    # The description of the profile as a table of text, another name in the same length.
    named = SRGB_PROFILE.replace(
        "sRGB built-in".encode("utf-16-be"), "Display P3 in".encode("utf-16-be")
    )
    assert named != SRGB_PROFILE
    Image.fromarray(GREY).save(path, icc_profile=named)


STATED = {
    "plain.png": (lambda path: Image.fromarray(GREY).save(path), None),
    "plain.jpg": (lambda path: Image.fromarray(GREY).save(path), None),
    "plain.tga": (lambda path: Image.fromarray(GREY).save(path), None),
    "exif.jpg": (exif, "sRGB"),
    "profile.png": (profile, "sRGB"),
    "profile.jpg": (profile, "sRGB"),
    "p3.jpg": (profile_of_p3, "Display P3"),
    "linear.png": (lambda path: png_of_gamma(path, 100000), "linear"),
    "gamma.png": (lambda path: png_of_gamma(path, 45455), "gamma"),
}


@pytest.mark.parametrize("name", STATED)
def test_what_a_file_states(tmp_path, name):
    write, encoding = STATED[name]
    write(tmp_path / name)
    assert read_image(tmp_path / name).encoding == encoding


def test_pictures_of_radiance_state_nothing(tmp_path):
    write_image(tmp_path / "a.exr", GREY / 255.0)
    assert contradiction(read_image(tmp_path / "a.exr").encoding, Linear()) is None


@pytest.mark.parametrize(
    ("encoding", "response", "said"),
    [
        (None, Linear(), None),
        ("linear", Linear(), None),
        ("sRGB", SRGB(), None),
        ("gamma", SRGB(), None),
        ("sRGB", Curve(np.array([0.0, 1.0]), np.array([0.0, 1.0])), None),
        ("sRGB", Linear(), "say sRGB, but the stated response is linear"),
        ("linear", SRGB(), "say linear, but the stated response is srgb"),
        ("Display P3", SRGB(), "say Display P3, whose red, green and blue are not those of sRGB"),
    ],
)
def test_contradictions(encoding, response, said):
    found = contradiction(encoding, response)
    assert found is None if said is None else said in (found or "")


def test_a_capture_says_it_once(tmp_path):
    frames = []
    for number in range(3):
        path = tmp_path / f"{number}.jpg"
        exif(path)
        camera = Orthographic(4, 4, np.eye(4), scale=1.0)
        frames.append(Frame(str(number), camera, path, None, None))
    capture, notes = Capture(tuple(frames)), []
    read_photographs(capture, Reading(Linear()), Listener(notes.append))
    assert len(notes) == 1
    assert "0.jpg, and of 2 more: warning: its metadata say sRGB" in notes[0]
    read_photographs(capture, Reading(SRGB()), Listener(notes.append))
    assert len(notes) == 1
