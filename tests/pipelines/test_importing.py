"""Captures of other programs become ours: ``jaxrender import``.

- What is written is a config that loads, whose cameras are those of the folder; it says in comments
  what was found and assumed.
- Photographs stay where they are, or are copied; shapes and lights come along, where they belong.
- Exposures and focal lengths are those of EXIF where nothing else tells them.
- What is missing, too much or contradictory is told with the remedy, and nothing is written.
- The same capture in two formats gives the same fit (slow).
"""

import json
import struct
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
import trimesh
from small_captures import jaxrender, read_result, write_ball

from jaxrender.errors import InputError
from jaxrender.geometry import Sphere, observe
from jaxrender.io import read_capture, read_mesh, read_per_frame_lights, write_image
from jaxrender.io.captures import StatedSphere
from jaxrender.pipelines.captures import capture_of, captures_of
from jaxrender.pipelines.config import load_run_config
from jaxrender.pipelines.importing import ImportOptions, import_capture

sys.path.append(str(Path(__file__).parents[1] / "io"))
from capture_formats import COUNT, FORMATS, HEIGHT, WIDTH, cameras, name

BALL = StatedSphere((0.0, 0.0, 0.0), 1.0)
DILIGENT = Path(__file__).parents[3] / "shared" / "data" / "photos" / "diligent_ball"


def imported(tmp_path, form, **options):
    """Write a capture in a format, and import it; returns the config and its text."""
    FORMATS[form].write(tmp_path / "theirs")
    options = {"sphere": BALL} | options
    import_capture(tmp_path / "theirs", tmp_path / "ours", ImportOptions(**options))
    path = tmp_path / "ours/capture.yaml"
    return load_run_config(path), path.read_text()


@pytest.mark.parametrize("form", ["nerfstudio", "colmap binary", "opencv yaml", "metashape"])
def test_cameras_of_the_config_are_those_of_the_folder(tmp_path, form):
    config, text = imported(tmp_path, form)
    frames = capture_of(config.capture).frames
    for frame, camera in zip(frames, cameras(FORMATS[form]), strict=True):
        np.testing.assert_allclose(frame.camera.rays()[1], camera.rays()[1], atol=1e-9)
        assert frame.image_path.is_relative_to((tmp_path / "theirs").resolve())
    assert config.task == "factorize"
    assert config.capture.geometry.sphere.radius == 1
    assert text.replace("\n# ", " ").startswith(f"# Imported from {tmp_path}/theirs/")
    assert f"# - {COUNT} photographs: {COUNT} of {WIDTH} x {HEIGHT} pixels\n" in text
    assert "# Assumed:\n# - " in text
    assert "no exposures are stated" in text
    assert (tmp_path / "ours/run.json").is_file()


def test_a_scene_of_mitsuba_is_fitted_under_its_light(tmp_path):
    config, text = imported(tmp_path, "mitsuba", sphere=None)
    assert config.task == "brdf"
    (source,) = config.lighting.directional
    assert source.irradiance == (1, 2, 3)
    assert config.capture.geometry.sphere.center == (0.1, 0, 0)
    assert "the light of the scene: 1 distant source(s)" in text


def test_a_flat_sample_under_a_flash_is_a_texture(tmp_path):
    places = [[0.5, 0.25, 9.0], [-1.0, 0.0, 8.0]]
    stated = {"image_size": 4.0, "camera_pos": places, "light_pos": places}
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs/parameters.json").write_text(json.dumps(stated | {"light_pow": [9, 8, 7]}))
    for number in range(2):
        write_image(tmp_path / f"theirs/{number:02d}.png", np.full((6, 6, 3), 0.4))
    import_capture(tmp_path / "theirs", tmp_path / "ours", ImportOptions())
    config = load_run_config(tmp_path / "ours/capture.yaml")
    assert (config.task, config.texture.size) == ("texture", 6)
    assert config.brdf.known("mu") is None
    (capture,) = captures_of(config)
    shape = read_mesh(config.capture.geometry.mesh)
    light = capture.light(shape)
    for number, place in enumerate(places):
        points = light.points_of(number)
        np.testing.assert_allclose(points.positions, [place], atol=1e-6)
        np.testing.assert_allclose(points.intensity, [[9, 8, 7]], rtol=1e-6)
    # Texels are where the picture shows them: the upper left corner is (0, 1).
    view = observe(capture.capture.frames[0].camera, shape)
    assert view.hit.all()
    found = shape.texture_coordinates[view.face[0, 0]]
    middle = np.einsum("k,ki->i", view.barycentric[0, 0], found)
    np.testing.assert_allclose(middle, [1 / 12, 11 / 12], atol=1e-6)


