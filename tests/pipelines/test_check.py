"""``jaxrender check`` finds how a capture is meant, says it, and writes it into the config.

- Axes, mirror, unit, turn and the light's layout are named; ``--fix`` writes them, keeps comments,
  and a check of the mended capture finds nothing wrong; a fit of it then sees the object.
- A file that cannot be mended stays as it was.
- A photograph of another exposure is wrong; gloss, which is brighter from some sides, is none.
- Meshes with holes or of two parts are said; so is a shape that no silhouette fits.
"""

import json

import numpy as np
import pytest
import small_captures
from scipy.ndimage import gaussian_filter
from small_captures import Ball, edit_json, jaxrender, write_ball, write_json

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Pinhole, Placement, look_at, observe, sculpture
from jaxrender.inverse.conventions import Framing
from jaxrender.io import read_image, read_mesh, write_image, write_mesh
from jaxrender.pipelines.check.check import _remarks_on, _wrong_with, check, config_path
from jaxrender.pipelines.check.conventions import RawCapture
from jaxrender.pipelines.check.mend import changed_text, write_changes
from jaxrender.pipelines.check.mesh import about_mesh
from jaxrender.pipelines.check.photographs import judged
from jaxrender.pipelines.config import load_run_config

CONFIG = """\
# my capture
task: brdf
capture:
  transforms: transforms.json  # from the solver
  geometry: {mesh: shape.ply}   # millimetres?
output: runs/a
lighting:
  directional:
    - {direction: [0, 0, 1], irradiance: 1}  # a lamp
"""
# y up and x along x: z of the file is -y of the world.
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
SAME = np.eye(3)


def write_capture(folder, *, axes=SAME, scale=1.0, turn=SAME, mirrored=False, views=4, size=48):
    """A sculpture under a lamp above, written as other programs might."""
    shape, frames = sculpture(3), []
    folder.mkdir(exist_ok=True)
    for number, azimuth in enumerate(np.arange(views) * 2 * np.pi / views):
        place = 6 * np.array([np.cos(azimuth), np.sin(azimuth), 0.3 + 0.1 * number])
        pose = look_at(place, np.zeros(3), np.array([0.0, 0, 1]))
        camera = Pinhole(size, size, pose, fl_x=1.5 * size)
        view = observe(camera, shape)
        light = np.maximum(view.normals[..., 2:], 0) + np.zeros(3)
        picture = np.concatenate([0.2 * light, view.hit[..., None]], axis=-1)
        write_image(folder / f"{number}.exr", picture[:, ::-1] if mirrored else picture)
        pose = camera.world_from_camera.copy()
        pose[:3, :3] = pose[:3, :3] @ axes
        frames.append({"file_path": f"{number}.exr", "transform_matrix": pose.tolist()})
    lens = {"w": size, "h": size, "fl_x": 1.5 * size}
    write_json(folder / "transforms.json", {**lens, "frames": frames})
    mesh = Mesh(scale * shape.vertices @ turn, shape.faces, shape.normals @ turn)
    write_mesh(folder / "shape.ply", mesh)
    (folder / "capture.yaml").write_text(CONFIG)
    return folder


OPENCV = np.diag([1.0, -1, -1])


@pytest.fixture
def unforeseen(monkeypatch):
    """Leave out the analysis, which has tests of its own."""
    monkeypatch.setattr("jaxrender.pipelines.check.check._prospects", lambda *_: "a <b> forecast")


