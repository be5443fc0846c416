"""Scenes of Blender, opened and rendered by Blender itself (5.0; ``io.exports.blender``).

- A scene has our mesh, poses, numbers, pictures with their colour spaces inside, and no path out.
- Cycles renders GGX, Beckmann and Lambert under our light as our exact integral does, within 1 %;
  so it does with suns, near sources, and each of our cameras.
- ``BlenderMaterial`` is what Cycles makes of a Principled BSDF, and of the same numbers in a GLB.
- It keeps energy: a white base under a smooth interface reflects what arrives.
- What is lost is said; without Blender the remedy is, and what a script said before it failed.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from blender_scenes import apart, cycles_picture, need_blender, scene_of

import jaxrender as jr
from jaxrender.brdf import AnisotropicGGX, Lambertian, Microfacet, directional_albedo
from jaxrender.errors import InputError
from jaxrender.geometry import observe
from jaxrender.io.captures import Frame
from jaxrender.io.exports import (
    BlenderMaterial,
    Contents,
    GltfMaterial,
    GltfTextures,
    MaterialMaps,
    blend_losses,
    blender_command,
    mesh_of,
    own_surface,
    own_textured,
    principled,
    principled_losses,
    run_in_blender,
    with_normals,
    write_blend,
    write_gltf,
)
from jaxrender.io.exports import blender as finding
from jaxrender.reflection import render_lit

POSE = jr.look_at(np.array([4.0, 1.5, 1]), np.array([0.05, 0, 0]), np.array([0.0, 0, 1]))
CAMERA = jr.Pinhole(64, 48, POSE, fl_x=100.0)
SMALL = jr.Pinhole(24, 18, POSE, fl_x=37.5)
COLOR, KD, GREY = np.array([0.6, 0.4, 0.2]), np.array([0.1, 0.075, 0.05]), np.full(3, 0.12)
LAMP = jr.DirectionalSources(np.array([[0.5, -0.4, 0.7]]), np.array([[2.0, 1.5, 1.0]]))
NEAR = jr.PointSources(np.array([[1.5, -1.0, 2.0]]), np.array([[4.0, 3.0, 2.0]]))
GGX = Microfacet(KD, GREY, 0.2, 1.5, "half", "smith", "ggx")
PLASTIC = GltfMaterial(COLOR, 0.0, 0.4, 1.8, 1.0, np.array([1.0, 0.8, 0.6]))


def sky(rows=64):
    """Bright towards +X and up, a soft lamp at azimuth 1: not the same in any mirror."""
    polar = ((np.arange(rows) + 0.5) * np.pi / rows)[:, None]
    azimuth = ((np.arange(2 * rows) + 0.5) * np.pi / rows)[None, :]
    found = 1 + 0.6 * np.sin(polar) * np.cos(azimuth) + 0.3 * np.cos(polar)
    found = found + 2 * np.exp(-((polar - 1) ** 2 + (azimuth - 1) ** 2) / 0.3)
    return jr.Environment(found[..., None] * np.array([1, 0.8, 0.6]))


def contents(environment=None, lamp=None, points=None, cameras=(CAMERA,), shape=None):
    frames = tuple(
        Frame(f"../<b>{number}", camera, Path("none.exr"), None, None)
        for number, camera in enumerate(cameras)
    )
    lamp = jr.DirectionalSources.none() if lamp is None else lamp
    shape = jr.Sphere() if shape is None else shape
    return Contents("a <b>", None, shape, environment, lamp, frames, points=points)


def off(material, surface, light, made, folder, samples, camera=CAMERA):
    """How far Cycles is from us, and from itself with other random numbers."""
    write_blend(made, folder, surface)
    theirs = cycles_picture(folder / "scene.blend", samples)
    again = cycles_picture(folder / "scene.blend", samples, seed=1)
    ours = np.asarray(render_lit(material, light, made.shape, camera))
    where = theirs.whole & (ours.sum(axis=-1) > 0)
    assert where.sum() > 0.2 * where.size
    noise = apart(theirs.pixels, again.pixels, where) / np.sqrt(2)
    return apart(theirs.pixels, ours, where), noise


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A textured ball under everything that shines, with a perspective and another camera."""
    need_blender()
    folder = tmp_path_factory.mktemp("blend")
    cameras = (CAMERA, jr.Orthographic(64, 48, POSE, scale=0.1, cx=30.0, cy=25.0))
    light = jr.Environment(np.random.default_rng(0).uniform(0.1, 3, (4, 8, 3)))
    made = contents(light, LAMP, NEAR, cameras)
    maps = GltfTextures(np.linspace(0, 1, 96).reshape(4, 8, 3), None, np.full((4, 8), 0.3))
    parts = write_blend(made, folder, principled(PLASTIC, maps))
    assert [part.file for part in parts] == [path.name for path in folder.iterdir()]
    return made, maps, scene_of(folder / "scene.blend")


