"""Readers against the programs whose formats they read, where these are installed.

- A model that COLMAP itself writes, as text and binary: projections agree with its own.
- A scene that Mitsuba itself loads: rays of its sensors, and its environment from all sides,
  texel by texel at the poles, too.
- A calibration that OpenCV itself writes: projections agree with ``projectPoints``.
"""

import numpy as np
import pytest
from capture_formats import HEIGHT, WIDTH, name, pictures, poses, world_to_camera
from test_capture_formats import contents_of

from jaxrender.io import read_environment, write_environment, write_image
from jaxrender.lighting import Environment
from jaxrender.lighting.panoramas import from_polar_rows

POINTS = np.random.default_rng(3).uniform(-0.4, 0.4, (20, 3))
FISHEYE = [30.0, 32.0, 11.5, 9.25, -0.03, 0.004, -0.001, 1e-4]


@pytest.mark.parametrize("write", ["write_text", "write_binary"])
@pytest.mark.parametrize(
    ("model", "numbers"),
    [("OPENCV_FISHEYE", FISHEYE), ("SIMPLE_RADIAL", [30.0, 11.5, 9.25, -0.1])],
)
def test_models_that_colmap_writes(tmp_path, write, model, numbers):
    pycolmap = pytest.importorskip("pycolmap")
    pictures(tmp_path / "images")
    made = pycolmap.Reconstruction()
    own = pycolmap.Camera(model=model, width=WIDTH, height=HEIGHT, params=numbers, camera_id=4)
    made.add_camera_with_trivial_rig(own)
    wanted = {}
    for i, (turn, shift) in enumerate(world_to_camera()):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(turn), shift)
        image = pycolmap.Image(name=f"{name(i)}.exr", camera_id=4, image_id=i + 2)
        made.add_image_with_trivial_frame(image, pose)
        wanted[name(i)] = own.img_from_cam(POINTS @ turn.T + shift)
    folder = tmp_path / "sparse"
    folder.mkdir()
    getattr(made, write)(str(folder))
    frames = contents_of(tmp_path).capture.frames
    assert [frame.name for frame in frames] == sorted(wanted)
    for frame in frames:
        np.testing.assert_allclose(frame.camera.project(POINTS), wanted[frame.name], atol=1e-9)


SENSOR = """<sensor type="perspective" id="{id}"><float name="fov" value="40"/>
<string name="fov_axis" value="{axis}"/><float name="principal_point_offset_x" value="0.1"/>
<float name="principal_point_offset_y" value="-0.07"/><transform name="to_world">
<rotate x="0.6" y="0.8" z="0" angle="20"/><lookat origin="3, 1, 2" target="0, 0.1, 0" up="0, 0, 1"/>
</transform><film type="hdrfilm"><integer name="width" value="24"/>
<integer name="height" value="18"/>{crop}</film></sensor>"""
CROP = """<integer name="crop_width" value="20"/><integer name="crop_height" value="10"/>
<integer name="crop_offset_x" value="3"/><integer name="crop_offset_y" value="5"/>"""


@pytest.mark.parametrize(
    ("axis", "crop"), [("x", ""), ("y", CROP), ("smaller", ""), ("larger", ""), ("diagonal", "")]
)
def test_sensors_of_mitsuba(tmp_path, axis, crop):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    pictures(tmp_path)
    text = SENSOR.format(id=name(0), axis=axis, crop=crop)
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{text}</scene>')
    (frame,) = contents_of(tmp_path).capture.frames
    width, height = (20, 10) if crop else (24, 18)
    assert (frame.camera.width, frame.camera.height) == (width, height)
    sensor = mi.load_file(str(tmp_path / "scene.xml")).sensors()[0]
    origins, directions = frame.camera.rays()
    for row, column in ((0, 0), (7, 3), (height - 1, width - 1)):
        place = [(column + 0.5) / width, (row + 0.5) / height]
        ray, _ = sensor.sample_ray(0.0, 0.5, place, [0.5, 0.5])
        np.testing.assert_allclose(directions[row, column], np.array(ray.d).ravel(), atol=2e-6)
        np.testing.assert_allclose(origins[row, column], [3, 1, 2], atol=1e-9)


