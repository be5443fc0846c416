"""A scene of Blender: mesh, shader nodes, light and cameras, in one file with its pictures.

Axes, poses and lengths are the world's, which are Blender's own: z up, cameras look along -z.
Pictures are packed as EXR in floats: colours linear, roughness and metalness no colours at all.
The panorama has +x in the middle and +y left of it, as Blender's environment texture reads it.
Suns have our irradiance on a plane that faces them, points 4 pi times our intensity.

Light is followed to its first reflection, as our renderings do, by a box as wide as a pixel.
"""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from jaxrender.geometry import Camera, Mesh, Orthographic, Pinhole
from jaxrender.io.atomic import replacing
from jaxrender.io.exports.anisotropy import tangents
from jaxrender.io.exports.blender import run_in_blender
from jaxrender.io.exports.blender_surfaces import Shader, Surface
from jaxrender.io.exports.contents import Contents, Part, lamp_pose, mesh_of, plain_name
from jaxrender.io.exports.gltf import facing_panorama
from jaxrender.io.images import write_image
from jaxrender.lighting import DirectionalSources, PointSources
from jaxrender.shapes import Float

SCENE = "scene.blend"
_SCRIPT = Path(__file__).with_name("blender_scene.py")
_LINEAR, _NUMBERS = "Linear Rec.709", "Non-Color"
_SAMPLES = 256
_SENSOR = 36.0
_NEAR, _FAR = 1e-3, 1e5
# Two pixels are alike in shape if their sides are.
_SQUARE = 1e-3
_SIZE = (512, 512)


def blend_losses(contents: Contents) -> tuple[str, ...]:
    """Say what a scene of Blender cannot hold of cameras."""
    lost, cameras = [], [one.camera for one in contents.cameras]
    if any(isinstance(one, Pinhole) and one.lens is not None for one in cameras):
        lost.append("the distortion of lenses: Blender's cameras are undistorted")
    if len({(one.width, one.height) for one in cameras}) > 1:
        lost.append("the sizes of all photographs but the first: a scene of Blender has one size")
    aspects = [_aspect(one) for one in cameras]
    if any(abs(one / aspects[0] - 1) > _SQUARE for one in aspects):
        lost.append("the shape of other pixels than the first camera's: a scene has one")
    return tuple(lost)


def write_blend(contents: Contents, folder: Path, surface: Surface) -> tuple[Part, ...]:
    """Write ``scene.blend``, by Blender in a process of its own.

    Raises ``ValueError`` for contents without a shape, ``InputError`` where Blender is missing.
    """
    if contents.shape is None:
        raise ValueError("a scene of Blender needs a shape")
    mesh, name = mesh_of(contents.shape, surface.is_textured), plain_name(contents.name)
    with TemporaryDirectory(prefix="jaxrender-") as made, replacing(folder / SCENE) as aside:
        place = Path(made)
        _write_mesh(place, mesh, surface.turn)
        environment = None
        if contents.environment is not None:
            panorama = facing_panorama(contents.environment)
            environment = _picture(place, "environment", panorama)
        told = {
            "name": name,
            "shaders": [_shader(place, *pair) for pair in zip(surface.shaders, range(9))],
            "has_tangents": surface.turn is not None,
            "environment": environment,
            "lights": [*_suns(contents.sources), *_points(contents.points)],
            "cameras": [
                _camera(plain_name(frame.name), frame.camera) for frame in contents.cameras
            ],
            "render": _render([frame.camera for frame in contents.cameras]),
        }
        (place / "scene.json").write_text(json.dumps(told, allow_nan=False), encoding="utf-8")
        run_in_blender(_SCRIPT, (place, aside))
    about = "mesh, shader nodes, light and cameras for Blender 5.0 and later, pictures inside"
    return (Part(SCENE, about),)


def _write_mesh(place: Path, mesh: Mesh, turn: float | None) -> None:
    """Write the arrays of a mesh; tangents are those of a brushed surface."""
    arrays: dict[str, Any] = {
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        "normals": mesh.normals,
    }
    if mesh.texture_coordinates is not None:
        arrays["coordinates"] = mesh.texture_coordinates.reshape(-1, 2)
    if turn is not None:
        arrays["tangents"] = tangents(mesh.normals, turn)
    np.savez(place / "mesh.npz", **arrays)