def test_a_scene_has_our_numbers(written):
    made, _, scene = written
    things, name = scene["things"], "a_b"
    mesh = mesh_of(made.shape, textured=True)
    found = np.reshape(things[name]["vertices"], (-1, 3))
    np.testing.assert_allclose(found, mesh.vertices, atol=1e-6)
    assert things[name]["faces"] == len(mesh.faces)
    for number in range(2):
        np.testing.assert_allclose(things[f"b_{number}"]["pose"], POSE, atol=1e-6)
    sun, near = things["source_0"], things["point_0"]
    np.testing.assert_allclose(np.array(sun["pose"])[:3, 2], LAMP.nodes()[0][0], atol=1e-6)
    np.testing.assert_allclose(sun["energy"] * np.array(sun["color"]), [2, 1.5, 1], rtol=1e-6)
    np.testing.assert_allclose(np.array(near["pose"])[:3, 3], [1.5, -1, 2])
    surface = next(one for one in scene["shaders"] if one["node"] == "ShaderNodeBsdfPrincipled")
    assert surface["IOR"] == pytest.approx(1.8)
    assert surface["Specular Tint"][:3] == pytest.approx([1.0, 0.8, 0.6])
    assert surface["linked"] == ["Base Color", "Roughness"]


def test_pictures_are_inside(written):
    made, maps, scene = written
    found = scene["pictures"]
    spaces = {name: one["space"] for name, one in found.items()}
    linear = "Linear Rec.709"
    assert spaces == {"base_color_0.exr": linear, "environment.exr": linear,
                      "roughness_0.exr": "Non-Color"}  # fmt: skip
    assert all(one["packed"] and one["file"] == f"//{name}" for name, one in found.items())
    pixels = np.array(found["base_color_0.exr"]["pixels"])[..., :3]
    np.testing.assert_allclose(pixels, maps.base_color, atol=1e-6)
    # Blender looks along +x in the middle, and has +y left of it: columns run against the azimuth.
    pixels = np.array(found["environment.exr"]["pixels"])[..., :3]
    radiance = np.asarray(made.environment.radiance)
    np.testing.assert_allclose(pixels[:, 3], radiance[:, 0], rtol=1e-5)
    np.testing.assert_allclose(pixels[:, 1], radiance[:, 2], rtol=1e-5)


def test_cycles_renders_ggx(tmp_path):
    """The quick sister of the tests below; noise is .5 %."""
    need_blender()
    light = sky(32)
    surface = own_surface(GGX)
    write_blend(contents(light, cameras=(SMALL,)), tmp_path, surface)
    theirs = cycles_picture(tmp_path / "scene.blend", 128)
    ours = np.asarray(render_lit(GGX, light, jr.Sphere(), SMALL))
    assert theirs.whole.sum() > 100
    assert apart(theirs.pixels, ours, theirs.whole) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    "material",
    [
        pytest.param(Lambertian(2 * KD), id="lambert"),
        pytest.param(GGX, id="ggx"),
        pytest.param(Microfacet(KD, GREY / 8, 0.2, 1.5, "half", "smith", "ggx"), id="weak ggx"),
        pytest.param(Microfacet(KD, COLOR / 5, 0.2, 1.5, "exit", "smith", "ggx"), id="exit angle"),
        pytest.param(Microfacet(KD, COLOR, 0.6, None, "half", "smith", "ggx"), id="metal"),
        pytest.param(
            Microfacet(KD, COLOR / 5, 0.3, 1.6, "exit", "smith", "beckmann"), id="beckmann"
        ),
        pytest.param(AnisotropicGGX(KD, COLOR, 0.1, 0.5, None, 0.3), id="brushed metal"),
        pytest.param(AnisotropicGGX(KD, GREY, 0.5, 0.1, 1.6, 0.3), id="brushed"),
    ],
)
def test_cycles_renders_what_blender_has(tmp_path, material):
    need_blender()
    light = sky()
    surface = own_surface(material)
    difference, noise = off(material, surface, light, contents(light), tmp_path, 256)
    print(f"{difference:.4f}, noise {noise:.4f}")
    assert difference < 0.01
    assert noise < 0.006


