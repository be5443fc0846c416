"""Captures: transforms.json to cameras and paths.

Pinned down: intrinsics from each way to state them, with overrides frame by frame; poses untouched;
files found by suffix and below a trusted folder only; frame names; and a message for every mistake
with the file, the frame, the key and the value.
"""

import json
import math

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.geometry.cameras import Orthographic, Pinhole
from jaxrender.io import read_capture, read_mask, read_photograph
from jaxrender.io.images import write_image

POSE = [[1, 0, 0, 0.5], [0, 0, -1, -4], [0, 1, 0, 1.5], [0, 0, 0, 1]]
TOP = {"fl_x": 100, "w": 6, "h": 4}


def frame(path: str = "a.exr", **keys) -> dict:
    return {"file_path": path, "transform_matrix": POSE, **keys}


@pytest.fixture
def capture(tmp_path):
    """Write a transforms.json and its pictures (6 x 4 pixels), and return the path."""

    def write(*frames, pictures=("a.exr",), folder=tmp_path, **top):
        for name in pictures:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_image(folder / name, np.full((4, 6, 3), 0.5))
        path = tmp_path / "transforms.json"
        path.write_text(json.dumps({**(top or TOP), "frames": list(frames)}))
        return path

    return write


def refused(path, message: str, **options) -> None:
    with pytest.raises(InputError, match=r"transforms\.json.*" + message):
        read_capture(path, **options)


def test_intrinsics_and_pose(capture):
    keys = {"fl_x": 100, "fl_y": 110, "cx": 2.5, "cy": 1.5, "w": 6, "h": 4}
    (only,) = read_capture(capture(frame(exposure=0.25), aabb_scale=4, **keys)).frames
    camera = only.camera
    assert isinstance(camera, Pinhole)
    assert (camera.width, camera.height, camera.fl_x, camera.fl_y) == (6, 4, 100, 110)
    assert (camera.cx, camera.cy) == (2.5, 1.5)
    np.testing.assert_array_equal(camera.world_from_camera, POSE)
    assert (only.name, only.exposure, only.mask_path) == ("a", 0.25, None)


def test_centre_and_second_focal_length_default(capture):
    camera = read_capture(capture(frame())).frames[0].camera
    assert (camera.cx, camera.cy, camera.fl_y) == (3, 2, 100)


def test_size_and_focal_length_from_picture_and_angle(capture):
    """f = w / 2 / tan(angle / 2): 90 degrees over 6 pixels give 3."""
    camera = read_capture(capture(frame(), camera_angle_x=math.pi / 2)).frames[0].camera
    assert (camera.width, camera.height) == (6, 4)
    assert camera.fl_x == pytest.approx(3, rel=1e-15)
    assert camera.fl_y == camera.fl_x
    angles = {"camera_angle_x": math.pi / 2, "camera_angle_y": 2 * math.atan(1 / 4)}
    camera = read_capture(capture(frame(), **angles)).frames[0].camera
    assert camera.fl_y == pytest.approx(8, rel=1e-15)


def test_orthographic(capture):
    path = capture(frame(), camera_model="orthographic", ortho_scale=0.01, cx=2)
    camera = read_capture(path).frames[0].camera
    assert isinstance(camera, Orthographic)
    assert (camera.scale, camera.cx, camera.cy) == (0.01, 2, 2)


def test_a_frame_overrides_the_top(capture):
    path = capture(frame(), frame("b", fl_x=50), pictures=("a.exr", "b.exr"))
    first, second = read_capture(path).frames
    assert (first.camera.fl_x, second.camera.fl_x) == (100, 50)


def test_suffixes_are_tried_linear_first(capture):
    path = capture(frame("a"), frame("gray.0"), pictures=("a.png", "a.exr", "gray.0.tga"))
    frames = read_capture(path).frames
    assert [f.image_path.name for f in frames] == ["a.exr", "gray.0.tga"]
    assert [f.name for f in frames] == ["a", "gray.0"]


def test_names_that_would_clash_take_the_folder_along(capture):
    path = capture(frame("./x/1"), frame("y/1"), pictures=("x/1.exr", "y/1.exr"))
    assert [f.name for f in read_capture(path).frames] == ["x_1", "y_1"]