def _shader(place: Path, shader: Shader, number: int) -> dict[str, Any]:
    """Describe a shader, and write its pictures."""
    pictures = {}
    for socket, values in shader.pictures.items():
        name = socket.lower().replace(" ", "_")
        if socket == "Normal":
            # As colours: 0 to 1 stands for -1 to 1.
            pictures[socket] = _picture(place, name, (values + 1) / 2) | {"space": _NUMBERS}
        else:
            # A diffuse base and a lobe may both have colours.
            pictures[socket] = _picture(place, f"{name}_{number}", values)
    return shader._asdict() | {"pictures": pictures}


def _picture(
    place: Path, name: str, values: Float[np.ndarray, "row column *channel"]
) -> dict[str, str]:
    """Write a picture as EXR: of linear colours, or of numbers that are none."""
    is_colour = values.ndim == 3
    file = f"{name}.exr"
    write_image(place / file, values if is_colour else np.repeat(values[..., None], 3, axis=-1))
    return {"file": file, "space": _LINEAR if is_colour else _NUMBERS}


def _suns(sources: DirectionalSources) -> list[dict[str, Any]]:
    """Describe distant sources: they shine along -z of their own axes."""
    found = []
    for direction, irradiance in zip(*(np.asarray(part, float) for part in sources.nodes())):
        if np.any(irradiance > 0):
            emitted = _emitted(irradiance)
            pose = lamp_pose(direction).tolist()
            found.append({"name": f"source_{len(found)}", "type": "SUN", "pose": pose, **emitted})
    return found


def _points(points: PointSources | None) -> list[dict[str, Any]]:
    """Describe sources that have a place, by the watts that Blender wants."""
    found = []
    if points is None:
        return found
    pairs = zip(np.asarray(points.positions, float), np.asarray(points.intensity, float))
    for place, intensity in pairs:
        if np.any(intensity > 0):
            pose = np.eye(4)
            pose[:3, 3] = place
            emitted = _emitted(4 * np.pi * intensity)
            name = f"point_{len(found)}"
            found.append({"name": name, "type": "POINT", "pose": pose.tolist(), **emitted})
    return found


def _emitted(values: Float[np.ndarray, "3"]) -> dict[str, Any]:
    strength = float(np.max(values))
    return {"energy": strength, "color": [float(x) for x in np.clip(values / strength, 0, 1)]}


def _camera(name: str, camera: Camera) -> dict[str, Any]:
    """Describe a camera; shifts are in widths of the picture."""
    width, height = camera.width, camera.height
    found: dict[str, Any] = {
        "name": name, "pose": camera.world_from_camera.tolist(), "size": [width, height],
        "clip": [_NEAR, _FAR],
    }  # fmt: skip
    if isinstance(camera, Pinhole):
        found |= {"type": "PERSP", "sensor_width": _SENSOR}
        found["lens"] = camera.fl_x / width * _SENSOR
    else:
        assert isinstance(camera, Orthographic)
        found |= {"type": "ORTHO", "ortho_scale": width * camera.scale}
    found["shift_x"] = (width / 2 - camera.cx) / width
    found["shift_y"] = (camera.cy - height / 2) / width * _aspect(camera)
    return found


def _render(cameras: list[Camera]) -> dict[str, Any]:
    """Set the picture up as the first camera has it."""
    size = (cameras[0].width, cameras[0].height) if cameras else _SIZE
    tall = _aspect(cameras[0]) if cameras else 1.0
    return {
        "size": size, "aspect": [max(1 / tall, 1.0), max(tall, 1.0)],
        "samples": _SAMPLES, "bounces": 0,
    }  # fmt: skip


def _aspect(camera: Camera) -> float:
    """Find how many times as high as wide a pixel is."""
    return camera.fl_x / camera.fl_y if isinstance(camera, Pinhole) else 1.0