def test_a_capture_is_checked_mended_and_then_fine(tmp_path, capsys, monkeypatch, unforeseen):
    monkeypatch.chdir(tmp_path)
    folder = write_capture(tmp_path / "a", axes=OPENCV, scale=1000.0, turn=Y_UP, mirrored=True)
    assert jaxrender("check", folder, "--strict") == 1
    said = capsys.readouterr().out
    assert "OpenCV axes: overlap" in said
    assert "capture.geometry.scale should be 0.001" in said
    assert (folder / "capture.yaml").read_text() == CONFIG
    assert jaxrender("check", folder, "--fix", "--strict") == 0
    text = (folder / "capture.yaml").read_text()
    for comment in ("# my capture", "# from the solver", "# millimetres?", "# a lamp"):
        assert comment in text
    config = load_run_config(folder / "capture.yaml")
    assert config.capture.camera_axes == "opencv"
    assert config.capture.mirrored
    assert config.capture.geometry.scale == 0.001
    np.testing.assert_allclose(config.capture.geometry.rotation, [90, 0, 0], atol=1e-6)
    assert config.lighting == load_run_config_of(CONFIG, folder).lighting
    assert jaxrender("check", folder / "capture.yaml", "--strict") == 0
    assert "nothing is wrong" in capsys.readouterr().out
    # A fit sees all of the object.
    assert jaxrender("fit", folder / "capture.yaml", "--dry-run") == 0


def load_run_config_of(text, folder):
    (folder / "other.yaml").write_text(text)
    return load_run_config(folder / "other.yaml")


def test_the_light_is_mended_too(tmp_path, capsys, monkeypatch, unforeseen):
    monkeypatch.chdir(tmp_path)
    folder = write_capture(tmp_path / "a")
    # The lamp above as a panorama, whose rows begin at +Y.
    image = np.full((16, 32, 3), 1e-3)
    image[:3] = 1.0
    write_image(folder / "probe.exr", image)
    text = CONFIG[: CONFIG.index("  directional")] + "  environment: {path: probe.exr, "
    (folder / "capture.yaml").write_text(text + "convention: y-up}\n")
    assert jaxrender("check", folder, "--fix") == 0
    assert "environment `z-up`" in capsys.readouterr().out
    assert load_run_config(folder / "capture.yaml").lighting.environment.convention == "z-up"


def test_a_shape_that_fits_nothing_is_wrong(tmp_path, monkeypatch):
    monkeypatch.setattr("jaxrender.inverse.alignment.pose_search._TURNS", 10)
    folder = write_capture(tmp_path / "a")
    write_mesh(folder / "shape.ply", Mesh.ellipsoid(np.array([0.02, 0.02, 3.0]), 2))
    found = check(folder / "capture.yaml")
    assert not found.is_fine
    assert "no axes, turn or unit fit" in found.wrong[0]
    assert found.changes == {}


def test_masks_that_show_nothing_are_said(tmp_path):
    folder = write_capture(tmp_path / "a", views=1)
    write_image(folder / "mask.png", np.zeros((48, 48, 3)))
    edit_json(folder / "transforms.json", lambda t: t["frames"][0].update(mask_path="mask.png"))
    assert "no photograph shows a silhouette" in check(folder / "capture.yaml").wrong[0]


def test_further_captures_have_axes_of_their_own(tmp_path, unforeseen):
    folder = write_capture(tmp_path / "a")
    other = write_capture(tmp_path / "b", axes=OPENCV)
    content = json.loads((other / "transforms.json").read_text())
    for frame in content["frames"]:
        frame["file_path"] = "b/" + frame["file_path"]
    write_json(tmp_path / "b.json", content)
    light = "{directional: [{direction: [0, 0, 1], irradiance: 1}]}"
    text = f"captures:\n- transforms: ../b.json\n  lighting: {light}\n"
    (folder / "capture.yaml").write_text(CONFIG + text)
    found = check(folder / "capture.yaml")
    assert found.changes == {("captures", 0, "camera_axes"): "opencv"}
    assert write_changes(folder / "capture.yaml", found.changes).captures[0].camera_axes == "opencv"


