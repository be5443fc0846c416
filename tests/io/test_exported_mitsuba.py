"""Scenes for Mitsuba 3, rendered by Mitsuba against our own exact renderings.

- A ball and a mesh under a panorama and a lamp: for a plugin of Mitsuba's own, and T 6.2 through
  a table, the mean relative difference of blocks of pixels is under .5 %, noise included.
- The dictionary in JSON, through the script beside it, and the XML are the same scene.
- Mitsuba's cameras have our rays; our own reader of Mitsuba's scenes finds them again.
- The panorama is upright, not mirrored, and ours at our texels.
"""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

import jaxrender as jr
from jaxrender.brdf import Lambertian, MetallicRoughness, Microfacet, Principled
from jaxrender.io import read_capture
from jaxrender.io.captures import Frame, Looking, read_contents, recognise
from jaxrender.io.exports import Contents, mitsuba_losses, write_mitsuba
from jaxrender.io.exports.mitsuba_materials import own_plugin

KD, CLEAR = np.array([0.2, 0.15, 0.1]), np.ones(3)
ROWS = 16
POLAR = ((np.arange(ROWS) + 0.5) * np.pi / ROWS)[:, None]
AZIMUTH = ((np.arange(2 * ROWS) + 0.5) * np.pi / ROWS)[None, :]
# Bright towards +X and up, a lamp at azimuth 1: not the same in any mirror.
SKY = 1 + 0.6 * np.sin(POLAR) * np.cos(AZIMUTH) + 0.3 * np.cos(POLAR)
SKY = SKY + 2 * np.exp(-((POLAR - 1) ** 2 + (AZIMUTH - 1) ** 2) / 0.3)
LIGHT = jr.Environment(SKY[..., None] * np.array([1, 0.8, 0.5]))
LAMP = jr.DirectionalSources(np.array([[0.5, -0.4, 0.7]]), np.array([[2.0, 1.5, 1.0]]))
POSE = jr.look_at(np.array([4.0, 1, 1]), np.zeros(3), np.array([0.0, 0, 1]))
CAMERAS = (
    jr.Pinhole(32, 24, POSE, fl_x=60.0, cx=14.0, cy=13.0),
    jr.Orthographic(32, 24, POSE, scale=0.1, cx=14.0, cy=13.0),
)
FRAMES = tuple(
    Frame(f"../<b>{number}", camera, Path("none.exr"), None, None)
    for number, camera in enumerate(CAMERAS)
)
BLOCK = 4


@pytest.fixture(scope="module")
def mitsuba():
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_rgb")
    return found


def contents(material, shape, environment=LIGHT):
    return Contents("ball", material, shape, environment, LAMP, FRAMES)


