"""MaterialX, through its own library (extra ``materialx``).

OpenPBR's material becomes the node ``open_pbr_surface`` with its own numbers, all others
``gltf_pbr``.  Colours are linear, with the primaries of sRGB (``lin_rec709``).  The document is
validated before it is written.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.brdf import OpenPBR
from jaxrender.errors import InputError
from jaxrender.io.atomic import replacing
from jaxrender.io.exports.contents import Part, plain_name
from jaxrender.io.exports.gltf_material import GltfMaterial
from jaxrender.shapes import AnyArray

DOCUMENT = "material.mtlx"
_COLORSPACE = "lin_rec709"
# Numbers of OpenPBR that are shares of all colours alike here, and colours there.
_GREY = ("specular_color", "coat_color")
_OPENPBR = (
    "base_color",
    "base_metalness",
    "specular_roughness",
    "specular_ior",
    "specular_color",
    "specular_roughness_anisotropy",
    "coat_weight",
    "coat_color",
    "coat_roughness",
    "coat_ior",
    "fuzz_weight",
    "fuzz_roughness",
)
_GLTF = (
    "base_color",
    "metallic",
    "roughness",
    "ior",
    "specular",
    "specular_color",
    "clearcoat",
    "clearcoat_roughness",
    "anisotropy_strength",
    "anisotropy_rotation",
)


# A document of a material has no mesh, and so no tangents.
MERIDIAN = "the meridian that brushing follows: it follows the renderer's own tangents"


def openpbr_losses(material: OpenPBR) -> tuple[str, ...]:
    """Say what the node ``open_pbr_surface`` cannot hold of a material of OpenPBR."""
    lost = []
    if not np.allclose(np.asarray(material.interface), 1):
        lost.append("the brightness of the interface that the fit found: it is 1")
    if np.any(np.asarray(material.tangent_rotation)):
        lost.append("the rotation of the tangent: the renderer's own tangents are kept")
    elif not material.isotropic:
        lost.append(MERIDIAN)
    if material.multiple_scattering == "none":
        lost.append("that facets hand no light on to one another: renderers add it")
    return tuple(lost)


def write_materialx(material: OpenPBR | GltfMaterial, name: str, folder: Path) -> tuple[Part, ...]:
    """Write a document of one material.

    Raises ``InputError`` where the library is missing, and where it finds the document invalid.
    """
    mx = materialx_library()
    is_openpbr = isinstance(material, OpenPBR)
    node = "open_pbr_surface" if is_openpbr else "gltf_pbr"
    document = mx.createDocument()
    document.setColorSpace(_COLORSPACE)
    plain = plain_name(name)
    shader = document.addNode(node, f"{plain}_shader", "surfaceshader")
    for key, value in _inputs(material, _OPENPBR if is_openpbr else _GLTF).items():
        shader.setInputValue(key, mx.Color3(*value) if isinstance(value, list) else value)
    document.addMaterialNode(plain, shader)
    _validate(mx, document)
    with replacing(folder / DOCUMENT) as aside:
        aside.write_text(mx.writeToXmlString(document), encoding="utf-8")
    about = f"the material as MaterialX's node {node}; colours linear ({_COLORSPACE})"
    return (Part(DOCUMENT, about),)


def _inputs(
    material: OpenPBR | GltfMaterial, names: tuple[str, ...]
) -> Mapping[str, float | list[float]]:
    found: dict[str, float | list[float]] = {}
    for name in names:
        value: AnyArray = np.asarray(getattr(material, name), float)
        if value.ndim == 0 and name in _GREY:
            value = np.full(3, value)
        found[name] = float(value) if value.ndim == 0 else value.tolist()
    return found


def materialx_library() -> Any:
    """Import MaterialX; ``InputError`` says how to install it."""
    try:
        import MaterialX  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise InputError(
            "--to materialx: needs the package materialx: pip install 'jaxrender[materialx]'"
        ) from None
    return MaterialX


def _validate(mx: Any, document: Any) -> None:
    """Check a document against the definitions of the library's nodes."""
    definitions = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), definitions)
    document.setDataLibrary(definitions)
    valid, message = document.validate()
    if not valid:
        raise InputError(f"{DOCUMENT}: MaterialX finds the document invalid: {message}")
