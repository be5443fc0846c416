"""Stages of USD, against USD's own library (extra ``usd``).

- Its validators find no error in a textured mesh under a dome, with sources and cameras.
- Up axis, unit, points, texture coordinates, colours and textures are ours.
- A dome's texel lies in our direction; its lights shine from ours; cameras have our rays.
- What is lost is said; without the library the remedy is.
"""

import builtins
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jaxrender as jr
from jaxrender.errors import InputError
from jaxrender.io import read_image
from jaxrender.io.captures import Frame
from jaxrender.io.exports import (
    Contents,
    GltfMaterial,
    GltfTextures,
    mesh_of,
    srgb,
    usd_losses,
    write_usd,
)

POSE = jr.look_at(np.array([4.0, 1, 1]), np.zeros(3), np.array([0.0, 0, 1]))
CAMERAS = (
    jr.Pinhole(32, 24, POSE, fl_x=60.0, fl_y=66.0, cx=14.0, cy=13.0),
    jr.Orthographic(32, 24, POSE, scale=0.1, cx=14.0, cy=13.0),
)
FRAMES = tuple(
    Frame(f"../<b>{number}", camera, Path("none.exr"), None, None)
    for number, camera in enumerate(CAMERAS)
)
LAMP = jr.DirectionalSources(np.array([[0.5, -0.4, 0.7]]), np.array([[2.0, 1.5, 1.0]]))
LIGHT = jr.Environment(np.random.default_rng(0).uniform(0.1, 1, (8, 16, 3)))
NEAR = jr.PointSources(np.array([[1.5, -1.0, 2.0]]), np.array([[4.0, 3.0, 2.0]]))
MATERIAL = GltfMaterial(np.array([0.5, 0.3, 0.2]), 0.0, 0.4, 1.8)
TEXTURES = GltfTextures(
    np.linspace(0, 1, 96).reshape(4, 8, 3), np.full((4, 8, 3), 0.5), np.full((4, 8), 0.3)
)
CONTENTS = Contents("a <b>", None, mesh_of(jr.Sphere(), True), LIGHT, LAMP, FRAMES, points=NEAR)


@pytest.fixture(scope="module")
def pxr():
    return pytest.importorskip("pxr", reason="needs the extra usd: pip install 'jaxrender[usd]'")


@pytest.fixture(scope="module")
def written(pxr, tmp_path_factory):
    from pxr import Usd

    folder = tmp_path_factory.mktemp("usd")
    parts = write_usd(CONTENTS, folder, MATERIAL, TEXTURES)
    assert sorted(part.file for part in parts) == sorted(p.name for p in folder.iterdir())
    return folder, Usd.Stage.Open(str(folder / "scene.usdc"))


def test_validators_find_no_error(written):
    from pxr import UsdValidation

    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadAllValidators()
    assert len(validators) > 10
    found = UsdValidation.ValidationContext(validators).Validate(written[1])
    assert [(one.GetName(), one.GetMessage()) for one in found] == []


def test_validators_would_find_errors(written):
    """The same check sees a stage without its default prim, and a texture that has gone."""
    from pxr import Sdf, Usd, UsdValidation

    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(written[1].GetRootLayer())
    layer.ClearDefaultPrim()
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(layer))
    names = {one.GetName() for one in found}
    assert any("Default" in name for name in names), names
    assert len(names) > 1


def test_axes_mesh_and_material_are_ours(written):
    from pxr import Usd, UsdGeom, UsdShade

    folder, stage = written
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    shape = UsdGeom.Mesh(stage.GetPrimAtPath("/scene/object"))
    mesh = CONTENTS.shape
    np.testing.assert_allclose(shape.GetPointsAttr().Get(), mesh.vertices, atol=1e-6)
    st = UsdGeom.PrimvarsAPI(shape).GetPrimvar("st")
    np.testing.assert_allclose(st.Get(), mesh.texture_coordinates.reshape(-1, 2), atol=1e-6)
    material, _ = UsdShade.MaterialBindingAPI(shape.GetPrim()).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0]
    assert surface.GetInput("useSpecularWorkflow").Get() == 1
    head_on = ((1.8 - 1) / (1.8 + 1)) ** 2
    source = surface.GetInput("specularColor").GetConnectedSources()[0][0].source
    reader = UsdShade.Shader(source.GetPrim())
    assert reader.GetInput("scale").Get()[0] == pytest.approx(head_on)
    assert reader.GetInput("sourceColorSpace").Get() == "sRGB"
    picture = np.asarray(Image.open(folder / "base_color.png")) / 255
    np.testing.assert_allclose(picture, srgb(TEXTURES.base_color), atol=0.003)
    assert [p.GetTypeName() for p in Usd.PrimRange(stage.GetPrimAtPath("/scene"))].count(
        "Shader"
    ) == 5


