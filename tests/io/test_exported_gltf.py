"""glTF 2.0: the material as a BRDF, and files that others can read.

- The material is our metallic-roughness where that has no extension; a coat and a specular colour
  are what the extensions' formulas make of them at normal incidence.
- Read back by trimesh, a file has our mesh in glTF's axes; GLB and text hold the same.
- Accessors lie within their views, views within the buffer, extensions are declared; the validator
  of the Khronos group found no errors (gltf-validator 2.0.0-dev.3.10, by hand).
- Colours are sRGB in textures and linear in factors, rows upright; cameras and sources are ours.
"""

import io
import json
import struct
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
import trimesh
from PIL import Image

import jaxrender as jr
from jaxrender.brdf import BRDF, MetallicRoughness
from jaxrender.io import read_image
from jaxrender.io.captures import Frame
from jaxrender.io.exports import Contents, GltfMaterial, GltfTextures, gltf_losses, srgb, write_gltf

COLOR = np.array([0.6, 0.3, 0.1])
POSE = jr.look_at(np.array([4.0, 1, 1]), np.zeros(3), np.array([0.0, 0, 1]))
CAMERA = jr.Pinhole(32, 24, POSE, fl_x=60.0, fl_y=50.0)
LIGHT = jr.Environment(np.random.default_rng(0).random((4, 8, 3)))
LAMP = jr.DirectionalSources(np.array([[0.6, 0, 0.8], [0, 0, -1.0]]), np.array([[2, 1, 0.5]] * 2))
FULL = GltfMaterial(COLOR, 0.0, 0.4, 1.8, 0.9, np.array([1, 0.8, 0.7]), 0.6, 0.2)
evaluate = eqx.filter_jit(BRDF.evaluate)


def contents(shape):
    frames = (Frame('../<script>"', CAMERA, Path("none.exr"), None, None),)
    return Contents("cat & <b>", None, shape, LIGHT, LAMP, frames)


