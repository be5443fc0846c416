"""Brushed surfaces for other programs.

- Mitsuba renders ``anisotropic-ggx`` on a ball: its picture is ours within .5 %, and nearer to ours
  with its own masking; the README says how far the two maskings are apart.
- glTF has the strength of KHR_materials_anisotropy and our tangents at the vertices; its material
  as a BRDF is the nearest, and goes round with the tangent.
"""

import json
import re

import numpy as np
import pytest
from test_exporting import CONFIG, made

import jaxrender as jr
from jaxrender.brdf import AnisotropicGGX, OpenPBR
from jaxrender.geometry import Pinhole, Sphere
from jaxrender.io.captures import Frame
from jaxrender.io.exports import Brushed, Contents, GltfMaterial, SeparatelyMasked, write_mitsuba
from jaxrender.io.exports.anisotropy import tangents
from jaxrender.pipelines.exporting import export
from jaxrender.pipelines.exporting.differences import difference
from jaxrender.pipelines.exporting.nearest_gltf import nearest_brushed

CLEAR = np.ones(3)
METAL = AnisotropicGGX(np.zeros(3), np.array([0.7, 0.5, 0.3]), 0.15, 0.6, None, 0.4)
PAINT = AnisotropicGGX(np.array([0.1, 0.08, 0.05]), 0.06 * CLEAR, 0.5, 0.2, 1.5, 0.4)
POSE = jr.look_at(np.array([0.0, -4.0, 1.0]), np.zeros(3), np.array([0.0, 0, 1]))
SIZE, BLOCK = 48, 6
LAMPS = jr.DirectionalSources(
    np.array([[0.6, -0.5, 0.6], [-0.7, -0.7, 0.1]]), np.array([[2.0, 2, 2], [1.0, 1, 1]])
)


@pytest.fixture(scope="module")
def mitsuba():
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_rgb")
    return found


def blocks(image):
    return image.reshape(SIZE // BLOCK, BLOCK, SIZE // BLOCK, BLOCK, 3).mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("material", "samples", "most"),
    [
        pytest.param(PAINT, 256, 0.005, id="paint"),
        pytest.param(METAL, 900, 0.007, id="metal", marks=pytest.mark.slow),
    ],
)
def test_mitsuba_renders_brushed_surfaces(mitsuba, tmp_path, material, samples, most):
    """Masking apart is .06 % of the paint's picture and .4 % of the metal's; the rest is noise."""
    camera = Pinhole(SIZE, SIZE, POSE, fl_x=1.8 * SIZE)
    frame = Frame("0", camera, tmp_path / "none.exr", None, None)
    light = jr.Environment(np.full((24, 48, 3), 0.5))
    write_mitsuba(Contents("ball", material, Sphere(), light, LAMPS, (frame,)), tmp_path)
    scene = mitsuba.load_file(str(tmp_path / "scene.xml"))
    theirs = np.array(mitsuba.render(scene, spp=samples))
    exact, masked = (
        np.asarray(jr.render(one, light + LAMPS, Sphere(), camera))
        for one in (material, SeparatelyMasked(material))
    )
    whole = blocks(np.repeat((exact.sum(-1, keepdims=True) > 0) * 1.0, 3, axis=-1)).min(-1) == 1
    theirs, exact, masked = (blocks(one)[whole] for one in (theirs, exact, masked))
    assert np.abs(theirs - exact).sum() < most * exact.sum()
    assert np.abs(theirs - masked).sum() < 0.005 * masked.sum()


def test_what_is_lost_is_said(tmp_path):
    """The README's number is the difference of the two maskings, in a picture of a ball."""
    config = CONFIG.replace("metallic-roughness", "anisotropic-ggx")
    material = {"model": "anisotropic-ggx", "kd": [0.1, 0.08, 0.05], "ks": [0.06] * 3,
                "roughness": 0.5, "roughness_y": 0.2, "mu": 1.5,
                "tangent_rotation": 0.4}  # fmt: skip
    result = made(tmp_path / "cat", material, config)
    done = export(result, "mitsuba", lossy=True)
    text = " ".join((done.folder / "README.txt").read_text().split())
    stated = float(re.search(r"([0-9.]+) % in a picture", text).group(1)) / 100
    assert 0.0002 < stated < 0.02
    assert "roughconductor" in (done.folder / "scene.xml").read_text()


def test_gltf_has_anisotropy_and_tangents(tmp_path):
    config = CONFIG.replace("metallic-roughness", "anisotropic-ggx")
    material = {"model": "anisotropic-ggx", "kd": [0.0] * 3, "ks": [0.7, 0.5, 0.3],
                "roughness": 0.15, "roughness_y": 0.6, "mu": None,
                "tangent_rotation": 0.4}  # fmt: skip
    done = export(made(tmp_path / "cat", material, config), "gltf", lossy=True)
    document = json.loads((done.folder / "scene.gltf").read_text())
    found = document["materials"][0]
    strength = found["extensions"]["KHR_materials_anisotropy"]["anisotropyStrength"]
    across = found["pbrMetallicRoughness"]["roughnessFactor"] ** 2
    along = across + (1 - across) * strength**2
    assert along / across == pytest.approx(4, rel=0.01)
    assert across == pytest.approx(0.15, rel=0.1)
    assert "KHR_materials_anisotropy" in document["extensionsUsed"]
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    assert document["accessors"][attributes["TANGENT"]]["type"] == "VEC4"


def test_the_nearest_goes_round_with_the_tangent():
    near = nearest_brushed(METAL, Brushed.of(METAL))
    nothing = Contents("x")
    own = difference(METAL, near, nothing).relative_rms
    even = difference(METAL, GltfMaterial(near.base_color, 1.0, np.sqrt(0.3)), nothing).relative_rms
    turned = AnisotropicGGX(METAL.kd, METAL.ks, 0.6, 0.15, None, 0.4)
    across = difference(turned, near, nothing).relative_rms
    assert own < 0.25
    assert even > 2 * own
    assert across > 3 * own


def test_tangents_follow_the_meridian():
    normals = np.array([[1.0, 0, 0], [0, 0.6, 0.8]])
    np.testing.assert_allclose(tangents(normals, 0.0), [[0, 0, -1], [0, 0.8, -0.6]], atol=1e-12)
    np.testing.assert_allclose(tangents(normals, np.pi / 2), [[0, 1, 0], [-1, 0, 0]], atol=1e-12)


def test_openpbr_with_anisotropy_has_its_own_widths():
    brushed = OpenPBR(np.array([0.6, 0.3, 0.1]), CLEAR, 1.0, 0.5, specular_roughness_anisotropy=0.6)
    found = Brushed.of(brushed)
    assert found.across / found.along == pytest.approx(0.4)
    near = nearest_brushed(brushed, found)
    assert difference(brushed, near, Contents("x")).relative_rms < 0.2
    assert Brushed.of(OpenPBR(CLEAR, CLEAR, 1.0, 0.5)) is None
