"""glTF 2.0 and GLB: a mesh with its material, cameras and sources.

Axes are glTF's: y up, so that (x, y, z) of the world is (x, z, -y) of the file.  Lengths stay.
Base and specular colours are linear as factors and sRGB as textures; roughness is linear always,
in the green channel.  Texture coordinates have v downwards.  Sources are ``KHR_lights_punctual``,
whose lux are our units of irradiance.  The environment has no place in glTF: it lies beside it.
"""

import base64
import io
import json
import math
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image as PillowImage

from jaxrender.geometry import Mesh, Pinhole
from jaxrender.io.atomic import replacing
from jaxrender.io.exports.anisotropy import tangents
from jaxrender.io.exports.contents import Contents, Part, mesh_of, plain_name
from jaxrender.io.exports.gltf_material import GltfMaterial
from jaxrender.io.images import write_image
from jaxrender.lighting import DirectionalSources, Environment, PointSources
from jaxrender.shapes import AnyArray, Float

ENVIRONMENT = "environment.exr"
_ABOUT_ENVIRONMENT = (
    "radiance around the object, linear RGB, latitude-longitude with z up, +x in the middle and +y "
    "to the left of it, as Blender's environment texture and three.js have it"
)
_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_FLOAT, _UNSIGNED = 5126, 5125
_ARRAYS, _ELEMENTS = 34962, 34963
_REPEAT, _LINEAR, _MIPMAPS = 10497, 9729, 9987
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_KHR = "KHR_materials_"


class GltfTextures(NamedTuple):
    """Maps over the texture's square, row 0 at v = 1: linear colours, roughness and metalness.

    A share of metal goes with a roughness; without one the material's factor holds everywhere.
    """

    base_color: Float[np.ndarray, "row column 3"]
    specular_color: Float[np.ndarray, "row column 3"] | None = None
    roughness: Float[np.ndarray, "row column"] | None = None
    metallic: Float[np.ndarray, "row column"] | None = None