def test_pictures_in_a_trusted_folder(capture, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    path = capture(frame(mask_path="m.png"), pictures=("a.exr", "m.png"), folder=elsewhere)
    (only,) = read_capture(path, images=elsewhere).frames
    assert (only.image_path, only.mask_path) == (elsewhere / "a.exr", elsewhere / "m.png")
    refused(path, "does not exist")


@pytest.mark.parametrize("key", ["file_path", "mask_path"])
def test_paths_outside_need_permission(capture, tmp_path, key):
    folder = tmp_path / "inner"
    capture(frame(), pictures=("../secret.exr", "a.exr"), folder=folder)
    for place in ("../secret.exr", str(tmp_path / "secret.exr")):
        entry = {**frame(), key: place}
        (folder / "transforms.json").write_text(json.dumps({**TOP, "frames": [entry]}))
        refused(folder / "transforms.json", rf"frame 0 .*`{key}` leads outside .*inner")
        (allowed,) = read_capture(folder / "transforms.json", allow_outside=True).frames
        found = allowed.image_path if key == "file_path" else allowed.mask_path
        assert found.samefile(tmp_path / "secret.exr")


def test_symbolic_links_do_not_lead_outside(capture, tmp_path):
    folder = tmp_path / "inner"
    path = capture(frame("link.exr"), pictures=("../secret.exr",), folder=folder)
    (folder / "link.exr").symlink_to(tmp_path / "secret.exr")
    refused(path, "leads outside", images=folder)


def test_cameras_without_pictures(capture):
    path = capture(frame("new"), pictures=())
    refused(path, r"frame 0 \(new\): .*new does not exist, nor with one of \.exr, \.hdr")
    assert read_capture(path, require_images=False).frames[0].camera.fl_x == 100
    path = capture(frame("new"), pictures=(), fl_x=100)
    refused(path, r"no `w` and `h`, and no picture", require_images=False)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"camera_model": "fisheye"}, r"unknown camera_model 'fisheye'; known are pinhole"),
        ({"k1": 0.1, "camera_model": "PINHOLE"}, r"`k1` is 0\.1: .*PINHOLE has no distortion"),
        ({"k2": 0.1, "camera_model": "SIMPLE_RADIAL"}, r"`k2` is 0\.1: .*SIMPLE_RADIAL has k1;"),
        ({"k4": 0.1}, r"`k4` is 0\.1: Nerfstudio takes .*OpenCV takes .*FULL_OPENCV"),
        ({"k1": "0"}, r"`k1` is '0'; wanted a finite number"),
        ({"lens": 3}, r"`lens`: wanted the keys kind and distortions, found 3"),
        ({"camera_model": "orthographic"}, r"no `ortho_scale`"),
        ({"camera_model": "orthographic", "ortho_scale": -1}, r"scale is -1\.0: .*positive"),
        ({"fl_x": 0}, r"fl_x is 0\.0: it must be positive"),
        ({"fl_x": "100"}, r"`fl_x` is '100'; wanted a finite number"),
        ({"fl_x": True}, r"`fl_x` is True; wanted a finite number"),
        ({"fl_x": math.nan}, r"`fl_x` is nan; wanted a finite number"),
        ({"w": 6.5}, r"`w` x `h` is 6\.5 x 4\.0; wanted whole numbers"),
        ({"exposure": 0}, r"`exposure` is 0; it must be positive"),
        ({"mask_path": 3}, r"`mask_path` is 3; wanted the path of a picture"),
        ({"mask_path": "m"}, r"m does not exist"),
        ({"transform_matrix": [[1, 0], [0, 1]]}, r"`transform_matrix` has shape \(2, 2\)"),
        ({"transform_matrix": [[1], [1, 2]]}, r"`transform_matrix` must be 4 rows of 4 numbers"),
        ({"transform_matrix": (1.01 * np.array(POSE)).tolist()}, r"last row"),
        (
            {"transform_matrix": [[1.01, 0, 0, 0], *POSE[1:]]},
            r"deviates from a rotation by 0\.02",
        ),
        ({"transform_matrix": [[-1, 0, 0, 0], *POSE[1:]]}, r"reflection"),
    ],
)
def test_mistakes_in_a_frame_are_named(capture, keys, message):
    refused(capture({**frame(), **keys}), r"frame 0 \(a\.exr\): .*" + message)


def test_missing_keys_are_named(capture):
    refused(capture({"file_path": "a.exr"}), r"frame 0 \(a\.exr\): no `transform_matrix`")
    refused(capture({"transform_matrix": POSE}), r"frame 0 has no `file_path`")
    refused(capture(frame(), w=6, h=4), r"frame 0 \(a\.exr\): no focal length; give `fl_x`")
    path = capture(frame(), w=6, h=4, camera_angle_x=4)
    refused(path, r"`camera_angle_x` is 4; wanted radians between 0 and pi")


def test_frames_must_be_there_and_differ(capture):
    refused(capture(), "`frames` must be a list with at least one frame")
    path = capture(frame("a.exr"), frame("b"), frame("./a"), pictures=("a.exr", "b.exr"))
    refused(path, r"frame 2 \(\./a\) repeats the file_path of frame 0")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"w": 1,\n "h" 2}', r":2:6: Expecting ':' delimiter"),
        ('{"w": 1, "w": 2}', r"the key `w` occurs twice"),
        ("[]", r"`frames` must be a list"),
        ("[" * 100000, r"nested too deeply|Expecting"),
    ],
    ids=["syntax", "twice", "list", "deep"],
)
def test_broken_json_is_named_by_place(tmp_path, text, message):
    (tmp_path / "transforms.json").write_text(text)
    refused(tmp_path / "transforms.json", message)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_capture(tmp_path / "transforms.json")
    (tmp_path / "transforms.json").write_bytes(b"{\xff\xfe}")
    refused(tmp_path / "transforms.json", r"not a text in UTF-8 \(byte 1 is")


def test_photograph_and_mask_must_fit_the_camera(capture, tmp_path):
    path = capture(frame(mask_path="m"), pictures=("a.exr", "m.png"))
    (only,) = read_capture(path).frames
    mask = np.zeros((4, 6, 1))
    mask[1, 2] = 1
    write_image(tmp_path / "m.png", mask)
    np.testing.assert_array_equal(read_photograph(only).pixels, np.full((4, 6, 3), 0.5))
    np.testing.assert_array_equal(read_mask(only), mask[..., 0] == 1)
    (taller,) = read_capture(capture(frame(mask_path="m"), fl_x=9, w=6, h=5)).frames
    message = r"a\.exr: frame a: the picture is 6 x 4 pixels, its camera says 6 x 5"
    with pytest.raises(InputError, match=message):
        read_photograph(taller)
    with pytest.raises(InputError, match=r"m\.png: frame a: the picture is 6 x 4"):
        read_mask(taller)


def test_a_frame_without_mask_has_none(capture):
    assert read_mask(read_capture(capture(frame())).frames[0]) is None


def test_broken_pixels_follow_the_rule(capture, tmp_path):
    (only,) = read_capture(capture(frame())).frames
    write_image(tmp_path / "a.exr", np.full((4, 6, 3), -1.0))
    with pytest.raises(InputError, match="channel R"):
        read_photograph(only)
    assert read_photograph(only, "mask").invalid.all()
