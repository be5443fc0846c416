"""A capture made by Blender: photographs by Cycles, cameras and mesh in Blender's and glTF's axes.

    python experiments/blender_capture.py [--out FOLDER] [--probe broken] [--views 12]
        [--size 128] [--samples 256] [--bounces 0] [--unknown]

Blender's monkey, its surface subdivided, has a Diffuse and a Glossy (GGX) BSDF, and stands under a
probe in Blender's own layout.  Cycles photographs it with Blender's cameras, filter and EXR;
``transforms.json`` has their matrices as they are, the mesh is a GLB, whose y is up.  The commands
``import``, ``check --fix`` and ``fit`` run in a process each: ``check`` has to find which axis of
the mesh is up, and that Blender's panoramas are ours mirrored and turned by 180 degrees.  Printed
is what was recovered beside the truth.  ``--unknown`` leaves the light out of the capture.  Needs
Blender (``docs/guide/install.md``).
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

# Colours of the diffuse base (pi K_d) and of the lobe, and GGX's width.
BASE, LOBE, SIGMA = (0.45, 0.25, 0.12), (0.15, 0.15, 0.15), 0.2
LENS, DISTANCE = 85.0, 8.0


def photograph(folder: Path, options: dict) -> None:
    """Build the scene in Blender, and write mesh, photographs and cameras."""
    import bpy
    from mathutils import Vector

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_monkey_add(size=2)
    monkey = bpy.context.object
    monkey.modifiers.new("smooth", "SUBSURF").render_levels = 2
    monkey.modifiers["smooth"].levels = 2
    bpy.ops.object.modifier_apply(modifier="smooth")
    bpy.ops.object.shade_smooth()
    bpy.ops.export_scene.gltf(filepath=str(folder / "mesh.glb"), export_format="GLB")
    monkey.data.materials.append(material(bpy))
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("probe")
    scene.world.use_nodes = True
    nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
    probe = nodes.new("ShaderNodeTexEnvironment")
    probe.image = bpy.data.images.load(str(folder / "light.exr"))
    links.new(probe.outputs["Color"], nodes["Background"].inputs["Color"])
    camera = bpy.data.cameras.new("camera")
    camera.lens = LENS
    eye = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.max_bounces = options["samples"], options["bounces"]
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = options["size"]
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    frames = []
    for number in range(options["views"]):
        azimuth, height = 2 * np.pi * number / options["views"], (0.1, 0.7)[number % 2]
        towards = Vector((np.cos(azimuth), np.sin(azimuth), height)).normalized()
        eye.location = DISTANCE * towards
        eye.rotation_euler = (-towards).to_track_quat("-Z", "Y").to_euler()
        scene.cycles.seed = number
        name = f"photo_{number:03d}.exr"
        scene.render.filepath = str(folder / name)
        bpy.ops.render.render(write_still=True)
        frames.append({"file_path": name, "transform_matrix": np.array(eye.matrix_world).tolist()})
    size = {"w": options["size"], "h": options["size"], "camera_angle_x": camera.angle_x}
    (folder / "transforms.json").write_text(json.dumps(size | {"frames": frames}, indent=1))


def material(bpy):
    """Make the sum of Blender's Diffuse and Glossy BSDF."""
    found = bpy.data.materials.new("paint")
    found.use_nodes = True
    nodes, links = found.node_tree.nodes, found.node_tree.links
    nodes.clear()
    base, lobe, both, output = (
        nodes.new(f"ShaderNode{kind}")
        for kind in ("BsdfDiffuse", "BsdfGlossy", "AddShader", "OutputMaterial")
    )
    base.inputs["Color"].default_value = (*BASE, 1)
    lobe.inputs["Color"].default_value = (*LOBE, 1)
    lobe.inputs["Roughness"].default_value = SIGMA**0.5
    lobe.distribution = "GGX"
    for number, shader in enumerate((base, lobe)):
        links.new(shader.outputs["BSDF"], both.inputs[number])
    links.new(both.outputs["Shader"], output.inputs["Surface"])
    return found


def main() -> None:
    import scenes
    from commands import run

    from jaxrender.io import write_image
    from jaxrender.io.exports import facing_panorama, run_in_blender

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("blender_capture"))
    parser.add_argument("--probe", default="broken", choices=sorted(scenes.PROBES))
    parser.add_argument("--views", type=int, default=12)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--bounces", type=int, default=0)
    parser.add_argument("--unknown", action="store_true")
    options = parser.parse_args()
    photos, capture, result = (options.out / name for name in ("photos", "capture", "result"))
    photos.mkdir(parents=True)
    write_image(photos / "light.exr", facing_panorama(scenes.probe(options.probe, 1)))
    told = {name: getattr(options, name) for name in ("views", "size", "samples", "bounces")}
    start = time.perf_counter()
    run_in_blender(Path(__file__), (photos.resolve(), json.dumps(told)))
    seconds = {"Blender": time.perf_counter() - start}
    seconds["import"] = run("import", photos, "--mesh", photos / "mesh.glb", "--out", capture)
    config = capture / "capture.yaml"
    if not options.unknown:
        light = (photos / "light.exr").resolve()
        lighting = f"lighting:\n  environment: {{path: {light}, convention: z-up}}\n"
        text = config.read_text().replace("task: factorize", "task: brdf")
        config.write_text(f"{text}\n{lighting}")
    seconds["check"] = run("check", capture, "--fix")
    model = "brdf={model: ggx, mu: none}"
    seconds["fit"] = run("fit", config, model, f"output={result}")
    print("  ".join(f"{name} {spent:.0f} s" for name, spent in seconds.items()))
    compared(json.loads((result / "result.json").read_text()))


def compared(found: dict) -> None:
    """Print what was recovered beside the truth, as shares where the light was unknown."""
    kd, ks = np.array(BASE) / np.pi, np.array(LOBE)
    if found["task"] == "factorize":
        kd, ks = kd / (kd + ks), ks / (kd + ks)
    values, intervals = found["brdf"], found["interval90"]
    print(f"{found['outcome']}, unexplained {found['residual']['relative_rms']:.2%}")
    print(f"{'':8}{'recovered':>10}{'90 % interval':>22}{'true':>9}{'error':>9}")
    rows = [(f"kd[{c}]", values["kd"][c], intervals["kd"][c], kd[c]) for c in range(3)]
    if np.ndim(values["ks"]):
        rows += [(f"ks[{c}]", values["ks"][c], intervals["ks"][c], ks[c]) for c in range(3)]
    else:
        rows.append(("ks", values["ks"], intervals["ks"], ks[0]))
    rows.append(("sigma", values["sigma"], intervals["sigma"], SIGMA))
    for name, value, (low, high), true in rows:
        error = value / true - 1
        print(f"{name:8}{value:10.4f}{low:12.4f} to {high:.4f}{true:9.4f}{error:9.2%}")


if __name__ == "__main__":
    if "--" in sys.argv:
        photograph(Path(sys.argv[-2]), json.loads(sys.argv[-1]))
    else:
        main()
