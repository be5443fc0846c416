"""The script that Blender runs: a scene told in numbers becomes a ``.blend``.

It imports Blender's ``bpy`` and NumPy alone, since Blender's own Python has nothing else.  What the
numbers are is decided in ``blend``.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

# Where nodes stand, in Blender's units: columns from the left.
_COLUMNS = (-700, -300, 100, 300, 500)
_SPACING = 300
# Cycles keeps the name "tangent" for its own.
_TANGENTS = "brushed_along"


def build(folder: Path, out: Path) -> None:
    """Read ``scene.json``, ``mesh.npz`` and pictures from a folder, and save the scene."""
    import bpy  # pyright: ignore[reportMissingImports]

    told = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _settings(scene, told["render"])
    thing = _object(folder, told["name"])
    thing.materials.append(_material(folder, told))
    _placed(scene, told["name"], thing, np.eye(4))
    scene.world = _world(folder, told["environment"])
    for light in told["lights"]:
        _light(scene, light)
    for camera in told["cameras"]:
        _camera(scene, camera)
    bpy.ops.wm.save_as_mainfile(filepath=str(out), compress=True)


def _settings(scene: Any, told: dict[str, Any]) -> None:
    scene.render.engine = "CYCLES"
    scene.cycles.samples = told["samples"]
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.max_bounces = told["bounces"]
    scene.render.film_transparent = True
    scene.render.resolution_x, scene.render.resolution_y = told["size"]
    scene.render.resolution_percentage = 100
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = told["aspect"]
    scene.render.filepath = "//picture.exr"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.image_settings.color_depth = "32"
    scene.view_settings.view_transform = "Standard"


def _placed(scene: Any, name: str, data: Any, pose: Any) -> None:
    """Put data into the scene; a pose is the rows of a matrix from its axes to the world's."""
    import bpy  # pyright: ignore[reportMissingImports]

    found = bpy.data.objects.new(name, data)
    scene.collection.objects.link(found)
    found.matrix_world = np.asarray(pose).T
    if data.bl_rna.identifier == "Camera" and scene.camera is None:
        scene.camera = found


def _object(folder: Path, name: str) -> Any:
    """Make the mesh: triangles, normals of vertices, texture coordinates, tangents."""
    import bpy  # pyright: ignore[reportMissingImports]

    with np.load(folder / "mesh.npz", allow_pickle=False) as stored:
        arrays = dict(stored)
    faces = arrays["faces"]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(arrays["vertices"], [], faces)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    if "coordinates" in arrays:
        layer = mesh.uv_layers.new(name="texture")
        layer.uv.foreach_set("vector", arrays["coordinates"].astype(np.float32).ravel())
    if "tangents" in arrays:
        along = mesh.attributes.new(_TANGENTS, "FLOAT_VECTOR", "POINT")
        along.data.foreach_set("vector", arrays["tangents"].astype(np.float32).ravel())
    mesh.normals_split_custom_set_from_vertices(arrays["normals"])
    return mesh


def _material(folder: Path, told: dict[str, Any]) -> Any:
    """Make the sum of shaders, whose values are named as their sockets are."""
    import bpy  # pyright: ignore[reportMissingImports]

    material = bpy.data.materials.new(told["name"])
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = _node(tree, "ShaderNodeOutputMaterial", 4)
    along = _tangents(tree) if told["has_tangents"] else None
    whole = None
    for row, shader in enumerate(told["shaders"]):
        made = _shader(folder, tree, shader, row)
        if along is not None and "Tangent" in made.inputs:
            tree.links.new(along, made.inputs["Tangent"])
        share = shader["pictures"].get("Weight")
        if share is not None:
            share = _texture(folder, tree, share, 3).outputs["Color"]
        made = _taken(tree, made.outputs["BSDF"], shader["weight"], share, row)
        whole = made if whole is None else _sum(tree, whole, made)
    tree.links.new(whole, output.inputs["Surface"])
    return material


def _shader(folder: Path, tree: Any, told: dict[str, Any], row: int) -> Any:
    """Make a shader with its numbers, pictures and Fresnel's factor."""
    found = _node(tree, told["node"], 1, row)
    if told["distribution"] is not None:
        found.distribution = told["distribution"]
    for name, value in told["inputs"].items():
        found.inputs[name].default_value = value
    colour = None
    for number, (name, picture) in enumerate(told["pictures"].items()):
        if name == "Weight":
            continue
        value = _texture(folder, tree, picture, number).outputs["Color"]
        if name == "Normal":
            turned = _node(tree, "ShaderNodeNormalMap", 0, number)
            turned.space = "OBJECT"
            tree.links.new(value, turned.inputs["Color"])
            value = turned.outputs["Normal"]
        colour = value if name == "Color" else colour
        tree.links.new(value, found.inputs[name])
    if told["fresnel"] is not None:
        share = _node(tree, "ShaderNodeFresnel", 0, row)
        share.inputs["IOR"].default_value = told["fresnel"]
        scaled = _node(tree, "ShaderNodeVectorMath", 0, row + 1)
        scaled.operation = "SCALE"
        scaled.inputs["Vector"].default_value = told["inputs"]["Color"][:3]
        if colour is not None:
            tree.links.new(colour, scaled.inputs["Vector"])
        tree.links.new(share.outputs["Fac"], scaled.inputs["Scale"])
        tree.links.new(scaled.outputs["Vector"], found.inputs["Color"])
    return found


