"""Captures of a ball of plastic and metal: the formulas of glTF 2.0, appendix B, in plain NumPy.

Nothing of the program's forward model is used.  Paint is the checkerboard of ``painted_captures``.
"""

from pathlib import Path

import numpy as np
from painted_captures import CHECKER, NOISE, SOURCES, soft_light
from small_captures import Ball, cameras, focal_length, write_json

from jaxrender.geometry import observe
from jaxrender.io import write_image

# Of plastic and of metal.
COLORS = np.array([[0.25, 0.4, 0.6], [0.9, 0.7, 0.35]])
ROUGHNESS, METALLIC = np.array([0.5, 0.35]), np.array([0.0, 1.0])
LIGHT = [*SOURCES, *soft_light(160)]
_SOURCES = ", ".join(f"{{direction: {list(d)}, irradiance: {list(e)}}}" for d, e in LIGHT)
LIGHTING = f"lighting: {{directional: [{_SOURCES}]}}\n"


def reflected(normals, outgoing, which):
    """Add up what each source sends to the camera."""
    color, metal = COLORS[which], METALLIC[which][:, None]
    squared = ROUGHNESS[which] ** 4
    radiance = np.zeros_like(color)

    def masked(cosine):
        return 2 * cosine / (cosine + np.sqrt(squared + (1 - squared) * cosine**2))

    view = np.sum(normals * outgoing, axis=1)
    for direction, irradiance in LIGHT:
        towards = np.array(direction) / np.linalg.norm(direction)
        half = outgoing + towards
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        light = normals @ towards
        facing = np.sum(normals * half, axis=1)
        growth = ((1 - half @ towards) ** 5)[:, None]
        density = squared / (np.pi * (facing**2 * (squared - 1) + 1) ** 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            lobe = density * masked(light) * masked(view) / (4 * light * view)
        lobe = np.where(light > 0, lobe, 0)[:, None]
        fresnel = 0.04 + 0.96 * growth
        plastic = (1 - fresnel) * color / np.pi + fresnel * lobe
        whole = (1 - metal) * plastic + metal * (color + (1 - color) * growth) * lobe
        radiance += np.array(irradiance) * np.maximum(light, 0)[:, None] * whole
    return radiance


def write_metallic(folder: Path, views: int = 9):
    """Write pictures of the ball and transforms.json."""
    ball = Ball(views=views, size=40)
    (folder / "images").mkdir(parents=True)
    rng, frames = np.random.default_rng(0), []
    for number, camera in enumerate(cameras(ball)):
        view = observe(camera, ball.shape)
        exact = reflected(
            view.normals[view.hit], view.outgoing[view.hit], CHECKER.which(view.points[view.hit])
        )
        image = np.zeros((*view.hit.shape, 4))
        image[view.hit, :3] = exact * (1 + NOISE * rng.normal(size=exact.shape))
        image[..., 3] = view.hit
        write_image(folder / f"images/{number}.exr", image)
        pose = camera.world_from_camera.tolist()
        frames.append({"file_path": f"images/{number}.exr", "transform_matrix": pose})
    intrinsics = {"w": ball.size, "h": ball.size, "fl_x": focal_length(ball.size)}
    write_json(folder / "transforms.json", {**intrinsics, "frames": frames})
    return folder
