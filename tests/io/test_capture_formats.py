"""The same capture in the format of each program gives the same cameras and photographs.

- Rays, positions, sizes and files agree to 1e-9 with the cameras that were written, each format by
  its own conventions of axes, pixels and distortion; so they do when they are written as ours.
- A folder is known by what it has; none or several are told, and one of several can be chosen.
- What stands beside the cameras: the shape and the light of a Mitsuba scene, a mesh and masks of
  COLMAP, what Nerfstudio has applied.
- Lenses of all kinds come back from a ``transforms.json``.
- Mistakes are named with the file and the place in it.
"""

import json

import numpy as np
import pytest
from capture_formats import APPLIED, APPLIED_SCALE, COUNT, FORMATS, SKEWED, cameras, name

from jaxrender.errors import InputError
from jaxrender.geometry import (
    LENS_MODELS,
    Division,
    FieldOfView,
    FisheyeLens,
    PerspectiveLens,
    Pinhole,
    opencv_lens,
)
from jaxrender.io import Capture, Frame, read_capture, write_capture
from jaxrender.io.captures import FORMATS as READERS
from jaxrender.io.captures import Looking, read_contents, recognise

SAME = 1e-9


def contents_of(folder, **looking):
    return read_contents(recognise(folder), Looking(folder, original=True, **looking))


def same_cameras(found, wanted):
    assert [type(one) for one in found] == [type(one) for one in wanted]
    for one, other in zip(found, wanted, strict=True):
        assert (one.width, one.height) == (other.width, other.height)
        for mine, theirs in zip(one.rays(), other.rays()):
            np.testing.assert_allclose(mine, theirs, atol=SAME)
        points = np.array([[0.1, 0.2, -0.1], [0, 0, 0.3]])
        np.testing.assert_allclose(one.project(points), other.project(points), atol=1e-8)


@pytest.mark.parametrize("form", FORMATS)
def test_the_same_capture_in_every_format(tmp_path, form):
    FORMATS[form].write(tmp_path)
    frames = contents_of(tmp_path).capture.frames
    assert [frame.name for frame in frames] == [name(i) for i in range(COUNT)]
    assert all(frame.image_path.is_file() for frame in frames)
    assert [frame.image_path.stem for frame in frames] == [frame.name for frame in frames]
    wanted = cameras(FORMATS[form])
    same_cameras([frame.camera for frame in frames], wanted)
    write_capture(tmp_path / "ours.json", Capture(frames, tmp_path / "ours.json"))
    again = read_capture(tmp_path / "ours.json").frames
    same_cameras([frame.camera for frame in again], wanted)
    if form != "nerfstudio":
        place = tmp_path / "transforms.json" if form == "transforms" else tmp_path
        same_cameras([frame.camera for frame in read_capture(place).frames], wanted)


def test_what_nerfstudio_applied_stays_unless_asked(tmp_path):
    FORMATS["nerfstudio"].write(tmp_path)
    read = recognise(tmp_path)
    (first, *_) = read_contents(read, Looking(tmp_path)).capture.frames
    original = cameras(FORMATS["nerfstudio"])[0].position
    moved = APPLIED_SCALE * (APPLIED[:, :3] @ original + APPLIED[:, 3])
    np.testing.assert_allclose(first.camera.position, moved, atol=1e-12)
    assert "applied_transform and applied_scale were undone" in contents_of(tmp_path).found[0]
    same = read_capture(tmp_path / "transforms.json").frames[0].camera.position
    np.testing.assert_array_equal(same, first.camera.position)


def test_every_reader_is_tried():
    tried = {form.split()[0] for form in FORMATS} - {"nerfstudio"}
    # Their cameras stand in one place, look straight down, or have names of their own: other files
    # try them.
    assert tried >= set(READERS) - {"diligent", "flash", "stanford-orb", "objects-with-lighting"}


def test_point_sources_of_a_scene_of_mitsuba(tmp_path):
    FORMATS["mitsuba"].write(tmp_path)
    scene = tmp_path / "scene.xml"
    near = (
        '<emitter type="point"><point name="position" value="1, 2, 3"/>'
        '<rgb name="intensity" value="4, 5, 6"/></emitter>'
        '<emitter type="point"><transform name="to_world"><translate z="7"/></transform>'
        '<rgb name="intensity" value="1, 1, 1"/></emitter></scene>'
    )
    scene.write_text(scene.read_text().replace("</scene>", near))
    first, second = read_contents(recognise(tmp_path), Looking(tmp_path)).light.point
    assert (first.position, first.intensity) == ((1, 2, 3), (4, 5, 6))
    assert (second.position, second.intensity) == ((0, 0, 7), (1, 1, 1))


def test_a_scene_of_mitsuba_has_shape_and_light(tmp_path):
    FORMATS["mitsuba"].write(tmp_path)
    contents = contents_of(tmp_path)
    assert contents.sphere.center == (0.1, 0.0, 0.0)
    assert contents.sphere.radius == pytest.approx(1, rel=1e-15)
    ((direction, irradiance),) = contents.light.directional
    np.testing.assert_allclose(direction, [0, 0.6, 0.8], atol=1e-15)
    assert irradiance == (1, 2, 3)