def blocks(image):
    """Means over blocks of pixels, which noise spoils less."""
    rows, columns = (n // BLOCK for n in image.shape[:2])
    return image.reshape(rows, BLOCK, columns, BLOCK, 3).mean(axis=(1, 3))


def off(theirs, ours):
    """Mean relative difference of the blocks that lie on the object."""
    on = blocks(np.broadcast_to((ours.sum(-1, keepdims=True) > 0) * 1.0, ours.shape)).min(-1) == 1
    assert on.sum() > 8
    return np.abs(blocks(theirs) - blocks(ours))[on].mean() / blocks(ours)[on].mean()


@pytest.mark.parametrize(
    ("material", "shape"),
    [
        (Microfacet(KD, 0.12 * CLEAR, 0.25, 1.6), jr.Sphere(np.array([0.1, 0, 0]), 1.1)),
        (Principled(3 * KD, CLEAR, 0.2 * CLEAR, 0 * CLEAR, 0.2, 0.5, 0.4), jr.Mesh.icosphere(3)),
    ],
    ids=["table", "plugin"],
)
def test_mitsuba_renders_what_we_do(mitsuba, tmp_path, material, shape):
    parts = write_mitsuba(contents(material, shape), tmp_path)
    assert sorted(part.file for part in parts) == sorted(p.name for p in tmp_path.iterdir())
    by_dictionary = mitsuba.load_dict(runpy.run_path(str(tmp_path / "scene.py"))["scene"]())
    by_xml = mitsuba.load_file(str(tmp_path / "scene.xml"))
    ours = np.asarray(jr.render(material, LIGHT + LAMP, shape, CAMERAS[0]))
    pictures = [
        np.array(mitsuba.render(scene, sensor=0, spp=900, seed=seed))
        for seed, scene in enumerate((by_dictionary, by_xml))
    ]
    # .4 % of each picture is noise, and .3 % of their mean.
    assert off(pictures[0], pictures[1]) < 0.008
    assert off((pictures[0] + pictures[1]) / 2, ours) < 0.005


def test_mitsuba_renders_lamps_that_are_near(mitsuba, tmp_path):
    near = jr.PointSources(np.array([[1.5, -1.0, 2.0]]), np.array([[4.0, 3.0, 2.0]]))
    shape, material = jr.Sphere(), Lambertian(KD)
    held = contents(material, shape, None)._replace(sources=jr.DirectionalSources.none())
    write_mitsuba(held._replace(points=near), tmp_path)
    scene = mitsuba.load_file(str(tmp_path / "scene.xml"))
    ours = np.asarray(jr.render(material, near, shape, CAMERAS[0]))
    assert off(np.array(mitsuba.render(scene, sensor=0, spp=64)), ours) < 0.005
    (read,) = read_contents(
        recognise(tmp_path / "scene.xml"), Looking(tmp_path, False, False)
    ).light.point
    assert (read.position, read.intensity) == ((1.5, -1.0, 2.0), (4.0, 3.0, 2.0))


def test_cameras_have_our_rays(mitsuba, tmp_path):
    write_mitsuba(contents(Lambertian(KD), jr.Sphere()), tmp_path)
    scene = mitsuba.load_file(str(tmp_path / "scene.xml"))
    for sensor, camera in zip(scene.sensors(), CAMERAS):
        rays = camera.rays()
        for row, column in ((0, 0), (10, 20), (23, 31)):
            place = [(column + 0.5) / camera.width, (row + 0.5) / camera.height]
            ray = sensor.sample_ray(0, 0.5, place, [0.5, 0.5])[0]
            towards = rays.directions[row, column]
            np.testing.assert_allclose(np.array(ray.d), towards, atol=1e-6)
            aside = np.cross(np.array(ray.o) - rays.origins[row, column], towards)
            np.testing.assert_allclose(aside, 0, atol=1e-5)


def test_our_reader_finds_the_cameras_again(tmp_path):
    write_mitsuba(contents(Lambertian(KD), jr.Sphere()), tmp_path)
    found = read_capture(tmp_path / "scene.xml", require_images=False, foreign=True)
    for frame, camera in zip(found.frames, CAMERAS):
        own = frame.camera
        rays, read = camera.rays(), own.rays()
        np.testing.assert_allclose(read.directions, rays.directions, atol=1e-9)
        np.testing.assert_allclose(read.origins, rays.origins, atol=1e-9)
        assert (own.width, own.height) == (camera.width, camera.height)


def test_the_panorama_is_ours(mitsuba, tmp_path):
    write_mitsuba(contents(Lambertian(KD), jr.Sphere()), tmp_path)
    scene = mitsuba.load_file(str(tmp_path / "scene.xml"))
    for row, column in ((2, 3), (8, 20), (14, 31)):
        direction = np.asarray(LIGHT.grid.directions()[row, column])
        surface = mitsuba.SurfaceInteraction3f()
        surface.wi = mitsuba.Vector3f(*(-direction))
        found = np.ravel(np.asarray(scene.environment().eval(surface)))
        np.testing.assert_allclose(found, LIGHT.radiance[row, column], rtol=2e-3)


def test_plugins_are_taken_where_definitions_agree():
    assert own_plugin(MetallicRoughness(3 * KD, CLEAR, 1.0, 0.4))["type"] == "principled"
    plugin = own_plugin(Lambertian(KD))
    assert plugin["type"] == "diffuse"
    np.testing.assert_allclose(plugin["reflectance"]["value"], np.pi * KD)
    # Mitsuba has no white above one, another clear coat, and another base below glTF's dielectric.
    assert own_plugin(Lambertian(10 * KD)) is None
    assert own_plugin(Principled(3 * KD, CLEAR, 0 * KD, 0.5 * CLEAR, 0.2, 0.5)) is None
    assert own_plugin(Principled(3 * KD, 0.5 * CLEAR, 0 * KD, 0 * KD, 0.2, 0.5)) is None
    assert own_plugin(MetallicRoughness(3 * KD, CLEAR, 0.5, 0.4)) is None


def test_names_of_cameras_do_no_harm(tmp_path):
    write_mitsuba(contents(Lambertian(KD), jr.Sphere()), tmp_path)
    names = [name for name in json.loads((tmp_path / "scene.json").read_text()) if "camera" in name]
    assert names == ["camera_0_b_0", "camera_1_b_1"]


def test_what_is_lost_is_said():
    stretched = jr.Pinhole(32, 24, POSE, fl_x=60.0, fl_y=66.0)
    one = contents(Lambertian(KD), jr.Sphere())
    assert mitsuba_losses(one) == ()
    frames = (FRAMES[0]._replace(camera=stretched),)
    assert "not square" in mitsuba_losses(one._replace(cameras=frames))[0]
    with pytest.raises(ValueError, match="needs a material, a shape and a light"):
        write_mitsuba(one._replace(shape=None), Path())
