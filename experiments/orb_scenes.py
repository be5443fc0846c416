"""Stanford-ORB's layout: what Mitsuba 3 photographs, and how a scene is written with light maps.

Materials under probes, direct light only.  The light map of a photograph is in the frame of its
camera, turned by 3 degrees about an axis of its own and off by 5 % in brightness, as a probe makes
it that stands elsewhere.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import mitsuba_scenes
import numpy as np
import scenes
from PIL import Image
from scipy.spatial.transform import Rotation

from jaxrender.geometry import Pinhole
from jaxrender.io import read_mesh, write_image, write_mesh
from jaxrender.lighting import Environment

TURN, GAIN = 3.0, 0.05
# Every third view is left out of the fit.
THIRD = 3
# Samples a pixel, and the least alpha of the object.
SPP, SEEN = 1024, 0.99
# A camera sees +x to the right, +y up and -z ahead; a panorama of ours has +z up, and ahead is -x.
PANORAMA = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


def _plastic(colour: list[float], alpha: float) -> dict:
    facets = {"type": "roughplastic", "distribution": "ggx", "alpha": alpha}
    return facets | {"diffuse_reflectance": {"type": "rgb", "value": colour}}


def _metal(name: str, alpha: float) -> dict:
    return {"type": "roughconductor", "distribution": "ggx", "material": name, "alpha": alpha}


def _mixed(weight: float, metal: dict, colour: list[float]) -> dict:
    diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}
    return {"type": "blendbsdf", "weight": weight, "diffuse": diffuse, "facets": metal}


MATERIALS = {
    "red plastic": _plastic([0.55, 0.08, 0.06], 0.15),
    "gold": _metal("Au", 0.2),
    "blue plastic": _plastic([0.05, 0.12, 0.5], 0.08),
    "copper": _metal("Cu", 0.3),
    "white plastic": _plastic([0.7, 0.7, 0.68], 0.25),
    "aluminium": _metal("Al", 0.12),
    "green paint": _mixed(0.15, _metal("Al", 0.2), [0.1, 0.4, 0.12]),
    "chromium": _metal("Cr", 0.15),
    "black plastic": _plastic([0.03, 0.03, 0.03], 0.12),
    "silver": _metal("Ag", 0.35),
    "metallic paint": _mixed(0.4, _metal("Au", 0.25), [0.3, 0.05, 0.1]),
    "clay": _plastic([0.5, 0.3, 0.2], 0.5),
    "brass paint": _mixed(0.6, _metal("Cu", 0.18), [0.3, 0.25, 0.1]),
    "yellow plastic": _plastic([0.6, 0.5, 0.05], 0.1),
}


def coarsened(light: Environment, rows: int) -> Environment:
    """Average texels until so many rows are left."""
    return scenes.coarser(light, light.grid.shape[0] // rows)


class World(NamedTuple):
    """What is photographed: a mesh's file, from where, and under which probes.

    Light maps have ``rows``, fewer than the probes.
    """

    mi: Any
    mesh: Path
    eyes: list[Pinhole]
    probes: dict[str, Environment]
    rows: int

    def coarse(self, probe: str) -> Environment:
        """Show a probe with as many rows as maps have."""
        return coarsened(self.probes[probe], self.rows)

    @property
    def left_out(self) -> list[int]:
        """The views that no fit sees."""
        return list(range(THIRD - 1, len(self.eyes), THIRD))

    @property
    def given(self) -> list[int]:
        """The views of the test, each of which has a light map."""
        return [number for number in range(len(self.eyes)) if number not in self.left_out]

    def scene(self, material: dict, light: Environment) -> Any:
        """Make Mitsuba's scene."""
        shape = {"type": "ply", "filename": str(self.mesh), "bsdf": material}
        parts = {"light": mitsuba_scenes.envmap(self.mi, light), "object": shape}
        return self.mi.load_dict({"type": "scene", **parts})

    def sensor(self, number: int) -> Any:
        """Make Mitsuba's camera of a view."""
        sensor = mitsuba_scenes.sensor_of(self.mi, self.eyes[number])
        sensor["film"] |= {"pixel_format": "rgba"}
        return self.mi.load_dict(sensor)

    def integrator(self) -> Any:
        """Direct light alone."""
        return self.mi.load_dict({"type": "direct", "hide_emitters": True})

    def photographs(self, scene: Any, which: list[int], spp: int = SPP) -> list[np.ndarray]:
        """Render views; alpha is the last channel."""
        direct = self.integrator()
        return [
            np.asarray(
                self.mi.render(scene, sensor=self.sensor(at), integrator=direct, spp=spp, seed=at),
                float,
            )
            for at in which
        ]