def test_the_page_shows_what_was_found_and_escapes_names(tmp_path, unforeseen):
    folder = write_capture(tmp_path / "a <i>b", views=2)
    name = "<script>alert(1)"
    (folder / "0.exr").rename(folder / f"{name}.exr")

    def renamed(content):
        content["frames"][0]["file_path"] = f"{name}.exr"

    edit_json(folder / "transforms.json", renamed)
    assert jaxrender("check", folder, "--out", tmp_path / "out") == 0
    page = (tmp_path / "out" / "check.html").read_text()
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "a &lt;i&gt;b" in page
    assert "a &lt;b&gt; forecast" in page
    # Three pictures of each photograph, and two of directions; nothing from elsewhere.
    assert page.count("data:image/png;base64,") == 2 * 3 + 2
    assert "http" not in page.replace("http-equiv", "")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["check.html"]


def spoil(path, change):
    """Change the colours of a picture, and keep its coverage."""
    image = read_image(path)
    coverage = image.alpha[..., None]
    write_image(path, np.concatenate([change(image.pixels), coverage], axis=-1))


def test_photographs_are_judged(tmp_path, unforeseen):
    folder = write_capture(tmp_path / "a", views=6, size=72)
    spoil(folder / "1.exr", lambda pixels: 1.5 * pixels)
    spoil(folder / "2.exr", lambda pixels: np.minimum(pixels, 0.1))
    spoil(folder / "3.exr", lambda pixels: gaussian_filter(pixels, (3, 3, 0)))
    spoil(folder / "4.exr", lambda pixels: pixels + 0.08)
    found = check(folder / "capture.yaml")
    one, two, three, four = (found.photographs[k] for k in (1, 2, 3, 4))
    # The others are spoilt, too, which the median of a few does not take out.
    assert one.exposure / found.photographs[0].exposure == pytest.approx(1.5, rel=0.05)
    assert two.saturated > 0.1
    assert found.photographs[0].saturated == 0
    assert three.sharpness < 0.7 * found.photographs[0].sharpness
    assert four.black > 0.3
    # Beside so many spoilt ones it may be gloss as well.
    said_of_one = [said for said in (*found.wrong, *found.remarks) if said.startswith("1: 1.")]
    assert any("solve.free_exposure" in said for said in said_of_one)
    assert two.clipped_at == pytest.approx(0.1)
    assert one.clipped_at is None
    assert any("2: " in said and "values pile up at 0.1; " in said for said in found.remarks)
    assert any("4: " in said and "black level" in said for said in found.remarks)


def glossy_ball(folder, gain=1.0, count=5):
    """Five small views of a broad highlight under one lamp; one of them brighter by a factor."""
    lamp = [[((1.0, 0.0, 0.5), (2.0, 2.0, 2.0))]] * count
    write_ball(folder, Ball(views=count, size=32, lights=tuple(lamp), gains=(1, gain, 1, 1, 1)))
    return load_run_config(folder / "config.yaml")


@pytest.mark.parametrize(
    ("ks", "sigma", "gain"), [(0.3, 0.4, 1), (0.12, 0.25, 1), (0.02, 0.25, 1.6)]
)
def test_gloss_is_told_from_another_exposure(tmp_path, monkeypatch, ks, sigma, gain):
    monkeypatch.setattr(small_captures, "KS", ks)
    monkeypatch.setattr(small_captures, "SIGMA", sigma)
    config = glossy_ball(tmp_path / "a", gain)
    raw = RawCapture.of(config, 0)
    found = judged(raw, Framing("opengl", False), small_captures.UNIT_BALL, one_light=True)
    wrong = [said for one in found for said in _wrong_with(one)]
    assert max(one.exposure for one in found if one.exposure is not None) > 1.3
    assert [said.split(":")[0] for said in wrong] == (["1"] if gain > 1 else [])
    if not wrong:
        assert any("by its gloss" in said for one in found for said in _remarks_on(one))


