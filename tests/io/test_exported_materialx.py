"""MaterialX documents, against MaterialX's own library.

- OpenPBR's numbers are those of ``open_pbr_surface``, glTF's those of ``gltf_pbr``: every input is
  one of the node's definition, and the document is valid.
- What OpenPBR's node cannot hold is said; without the library the remedy is.
"""

import builtins

import numpy as np
import pytest

from jaxrender.brdf import OpenPBR
from jaxrender.errors import InputError
from jaxrender.io.exports import GltfMaterial, openpbr_losses, write_materialx

COLOR, CLEAR = np.array([0.6, 0.3, 0.1]), np.ones(3)
COATED = OpenPBR(
    COLOR, CLEAR, 0.2, 0.4, 1.6, 0.9, coat_weight=0.5, multiple_scattering="facets"
)  # fmt: skip
GLAZED = GltfMaterial(COLOR, 0.0, 0.4, 1.8, 0.9, np.array([1, 0.8, 0.7]), 0.6, 0.2)

BRUSHED = GltfMaterial(COLOR, 1.0, 0.4, anisotropy_strength=0.7, anisotropy_rotation=0.4)


@pytest.mark.parametrize(
    ("material", "node", "expected"),
    [
        (COATED, "open_pbr_surface", {"specular_ior": 1.6, "coat_weight": 0.5}),
        (GLAZED, "gltf_pbr", {"ior": 1.8, "clearcoat": 0.6, "metallic": 0.0}),
        (BRUSHED, "gltf_pbr", {"anisotropy_strength": 0.7, "anisotropy_rotation": 0.4}),
    ],
    ids=["openpbr", "gltf", "brushed"],
)
def test_a_document_is_valid_and_has_our_numbers(tmp_path, material, node, expected):
    mx = pytest.importorskip("MaterialX")
    write_materialx(material, "../a <b>", tmp_path)
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(tmp_path / "material.mtlx"))
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document.setDataLibrary(library)
    assert document.validate() == (True, "")
    (shader,) = document.getNodes(node)
    known = {one.getName() for one in library.getNodeDef(f"ND_{node}_surfaceshader").getInputs()}
    assert {one.getName() for one in shader.getInputs()} <= known
    np.testing.assert_allclose(list(shader.getInputValue("base_color")), COLOR, rtol=1e-6)
    for name, value in expected.items():
        assert shader.getInputValue(name) == pytest.approx(value)
    assert document.getMaterialNodes()[0].getName() == "a_b"
    assert document.getColorSpace() == "lin_rec709"


def test_what_openpbr_loses_is_said():
    assert openpbr_losses(COATED) == ()
    dim = OpenPBR(COLOR, 0.5 * CLEAR, 0.2, 0.4, tangent_rotation=0.3)
    lost = " ".join(openpbr_losses(dim))
    assert "interface" in lost
    assert "tangent" in lost
    assert "facets" in lost


def test_without_the_library_the_remedy_is_said(tmp_path, monkeypatch):
    own = builtins.__import__

    def missing(name, *rest, **named):
        if name == "MaterialX":
            raise ImportError(name)
        return own(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match=r"pip install 'jaxrender\[materialx\]'"):
        write_materialx(GLAZED, "a", tmp_path)
    assert not list(tmp_path.iterdir())
