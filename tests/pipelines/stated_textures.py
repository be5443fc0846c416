"""Result folders of ``task: texture`` whose maps are stated, without the fit that finds them."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Shape, Sphere, look_at
from jaxrender.geometry.texels import texel_coordinates
from jaxrender.io import write_image
from jaxrender.io.meshes import write_mesh
from jaxrender.io.netcdf import Group, Variable, write
from jaxrender.pipelines.result import ARRAYS, ARRAYS_FORMAT

ROWS = 16
POLAR = ((np.arange(ROWS) + 0.5) * np.pi / ROWS)[:, None]
AZIMUTH = ((np.arange(2 * ROWS) + 0.5) * np.pi / ROWS)[None, :]
# Bright towards +X and up, a soft lamp at azimuth 1: not the same in any mirror.
SKY = 1 + 0.6 * np.sin(POLAR) * np.cos(AZIMUTH) + 0.3 * np.cos(POLAR)
SKY = SKY + 2 * np.exp(-((POLAR - 1) ** 2 + (AZIMUTH - 1) ** 2) / 0.3)
SIZE = 48


class StatedMaps(NamedTuple):
    """What every site has; sigma and mu are those of the only region."""

    kd: np.ndarray
    ks: np.ndarray
    sigma: float = 0.3
    mu: float = 1.5
    widths: np.ndarray | None = None
    offset: np.ndarray | None = None


def smooth_maps(places: np.ndarray, channels: int = 1, varying: bool = False) -> StatedMaps:
    """Maps that change slowly with the direction of a place from the middle of an object."""
    x, y, z = np.moveaxis(places / np.linalg.norm(places, axis=-1, keepdims=True), -1, 0)
    kd = np.stack([0.14 + 0.08 * x, 0.12 + 0.06 * y, 0.1 - 0.05 * z], axis=-1)
    ks = 0.12 + 0.05 * y
    if channels == 3:
        ks = np.stack([ks, 0.1 - 0.04 * x, 0.08 + 0.05 * z], axis=-1)
    widths = offset = None
    if varying:
        widths = 0.25 * np.exp(0.4 * z)
        offset = 0.1 * np.stack([np.sin(3 * z), np.sin(3 * x), 0 * x], axis=-1)
    return StatedMaps(kd, ks, 0.25, 1.5, widths, offset)


def texel_places(rows: int = ROWS) -> np.ndarray:
    """Directions of the middles of a sphere's texels, row by row from the top."""
    u, v = texel_coordinates((rows, 2 * rows)).reshape(rows, 2 * rows, 2).transpose(2, 0, 1)
    polar, azimuth = np.pi * (1 - v), 2 * np.pi * u
    x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
    return np.stack([x, y, np.cos(polar)], axis=-1)


class StatedMetal(NamedTuple):
    """glTF's material of every texel."""

    base_color: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray
    ior: float = 1.5


def metal_maps(places: np.ndarray) -> StatedMetal:
    """Metal in one half, plastic in the other, worn between; roughness that changes apart."""
    x, y, z = np.moveaxis(places / np.linalg.norm(places, axis=-1, keepdims=True), -1, 0)
    color = np.stack([0.5 + 0.3 * x, 0.45 + 0.2 * y, 0.35 - 0.2 * z], axis=-1)
    return StatedMetal(color, 0.45 * np.exp(0.25 * z), np.clip(0.5 + y, 0, 1))


def write_metal_result(
    folder: Path, maps: StatedMetal, shape: Shape, sky: np.ndarray = SKY
) -> Path:
    """Write a result of such a texture, with errors, and what its config names."""
    asked = "{roughness: map, metalness: map}\nbrdf: {model: metallic-roughness}"
    numbers = {"model": "metallic-roughness", "ior": maps.ior}
    sites = ("row", "column") if maps.roughness.ndim == 2 else ("vertex",)
    _write_around(folder, shape, asked, numbers, sky)

    def site(values: np.ndarray) -> Variable:
        names = (*sites, "channel")[: values.ndim]
        return Variable(names, values, "1", "stated")

    texture = {"seen": site(np.ones(maps.roughness.shape, int))}
    for name in ("base_color", "roughness", "metallic"):
        values = getattr(maps, name)
        texture[name], texture[f"{name}_error"] = site(values), site(0.01 * (1 + values))
    shared = {"ior": Variable((), np.array(maps.ior), "1", "stated")}
    groups = {"texture": Group(texture), "shared": Group(shared)}
    write(folder / ARRAYS, ARRAYS_FORMAT, Group(groups=groups))
    return folder


def _write_around(folder: Path, shape: Shape, asked: str, brdf: dict, sky: np.ndarray) -> None:
    """Write the config, the summary, and what they name: light, one camera, the shape."""
    folder.mkdir(parents=True)
    geometry = "sphere: {radius: 1}"
    if not isinstance(shape, Sphere):
        write_mesh(folder / "object.ply", shape)
        geometry = "mesh: object.ply"
    (folder / "config.yaml").write_text(
        f"task: texture\ncapture: {{transforms: transforms.json, geometry: {{{geometry}}}}}\n"
        f"lighting: {{environment: {{path: light.exr}}}}\n"
        f"texture: {asked}\n"
    )
    pose = look_at(np.array([4.0, 1.0, 1.5]), np.zeros(3), np.array([0.0, 0, 1]))
    frame = {"file_path": "0.exr", "transform_matrix": pose.tolist()}
    cameras = {"w": SIZE, "h": SIZE, "fl_x": 1.7 * SIZE, "frames": [frame]}
    (folder / "transforms.json").write_text(json.dumps(cameras))
    write_image(folder / "light.exr", sky[..., None] * np.array([1, 0.8, 0.5]))
    summary = {"task": "texture", "outcome": "converged", "lighting": {}, "brdf": brdf}
    (folder / "result.json").write_text(json.dumps(summary))


def write_result(folder: Path, maps: StatedMaps, shape: Shape, sky: np.ndarray = SKY) -> Path:
    """Write a result, and what its config names: light, one camera, the shape."""
    asked = []
    if maps.widths is not None:
        asked.append("sigma: map")
    if maps.offset is not None:
        asked.append("normals: map")
    if maps.ks.ndim == maps.kd.ndim:
        asked.append("ks: color")
    numbers = {"model": "microfacet", "sigma": maps.sigma, "mu": maps.mu}
    _write_around(folder, shape, f"{{{', '.join(asked)}}}", numbers, sky)
    sites = ("row", "column") if maps.kd.ndim == 3 else ("vertex",)

    def site(values: np.ndarray, inner: str) -> Variable:
        names = (*sites, inner) if values.ndim > len(sites) else sites
        return Variable(names, values, "1", "stated")

    texture = {"kd": site(maps.kd, "channel"), "ks": site(maps.ks, "channel"),
               "region": site(np.zeros(maps.kd.shape[:-1], int), "")}  # fmt: skip
    if maps.widths is not None:
        texture["sigma"] = site(maps.widths, "")
    if maps.offset is not None:
        texture["normal_offset"] = texture["normal"] = site(maps.offset, "axis")
        texture["normal_error"] = site(np.zeros(maps.kd.shape[:-1]), "")
    lobe = {
        name: Variable(("region",), np.array([getattr(maps, name)]), "1", "stated")
        for name in ("sigma", "mu")
    }
    write(
        folder / ARRAYS,
        ARRAYS_FORMAT,
        Group(groups={"texture": Group(texture), "lobe": Group(lobe)}),
    )
    return folder
