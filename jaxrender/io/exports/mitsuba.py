"""A scene of Mitsuba 3: material, shape, light and cameras, as XML and as a dictionary in JSON.

Axes and units are the world's: nothing is turned but the panorama, whose ``to_world`` says that z
is up.  Mitsuba's panoramas have their first and last rows *at* the poles, so the picture has
2 H + 1 rows for our H: every other one is ours, those between are what it interpolates itself.
Its azimuth runs the other way round, so columns are mirrored.

A directional source has the irradiance on a plane that faces it, and ``direction`` is where its
light goes.  Light is followed to its first reflection, as our renderings do (``max_depth`` 2).
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from jaxrender.brdf import AnisotropicGGX
from jaxrender.geometry import Camera, Mesh, Orthographic, Pinhole, Sphere
from jaxrender.io.atomic import replacing
from jaxrender.io.exports.anisotropy import brushed_mesh, brushed_plugin
from jaxrender.io.exports.contents import Contents, MetallicMaps, Part, mesh_of, plain_name
from jaxrender.io.exports.mitsuba_materials import mitsuba_material, rgb
from jaxrender.io.exports.mitsuba_metal import metallic_plugin
from jaxrender.io.exports.mitsuba_textures import textured_plugin, write_textured_mesh
from jaxrender.io.images import write_image
from jaxrender.io.meshes import write_mesh
from jaxrender.lighting import Environment
from jaxrender.shapes import Float

SCENE_XML, SCENE_JSON, SCENE_PY = "scene.xml", "scene.json", "scene.py"
LIGHT, OBJECT = "light.exr", "object.ply"
_VERSION = "3.0.0"
_SAMPLES = 256
# x left, y up, z ahead: columns of our poses times these.
_SENSOR_AXES = np.array([-1.0, 1.0, -1.0])
# World from the panorama's own axes, whose y is up; our azimuth 0 is its -z.
_WORLD_FROM_PANORAMA = np.array([[0.0, 0, -1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
# Mitsuba's pixels are square: a pixel may be so much longer than wide.
_SQUARE = 1e-3
_LOADER = '''\
"""Load this folder's scene into Mitsuba 3: `python scene.py` renders every camera as EXR."""

import json
import sys
from pathlib import Path

import mitsuba as mi

HERE = Path(__file__).resolve().parent


def scene(path=HERE / "scene.json"):
    """Read the dictionary, with its matrices and paths as Mitsuba wants them."""

    def ready(found):
        if "to_world" in found:
            found["to_world"] = mi.ScalarTransform4f(found["to_world"])
        if "filename" in found:
            found["filename"] = str(HERE / found["filename"])
        return found

    return json.loads(Path(path).read_text(encoding="utf-8"), object_hook=ready)


if __name__ == "__main__":
    mi.set_variant(sys.argv[1] if len(sys.argv) > 1 else "scalar_rgb")
    loaded = mi.load_dict(scene())
    for number, sensor in enumerate(loaded.sensors()):
        mi.Bitmap(mi.render(loaded, sensor=sensor)).write(str(HERE / f"{number}.exr"))
