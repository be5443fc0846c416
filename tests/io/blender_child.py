"""The script that tests run in Blender: tell what a scene holds, or have Cycles render it."""

import json
import sys
from pathlib import Path

import bpy
import numpy as np


def imported(path: str, light: str | None) -> None:
    """Read a GLB as Blender's importer does, with numbers of lights as they are."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path, export_import_convert_lighting_mode="RAW")
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.pixel_filter_type = "CYCLES", "BOX"
    scene.cycles.max_bounces, scene.render.film_transparent = 0, True
    scene.camera = next(one for one in bpy.data.objects if one.type == "CAMERA")
    for material in bpy.data.materials:
        for node in material.node_tree.nodes:
            if node.bl_idname == "ShaderNodeBsdfPrincipled":
                # The importer's own choice adds light that facets hand on to one another.
                node.distribution = "GGX"
    if light is not None:
        scene.world = bpy.data.worlds.new("light")
        scene.world.use_nodes = True
        tree = scene.world.node_tree
        texture = tree.nodes.new("ShaderNodeTexEnvironment")
        texture.image = bpy.data.images.load(light)
        tree.links.new(texture.outputs["Color"], tree.nodes["Background"].inputs["Color"])


def plain(value):
    return list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def told() -> dict:
    """Tell the scene: shaders, pictures, lights, cameras and mesh."""
    shaders = [
        {one.name: plain(one.default_value) for one in node.inputs if hasattr(one, "default_value")}
        | {"node": node.bl_idname, "linked": [one.name for one in node.inputs if one.is_linked]}
        for material in bpy.data.materials
        for node in material.node_tree.nodes
    ]
    pictures = {}
    for image in bpy.data.images:
        width, height = image.size
        rows = np.array(image.pixels[:]).reshape(height, width, -1)[::-1]
        pictures[image.name] = {
            "packed": bool(image.packed_file), "space": image.colorspace_settings.name,
            "file": image.filepath, "pixels": rows.tolist(),
        }  # fmt: skip
    things = {}
    for one in bpy.data.objects:
        things[one.name] = {"type": one.type, "pose": np.array(one.matrix_world).tolist()}
        if one.type == "LIGHT":
            light = one.data
            things[one.name] |= {"energy": light.energy, "color": list(light.color),
                                 "kind": light.type}  # fmt: skip
        if one.type == "MESH":
            mesh = one.data
            found = np.empty(3 * len(mesh.vertices))
            mesh.vertices.foreach_get("co", found)
            things[one.name] |= {"vertices": found.tolist(), "faces": len(mesh.polygons)}
    return {"shaders": shaders, "pictures": pictures, "things": things}


if __name__ == "__main__":
    path, out, options = *sys.argv[-3:-1], json.loads(sys.argv[-1])
    if path.endswith(".blend"):
        bpy.ops.wm.open_mainfile(filepath=path)
    else:
        imported(path, options.get("light"))
    scene = bpy.context.scene
    if "samples" in options:
        scene.cycles.samples, scene.cycles.seed = options["samples"], options["seed"]
        if "size" in options:
            scene.render.resolution_x, scene.render.resolution_y = options["size"]
        if "camera" in options:
            scene.camera = bpy.data.objects[options["camera"]]
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.image_settings.color_mode = "RGBA"
        scene.render.image_settings.color_depth = "32"
        scene.render.filepath = out
        bpy.ops.render.render(write_still=True)
    else:
        Path(out).write_text(json.dumps(told()))
