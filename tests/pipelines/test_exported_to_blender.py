"""``jaxrender export --to blend``: what a result becomes in Blender, and what of it is lost.

- GGX with Smith's masking leaves whole; the README says so, and the file is Blender's.
- Of other models the loss is stated as what Blender makes of the nearest Principled BSDF, which is
  nearer than what it makes of glTF's nearest; glTF's own model keeps its numbers.
- Without Blender nothing is written.
"""

import re
import sys

import numpy as np
import pytest
from test_exporting import CONFIG, GLTF, THESIS, made

from jaxrender.brdf import MetallicRoughness, OpenPBR
from jaxrender.errors import InputError
from jaxrender.io.exports import BlenderMaterial, Contents, GltfMaterial, blender_command
from jaxrender.io.exports import blender as finding
from jaxrender.pipelines.exporting import export
from jaxrender.pipelines.exporting.differences import difference
from jaxrender.pipelines.exporting.nearest_gltf import nearest_gltf

GGX = {"model": "ggx", "kd": [0.1, 0.08, 0.05], "ks": 0.12, "sigma": 0.2, "mu": 1.5,
       "fresnel": "half", "masking": "smith"}  # fmt: skip


def test_ggx_leaves_whole(tmp_path):
    try:
        blender_command()
    except InputError as error:
        pytest.skip(str(error))
    result = made(tmp_path / "cat", GGX, CONFIG.replace("metallic-roughness", "ggx"))
    done = export(result, "blend")
    files = {path.name for path in done.folder.iterdir()}
    assert files == {"scene.blend", "README.txt", "run.json"}
    text = " ".join((done.folder / "README.txt").read_text().split())
    assert "Lost: nothing" in text
    assert "a sum of Blender's own shaders" in text
    # Compressed as Blender does it (zstd).
    assert (done.folder / "scene.blend").read_bytes()[:4] == b"\x28\xb5\x2f\xfd"


def test_losses_are_those_of_blender(tmp_path, monkeypatch):
    monkeypatch.setenv(finding.VARIABLE, sys.executable)
    thesis = made(tmp_path / "thesis", THESIS, CONFIG.replace("metallic-roughness", "microfacet"))
    with pytest.raises(InputError, match=r"blend would lose the model.*the nearest that it has is"):
        export(thesis, "blend")
    with pytest.raises(InputError, match=r"of the same numbers it makes one") as told:
        export(made(tmp_path / "cat"), "blend")
    own = MetallicRoughness(np.array(GLTF["base_color"]), np.ones(3), 0.25, 0.4)
    numbers = GltfMaterial(np.array(GLTF["base_color"]), 0.25, 0.4)
    expected = difference(own, BlenderMaterial(numbers), Contents("x")).relative_rms
    stated = float(re.search(r"makes one ([0-9.]+) % rms", str(told.value)).group(1)) / 100
    assert stated == pytest.approx(expected, rel=0.06)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cat", "thesis"]


def test_the_nearest_is_blenders():
    paint = OpenPBR(np.array([0.5, 0.3, 0.2]), np.ones(3), 0.0, 0.4)
    nothing = Contents("x")
    near = difference(
        paint, BlenderMaterial(nearest_gltf(paint, reading=BlenderMaterial)), nothing
    ).relative_rms
    of_gltf = difference(paint, BlenderMaterial(nearest_gltf(paint)), nothing).relative_rms
    assert near < 0.03
    assert near < of_gltf


def test_without_blender_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.delenv(finding.VARIABLE, raising=False)
    monkeypatch.setattr(finding, "find_spec", lambda name: None)
    monkeypatch.setattr(finding.shutil, "which", lambda name: None)
    result = made(tmp_path / "cat")
    with pytest.raises(InputError, match=r"Blender is not there: pip install --no-deps"):
        export(result, "blend", lossy=True)
    assert [path.name for path in tmp_path.iterdir()] == ["cat"]
