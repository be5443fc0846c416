"""Captures whose conventions are told wrong: are they named by ``jaxrender check``?

    python experiments/conventions.py [--probes FILE ...] [--meshes FILE ...] [--spp 256]

Eight scenes: four objects (a ball, the project's sculpture, and meshes) under two lights.  Half of
them are photographed by Mitsuba's direct light, half by the project's own integral, each with 1 %
noise at 96 pixels.  Each is written in five conventions, all wrong at once in cameras, mesh and
panorama, and checked as if nothing was known.  All 40 should be named: axes, mirror, turn, unit,
and the panorama's layout, mirror and yaw (within 3 degrees); what symmetry hides, such as the
mirror of a ball, is asked of the picture that the light makes.  Eight more are lit uniformly, and
there the layout "cannot be told".
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import jax
import mitsuba_scenes
import numpy as np
from scipy.spatial.transform import Rotation

from jaxrender.geometry import Mesh, Pinhole, Placement, Shape, observe, pose_from
from jaxrender.geometry.sculpture import sculpture
from jaxrender.inverse.conventions import (
    FoundFraming,
    FoundOrientation,
    Framing,
    Known,
    Orientation,
    Silhouettes,
    find_framing,
    find_orientation,
)
from jaxrender.inverse.conventions.orientations import Panoramas
from jaxrender.inverse.conventions.silhouettes import covered
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.photographs import Reading, observations_of, trace_photographs
from jaxrender.io import Capture, Frame, Image, read_environment, read_mesh
from jaxrender.lighting import Environment
from jaxrender.reflection import ExactForward, ShadowedForward, render_view

ROWS, NOISE = 64, 0.01
CONVENTIONS = [
    (Framing("opencv", False, 5, 0.001), Orientation("y-up", False, 90.0)),
    (Framing("opencv_inverted", False, 0, 10.0), Orientation("z-up", True, -35.0)),
    (Framing("opengl", True, 11, 1.0), Orientation("y-up", True, 140.0)),
    (Framing("llff", False, 17, 100.0), Orientation("z-up", False, 60.0)),
    (Framing("ros_inverted", True, 22, 0.1), Orientation("y-up", False, -110.0)),
]


class Scene(NamedTuple):
    """What is photographed, and the pictures with their coverage."""

    name: str
    shape: Shape
    light: Environment
    cameras: list[Pinhole]
    pictures: list[np.ndarray]
    masks: list[np.ndarray]


def about_origin(mesh: Mesh) -> Mesh:
    """Put a mesh about the origin, two units high at most, as a file might have it."""
    low, high = mesh.bounds()
    size = 2 / float((high - low).max())
    return Placement(size, None, -size * (low + high) / 2).mesh(mesh)


def photographed(name: str, mesh: Mesh, light: Environment, mi, spp: int) -> Scene:
    """Take the photographs by Mitsuba, or by the project's own integral where there is none."""
    cameras = mitsuba_scenes.cameras(mesh)
    rng, views = np.random.default_rng(1), [observe(camera, mesh) for camera in cameras]
    if mi is not None:
        what = mitsuba_scenes.Object(mesh, light, "ggx")
        pictures = mitsuba_scenes.photographs(mi, what, spp)
    else:
        nodes = light.nodes()
        convex = mesh.is_convex()
        forward = ExactForward(nodes) if convex else ShadowedForward(mesh, nodes)
        material = mitsuba_scenes.material("ggx")
        pictures = [np.asarray(render_view(material, view, forward)) for view in views]
    pictures = [np.maximum(p * (1 + NOISE * rng.normal(size=p.shape)), 0) for p in pictures]
    masks = [covered(camera, mesh) for camera in cameras]
    return Scene(name, mesh, light, cameras, pictures, masks)


def as_file(camera: Pinhole, axes: str) -> Pinhole:
    """Write a pose in other axes: what ``pose_from`` undoes."""
    pose = camera.world_from_camera.copy()
    own = pose_from(np.eye(4), axes.removesuffix("_inverted"))[:3, :3]
    pose[:3, :3] = pose[:3, :3] @ own.T
    if axes.endswith("_inverted"):
        pose = np.linalg.inv(pose)
        pose[3] = [0, 0, 0, 1]
    return Pinhole(camera.width, camera.height, pose, fl_x=camera.fl_x)


def picture_of(image: np.ndarray, meant: Orientation) -> np.ndarray:
    """Write a z-up panorama so that it is read as it is only if it is meant so."""
    rows = len(image)
    polar, azimuth = np.meshgrid(
        (np.arange(rows) + 0.5) * np.pi / rows,
        (np.arange(2 * rows) + 0.5) * np.pi / rows,
        indexing="ij",
    )
    level, height = np.sin(polar), np.cos(polar)
    if meant.convention == "z-up":
        own, up = (level * np.cos(azimuth), level * np.sin(azimuth), height), [0.0, 0, 1]
    else:
        own, up = (level * np.sin(azimuth), height, -level * np.cos(azimuth)), [0.0, 1, 0]
    turn = Rotation.from_rotvec(meant.yaw * np.array(up), degrees=True)
    world = turn.apply(np.stack(own, axis=-1).reshape(-1, 3))
    found = Panoramas({"z-up": image}).radiance(Orientation(), world).reshape(image.shape)
    return found[:, ::-1] if meant.mirrored else found