class Maps(NamedTuple):
    """What is wrong with the light map of each photograph: how it is turned, and its brightness."""

    turns: Rotation
    gains: np.ndarray

    @classmethod
    def drawn(cls, count: int, seed: int) -> "Maps":
        """Turn each by 3 degrees, and make it 5 % brighter or darker (rms)."""
        rng = np.random.default_rng(seed)
        axes = scenes.unit(rng.normal(size=(count, 3)))
        gains = np.exp(GAIN * rng.normal(size=count))
        return cls(Rotation.from_rotvec(np.radians(TURN) * axes), gains)

    def map(self, world: World, probe: str, number: int, frame: np.ndarray) -> Environment:
        """See a probe as the map of a photograph does, in a frame of its own."""
        turn = frame @ self.turns[number].as_matrix()
        seen = world.probes[probe].turned(turn)
        return coarsened(seen.scaled(float(self.gains[number])), world.rows)

    def left(self, calibration: dict) -> tuple[float, float]:
        """Say what a fit leaves of both: degrees, and the scatter of brightness (rms, per cent)."""
        found = calibration["nuisances"]
        vectors = np.radians(np.reshape(found["environment"]["value"], (-1, 3)))
        angles = (Rotation.from_rotvec(vectors) * self.turns).magnitude()
        bright = np.asarray(found["exposure"]["value"]) + 100 * np.log(self.gains)
        return float(np.degrees(np.sqrt(np.mean(angles**2)))), float(np.std(bright))


def write_part(folder: Path, part: str, world: World, photographs: dict[int, np.ndarray]) -> Path:
    """Write photographs, masks and cameras of one part of a scene as Stanford-ORB does."""
    frames = []
    for number, picture in photographs.items():
        name = f"{number:04d}"
        for inner in (part, f"{part}_mask"):
            (folder / inner).mkdir(parents=True, exist_ok=True)
        write_image(folder / part / f"{name}.exr", picture[..., :3])
        mask = (255 * (picture[..., 3] > SEEN)).astype(np.uint8)
        Image.fromarray(mask).save(folder / f"{part}_mask" / f"{name}.png")
        pose = world.eyes[number].world_from_camera.tolist()
        told = {"file_path": f"{part}/{name}.exr", "mask_path": f"{part}_mask/{name}.png"}
        frames.append(told | {"transform_matrix": pose})
    eye = world.eyes[0]
    keys = {"w": eye.width, "h": eye.height, "fl_x": eye.fl_x, "fl_y": eye.fl_x}
    keys |= {"cx": eye.width / 2, "cy": eye.height / 2}
    path = folder / f"transforms_{part}.json"
    path.write_text(json.dumps(keys | {"frames": frames}))
    return path


def write_scene(
    data: Path, world: World, shots: dict[int, np.ndarray], maps: Maps, probe: str
) -> Path:
    """Write a scene of the benchmark with its light maps; returns its folder."""
    folder = data / "blender_HDR" / "object_scene001"
    truth = data / "ground_truth" / folder.name
    write_part(folder, "test", world, {at: shots[at] for at in world.given})
    (truth / "env_map").mkdir(parents=True)
    for place, number in enumerate(world.given):
        to_camera = np.asarray(world.eyes[number].world_from_camera)[:3, :3].T
        seen = maps.map(world, probe, place, PANORAMA @ to_camera)
        # Seen from inside, our azimuths run the other way.
        image = np.asarray(seen.radiance)[:, ::-1]
        write_image(truth / "env_map" / f"{number:04d}.exr", image)
    (truth / "mesh_blender").mkdir()
    write_mesh(truth / "mesh_blender" / "mesh.obj", read_mesh(world.mesh))
    return folder