@pytest.mark.slow
@pytest.mark.parametrize(
    "numbers",
    [
        pytest.param(PLASTIC, id="tinted"),
        pytest.param(GltfMaterial(COLOR, 0.0, 0.8), id="rough"),
        pytest.param(GltfMaterial(COLOR, 0.4, 0.4), id="half metal"),
        pytest.param(GltfMaterial(COLOR, 1.0, 0.8), id="metal"),
        pytest.param(
            GltfMaterial(COLOR, 0.0, 0.6, clearcoat=0.7, clearcoat_roughness=0.3), id="coat"
        ),
        pytest.param(
            GltfMaterial(COLOR, 1.0, 0.4, anisotropy_strength=0.5, anisotropy_rotation=0.4),
            id="brushed",
        ),
    ],
)
def test_cycles_renders_the_principled(tmp_path, numbers):
    """As a .blend, and as a GLB that Blender imports, whose tangents it does not read."""
    need_blender()
    light, material = sky(), BlenderMaterial(numbers)
    made = contents(light)
    difference, noise = off(material, principled(numbers), light, made, tmp_path, 256)
    write_gltf(made, tmp_path, numbers, binary=True)
    theirs = cycles_picture(
        tmp_path / "scene.glb", 256, size=[64, 48], light=str(tmp_path / "environment.exr")
    )
    ours = np.asarray(render_lit(material, light, jr.Sphere(), CAMERA))
    inside = np.roll(ours.sum(axis=-1) > 0, 1) & theirs.whole
    of_glb = apart(theirs.pixels, ours, inside)
    told = np.asarray(render_lit(numbers, light, jr.Sphere(), CAMERA))
    of_gltf = apart(ours, told, inside)
    print(f"blend {difference:.4f}, glb {of_glb:.4f}, noise {noise:.4f}; glTF's own {of_gltf:.4f}")
    assert difference < 0.01
    assert (of_glb < 0.01) == numbers.isotropic
    assert noise < 0.006


@pytest.mark.slow
@pytest.mark.parametrize(
    "camera",
    [
        pytest.param(jr.Pinhole(64, 48, POSE, fl_x=100.0, fl_y=120.0, cx=29.0, cy=27.0), id="tall"),
        pytest.param(jr.Pinhole(64, 48, POSE, fl_x=100.0, fl_y=80.0, cx=35.0, cy=20.0), id="flat"),
        pytest.param(jr.Orthographic(64, 48, POSE, scale=0.05, cx=29.0, cy=27.0), id="parallel"),
    ],
)
@pytest.mark.parametrize("light", [LAMP, NEAR], ids=["sun", "near"])
def test_cycles_has_our_cameras_and_sources(tmp_path, camera, light):
    need_blender()
    points = light if light is NEAR else None
    lamp = light if light is LAMP else None
    made = contents(None, lamp, points, (camera,))
    difference, noise = off(GGX, own_surface(GGX), light, made, tmp_path, 256, camera)
    print(f"{difference:.4f}, noise {noise:.4f}")
    assert difference < 0.01


@pytest.mark.slow
def test_cycles_renders_maps_of_metalness(tmp_path):
    """Metal on one side of y = 0, plastic on the other, in a .blend and in a GLB."""
    need_blender()
    light = sky()
    left = np.arange(128)[None, :] < 64
    sides = [GltfMaterial(COLOR, 1.0, 0.4), GltfMaterial(COLOR[::-1], 0.0, 0.6)]
    color = np.where(left[..., None], COLOR, COLOR[::-1]) * np.ones((64, 1, 1))
    roughness, metallic = (
        np.where(left, a, b) * np.ones((64, 1)) for a, b in ((0.4, 0.6), (1, 0.0))
    )
    maps = GltfTextures(color, None, roughness, metallic)
    made, white = contents(light), GltfMaterial(np.ones(3), 1.0, 1.0)
    write_blend(made, tmp_path, principled(white, maps))
    write_gltf(made, tmp_path, white, maps, binary=True)
    blend = cycles_picture(tmp_path / "scene.blend", 256)
    options = {"size": [64, 48], "light": str(tmp_path / "environment.exr")}
    glb = cycles_picture(tmp_path / "scene.glb", 256, **options)
    ours = [np.asarray(render_lit(BlenderMaterial(m), light, jr.Sphere(), CAMERA)) for m in sides]
    height = observe(CAMERA, jr.Sphere()).normals[..., 1]
    for side, where in zip(ours, (height > 0.1, height < -0.1)):
        where = where & blend.whole
        assert where.sum() > 200
        assert apart(blend.pixels, side, where) < 0.01
        # Eight bits of sRGB.
        assert apart(glb.pixels, side, where) < 0.01


