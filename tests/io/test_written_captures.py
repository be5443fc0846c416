"""Cameras that are written are those that are read again.

Pinned down: pinhole and orthographic cameras, poses and all intrinsics; exposures, and that there
are none; the places of pictures and masks relative to the capture that they came from, absolute
where they lie outside.
"""

import json

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.geometry import Orthographic, Pinhole, look_at
from jaxrender.io import Capture, Frame, read_capture, write_capture

UP = np.array([0.0, 0.0, 1.0])
NAMES = ("width", "height", "cx", "cy")


def pose(number):
    """Make a pose of many digits."""
    return look_at(np.array([3.1, np.sqrt(number + 0.3), 1 / 3]), np.array([0.1, 0.2, 0.3]), UP)


def pinhole(number):
    return Pinhole(7, 5, pose(number), fl_x=100 / 3, fl_y=20.5, cx=3.25, cy=2.75)


def orthographic(number):
    return Orthographic(7, 5, pose(number), scale=1 / 7, cx=3.25, cy=2.75)


def pictures(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


@pytest.fixture
def folder(tmp_path):
    """Make a folder of pictures, as a capture names them."""
    folder = tmp_path / "capture"
    pictures(folder, "images/a.exr", "images/b.exr", "masks/b.png")
    return folder


def taken(folder, cameras):
    """Make a capture of two photographs, one with a mask and an exposure."""
    first, second = cameras
    frames = (
        Frame("a", first, folder / "images/a.exr", None, None),
        Frame("b", second, folder / "images/b.exr", folder / "masks/b.png", 0.125),
    )
    return Capture(frames, folder / "transforms.json")


@pytest.mark.parametrize(
    ("make", "lengths"), [(pinhole, ("fl_x", "fl_y")), (orthographic, ("scale",))]
)
def test_what_is_written_is_read_again(folder, make, lengths):
    capture = taken(folder, (make(0), make(1)))
    write_capture(folder / "mended.json", capture)
    found = read_capture(folder / "mended.json")
    assert found.source == folder / "mended.json"
    for one, other in zip(found.frames, capture.frames, strict=True):
        assert type(one.camera) is type(other.camera)
        np.testing.assert_array_equal(one.camera.world_from_camera, other.camera.world_from_camera)
        for name in (*NAMES, *lengths):
            assert getattr(one.camera, name) == getattr(other.camera, name)
        assert one._replace(camera=None) == other._replace(camera=None)


def test_cameras_of_two_kinds_in_one_capture(folder):
    capture = taken(folder, (orthographic(0), pinhole(1)))
    write_capture(folder / "mended.json", capture)
    first, second = read_capture(folder / "mended.json").frames
    assert isinstance(first.camera, Orthographic)
    assert isinstance(second.camera, Pinhole)


def test_a_file_elsewhere_finds_its_pictures_by_the_folder_they_came_from(folder, tmp_path):
    capture = taken(folder, (pinhole(0), pinhole(1)))
    (tmp_path / "out").mkdir()
    written = tmp_path / "out/capture.json"
    write_capture(written, capture)
    entries = json.loads(written.read_text())["frames"]
    assert [entry["file_path"] for entry in entries] == ["images/a.exr", "images/b.exr"]
    assert entries[1]["mask_path"] == "masks/b.png"
    assert "mask_path" not in entries[0]
    with pytest.raises(InputError, match="does not exist"):
        read_capture(written)
    first, second = read_capture(written, images=folder).frames
    assert (first.image_path, second.mask_path) == (folder / "images/a.exr", folder / "masks/b.png")


def test_pictures_outside_the_folder_are_written_absolute(folder, tmp_path):
    pictures(tmp_path, "elsewhere/c.exr")
    outside = tmp_path / "elsewhere/c.exr"
    capture = taken(folder, (pinhole(0), pinhole(1)))
    moved = capture.frames[0]._replace(image_path=folder / "../elsewhere/c.exr", name="c")
    write_capture(folder / "mended.json", capture._replace(frames=(moved, capture.frames[1])))
    entries = json.loads((folder / "mended.json").read_text())["frames"]
    assert entries[0]["file_path"] == str(outside.resolve())
    assert entries[1]["file_path"] == "images/b.exr"
    with pytest.raises(InputError, match=r"frame 0 .*`file_path` leads outside"):
        read_capture(folder / "mended.json")
    first, _ = read_capture(folder / "mended.json", allow_outside=True).frames
    assert first.image_path.samefile(outside)
    assert first.name == "c"