def srgb(linear: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Encode linear values from 0 to 1 as sRGB (IEC 61966-2-1)."""
    inside = np.clip(linear, 0, 1)
    return np.where(inside <= 0.0031308, 12.92 * inside, 1.055 * inside ** (1 / 2.4) - 0.055)


def gltf_losses(contents: Contents) -> tuple[str, ...]:
    """Say what glTF cannot hold of shape, cameras and light."""
    lost, cameras = [], [one.camera for one in contents.cameras]
    if any(not isinstance(one, Pinhole) for one in cameras):
        lost.append("orthographic cameras: they are left out")
    if any(isinstance(one, Pinhole) and one.lens is not None for one in cameras):
        lost.append("the distortion of lenses: glTF's cameras are undistorted")
    return tuple(lost)


def write_gltf(
    contents: Contents,
    folder: Path,
    material: GltfMaterial,
    textures: GltfTextures | None = None,
    *,
    binary: bool,
) -> tuple[Part, ...]:
    """Write ``scene.glb``, or ``scene.gltf`` with all of it inside, and the environment.

    Raises ``ValueError`` for contents without a shape.
    """
    if contents.shape is None:
        raise ValueError("a glTF scene needs a shape")
    writer = _Writer()
    mesh = mesh_of(contents.shape, textured=textures is not None)
    document = writer.document(contents, mesh, material, textures)
    name = "scene.glb" if binary else "scene.gltf"
    with replacing(folder / name) as aside:
        if binary:
            aside.write_bytes(_glb(document, bytes(writer.data)))
        else:
            uri = base64.b64encode(bytes(writer.data)).decode()
            document["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{uri}"
            text = json.dumps(document, indent=1, allow_nan=False)
            aside.write_text(text + "\n", encoding="utf-8")
    about = "mesh, material, cameras and sources in glTF 2.0; y is up (world z)"
    parts = [Part(name, about)]
    if contents.environment is not None:
        write_image(folder / ENVIRONMENT, facing_panorama(contents.environment))
        parts.append(Part(ENVIRONMENT, _ABOUT_ENVIRONMENT))
    return tuple(parts)


def facing_panorama(environment: Environment) -> Float[np.ndarray, "row column channel"]:
    """Lay an environment out as who looks along +x within it sees it: azimuth runs to the left."""
    mirrored = np.asarray(environment.radiance)[:, ::-1]
    return np.roll(mirrored, mirrored.shape[1] // 2, axis=1)


class _Writer:
    """The binary data of a file, and the tables that say what lies where in it."""

    def __init__(self):
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.images: list[dict[str, Any]] = []

    def document(
        self,
        contents: Contents,
        mesh: Mesh,
        material: GltfMaterial,
        textures: GltfTextures | None,
    ) -> dict[str, Any]:
        """Lay the whole scene out."""
        turn = float(material.anisotropy_rotation) if float(material.anisotropy_strength) else None
        primitive = self._primitive(mesh, turn)
        name = plain_name(contents.name)
        described = self._material(material, textures) | {"name": name}
        nodes: list[dict[str, Any]] = [{"name": name, "mesh": 0}]
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "jaxrender"},
            "scene": 0,
            "meshes": [{"name": name, "primitives": [primitive]}],
            "materials": [described],
        }
        cameras = _cameras(contents, nodes)
        if cameras:
            document["cameras"] = cameras
        lights = _sources(contents.sources, nodes)
        if contents.points is not None:
            _add_points(contents.points, nodes, lights)
        used = sorted(described.get("extensions", {}))
        if lights:
            document["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
            used = sorted([*used, "KHR_lights_punctual"])
        if used:
            document["extensionsUsed"] = used
        if self.images:
            document["images"] = self.images
            document["samplers"] = [
                {"magFilter": _LINEAR, "minFilter": _MIPMAPS, "wrapS": _REPEAT, "wrapT": _REPEAT}
            ]
            document["textures"] = [
                {"sampler": 0, "source": source} for source in range(len(self.images))
            ]
        return document | {
            "nodes": nodes,
            "scenes": [{"nodes": list(range(len(nodes)))}],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
        }

    def _primitive(self, mesh: Mesh, turn: float | None) -> dict[str, Any]:
        """Write the triangles; corners with different texture coordinates are split.

        Tangents are those of a brushed surface, whose meridians are turned.
        """
        vertex, faces, coordinates = np.arange(len(mesh.vertices)), mesh.faces, None
        if mesh.texture_coordinates is not None:
            corners = np.column_stack([faces.ravel(), mesh.texture_coordinates.reshape(-1, 2)])
            written, index = np.unique(corners, axis=0, return_inverse=True)
            vertex, faces = written[:, 0].astype(int), index.reshape(-1, 3)
            coordinates = written[:, 1:]
        normals = mesh.normals[vertex] @ _FROM_WORLD.T
        # A vertex of no face has no normal, and glTF wants one.
        normals[~np.any(normals, axis=1)] = [0, 1, 0]
        attributes = {
            "POSITION": self._array(mesh.vertices[vertex] @ _FROM_WORLD.T, bounded=True),
            "NORMAL": self._array(normals),
        }
        if turn is not None:
            along = tangents(normals @ _FROM_WORLD, turn) @ _FROM_WORLD.T
            attributes["TANGENT"] = self._array(np.column_stack([along, np.ones(len(along))]))
        if coordinates is not None:
            flipped = coordinates * [1, -1] + [0, 1]
            attributes["TEXCOORD_0"] = self._array(flipped)
        return {"attributes": attributes, "indices": self._indices(faces), "material": 0}

    def _array(self, rows: np.ndarray, bounded: bool = False) -> int:
        values = np.ascontiguousarray(rows, "<f4")
        kind = {2: "VEC2", 3: "VEC3", 4: "VEC4"}[values.shape[1]]
        accessor: dict[str, Any] = {
            "bufferView": self._view(values.tobytes(), _ARRAYS),
            "componentType": _FLOAT, "count": len(values), "type": kind,
        }  # fmt: skip
        if bounded:
            accessor["min"], accessor["max"] = (
                [float(x) for x in bound] for bound in (values.min(axis=0), values.max(axis=0))
            )
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def _indices(self, faces: np.ndarray) -> int:
        values = np.ascontiguousarray(faces.ravel(), "<u4")
        self.accessors.append({
            "bufferView": self._view(values.tobytes(), _ELEMENTS),
            "componentType": _UNSIGNED, "count": len(values), "type": "SCALAR",
        })  # fmt: skip
        return len(self.accessors) - 1

    def _view(self, data: bytes, target: int | None = None) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view if target is None else view | {"target": target})
        self.data += data
        return len(self.views) - 1

    def _picture(self, values: Float[np.ndarray, "row column 3"]) -> dict[str, int]:
        """Write encoded values from 0 to 1 as a picture, and refer to it as a texture."""
        stored = io.BytesIO()
        whole = np.round(255 * np.clip(values, 0, 1)).astype(np.uint8)
        PillowImage.fromarray(whole).save(stored, "PNG")
        self.images.append({"bufferView": self._view(stored.getvalue()), "mimeType": "image/png"})
        return {"index": len(self.images) - 1}

    def _material(self, material: GltfMaterial, textures: GltfTextures | None) -> dict[str, Any]:
        base: dict[str, Any] = {
            "baseColorFactor": [*_factor(material.base_color), 1.0],
            "metallicFactor": float(material.metallic),
            "roughnessFactor": float(material.roughness),
        }
        specular: dict[str, Any] = {
            "specularFactor": float(material.specular),
            "specularColorFactor": _factor(material.specular_color, None),
        }
        plain = specular == {"specularFactor": 1.0, "specularColorFactor": [1.0, 1.0, 1.0]}
        if textures is not None:
            base["baseColorFactor"] = [1.0, 1.0, 1.0, 1.0]
            base["baseColorTexture"] = self._picture(srgb(textures.base_color))
            if textures.roughness is not None:
                base["roughnessFactor"] = 1.0
                rough = np.zeros((*textures.roughness.shape, 3))
                rough[..., 1], rough[..., 2] = textures.roughness, 1.0
                if textures.metallic is not None:
                    base["metallicFactor"] = 1.0
                    rough[..., 2] = textures.metallic
                base["metallicRoughnessTexture"] = self._picture(rough)
            if textures.specular_color is not None:
                plain = False
                specular["specularColorFactor"] = [1.0, 1.0, 1.0]
                specular["specularColorTexture"] = self._picture(srgb(textures.specular_color))
        extensions: dict[str, Any] = {}
        if material.ior != 1.5:
            extensions[f"{_KHR}ior"] = {"ior": float(material.ior)}
        if not plain:
            extensions[f"{_KHR}specular"] = specular
        if material.clearcoat:
            extensions[f"{_KHR}clearcoat"] = {
                "clearcoatFactor": float(material.clearcoat),
                "clearcoatRoughnessFactor": float(material.clearcoat_roughness),
            }
        if material.anisotropy_strength:
            strength = {"anisotropyStrength": float(material.anisotropy_strength)}
            extensions[f"{_KHR}anisotropy"] = strength
        found: dict[str, Any] = {"pbrMetallicRoughness": base}
        return found | ({"extensions": extensions} if extensions else {})


def _factor(values: Float[AnyArray, "3"], most: float | None = 1.0) -> list[float]:
    return [float(x) for x in np.clip(np.asarray(values, float), 0, most)]


def _cameras(contents: Contents, nodes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Add the perspective cameras to the nodes; their axes are ours."""
    found: list[dict[str, Any]] = []
    for frame in contents.cameras:
        camera = frame.camera
        if not isinstance(camera, Pinhole):
            continue
        name = plain_name(frame.name)
        pose = np.eye(4)
        pose[:3] = _FROM_WORLD @ camera.world_from_camera[:3]
        nodes.append({"name": name, "camera": len(found), "matrix": pose.T.ravel().tolist()})
        angle = 2 * math.atan(camera.height / 2 / camera.fl_y)
        aspect = camera.width * camera.fl_y / (camera.height * camera.fl_x)
        perspective = {"yfov": angle, "aspectRatio": aspect, "znear": 0.01}
        found.append({"name": name, "type": "perspective", "perspective": perspective})
    return found


def _sources(sources: DirectionalSources, nodes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Add distant sources to the nodes: they shine along -z of their own axes."""
    found: list[dict[str, Any]] = []
    for direction, irradiance in zip(*(np.asarray(part, float) for part in sources.nodes())):
        strength = float(irradiance.max())
        if not strength > 0:
            continue
        back = _FROM_WORLD @ direction
        aside = np.cross([0.0, 1.0, 0.0] if abs(back[1]) < 0.9 else [1.0, 0.0, 0.0], back)
        aside /= np.linalg.norm(aside)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([aside, np.cross(back, aside), back], axis=-1)
        reference = {"KHR_lights_punctual": {"light": len(found)}}
        matrix = pose.T.ravel().tolist()
        name = f"source_{len(found)}"
        nodes.append({"name": name, "matrix": matrix, "extensions": reference})
        color = [float(x) for x in np.clip(irradiance / strength, 0, 1)]
        light = {"name": name, "type": "directional", "intensity": strength, "color": color}
        found.append(light)
    return found


def _add_points(
    points: PointSources, nodes: list[dict[str, Any]], lights: list[dict[str, Any]]
) -> None:
    """Add sources that have a place."""
    pairs = zip(np.asarray(points.positions, float), np.asarray(points.intensity, float))
    for place, intensity in pairs:
        strength = float(intensity.max())
        if not strength > 0:
            continue
        reference = {"KHR_lights_punctual": {"light": len(lights)}}
        name = f"source_{len(lights)}"
        place = (_FROM_WORLD @ place).tolist()
        nodes.append({"name": name, "translation": place, "extensions": reference})
        color = [float(x) for x in intensity / strength]
        lights.append({"name": name, "type": "point", "intensity": strength, "color": color})


def _glb(document: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), _JSON) + text
    chunks += struct.pack("<II", len(data), _BINARY) + data
    return struct.pack("<III", _MAGIC, 2, 12 + len(chunks)) + chunks