def test_light_comes_from_our_directions(written):
    from pxr import Gf, UsdGeom, UsdLux

    folder, stage = written
    cache = UsdGeom.XformCache()
    dome = cache.GetLocalToWorldTransform(stage.GetPrimAtPath("/scene/environment"))
    picture = read_image(folder / "environment.exr").pixels
    rows, columns = picture.shape[:2]
    for row, column in ((2, 3), (5, 12)):
        # OpenEXR: longitude goes from pi to -pi, 0 is +z and pi / 2 is +x.
        longitude = np.pi - (column + 0.5) / columns * 2 * np.pi
        latitude = np.pi / 2 - (row + 0.5) / rows * np.pi
        own = Gf.Vec3d(np.sin(longitude) * np.cos(latitude), np.sin(latitude),
                       np.cos(longitude) * np.cos(latitude))  # fmt: skip
        world = np.array(dome.TransformDir(own))
        nearest = np.argmax(np.asarray(LIGHT.grid.directions()).reshape(-1, 3) @ world)
        np.testing.assert_allclose(
            picture[row, column], LIGHT.radiance.reshape(-1, 3)[nearest], rtol=1e-5
        )
    prim = stage.GetPrimAtPath("/scene/source_0")
    towards = -np.array(cache.GetLocalToWorldTransform(prim).TransformDir(Gf.Vec3d(0, 0, -1)))
    np.testing.assert_allclose(towards, np.asarray(LAMP.nodes()[0])[0], atol=1e-6)
    source = UsdLux.LightAPI(prim)
    assert source.GetNormalizeAttr().Get()
    irradiance = source.GetIntensityAttr().Get() * np.array(source.GetColorAttr().Get())
    np.testing.assert_allclose(irradiance, [2.0, 1.5, 1.0], rtol=1e-6)
    point = stage.GetPrimAtPath("/scene/point_0")
    place = cache.GetLocalToWorldTransform(point).ExtractTranslation()
    np.testing.assert_allclose(place, [1.5, -1, 2])


def test_cameras_have_our_rays(written):
    from pxr import Gf, UsdGeom

    stage = written[1]
    for number, camera in enumerate(CAMERAS):
        prim = stage.GetPrimAtPath(f"/scene/camera_{number}_b_{number}")
        frustum = UsdGeom.Camera(prim).GetCamera(1.0).frustum
        rays = camera.rays()
        for row, column in ((0, 0), (10, 20), (23, 31)):
            place = Gf.Vec2d(
                2 * (column + 0.5) / camera.width - 1, 1 - 2 * (row + 0.5) / camera.height
            )
            ray = frustum.ComputeNarrowedFrustum(place, Gf.Vec2d(1e-6, 1e-6))
            own = ray.ComputeViewDirection() if number else ray.ComputeCorners()[4]
            towards = np.array(own)
            if not number:
                towards -= rays.origins[row, column]
                towards /= np.linalg.norm(towards)
            np.testing.assert_allclose(towards, rays.directions[row, column], atol=1e-4)
            if number:
                aside = np.cross(
                    np.array(ray.ComputeCorners()[0]) - rays.origins[row, column], towards
                )
                np.testing.assert_allclose(aside, 0, atol=1e-4)


def test_what_is_lost_is_said():
    assert usd_losses(CONTENTS, MATERIAL) == ()
    brushed = GltfMaterial(np.ones(3), 1.0, 0.4, anisotropy_strength=0.5)
    assert "brushed" in usd_losses(CONTENTS, brushed)[0]


def test_without_the_library_the_remedy_is_said(tmp_path, monkeypatch):
    own = builtins.__import__

    def missing(name, *rest, **named):
        if name.startswith("pxr"):
            raise ImportError(name)
        return own(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match=r"pip install 'jaxrender\[usd\]'"):
        write_usd(CONTENTS, tmp_path, MATERIAL)
    assert not list(tmp_path.iterdir())