def test_what_is_beside_a_model_of_colmap(tmp_path):
    FORMATS["colmap text"].write(tmp_path)
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks/view_1.exr.png").touch()
    (tmp_path / "dense").mkdir()
    (tmp_path / "dense/meshed-poisson.ply").touch()
    contents = contents_of(tmp_path)
    masks = [frame.mask_path for frame in contents.capture.frames]
    assert masks == [None, tmp_path / "masks/view_1.exr.png", None]
    assert contents.mesh == tmp_path / "dense/meshed-poisson.ply"


def test_folders_of_nothing_and_of_two(tmp_path):
    with pytest.raises(InputError, match=r"nothing recognised; looked for transforms: .*colmap: "):
        recognise(tmp_path)
    FORMATS["transforms"].write(tmp_path)
    FORMATS["colmap binary"].write(tmp_path)
    message = r"several captures: transforms \(transforms\.json\), colmap \(sparse.0.cameras\.bin\)"
    with pytest.raises(InputError, match=message + "; choose by --format"):
        recognise(tmp_path)
    assert recognise(tmp_path, "colmap").name == "colmap"
    assert recognise(tmp_path / "transforms.json").name == "transforms"
    with pytest.raises(InputError, match="no format 'colmop'; known are transforms, colmap"):
        recognise(tmp_path, "colmop")
    text = (tmp_path / "transforms.json").read_text()
    for part in ("train", "test"):
        (tmp_path / f"transforms_{part}.json").write_text(text)
    (tmp_path / "transforms.json").unlink()
    with pytest.raises(InputError, match=r"several captures: .*give the path of one"):
        recognise(tmp_path, "transforms")
    with pytest.raises(InputError, match="no such folder"):
        recognise(tmp_path / "missing")


LENSES = {
    **{
        model: one.lens([0.01] * (len(one.parameters) - one.intrinsics))
        for model, one in LENS_MODELS.items()
    },
    "prism": opencv_lens([0.01 * i for i in range(1, 13)]),
    "skewed": SKEWED,
    "two": PerspectiveLens((Division(0.1), FieldOfView(0.3))),
    "idle fisheye": FisheyeLens(()),
}


@pytest.mark.parametrize("kind", LENSES)
def test_lenses_come_back(tmp_path, kind):
    lens = LENSES[kind]
    camera = Pinhole(6, 4, np.eye(4), fl_x=5.0, fl_y=5.5, lens=lens)
    frame = Frame("a", camera, tmp_path / "a.exr", None, None)
    write_capture(tmp_path / "t.json", Capture((frame,), tmp_path / "t.json"))
    (again,) = read_capture(tmp_path / "t.json", require_images=False).frames
    assert (again.camera.lens is None) == (lens is None)
    for mine, theirs in zip(again.camera.rays(), camera.rays()):
        np.testing.assert_array_equal(mine, theirs)


def spoil(folder, pattern, old, new):
    (path,) = folder.rglob(pattern)
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))