'''


def mitsuba_losses(contents: Contents) -> tuple[str, ...]:
    """Say what a scene of Mitsuba cannot hold of the contents."""
    lost = []
    pinholes = [one.camera for one in contents.cameras if isinstance(one.camera, Pinhole)]
    if any(one.lens is not None for one in pinholes):
        lost.append("the distortion of lenses: Mitsuba's cameras are undistorted")
    if any(abs(one.fl_y / one.fl_x - 1) > _SQUARE for one in pinholes):
        lost.append("pixels that are not square: fl_x serves both axes")
    material = contents.material
    if material is not None and not (material.isotropic or isinstance(material, AnisotropicGGX)):
        lost.append("the direction of brushed or fibrous surfaces: its mean over turns is kept")
    return tuple(lost)


def write_mitsuba(contents: Contents, folder: Path) -> tuple[Part, ...]:
    """Write the scene into a folder; isotropic materials, ``AnisotropicGGX`` and textures can be.

    Raises ``ValueError`` where there is no material, no shape or no light.
    """
    has_material = contents.material is not None or contents.maps is not None
    if not has_material or contents.shape is None or not contents.is_lit:
        raise ValueError("a scene of Mitsuba needs a material, a shape and a light")
    shape, parts = _object(contents, folder)
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
        "object": shape,
    }
    if contents.environment is not None:
        write_image(folder / LIGHT, mitsuba_panorama(contents.environment))
        scene["environment"] = {
            "type": "envmap", "filename": LIGHT, "to_world": _WORLD_FROM_PANORAMA.tolist(),
        }  # fmt: skip
        about = "radiance around the object, linear RGB, y up, for Mitsuba's `envmap` alone"
        parts.append(Part(LIGHT, about))
    for number, (direction, irradiance) in enumerate(
        zip(*(np.asarray(part, float) for part in contents.sources.nodes()))
    ):
        if np.any(irradiance > 0):
            scene[f"source_{number}"] = {
                "type": "directional",
                "direction": [float(-x) for x in direction],
                "irradiance": rgb(np.maximum(irradiance, 0)),
            }
    points = contents.points
    if points is not None:
        places = zip(*(np.asarray(p, float) for p in (points.positions, points.intensity)))
        for number, (place, intensity) in enumerate(places):
            scene[f"point_{number}"] = {
                "type": "point",
                "position": [float(x) for x in place],
                "intensity": rgb(intensity),
            }
    for number, frame in enumerate(contents.cameras):
        scene[f"camera_{number}_{plain_name(frame.name)}"] = _sensor(frame.camera)
    _write_text(folder / SCENE_JSON, json.dumps(scene, indent=1, allow_nan=False) + "\n")
    _write_text(folder / SCENE_XML, _xml(scene))
    _write_text(folder / SCENE_PY, _LOADER)
    return (
        Part(SCENE_XML, "the scene for Mitsuba 3: material, shape, light, every camera"),
        Part(SCENE_JSON, "the same as a dictionary; a `to_world` is the rows of a matrix"),
        Part(SCENE_PY, "reads scene.json for `mitsuba.load_dict`, and renders it"),
        *parts,
    )


def mitsuba_panorama(environment: Environment) -> Float[np.ndarray, "row column channel"]:
    """Lay an environment out as Mitsuba's ``envmap`` has it, with the same linear interpolation."""
    ours = np.asarray(environment.radiance, float)[:, ::-1]
    rows = np.empty((2 * len(ours) + 1, *ours.shape[1:]))
    rows[1::2] = ours
    rows[2:-1:2] = (ours[1:] + ours[:-1]) / 2
    # At a pole all azimuths are one direction.
    rows[0], rows[-1] = ours[0].mean(axis=0), ours[-1].mean(axis=0)
    return rows


def _object(contents: Contents, folder: Path) -> tuple[dict[str, Any], list[Part]]:
    """Write the shape with its material or texture, and what they read."""
    shape, maps = contents.shape, contents.maps
    assert shape is not None
    if isinstance(contents.material, AnisotropicGGX):
        brushed = brushed_mesh(mesh_of(shape), float(contents.material.tangent_rotation))
        u, v = brushed.coordinates.T
        write_mesh(folder / OBJECT, brushed.mesh, {"s": u, "t": v})
        plugin, parts = _held(brushed_plugin(contents.material), folder)
        about = "the mesh with its normals; u runs along the tangents of the brushed surface"
        return {"type": "ply", "filename": OBJECT, "bsdf": plugin}, [*parts, Part(OBJECT, about)]
    if maps is None:
        assert contents.material is not None
        made = mitsuba_material(contents.material, folder)
        if not isinstance(shape, Sphere):
            write_mesh(folder / OBJECT, mesh_of(shape))
    else:
        if isinstance(maps, MetallicMaps):
            made = metallic_plugin(maps, folder)
        else:
            made = textured_plugin(maps, shape, folder)
        if not isinstance(shape, Sphere):
            write_textured_mesh(folder / OBJECT, shape, maps, made.columns)
    if isinstance(shape, Sphere):
        center = [float(x) for x in shape.center]
        found = {"type": "sphere", "center": center, "radius": float(shape.radius)}
    else:
        found = {"type": "ply", "filename": OBJECT}
    parts = [*made.parts]
    if isinstance(shape, Mesh):
        parts.append(Part(OBJECT, "the mesh with its normals, in the world's axes and units"))
    return found | {"bsdf": made.plugin}, parts


def _held(plugin: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Part]]:
    """Write arrays as colours, or as bitmaps where they are above one, which colours may not be."""
    found, parts = {}, []
    for name, value in plugin.items():
        if isinstance(value, np.ndarray) and np.all(value <= 1):
            found[name] = rgb(value)
        elif isinstance(value, np.ndarray):
            file = f"{name}.exr"
            write_image(folder / file, value.reshape(1, 1, 3))
            parts.append(Part(file, f"{name}, the same everywhere; linear RGB"))
            found[name] = {"type": "bitmap", "filename": file, "raw": True}
        elif isinstance(value, dict):
            found[name], own = _held(value, folder)
            parts += own
        else:
            found[name] = value
    return found, parts


def _sensor(camera: Camera) -> dict[str, Any]:
    pose = np.array(camera.world_from_camera, float)
    pose[:3, :3] *= _SENSOR_AXES
    found: dict[str, Any] = {"near_clip": 1e-3, "far_clip": 1e5}
    if isinstance(camera, Pinhole):
        found["type"], found["fov_axis"] = "perspective", "x"
        found["fov"] = math.degrees(2 * math.atan(camera.width / 2 / camera.fl_x))
        found["principal_point_offset_x"] = 0.5 - camera.cx / camera.width
        found["principal_point_offset_y"] = 0.5 - camera.cy / camera.height
    else:
        assert isinstance(camera, Orthographic)
        found["type"] = "orthographic"
        # The picture is two units wide, about the principal point.
        along, down = camera.cx - camera.width / 2, camera.cy - camera.height / 2
        pose[:3, 3] -= camera.scale * (camera.world_from_camera[:3, :3] @ [along, -down, 0])
        pose[:3, :3] *= camera.scale * camera.width / 2
    found["to_world"] = pose.tolist()
    found["film"] = {
        "type": "hdrfilm", "width": camera.width, "height": camera.height,
        "pixel_format": "rgb", "component_format": "float32", "rfilter": {"type": "box"},
    }  # fmt: skip
    found["sampler"] = {"type": "independent", "sample_count": _SAMPLES}
    return found


# The elements of plugins by their key, and of objects within plugins.
_TAGS = {"integrator": "integrator", "object": "shape", "environment": "emitter", "bsdf": "bsdf"}
_TAGS |= {"film": "film", "sampler": "sampler", "rfilter": "rfilter"}
_TAGS |= dict.fromkeys(("reflectance", "specular_reflectance", "weight", "normalmap"), "texture")
_TAGS |= dict.fromkeys(("base_color", "roughness"), "texture")
_TAGS_BY_START = {"source": "emitter", "point": "emitter", "camera": "sensor", "bsdf": "bsdf"}


def _xml(scene: Mapping[str, Any]) -> str:
    root = ElementTree.Element("scene", version=_VERSION)
    for name, value in scene.items():
        if name != "type":
            _add(root, name, value)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _add(parent: ElementTree.Element, name: str, value: Any) -> None:
    """Add one value of a dictionary as Mitsuba's XML has it."""
    if isinstance(value, dict) and value["type"] == "rgb":
        ElementTree.SubElement(parent, "rgb", name=name, value=_numbers(value["value"]))
    elif isinstance(value, dict):
        tag = _TAGS.get(name) or _TAGS_BY_START[name.partition("_")[0]]
        element = ElementTree.SubElement(parent, tag, type=value["type"])
        if tag == "sensor":
            element.set("id", name)
        elif tag == "texture":
            element.set("name", name)
        for key, inner in value.items():
            if key != "type":
                _add(element, key, inner)
    elif name == "to_world":
        transform = ElementTree.SubElement(parent, "transform", name=name)
        ElementTree.SubElement(transform, "matrix", value=_numbers(np.ravel(value).tolist()))
    elif isinstance(value, list):
        tag = "point" if name in ("center", "position") else "vector"
        x, y, z = map(repr, value)
        ElementTree.SubElement(parent, tag, name=name, x=x, y=y, z=z)
    else:
        tags: dict[type, str] = {bool: "boolean", int: "integer", float: "float", str: "string"}
        text = str(value).lower() if isinstance(value, bool) else str(value)
        ElementTree.SubElement(parent, tags[type(value)], name=name, value=text)


def _numbers(values: list[float]) -> str:
    return " ".join(map(repr, values))


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as aside:
        aside.write_text(text, encoding="utf-8")
