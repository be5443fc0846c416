"""``jaxrender export``: a result folder in, a folder of files out.

- A folder has a README.txt that names every file, what was lost, and how far the nearest is.
- What a format cannot hold is refused without ``--lossy``, and nothing is written.
- Unknown formats, folders without a result, results of an older schema, other folders in the way,
  and materials that are missing are named with their remedy.
- The nearest material of glTF to one of its own is that one; maps change it texel by texel.
"""

import json

import numpy as np
import pytest

from jaxrender import cli
from jaxrender.brdf import MetallicRoughness, Microfacet
from jaxrender.errors import InputError
from jaxrender.io import read_image, write_image
from jaxrender.io.exports import Contents, GltfMaterial, MaterialMaps
from jaxrender.pipelines.exporting import export
from jaxrender.pipelines.exporting.differences import difference
from jaxrender.pipelines.exporting.nearest_gltf import nearest_gltf, nearest_textured

CONFIG = """\
task: brdf
capture: {transforms: transforms.json, geometry: {sphere: {center: [0, 0, 1], radius: 2}}}
lighting:
  environment: {path: light.exr}
  directional: [{direction: [0, 0.6, 0.8], irradiance: 2}]
brdf: {model: metallic-roughness}
"""
GLTF = {"model": "metallic-roughness", "base_color": [0.6, 0.3, 0.1], "roughness": 0.4,
        "metallic": 0.25, "ior": 1.5, "interface": 1.0}  # fmt: skip
THESIS = {"model": "microfacet", "kd": [0.2, 0.15, 0.1], "ks": 0.12, "sigma": 0.25, "mu": 1.6,
          "fresnel": "exit", "masking": "none"}  # fmt: skip


def made(folder, material=GLTF, config=CONFIG, **other):
    """A result folder, without the fit that would have made it."""
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(config)
    pose = np.diag([1.0, 1, 1, 1])
    pose[2, 3] = 9
    frame = {"file_path": "gone.exr", "transform_matrix": pose.tolist()}
    cameras = {"w": 16, "h": 12, "fl_x": 20, "frames": [frame]}
    (folder / "transforms.json").write_text(json.dumps(cameras))
    write_image(folder / "light.exr", np.full((8, 16, 3), 0.5))
    summary = {"task": "brdf", "outcome": "converged", "brdf": material, "lighting": {}, **other}
    (folder / "result.json").write_text(json.dumps(summary))
    return folder


def test_a_material_of_gltf_is_its_own(tmp_path):
    result = made(tmp_path / "cat", scale=2.0)
    done = export(result, "gltf")
    assert done.folder == tmp_path / "cat_gltf"
    document = json.loads((done.folder / "scene.gltf").read_text())
    factors = document["materials"][0]["pbrMetallicRoughness"]
    assert factors["baseColorFactor"] == pytest.approx([0.6, 0.3, 0.1, 1])
    assert (factors["roughnessFactor"], factors["metallicFactor"]) == pytest.approx((0.4, 0.25))
    # The light of the photographs is the given one times the scale.
    light = document["extensions"]["KHR_lights_punctual"]["lights"][0]
    assert light["intensity"] == pytest.approx(4)
    found = read_image(done.folder / "environment.exr").pixels
    np.testing.assert_allclose(found, 1.0, rtol=1e-6)
    accessor = document["accessors"][0]
    np.testing.assert_allclose(accessor["min"], [-2, -1, -2], atol=0.01)
    np.testing.assert_allclose(accessor["max"], [2, 3, 2], atol=0.01)
    text = (done.folder / "README.txt").read_text()
    files = {p.name for p in done.folder.iterdir()} - {"README.txt", "run.json"}
    assert files == {"scene.gltf", "environment.exr"}
    assert all(name in text for name in files)
    assert "Lost: nothing" in text
    assert "by its definition" in " ".join(done.sentences)
    # A second time nothing is done, and another export in the way stays.
    assert export(result, "gltf").sentences == ()
    with pytest.raises(InputError, match="holds the result of another run"):
        export(result, "glb", done.folder)
    assert (export(result, "glb", done.folder, force=True).folder / "scene.glb").is_file()