def read(path):
    """The document and the binary data of a .glb."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    return json.loads(data[20 : 20 + size]), data[28 + size :]


@pytest.mark.parametrize("metallic", [0.0, 0.3, 1.0])
def test_the_material_is_metallic_roughness(metallic):
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(2, 60, 3))
    directions[..., 2] = np.abs(directions[..., 2]) + 0.1
    incoming, outgoing = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    expected = evaluate(
        MetallicRoughness(COLOR, np.ones(3), metallic, 0.4, 1.8), incoming, outgoing
    )
    found = evaluate(GltfMaterial(COLOR, metallic, 0.4, 1.8), incoming, outgoing)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_extensions_do_what_they_say():
    """Head-on, where every growth is zero and D = 1 / (pi alpha^2)."""
    up = np.array([[0.0, 0.0, 1.0]])
    head_on = 0.9 * (0.8 / 2.8) ** 2 * np.array([1, 0.8, 0.7])
    facets = 1 / (4 * np.pi * 0.4**4)
    base = (1 - head_on[0]) * COLOR / np.pi + head_on * facets
    share = 0.6 * 0.04
    expected = (1 - share) * base + share / (4 * np.pi * 0.2**4)
    np.testing.assert_allclose(evaluate(FULL, up, up)[0], expected, rtol=1e-6)


def test_a_file_is_the_mesh_in_the_axes_of_gltf(tmp_path):
    ball = jr.Mesh.icosphere(2)
    mesh = jr.Mesh(ball.vertices * [1, 2, 3] + [0, 0, 5], ball.faces)
    write_gltf(contents(mesh), tmp_path, FULL, binary=True)
    write_gltf(contents(mesh), tmp_path, FULL, binary=False)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "environment.exr", "scene.glb", "scene.gltf",
    ]  # fmt: skip
    for name in ("scene.glb", "scene.gltf"):
        found = trimesh.load_scene(tmp_path / name, process=False).to_mesh()
        back = found.vertices @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        np.testing.assert_allclose(back, mesh.vertices, atol=1e-6)
        np.testing.assert_array_equal(found.faces, mesh.faces)


def test_all_of_it_is_within_bounds_and_declared(tmp_path):
    square = jr.Mesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        None,
        np.array([[[0.0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]),
    )
    picture = np.random.default_rng(2).random((3, 5, 3))
    textures = GltfTextures(picture, picture, picture[..., 0])
    write_gltf(contents(square), tmp_path, FULL, textures, binary=True)
    document, data = read(tmp_path / "scene.glb")
    assert document["buffers"][0]["byteLength"] <= len(data)
    sizes = {5126: 4, 5125: 4}
    parts = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        size = sizes[accessor["componentType"]] * parts[accessor["type"]] * accessor["count"]
        assert view["byteLength"] == size
        assert view["byteOffset"] % 4 == 0
    for view in document["bufferViews"]:
        assert view["byteOffset"] + view["byteLength"] <= document["buffers"][0]["byteLength"]
    (material,) = document["materials"]
    assert set(document["extensionsUsed"]) == {*material["extensions"], "KHR_lights_punctual"}
    # Row 0 is the picture's top, and at v = 0 of the file.
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    stored = data[view["byteOffset"] :][: view["byteLength"]]
    read_back = np.asarray(Image.open(io.BytesIO(stored))) / 255
    np.testing.assert_allclose(read_back, srgb(picture), atol=0.5 / 255 + 1e-9)
    rough = document["bufferViews"][document["images"][1]["bufferView"]]
    stored = data[rough["byteOffset"] :][: rough["byteLength"]]
    green = np.asarray(Image.open(io.BytesIO(stored)))[..., 1] / 255
    np.testing.assert_allclose(green, picture[..., 0], atol=0.5 / 255 + 1e-9)
    places = document["accessors"][
        document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"]
    ]
    start = document["bufferViews"][places["bufferView"]]["byteOffset"]
    coordinates = np.frombuffer(data, "<f4", 2 * places["count"], start).reshape(-1, 2)
    np.testing.assert_allclose(coordinates[0], [0, 1])


def test_colours_cameras_and_sources(tmp_path):
    write_gltf(contents(jr.Sphere()), tmp_path, FULL, binary=True)
    document, _ = read(tmp_path / "scene.glb")
    factors = document["materials"][0]["pbrMetallicRoughness"]
    assert factors == {
        "baseColorFactor": [0.6, 0.3, 0.1, 1.0], "metallicFactor": 0.0,
        "roughnessFactor": pytest.approx(0.4),
    }  # fmt: skip
    node = next(one for one in document["nodes"] if "camera" in one)
    assert node["name"] == "script"
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    matrix = np.reshape(node["matrix"], (4, 4)).T
    np.testing.assert_allclose(matrix[:3], turn @ POSE[:3], atol=1e-12)
    perspective = document["cameras"][0]["perspective"]
    assert np.tan(perspective["yfov"] / 2) == pytest.approx(12 / 50)
    assert perspective["aspectRatio"] == pytest.approx((16 / 60) / (12 / 50))
    shining = [one for one in document["nodes"] if "extensions" in one]
    for one, direction in zip(shining, np.asarray(LAMP.directions), strict=True):
        pose = np.reshape(one["matrix"], (4, 4)).T[:3, :3]
        np.testing.assert_allclose(pose[:, 2], turn @ direction, atol=1e-6)
        np.testing.assert_allclose(pose @ pose.T, np.eye(3), atol=1e-6)
        assert np.linalg.det(pose) == pytest.approx(1)
    light = document["extensions"]["KHR_lights_punctual"]["lights"][0]
    assert (light["intensity"], light["color"]) == (2.0, [1.0, 0.5, 0.25])
    assert "<" not in json.dumps(document)


def test_sources_with_a_place_have_it(tmp_path):
    near = jr.PointSources(np.array([[1.0, 2.0, 3.0]]), np.array([[4.0, 2.0, 1.0]]))
    write_gltf(contents(jr.Sphere())._replace(points=near), tmp_path, FULL, binary=False)
    document = json.loads((tmp_path / "scene.gltf").read_text())
    (node,) = [one for one in document["nodes"] if "translation" in one]
    # Their y is our z, their -z our y.
    assert node["translation"] == [1.0, 3.0, -2.0]
    number = node["extensions"]["KHR_lights_punctual"]["light"]
    light = document["extensions"]["KHR_lights_punctual"]["lights"][number]
    assert (light["type"], light["intensity"]) == ("point", 4.0)
    assert light["color"] == [1.0, 0.5, 0.25]


def test_the_environment_is_seen_from_within(tmp_path):
    write_gltf(contents(jr.Sphere()), tmp_path, FULL, binary=True)
    found = read_image(tmp_path / "environment.exr").pixels
    # Of our 8 columns number 1 lies at azimuth 67.5: as far to the left of +x, in the middle.
    np.testing.assert_allclose(found[1, 2], np.asarray(LIGHT.radiance)[1, 1], rtol=1e-6)


def test_losses_and_misuse():
    flat = jr.Orthographic(8, 8, POSE, scale=0.1)
    frames = (Frame("a", flat, Path("none.exr"), None, None),)
    one = contents(jr.Sphere())
    assert gltf_losses(one) == ()
    assert gltf_losses(one._replace(cameras=frames)) == ("orthographic cameras: they are left out",)
    with pytest.raises(ValueError, match="needs a shape"):
        write_gltf(one._replace(shape=None), Path(), FULL, binary=True)