def test_an_orthographic_sensor_of_mitsuba(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    pictures(tmp_path)
    text = SENSOR.format(id=name(0), axis="x", crop="").replace("perspective", "orthographic", 1)
    text = text.replace("<rotate", '<scale value="1.5"/><rotate')
    for key in ("fov", "principal_point_offset_x", "principal_point_offset_y"):
        start = text.index(f'<float name="{key}"')
        text = text[:start] + text[text.index("/>", start) + 2 :]
    text = text.replace('<string name="fov_axis" value="x"/>', "")
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{text}</scene>')
    (frame,) = contents_of(tmp_path).capture.frames
    sensor = mi.load_file(str(tmp_path / "scene.xml")).sensors()[0]
    origins, directions = frame.camera.rays()
    for row, column in ((0, 0), (7, 3), (17, 23)):
        place = [(column + 0.5) / 24, (row + 0.5) / 18]
        ray, _ = sensor.sample_ray(0.0, 0.5, place, [0.5, 0.5])
        own = np.array(ray.d).ravel()
        np.testing.assert_allclose(directions[row, column], own, atol=2e-6)
        apart = np.array(ray.o).ravel() - origins[row, column]
        np.testing.assert_allclose(apart - (apart @ own) * own, 0, atol=2e-5)


def test_an_environment_of_mitsuba(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    pictures(tmp_path)
    rng = np.random.default_rng(0)
    # Smooth, so that both interpolate alike.
    polar, azimuth = np.meshgrid(
        (np.arange(64) + 0.5) * np.pi / 64, (np.arange(128) + 0.5) * np.pi / 64, indexing="ij"
    )
    waves = [np.cos(polar), np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)]
    image = 1 + 0.5 * np.stack(waves, axis=-1)
    write_environment(tmp_path / "sky.exr", Environment(image))
    sensor = SENSOR.format(id=name(0), axis="x", crop="")
    (tmp_path / "scene.xml").write_text(
        f'<scene version="3.0.0">{sensor}<emitter type="envmap">'
        '<string name="filename" value="sky.exr"/><float name="scale" value="2.5"/>'
        '<transform name="to_world"><rotate x="1" angle="90"/><rotate y="1" angle="30"/>'
        "</transform></emitter></scene>"
    )
    panorama = contents_of(tmp_path).light.environment
    assert panorama.at_poles
    world = read_environment(panorama.path, panorama.convention, panorama.scale, at_poles=True)
    world = world.turned(panorama.turn)
    scene = mi.load_file(str(tmp_path / "scene.xml"))
    directions = rng.normal(size=(12, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    theirs = []
    for direction in directions:
        hit = scene.ray_intersect(mi.Ray3f([0, 0, 0], direction.tolist()))
        theirs.append(np.array(scene.environment().eval(hit)).ravel())
    nodes = world.grid.directions().reshape(-1, 3)
    nearest = np.argmax(directions @ nodes.T, axis=1)
    ours = np.asarray(world.radiance).reshape(-1, 3)[nearest]
    np.testing.assert_allclose(ours, theirs, rtol=0.06)


@pytest.mark.parametrize("size", [(8, 16), (9, 16), (6, 15)])
def test_rows_of_mitsuba_begin_and_end_at_the_poles(tmp_path, size):
    """What it evaluates at the middles of our texels is what we read, texel by texel."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    image = np.random.default_rng(1).uniform(0.1, 1, (*size, 3))
    write_image(tmp_path / "rough.exr", image)
    emitter = mi.load_dict({"type": "envmap", "filename": str(tmp_path / "rough.exr")})
    ours = from_polar_rows(image)
    rows, columns = ours.shape[:2]
    assert (rows, columns) == (size[1] // 2, size[1] // 2 * 2)
    for row, column in ((0, 0), (0, 5), (3, 13), (rows - 1, 2), (rows - 2, columns - 1)):
        polar, azimuth = (row + 0.5) * np.pi / rows, (column + 0.5) * 2 * np.pi / columns
        x, z = np.sin(polar) * np.sin(azimuth), -np.sin(polar) * np.cos(azimuth)
        surface = mi.SurfaceInteraction3f()
        surface.wi = mi.Vector3f(-x, -np.cos(polar), -z)
        theirs = np.ravel(np.asarray(emitter.eval(surface)))
        np.testing.assert_allclose(ours[row, column], theirs, rtol=2e-3)


def test_calibrations_that_opencv_writes(tmp_path):
    cv2 = pytest.importorskip("cv2")
    pictures(tmp_path)
    matrix = np.array([[30.0, 0, 11], [0, 31, 9], [0, 0, 1]])
    lens = np.array([-0.1, 0.02, 1e-3, -2e-3, 0.004])
    turned = world_to_camera()
    for suffix in ("yml", "xml"):
        path = tmp_path / f"calibration.{suffix}"
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        file.write("camera_matrix", matrix)
        file.write("distortion_coefficients", lens)
        for key, parts in (
            ("rvecs", [cv2.Rodrigues(turn)[0] for turn, _ in turned]),
            ("tvecs", [shift[:, None] for _, shift in turned]),
        ):
            file.startWriteStruct(key, cv2.FileNode_SEQ)
            for part in parts:
                file.write("", part)
            file.endWriteStruct()
        file.release()
        frames = contents_of(tmp_path).capture.frames
        for frame, (turn, shift) in zip(frames, turned, strict=True):
            theirs = cv2.projectPoints(POINTS, cv2.Rodrigues(turn)[0], shift, matrix, lens)[0]
            np.testing.assert_allclose(frame.camera.project(POINTS), theirs[:, 0] + 0.5, atol=1e-9)
        path.unlink()
    assert len(poses()) == len(frames)
