"""The folders of two benchmarks, written as their descriptions say; by none of our readers.

Panoramas show one lobe of light, which is smooth, so that resampling changes little.
"""

import json
from pathlib import Path

import numpy as np
from capture_formats import CX, CY, FX, FY, HEIGHT, WIDTH, poses, world_to_camera

from jaxrender.io import write_image

ROWS = 24
# Where the light comes from, in the world, and how sharply.
TOWARDS, SHARPNESS = np.array([0.36, -0.48, 0.8]), 4.0
EXPOSURE = -1.25
PICTURES = [np.full((HEIGHT, WIDTH, 3), 0.2 + 0.1 * i) for i in range(3)]
MASK = np.zeros((HEIGHT, WIDTH, 3))
MASK[5:12, 6:15] = 1


def shine(directions: np.ndarray) -> np.ndarray:
    """The radiance from unit directions of the world."""
    lobe = np.exp(SHARPNESS * (directions @ TOWARDS - 1))
    return lobe[..., None] * np.array([1.0, 2.0, 0.5])


def _texels() -> tuple[np.ndarray, np.ndarray]:
    """Across and down from the top left corner, as parts of the picture."""
    down, across = (np.mgrid[:ROWS, : 2 * ROWS] + 0.5) / [[[ROWS]], [[2 * ROWS]]]
    return across, down


def orb_panorama(world_from_camera: np.ndarray) -> np.ndarray:
    """As a camera sees it: ahead (-z) in the middle, its right (+x) right of that, +y up."""
    across, down = _texels()
    azimuth, polar = 2 * np.pi * (across - 0.5), np.pi * down
    x, z = np.sin(polar) * np.sin(azimuth), -np.sin(polar) * np.cos(azimuth)
    return shine(np.stack([x, np.cos(polar), z], axis=-1) @ world_from_camera.T)


def owl_panorama(env_from_world: np.ndarray) -> np.ndarray:
    """Objects With Lighting: +z at the top, +x in the middle, +y at a quarter of the width."""
    across, down = _texels()
    azimuth, polar = 2 * np.pi * (0.5 - across), np.pi * down
    x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
    return shine(np.stack([x, y, np.cos(polar)], axis=-1) @ env_from_world)


def stanford_orb(data: Path, scene: str = "ball_scene001", pictures=PICTURES) -> Path:
    """A scene of blender_HDR with its ground truth; returns its folder."""
    folder, truth = data / "blender_HDR" / scene, data / "ground_truth" / scene
    for part, numbers in (("test", (0, 1)), ("train", (2,))):
        for inner in (part, f"{part}_mask"):
            (folder / inner).mkdir(parents=True, exist_ok=True)
        frames = []
        for i in numbers:
            write_image(folder / part / f"{i:04d}.exr", pictures[i])
            write_image(folder / f"{part}_mask" / f"{i:04d}.png", MASK)
            frames.append({"file_path": f"{part}/{i:04d}", "transform_matrix": poses()[i].tolist()})
        keys = {"w": WIDTH, "h": HEIGHT, "fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY}
        (folder / f"transforms_{part}.json").write_text(json.dumps(keys | {"frames": frames}))
    (truth / "env_map").mkdir(parents=True)
    for i in (0, 1):
        write_image(truth / "env_map" / f"{i:04d}.exr", orb_panorama(poses()[i][:3, :3]))
    return folder


def objects_with_lighting(folder: Path, env_from_world: np.ndarray, rotated: bool) -> Path:
    """A folder ``test`` of an object; ``rotated``: with the panorama in the world's axes, too."""
    inputs = folder / "inputs"
    inputs.mkdir(parents=True)
    for i, (turn, shift) in enumerate(world_to_camera()):
        stored = np.clip((PICTURES[i] * 2**EXPOSURE) ** (1 / 2.2), 0, 1)
        write_image(inputs / f"image_{i:04d}.png", stored)
        write_image(inputs / f"mask_{i:04d}.png", MASK)
        rows = [[FX, 0, CX], [0, FY, CY], [0, 0, 1], *turn, shift, [WIDTH, HEIGHT, 3]]
        lines = (" ".join(repr(float(x)) for x in row) for row in rows)
        (inputs / f"camera_{i:04d}.txt").write_text("\n".join(lines) + "\n")
    (inputs / "exposure.txt").write_text(f"{EXPOSURE}\n")
    matrix = np.eye(4)
    matrix[:3, :3] = env_from_world
    np.savetxt(folder / "world_to_env.txt", matrix)
    write_image(folder / "env.hdr", owl_panorama(env_from_world))
    if rotated:
        write_image(folder / "env_512_rotated.hdr", owl_panorama(np.eye(3)))
    return folder