def test_a_shape_that_a_scene_has_moved_is_written_where_it_lies(tmp_path):
    FORMATS["mitsuba"].write(tmp_path / "theirs")
    trimesh.creation.box().export(tmp_path / "theirs/box.ply")
    scene = tmp_path / "theirs/scene.xml"
    start, end = scene.read_text().split("<shape")[0], "</shape>\n</scene>\n"
    shape = '<shape type="ply"><string name="filename" value="box.ply"/>'
    moved = '<transform name="toWorld"><scale value="2"/><translate y="3"/></transform>'
    scene.write_text(f"{start}{shape}{moved}{end}")
    import_capture(tmp_path / "theirs", tmp_path / "ours", ImportOptions())
    config = load_run_config(tmp_path / "ours/capture.yaml")
    bounds = np.array(read_mesh(config.capture.geometry.mesh).bounds())
    np.testing.assert_allclose(bounds, [[-1, 2, -1], [1, 4, 1]], atol=1e-6)


def test_copies_leave_nothing_outside(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.ply")
    options = {"copy": True, "mesh": tmp_path / "box.ply", "sphere": None}
    config, text = imported(tmp_path, "colmap text", **options)
    assert str(tmp_path / "theirs") not in text.split("task:")[1]
    for path in sorted((tmp_path / "theirs").rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    frames = capture_of(config.capture).frames
    assert [f.image_path.relative_to(tmp_path / "ours") for f in frames] == [
        Path(f"images/{name(i)}.exr") for i in range(COUNT)
    ]
    assert read_mesh(config.capture.geometry.mesh).faces.shape == (12, 3)


def photographs(folder, suffix=".tif", **attributes):
    """Replace the pictures of a folder by such with EXIF; lists are one for each."""
    for i, old in enumerate(sorted(folder.glob("*.exr"))):
        spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, "uint16" if suffix == ".tif" else "uint8")
        for key, value in attributes.items():
            spec.attribute(key.replace("_", ":"), value[i] if isinstance(value, list) else value)
        path = old.with_suffix(suffix)
        out = oiio.ImageOutput.create(str(path))
        assert out.open(str(path), spec)
        assert out.write_image(np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
        assert out.close()
        old.unlink()


def of_photographs(tmp_path, suffix, **attributes):
    """Import photographs with EXIF; returns the exposures and the text of the config."""
    FORMATS["transforms"].write(tmp_path / "theirs")
    photographs(tmp_path / "theirs/images", suffix, **attributes)
    import_capture(tmp_path / "theirs", tmp_path / "ours", ImportOptions(sphere=BALL))
    config = load_run_config(tmp_path / "ours/capture.yaml")
    frames = capture_of(config.capture).frames
    return [frame.exposure for frame in frames], (tmp_path / "ours/capture.yaml").read_text()


def test_exposures_of_photographs(tmp_path):
    """Seconds times ISO over the f-number squared, relative to the first."""
    attributes = {"ExposureTime": [0.5, 0.25, 0.5], "FNumber": [4.0, 4.0, 8.0]}
    attributes["Exif_PhotographicSensitivity"] = [100, 100, 800]
    exposures, text = of_photographs(tmp_path, ".jpg", **attributes)
    np.testing.assert_allclose(exposures, [1, 0.5, 2], rtol=1e-6)
    assert "exposures from EXIF" in text
    assert "pixels of 8 bits are taken to be srgb" in text
    assert "  response: srgb\n" in text


def test_photographs_that_are_exposed_alike(tmp_path):
    exposures, text = of_photographs(tmp_path, ".tif", ExposureTime=0.125)
    assert exposures == [None] * COUNT
    assert "by their EXIF all photographs are exposed alike" in text
    assert "pixels of 16 bits are taken to be linear" in text
    assert "  response: linear\n" in text


def test_a_focal_length_of_photographs(tmp_path):
    FORMATS["transforms"].write(tmp_path / "theirs")
    path = tmp_path / "theirs/transforms.json"
    document = json.loads(path.read_text())
    del document["fl_x"], document["fl_y"]
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="no focal length"):
        read_capture(path)
    photographs(tmp_path / "theirs/images", ".jpg", Exif_FocalLengthIn35mmFilm=72)
    import_capture(tmp_path / "theirs", tmp_path / "ours", ImportOptions(sphere=BALL))
    text = (tmp_path / "ours/capture.yaml").read_text()
    camera = read_capture(tmp_path / "ours/transforms.json", tmp_path / "theirs").frames[0].camera
    assert (camera.fl_x, camera.fl_y) == (2 * WIDTH, 2 * WIDTH)
    assert "the focal length is that of the photographs' EXIF" in text
    assert "pixels of 8 bits are taken to be srgb" in text


def test_an_import_that_is_there_is_used_and_another_is_not_replaced(tmp_path):
    imported(tmp_path, "transforms")
    before = (tmp_path / "ours/run.json").read_text()
    options = ImportOptions(sphere=BALL)
    again = import_capture(tmp_path / "theirs", tmp_path / "ours", options)
    assert again.sentences[0].startswith("imported before")
    assert (tmp_path / "ours/run.json").read_text() == before
    other = ImportOptions(sphere=StatedSphere((0.0, 0, 0), 2.0))
    with pytest.raises(InputError, match="holds the result of another run"):
        import_capture(tmp_path / "theirs", tmp_path / "ours", other)
    import_capture(tmp_path / "theirs", tmp_path / "ours", other, force=True)
    assert "radius: 2.0" in (tmp_path / "ours/capture.yaml").read_text()


def larger(folder):
    write_image(folder / f"images/{name(1)}.exr", np.ones((HEIGHT, 2 * WIDTH, 3)))


def of_integers(folder):
    (folder / f"images/{name(1)}.exr").unlink()
    write_image(folder / f"images/{name(1)}.png", np.ones((HEIGHT, WIDTH, 3)))


MISTAKES = {
    "no shape": ({"sphere": None}, None, r"theirs: the shape .* is not known; give --mesh FILE"),
    "two shapes": ({"mesh": Path("a.ply")}, None, r"give one of --mesh, --sphere"),
    "no mesh": ({"mesh": Path("a.ply"), "sphere": None}, None, r"a\.ply"),
    "size": ({}, larger, rf"view_1\.exr: {2 * WIDTH} x {HEIGHT} pixels, its camera says"),
    "kinds": ({}, of_integers, r"view_1\.png holds whole numbers and view_0\.exr floating"),
    "missing": ({}, lambda f: (f / f"images/{name(2)}.exr").unlink(), r"view_2 does not exist"),
    "format": ({"format": "colmap"}, None, r"nothing recognised; looked for colmap: cameras\.bin"),
    "nothing": ({}, lambda f: (f / "transforms.json").unlink(), r"nothing recognised"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_cannot_be_imported_is_told_and_leaves_nothing(tmp_path, mistake):
    options, spoil, message = MISTAKES[mistake]
    FORMATS["transforms"].write(tmp_path / "theirs")
    if spoil:
        spoil(tmp_path / "theirs")
    with pytest.raises(InputError, match=message):
        import_capture(
            tmp_path / "theirs", tmp_path / "ours", ImportOptions(**{"sphere": BALL} | options)
        )
    assert [path.name for path in tmp_path.iterdir()] == ["theirs"]


def test_names_in_comments_end_no_comment(tmp_path):
    """A path with a line break stays one comment."""
    (tmp_path / "a\ntask: texture").mkdir()
    FORMATS["transforms"].write(tmp_path / "a\ntask: texture/theirs")
    import_capture(
        tmp_path / "a\ntask: texture/theirs", tmp_path / "ours", ImportOptions(sphere=BALL)
    )
    assert load_run_config(tmp_path / "ours/capture.yaml").task == "factorize"


def write_stereo(folder):
    """Write photographs in the manner of DiLiGenT."""
    folder.mkdir()
    for number in range(3):
        write_image(folder / f"{number + 1:03d}.png", np.full((6, 8, 3), 0.5))
    write_image(folder / "mask.png", np.ones((6, 8, 1)))
    (folder / "light_directions.txt").write_text("0 0 1\n0.6 0 0.8\n0 -0.6 0.8\n")
    (folder / "light_intensities.txt").write_text("1 2 3\n2 2 2\n3 2 1\n")


def test_photometric_stereo(tmp_path):
    write_stereo(tmp_path / "theirs")
    import_capture(tmp_path / "theirs", tmp_path / "ours", ImportOptions(sphere=BALL))
    config = load_run_config(tmp_path / "ours/capture.yaml")
    assert config.task == "brdf"
    assert config.capture.response == "linear"
    frames = capture_of(config.capture).frames
    assert [frame.name for frame in frames] == ["001", "002", "003"]
    assert all(frame.mask_path.name == "mask.png" for frame in frames)
    lights = read_per_frame_lights(config.lighting.per_frame, [frame.name for frame in frames])
    np.testing.assert_allclose(lights[2].directions, [[0, -0.6, 0.8]], atol=1e-15)
    np.testing.assert_array_equal(lights[2].irradiance, [[3, 2, 1]])
    # The ball of radius 1 about the origin is two pixels across, in the middle.
    hit = observe(frames[0].camera, Sphere(np.zeros(3), 1.0)).hit
    assert np.argwhere(hit).tolist() == [[2, 3], [2, 4], [3, 3], [3, 4]]
    (tmp_path / "theirs/K.txt").write_text("80 0 3.5\n0 90 2.5\n0 0 1\n")
    camera = read_capture(tmp_path / "theirs/light_directions.txt").frames[0].camera
    assert (camera.fl_x, camera.fl_y, camera.cx, camera.cy) == (80, 90, 4, 3)
    (tmp_path / "theirs/K.txt").write_text("80 0")
    with pytest.raises(InputError, match=r"K\.txt: wanted 3 x 3 numbers"):
        read_capture(tmp_path / "theirs")


@pytest.mark.skipif(not DILIGENT.is_dir(), reason="the photographs of DiLiGenT are not here")
def test_the_real_ball_of_diligent(tmp_path):
    ball = StatedSphere((2.37, -8.368, 0.0), 70.751)
    import_capture(DILIGENT, tmp_path / "ours", ImportOptions(sphere=ball))
    config = load_run_config(tmp_path / "ours/capture.yaml")
    frames = capture_of(config.capture).frames
    assert len(frames) == 48
    assert (config.task, frames[0].name) == ("brdf", "001")


def test_the_command(tmp_path, capsys):
    FORMATS["transforms"].write(tmp_path / "theirs")
    arguments = ("import", tmp_path / "theirs", "--out", tmp_path / "ours")
    assert jaxrender(*arguments) == 2
    assert "give --mesh FILE" in capsys.readouterr().err
    assert jaxrender(*arguments, "--sphere", "0,0,one") == 2
    assert "wanted X,Y,Z,RADIUS" in capsys.readouterr().err
    assert jaxrender(*arguments, "--sphere", "0,0,0,-1") == 2
    assert "the radius must be positive" in capsys.readouterr().err
    assert jaxrender(*arguments, "--sphere", "0,0,0,1") == 0
    said = capsys.readouterr().out
    assert f"next: jaxrender check {tmp_path / 'ours'}, then jaxrender fit " in said
    assert f"{tmp_path / 'ours/capture.yaml'}" in said


def as_colmap(folder, capture):
    """Write a capture as a binary model of COLMAP."""
    (folder / "sparse/0").mkdir(parents=True)
    frames = capture.frames
    camera = frames[0].camera
    numbers = (camera.fl_x, camera.fl_y, camera.cx, camera.cy)
    head = struct.pack("<QIiQQ4d", 1, 1, 1, camera.width, camera.height, *numbers)
    (folder / "sparse/0/cameras.bin").write_bytes(head)
    from scipy.spatial.transform import Rotation

    content = struct.pack("<Q", len(frames))
    for i, frame in enumerate(frames):
        pose = frame.camera.world_from_camera
        turn = np.diag([1.0, -1, -1]) @ pose[:3, :3].T
        shift = -turn @ pose[:3, 3]
        quaternion = Rotation.from_matrix(turn).as_quat(scalar_first=True)
        content += struct.pack("<I7dI", i, *quaternion, *shift, 1)
        content += frame.image_path.name.encode() + b"\0" + struct.pack("<Q", 0)
    (folder / "sparse/0/images.bin").write_bytes(content)


@pytest.mark.slow
def test_two_formats_give_the_same_fit(tmp_path):
    theirs = tmp_path / "theirs"
    write_ball(theirs)
    as_colmap(theirs, read_capture(theirs / "transforms.json"))
    keys = (
        "task=brdf", f"lighting.per_frame={theirs / 'lights.json'}", "brdf.model=microfacet",
        "solve.starts=2", "solve.variants=false", "solve.refine_samples=300", "samples.count=600",
    )  # fmt: skip
    found = []
    for form in ("transforms", "colmap"):
        options = ImportOptions(sphere=BALL, format=form)
        import_capture(theirs, tmp_path / form, options)
        out = tmp_path / f"{form} fit"
        assert jaxrender("fit", tmp_path / form / "capture.yaml", *keys, f"output={out}") == 0
        found.append(read_result(out)["brdf"])
    for key in ("kd", "ks", "sigma", "mu"):
        np.testing.assert_allclose(found[0][key], found[1][key], rtol=1e-9)


def test_a_config_names_ours_alone(tmp_path):
    """All that a result depends on is in the files that a config names."""
    config, _ = imported(tmp_path, "colmap text")
    other = tmp_path / "theirs/sparse/0/cameras.txt"
    capture = config.capture.model_copy(update={"transforms": other})
    with pytest.raises(InputError, match=r"cameras\.txt: no transforms\.json; `jaxrender import`"):
        capture_of(capture)