@pytest.mark.slow
def test_a_mask_that_misses_the_shape_is_wrong(tmp_path, unforeseen):
    folder = write_capture(tmp_path / "a")
    mask = np.zeros((48, 48, 3))
    mask[5:20, 5:20] = 1
    write_image(folder / "mask.png", mask)
    edit_json(folder / "transforms.json", lambda t: t["frames"][0].update(mask_path="mask.png"))
    spoil(folder / "0.exr", lambda pixels: pixels)
    wrong = check(folder / "capture.yaml").wrong
    assert any(said.startswith("0: the silhouette overlaps the shape by 0.") for said in wrong)


def test_a_mesh_elsewhere_is_found(tmp_path, unforeseen):
    folder = write_capture(tmp_path / "a")
    away = Placement.of_degrees(7.0, np.array([10.0, 20, 100]), np.array([0.9, 0.5, -0.4]))
    write_mesh(folder / "shape.ply", away.mesh(sculpture(3)))
    found = check(folder / "capture.yaml")
    geometry = found.config.capture.geometry
    placed = Placement.of_degrees(
        geometry.scale, np.array(geometry.rotation), np.array(geometry.translation)
    )
    np.testing.assert_allclose(placed.after(away).scale, 1, atol=0.02)
    np.testing.assert_allclose(placed.after(away).rotation, np.eye(3), atol=0.03)
    assert "the mesh lies at scale" in found.conventions[0].sentences[-1]


def test_a_ball_elsewhere_is_found(tmp_path, unforeseen):
    folder = tmp_path / "a"
    write_ball(folder, Ball(size=48, noise=0))
    text = CONFIG.replace("{mesh: shape.ply}", "{sphere: {center: [0.5, 0.3, 0], radius: 0.8}}")
    (folder / "capture.yaml").write_text(text)
    found = check(folder / "capture.yaml")
    sphere = found.config.capture.geometry.sphere
    np.testing.assert_allclose(sphere.center, 0, atol=0.02)
    assert sphere.radius == pytest.approx(1, abs=0.02)


def test_a_folder_needs_a_config_and_photographs_need_be_no_recipes(tmp_path):
    with pytest.raises(InputError, match=r"the folder has no capture\.yaml"):
        config_path(tmp_path)
    (tmp_path / "run.yaml").write_text("task: brdf\ncapture: {recipe: a.yaml}\n")
    with pytest.raises(InputError, match="those of a recipe"):
        check(tmp_path / "run.yaml")


def test_a_text_is_changed_in_place_and_nothing_else(tmp_path):
    changed = changed_text(CONFIG, {("capture", "geometry", "rotation"): (0.0, 0.0, 90.0)})
    lines, expected = changed.splitlines(), CONFIG.splitlines()
    assert lines[4].startswith("  geometry: {mesh: shape.ply, rotation: [0.0, 0.0, 90.0]}")
    assert [*lines[:4], *lines[5:]] == [*expected[:4], *expected[5:]]


def test_a_file_that_cannot_be_mended_stays(tmp_path, monkeypatch):
    folder = write_capture(tmp_path / "a", views=1)
    path = folder / "capture.yaml"
    monkeypatch.setattr("jaxrender.pipelines.check.mend.changed_text", lambda text, _: text)
    with pytest.raises(InputError, match=r"write capture\.mirrored: True yourself"):
        write_changes(path, {("capture", "mirrored"): True})
    assert path.read_text() == CONFIG
    assert [p.name for p in folder.iterdir() if "unfinished" in p.name] == []


def test_holes_and_parts_of_a_mesh_are_said(tmp_path):
    ball, other = Mesh.icosphere(1), Mesh.icosphere(1, center=np.array([3.0, 0, 0]))
    assert about_mesh(ball) == []
    both = Mesh(
        np.concatenate([ball.vertices, other.vertices]),
        np.concatenate([ball.faces, other.faces + len(ball.vertices)]),
    )
    assert "2 parts" in about_mesh(both)[0]
    assert "holes" in about_mesh(Mesh(ball.vertices, ball.faces[3:]))[0]
    write_mesh(tmp_path / "two.stl", both)
    assert "2 parts" in about_mesh(read_mesh(tmp_path / "two.stl"))[0]