def checked(
    scene: Scene, framing: Framing, orientation: Orientation
) -> tuple[FoundFraming, FoundOrientation]:
    """Write a scene in the conventions, and look for them as a check does."""
    masks = [mask[:, ::-1] if framing.mirrored else mask for mask in scene.masks]
    names = tuple(f"{k}" for k in range(len(masks)))
    cameras = tuple(as_file(camera, framing.axes) for camera in scene.cameras)
    mesh = framing.own.inverse.mesh(scene.shape)
    found = find_framing(mesh, Silhouettes(names, cameras, tuple(masks)), Framing())
    picture = picture_of(np.asarray(scene.light.radiance), orientation)
    known = Known(None, mitsuba_scenes.material("ggx"))
    seen = observed(scene)
    return found, find_orientation(seen, scene.shape, picture, Orientation(), known)


def observed(scene: Scene) -> Observations:
    """Trace the photographs as they are meant."""
    frames, images = [], []
    for number, (camera, picture) in enumerate(zip(scene.cameras, scene.pictures)):
        frames.append(Frame(f"{number}", camera, Path(f"{number}"), None, None))
        images.append(Image(picture, None, {}, np.zeros(picture.shape[:2], bool)))
    capture = Capture(tuple(frames))
    return observations_of(trace_photographs(capture, images, scene.shape, Reading()))


def named(found: FoundOrientation, meant: Orientation) -> bool:
    return found.orientation[:2] == meant[:2] and found.orientation.off(meant) < 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--meshes", nargs="*", type=Path, default=[])
    parser.add_argument("--probes", nargs="*", type=Path, default=[])
    parser.add_argument("--views", type=int, default=6)
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--spp", type=int, default=256)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    mitsuba_scenes.VIEWS, mitsuba_scenes.SIZE = arguments.views, arguments.size
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    shapes = {"ball": Mesh.icosphere(4), "sculpture": sculpture(4)}
    shapes |= {path.stem: about_origin(read_mesh(path)) for path in arguments.meshes}
    lights = {path.stem: read_environment(path, "cross", height=ROWS) for path in arguments.probes}
    lights = lights or {"room": Environment(room())}
    told, total, unsure = 0, 0, 0
    uniform = Environment(np.ones((ROWS, 2 * ROWS, 3)))
    print(f"{'scene':38s} {'by':8s} {'axes mirror turn unit':22s} overlap next  light  left  next")
    for at, (name, mesh) in enumerate(shapes.items()):
        for other, (light_name, light) in enumerate(lights.items()):
            by = mi if (at + other) % 2 else None
            scene = photographed(f"{name}, {light_name}", mesh, light, by, arguments.spp)
            for framing, orientation in CONVENTIONS:
                begun = time.perf_counter()
                one, lit = checked(scene, framing, orientation)
                right = [a == b for a, b in zip(one.framing, framing)]
                hidden = [k not in one.told_apart for k in Framing._fields]
                fine = all(r or h for r, h in zip(right, hidden)) and named(lit, orientation)
                told, total = told + fine, total + 1
                marks = " ".join(
                    "yes" if r else "hidden" if h else "NO" for r, h in zip(right, hidden)
                )
                print(
                    f"{scene.name:38s} {'Mitsuba' if by else 'integral':8s} {marks:22s} "
                    f"{one.overlap:.2f} {max(one.rivals.values()):.2f} "
                    f"{'yes' if named(lit, orientation) else 'NO '} {100 * lit.unexplained:5.1f} % "
                    f"{100 * min(lit.rivals.values()):5.1f} %  "
                    f"({time.perf_counter() - begun:.0f} s)",
                    flush=True,
                )
            even = photographed(f"{name}, uniform", mesh, uniform, by, arguments.spp)
            _, lit = checked(even, *CONVENTIONS[other])
            unsure += not lit.told_apart
            print(f"{even.name:38s} {lit.why or lit.orientation.words()}", flush=True)
    print(f"named: {told} of {total}; cannot be told under uniform light: {unsure}")


def room() -> np.ndarray:
    """A window, a lamp and a floor, unlike from every side."""
    from jaxrender.harmonics import LatLongGrid

    directions = LatLongGrid(ROWS, 2 * ROWS).directions()
    image = 0.15 + 0.1 * np.maximum(directions[..., 2:], 0) + np.zeros(3)
    for towards, width, radiance in (
        ([1, 0.2, 0.3], 0.35, [3, 2.5, 2]),
        ([-0.3, 1, 0.1], 0.25, [1, 2, 3]),
    ):
        along = directions @ (np.array(towards) / np.linalg.norm(towards))
        image = image + np.exp((along - 1) / width**2)[..., None] * np.array(radiance)
    return image


if __name__ == "__main__":
    main()