MISTAKES = {
    "mitsuba direction": (
        "mitsuba", "scene.xml", b'z="-0.8"', b'z="-1e308"', r"<emitter .*: no direction",
    ),
    "colmap model": (
        "colmap text", "cameras.txt", b"FULL_OPENCV", b"EUCN",
        r"cameras\.txt:2: the camera model EUCN is not known here; known are SIMPLE_PINHOLE",
    ),
    "colmap count": (
        "colmap text", "cameras.txt", b"FULL_OPENCV", b"OPENCV",
        r"cameras\.txt:2: 12 numbers; OPENCV has 8: fx, fy",
    ),
    "colmap words": (
        "colmap text", "images.txt", b" 7 view_2.exr", b"",
        r"images\.txt:2: wanted IMAGE_ID QW",
    ),
    "colmap camera": (
        "colmap text", "images.txt", b" 7 view_2.exr", b" 8 view_2.exr",
        r"images\.txt:2: there is no camera 8",
    ),
    "colmap photograph": (
        "colmap text", "images.txt", b"view_2.exr", b"view_9.exr",
        r"images\.txt:2: `name`: .*view_9\.exr does not exist",
    ),
    "colmap outside": (
        "colmap text", "images.txt", b"view_2.exr", b"../../view_9.exr",
        r"images\.txt:2: `name` leads outside",
    ),
    "colmap binary model": (
        "colmap binary", "cameras.bin", b"\x06\0\0\0\x18", b"\x63\0\0\0\x18",
        r"cameras\.bin: camera 7: the camera model number 99 is not known",
    ),
    "colmap binary end": (
        "colmap binary", "images.bin", b"\x03\0\0\0\0\0\0\0", b"\x04\0\0\0\0\0\0\0",
        r"images\.bin: damaged or cut short at byte \d+",
    ),
    "colmap binary points": (
        "colmap binary", "images.bin", b"view_2.exr\0\x02", b"view_2.exr\0\xff",
        r"images\.bin: damaged or cut short",
    ),
    "opencv alias": (
        "opencv yaml", "calibration.yml", b'"today"', b"[&a [1, 2], *a, *a]",
        r"calibration\.yml:3: an alias",
    ),
    "opencv matrix": (
        "opencv yaml", "calibration.yml", b"rows: 3", b"rows: 4",
        r"calibration\.yml:\d+: a matrix of 4 x 3 with 9 numbers",
    ),
    "opencv poses": (
        "opencv yaml", "calibration.yml", b"extrinsic_parameters", b"extrinsics",
        r"calibration\.yml: no poses; give `extrinsic_parameters`",
    ),
    "opencv photographs": (
        "opencv yaml", "calibration.yml", b'   - "view_1.exr"\n', b"",
        r"calibration\.yml: 3 poses for 2 photographs",
    ),
    "opencv size": (
        "opencv yaml", "calibration.yml", b"image_width: 24", b"image_width: 24.5",
        r"calibration\.yml: photograph 0 .*image_width x image_height is 24\.5",
    ),
    "opencv syntax": (
        "opencv yaml", "calibration.yml", b"rows: 3", b"rows: [3",
        r"calibration\.yml:\d+: .*mend the file",
    ),
    "xml entity": (
        "opencv xml", "calibration.xml", b"<opencv_storage>",
        b'<!DOCTYPE a [<!ENTITY b "ha">]><opencv_storage>',
        r"calibration\.xml:2: a document type",
    ),
    "xml syntax": (
        "opencv xml", "calibration.xml", b"</opencv_storage>", b"",
        r"calibration\.xml:\d+:\d+: no element found; mend the XML",
    ),
    "mitsuba sensor": (
        "mitsuba", "scene.xml", b'type="perspective"', b'type="thinlens"',
        r"scene\.xml: <sensor type='thinlens'>: a sensor that is neither",
    ),
    "mitsuba number": (
        "mitsuba", "scene.xml", b'value="24"', b'value="wide"',
        r"scene\.xml: <film type='hdrfilm'>: `width` is 'wide'",
    ),
    "mitsuba include": (
        "mitsuba", "scene.xml", b"<default", b'<include filename="/etc/passwd"/><default',
        r"scene\.xml: <include>",
    ),
    "mitsuba colour": (
        "mitsuba", "scene.xml", b'"1, 2, 3"', b'"400:1, 500:2"',
        r"`irradiance` is '400:1, 500:2'; wanted 1 or 3",
    ),
    "metashape number": (
        "metashape", "cameras.xml", b"<p1>", b"<p3>0.5</p3><p1>",
        r"cameras\.xml: camera 'view_0': its calibration has p3 = 0\.5, which is not known",
    ),
    "metashape kind": (
        "metashape", "cameras.xml", b'<calibration type="frame"', b'<calibration type="spherical"',
        r"camera 'view_0': a sensor of the type 'spherical'",
    ),
    "metashape pose": (
        "metashape", "cameras.xml", b"<transform>0", b"<transform>x",
        r"camera 'view_0': <transform> is 'x",
    ),
    "nerfstudio applied": (
        "nerfstudio", "transforms.json", b"[[1.0, 0.0, 0.0, 0.25]", b"[[1.0, 0.5, 0.0, 0.25]",
        r"transforms\.json: `applied_transform` is no rotation",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named(tmp_path, mistake):
    form, pattern, old, new, message = MISTAKES[mistake]
    FORMATS[form].write(tmp_path)
    spoil(tmp_path, pattern, old, new)
    with pytest.raises(InputError, match=message):
        contents_of(tmp_path)


def test_light_that_is_not_read_is_told(tmp_path):
    FORMATS["mitsuba"].write(tmp_path)
    spoil(tmp_path, "scene.xml", b"</scene>", b'<emitter type="spot"/></scene>')
    contents = contents_of(tmp_path)
    assert not contents.light.given
    assert "emitters that are not read (spot)" in contents.assumed[0]


def test_a_fisheye_of_nerfstudio_and_of_instant_ngp(tmp_path):
    FORMATS["nerfstudio"].write(tmp_path)
    path = tmp_path / "transforms.json"
    document = json.loads(path.read_text())
    for frame in document["frames"]:
        for key in ("p1", "p2"):
            del frame[key]
    found = []
    for keys in ({"camera_model": "OPENCV_FISHEYE"}, {"is_fisheye": True}):
        del document[next(key for key in ("camera_model", "is_fisheye") if key in document)]
        path.write_text(json.dumps(document | keys))
        document |= keys
        found.append(read_capture(path).frames[0].camera.lens)
    assert all(isinstance(lens, FisheyeLens) for lens in found)
    assert found[0] == found[1]