def _texture(folder: Path, tree: Any, told: dict[str, str], row: int) -> Any:
    found = _node(tree, "ShaderNodeTexImage", 0, row)
    found.image = _picture(folder, told)
    return found


def _taken(tree: Any, shader: Any, weight: float, share_of_texel: Any, row: int) -> Any:
    """Take a shader so many times: a share of it, doubled as often as it takes."""
    doublings = max(0, math.ceil(math.log2(weight))) if weight > 0 else 0
    share = weight / 2**doublings
    if share != 1 or share_of_texel is not None:
        mix = _node(tree, "ShaderNodeMixShader", 2, row)
        mix.inputs["Fac"].default_value = share
        if share_of_texel is not None:
            product = _node(tree, "ShaderNodeMath", 1, row + 1)
            product.operation = "MULTIPLY"
            product.inputs[1].default_value = share
            tree.links.new(share_of_texel, product.inputs[0])
            tree.links.new(product.outputs["Value"], mix.inputs["Fac"])
        tree.links.new(shader, mix.inputs[2])
        shader = mix.outputs["Shader"]
    for _ in range(doublings):
        shader = _sum(tree, shader, shader)
    return shader


def _sum(tree: Any, first: Any, second: Any) -> Any:
    found = _node(tree, "ShaderNodeAddShader", 3, len(tree.nodes) % 5)
    tree.links.new(first, found.inputs[0])
    tree.links.new(second, found.inputs[1])
    return found.outputs["Shader"]


def _tangents(tree: Any) -> Any:
    """Read the tangents of a brushed surface, which turn with the object."""
    along = _node(tree, "ShaderNodeAttribute", 0, 3)
    along.attribute_name = _TANGENTS
    turned = _node(tree, "ShaderNodeVectorTransform", 0, 4)
    turned.vector_type = "VECTOR"
    turned.convert_from, turned.convert_to = "OBJECT", "WORLD"
    tree.links.new(along.outputs["Vector"], turned.inputs["Vector"])
    return turned.outputs["Vector"]


def _node(tree: Any, kind: str, column: int, row: int = 0) -> Any:
    found = tree.nodes.new(kind)
    found.location = (_COLUMNS[column], -_SPACING * row)
    return found


def _picture(folder: Path, told: dict[str, str]) -> Any:
    """Load a picture and keep it inside of the file, where no path leads out of it."""
    import bpy  # pyright: ignore[reportMissingImports]

    found = bpy.data.images.load(str(folder / told["file"]), check_existing=True)
    if found.packed_file:
        return found
    found.colorspace_settings.name = told["space"]
    found.pack()
    found.filepath = f"//{told['file']}"
    for packed in found.packed_files:
        packed.filepath = f"//{told['file']}"
    return found


def _world(folder: Path, told: dict[str, str] | None) -> Any:
    """Make the light around the object; black where there is none."""
    import bpy  # pyright: ignore[reportMissingImports]

    world = bpy.data.worlds.new("environment")
    world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    output = _node(tree, "ShaderNodeOutputWorld", 2)
    background = _node(tree, "ShaderNodeBackground", 1)
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    tree.links.new(background.outputs["Background"], output.inputs["Surface"])
    if told is not None:
        texture = _node(tree, "ShaderNodeTexEnvironment", 0)
        texture.image = _picture(folder, told)
        tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    return world


def _light(scene: Any, told: dict[str, Any]) -> None:
    import bpy  # pyright: ignore[reportMissingImports]

    light = bpy.data.lights.new(told["name"], told["type"])
    light.energy, light.color = told["energy"], told["color"]
    if told["type"] == "SUN":
        light.angle = 0
    else:
        light.shadow_soft_size = 0
    _placed(scene, told["name"], light, told["pose"])


def _camera(scene: Any, told: dict[str, Any]) -> None:
    import bpy  # pyright: ignore[reportMissingImports]

    camera = bpy.data.cameras.new(told["name"])
    camera.type, camera.sensor_fit = told["type"], "HORIZONTAL"
    for name in ("sensor_width", "lens", "ortho_scale", "shift_x", "shift_y"):
        if name in told:
            setattr(camera, name, told[name])
    camera.clip_start, camera.clip_end = told["clip"]
    camera["width"], camera["height"] = told["size"]
    _placed(scene, told["name"], camera, told["pose"])


if __name__ == "__main__":
    build(*(Path(one) for one in sys.argv[-2:]))