def test_what_is_lost_is_refused_first(tmp_path):
    config = CONFIG.replace("metallic-roughness", "microfacet")
    result = made(tmp_path / "cat", THESIS, config)
    with pytest.raises(InputError, match=r"would lose the model.*% rms.*Give --lossy to go on"):
        export(result, "glb")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cat"]
    done = export(result, "glb", lossy=True)
    text = " ".join((done.folder / "README.txt").read_text().split())
    assert "Lost: - the model of the material, which the format lacks; the nearest" in text
    assert "index" in text


def test_bad_input_is_named(tmp_path, capsys):
    result = made(tmp_path / "cat")
    assert cli.main(["export", str(result), "--to", "fbx"]) == 2
    said = capsys.readouterr().err
    assert "--to fbx: no such format; known are gltf, glb, mitsuba" in said
    with pytest.raises(InputError, match="holds no finished result"):
        export(tmp_path, "gltf")
    with pytest.raises(InputError, match="is the result itself"):
        export(result, "gltf", result)
    older = {"model": "metallic-roughness", "roughness": 0.4}
    old = made(tmp_path / "old", older, provenance={"jaxrender": "0.0.1"})
    with pytest.raises(InputError, match=r"result.json: no key .* older version \(0.0.1\)"):
        export(old, "gltf")
    mesh = CONFIG.replace("sphere: {center: [0, 0, 1], radius: 2}", "mesh: gone.ply")
    with pytest.raises(InputError, match=r"gone\.ply: no such mesh file"):
        export(made(tmp_path / "shapeless", config=mesh), "gltf")


def test_the_nearest_to_its_own_is_itself():
    own = GltfMaterial(np.array([0.5, 0.3, 0.2]), 0.0, 0.35, 1.7)
    found = nearest_gltf(own, metals=False)
    np.testing.assert_allclose(found.base_color, own.base_color, rtol=0.01)
    assert float(found.roughness) == pytest.approx(0.35, rel=0.01)
    assert float(found.ior) == pytest.approx(1.7, rel=0.01)
    assert difference(own, found, Contents("x")).relative_rms < 0.01
    other = MetallicRoughness(np.array([0.5, 0.3, 0.2]), np.ones(3), 0.0, 0.35, 1.7)
    assert difference(own, other, Contents("x")).relative_rms < 1e-6


def test_maps_change_the_nearest_texel_by_texel():
    mean = Microfacet(np.array([0.1, 0.08, 0.06]), np.full(3, 0.1), 0.2, 1.5)
    kd = np.stack([np.asarray(mean.kd), 0.5 * np.asarray(mean.kd)])[None]
    maps = MaterialMaps(mean, kd, np.array([[0.1, 0.05]]), np.array([[0.2, 0.05]]))
    found = nearest_textured(maps)
    base, rough = found.textures.base_color, found.textures.roughness
    np.testing.assert_allclose(base[0, 0], found.mean.base_color, rtol=1e-9)
    np.testing.assert_allclose(base[0, 1], 0.5 * base[0, 0], rtol=1e-9)
    assert rough[0, 1] == pytest.approx(0.5 * rough[0, 0])
    assert rough[0, 0] == pytest.approx(float(found.mean.roughness))
    np.testing.assert_allclose(
        found.textures.specular_color[0, 1], 0.5 * found.textures.specular_color[0, 0], rtol=1e-6
    )
    assert found.too_bright == 0
    gold = maps._replace(ks=maps.ks[..., None] * np.array([1.0, 0.8, 0.4]))
    mean = mean.with_amplitudes(mean.kd, 0.1 * np.array([1.0, 0.8, 0.4]))
    found = nearest_textured(gold._replace(mean=mean))
    colour = found.textures.specular_color
    # What is left of the highlights is nearly as coloured as they are.
    np.testing.assert_allclose(colour[0, 0] / colour[0, 0, 0], [1, 0.8, 0.4], atol=0.05)
    np.testing.assert_allclose(colour[0, 1], 0.5 * colour[0, 0], rtol=1e-6)