@pytest.mark.slow
def test_cycles_renders_maps_with_normals(tmp_path):
    """GGX of a K_d, K_s and sigma of every texel, whose normals are tilted alike in each half."""
    need_blender()
    light = sky()
    left = np.arange(128)[None, :] < 64
    sides = [GGX, Microfacet(KD[::-1], GREY / 2, 0.4, 1.5, "half", "smith", "ggx")]
    one = np.ones((64, 1, 1))
    kd = np.where(left[..., None], sides[0].kd, sides[1].kd) * one
    ks, sigma = (np.where(left, *pair) * one[..., 0] for pair in ((0.12, 0.06), (0.2, 0.4)))
    maps = MaterialMaps(GGX, kd, ks, sigma)
    surface = own_textured(maps)
    made = contents(light)
    write_blend(made, tmp_path, surface)
    found = cycles_picture(tmp_path / "scene.blend", 256)
    ours = [np.asarray(render_lit(side, light, jr.Sphere(), CAMERA)) for side in sides]
    height = observe(CAMERA, jr.Sphere()).normals[..., 1]
    for side, where in zip(ours, (height > 0.1, height < -0.1)):
        assert apart(found.pixels, side, where & found.whole) < 0.01
    # The shape's own normals, given as normals of texels, change nothing.
    flat = maps._replace(offset=np.zeros_like(kd))
    write_blend(made, tmp_path, with_normals(surface, flat, jr.Sphere()))
    again = cycles_picture(tmp_path / "scene.blend", 256)
    assert apart(again.pixels, found.pixels, found.whole) < 0.01
    # Upwards tilted, light from above is seen by more of them.
    up = maps._replace(offset=0.5 * np.broadcast_to([0, 0, 1.0], kd.shape))
    write_blend(made, tmp_path, with_normals(surface, up, jr.Sphere()))
    tilted = cycles_picture(tmp_path / "scene.blend", 64)
    assert apart(tilted.pixels, found.pixels, found.whole) > 0.02


def test_a_white_base_reflects_what_arrives():
    smooth = BlenderMaterial(GltfMaterial(np.ones(3), 0.0, 0.2))
    rough = BlenderMaterial(GltfMaterial(np.ones(3), 0.0, 0.9, 2.0))
    cosines = [0.2, 0.7, 0.99]
    found = directional_albedo(smooth, cosines, "outgoing")
    np.testing.assert_allclose(found, 1, atol=0.01)
    # Facets lose some of what they hand on to one another, and never make any.
    lost = 1 - directional_albedo(rough, cosines, "outgoing")
    assert np.all((lost > 0) & (lost < 0.2))


def test_what_is_lost_is_said():
    assert blend_losses(contents(cameras=(CAMERA, CAMERA))) == ()
    said = blend_losses(contents(cameras=(CAMERA, jr.Pinhole(32, 48, POSE, fl_x=9.0, fl_y=8.0))))
    assert "sizes of all photographs but the first" in said[0]
    assert "shape of other pixels" in said[1]
    wide = GltfMaterial(COLOR, 1.0, 0.1, anisotropy_strength=0.9)
    assert "tenfold" in principled_losses(wide)[0]
    assert principled_losses(PLASTIC) == ()
    # Masking of other kinds, and a coloured lobe that grows with the half angle, Blender lacks.
    assert own_surface(Microfacet(KD, GREY, 0.2, 1.5)) is None
    assert own_surface(Microfacet(KD, COLOR, 0.2, 1.5, "half", "smith", "ggx")) is None


def test_without_blender_the_remedy_is_said(tmp_path, monkeypatch):
    monkeypatch.delenv(finding.VARIABLE, raising=False)
    monkeypatch.setattr(finding, "find_spec", lambda name: None)
    monkeypatch.setattr(finding.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match=r"Blender is not there: pip install --no-deps .bpy=="):
        write_blend(contents(), tmp_path, principled(PLASTIC))
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(finding.shutil, "which", lambda name: f"/somewhere/{name}")
    assert blender_command()[:2] == ("/somewhere/blender", "--background")


def test_the_variable_names_what_runs(tmp_path, monkeypatch):
    monkeypatch.setenv(finding.VARIABLE, sys.executable)
    script = tmp_path / "script.py"
    script.write_text("import sys\nprint(sys.argv[-2:])")
    assert "['1', 'two']" in run_in_blender(script, ("1", "two"))
    script.write_text("raise ValueError('the cube is missing')")
    with pytest.raises(InputError, match="code 1; its last words: ValueError: the cube is missing"):
        run_in_blender(script, ())
    monkeypatch.setenv(finding.VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match="nowhere: no such program"):
        blender_command()
