"""Small captures that the tests of the pipelines share, rendered by T 6.2 in plain NumPy.

A ball of known material under directional sources, one list of them for each photograph: the sum
over sources is the whole reflection integral, so nothing of the program's forward model is used.
Fits that several test files look at are made once a session.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np

from jaxrender import cli
from jaxrender.geometry import Pinhole, Shape, Sphere, look_at, observe
from jaxrender.io import write_image

KD, KS, SIGMA, MU = (0.2, 0.15, 0.1), 0.12, 0.25, 1.6
UNIT_BALL = Sphere(np.zeros(3), 1.0)
# One moving source: the light (directions and irradiances) of each photograph.
MOVING = tuple(
    [((np.cos(angle), np.sin(angle), 0.5), (2.0, 2.0, 2.0))] for angle in (0.3, 1.1, 1.9, 2.6)
)
CONFIG = """\
task: brdf
capture: {transforms: transforms.json, geometry: {sphere: {radius: 1}}}
lighting: {per_frame: lights.json}
solve: {starts: 2, variants: false, refine_samples: 300}
samples: {count: 600}
"""


class Ball(NamedTuple):
    """How a capture is made; ``gains`` multiply the pictures and are told to nobody."""

    views: int = 4
    size: int = 32
    lights: tuple = MOVING
    noise: float = 0.005
    gains: tuple = (1.0, 1.0, 1.0, 1.0)
    shape: Shape = UNIT_BALL


STANDARD = Ball()


def write_ball(folder: Path, ball: Ball = STANDARD) -> Path:
    """Write pictures, transforms.json, lights.json and config.yaml; returns the config."""
    (folder / "images").mkdir(parents=True)
    rng = np.random.default_rng(0)
    frames = []
    for number, camera in enumerate(cameras(ball)):
        name = f"images/{number}.exr"
        radiance, covered = picture(camera, ball.lights[number], ball.shape)
        radiance *= 1 + ball.noise * rng.normal(size=radiance.shape)
        image = np.concatenate([ball.gains[number] * radiance, covered[..., None]], axis=-1)
        write_image(folder / name, image)
        frames.append({"file_path": name, "transform_matrix": camera.world_from_camera.tolist()})
    intrinsics = {"w": ball.size, "h": ball.size, "fl_x": focal_length(ball.size)}
    write_json(folder / "transforms.json", {**intrinsics, "frames": frames})
    lights = [[source(*one) for one in several] for several in ball.lights[: ball.views]]
    write_json(folder / "lights.json", lights)
    (folder / "config.yaml").write_text(CONFIG)
    return folder / "config.yaml"


def cameras(ball: Ball) -> list[Pinhole]:
    """Cameras about the equator, 40 degrees apart."""
    found = []
    for angle in np.radians(40 * np.arange(ball.views)):
        position = 10 * np.array([np.cos(angle), np.sin(angle), 0.2])
        pose = look_at(position, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        found.append(Pinhole(ball.size, ball.size, pose, fl_x=focal_length(ball.size)))
    return found


def focal_length(size: int) -> float:
    """The ball fills most of the picture."""
    return 4.6 * size


def picture(camera: Pinhole, lights, shape: Shape = UNIT_BALL) -> tuple[np.ndarray, np.ndarray]:
    """Radiance of a shape under directional sources, and which pixels it covers."""
    view = observe(camera, shape)
    image = np.zeros((*view.hit.shape, 3))
    image[view.hit] = reflected(view.normals[view.hit], view.outgoing[view.hit], lights)
    return image, view.hit


def reflected(normals: np.ndarray, outgoing: np.ndarray, lights) -> np.ndarray:
    """T 6.2 with Fresnel at the exit angle: sum over sources of (kd cos + ks F S / 4 cos_o) E."""
    exit_cosine = np.sum(normals * outgoing, axis=1)
    total = np.zeros((len(normals), 3))
    for direction, irradiance in lights:
        incoming = np.array(direction) / np.linalg.norm(direction)
        cosine = np.maximum(normals @ incoming, 0)
        half = outgoing + incoming
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        angle = np.arccos(np.clip(np.sum(half * normals, axis=1), -1, 1))
        lobe = np.exp(-((angle / SIGMA) ** 2)) / (np.pi * SIGMA**2) * (cosine > 0)
        specular = KS * fresnel(exit_cosine) * lobe / (4 * exit_cosine)
        total += (cosine[:, None] * np.array(KD) + specular[:, None]) * np.array(irradiance)
    return total


def fresnel(cosine: np.ndarray) -> np.ndarray:
    """Unpolarised Fresnel reflectance relative to normal incidence."""
    refracted = np.sqrt(1 - (1 - cosine**2) / MU**2)
    across = (cosine - MU * refracted) / (cosine + MU * refracted)
    along = (refracted - MU * cosine) / (refracted + MU * cosine)
    return (across**2 + along**2) / 2 * ((MU + 1) / (MU - 1)) ** 2


def source(direction, irradiance) -> dict:
    """One source as lights.json has it."""
    return {"direction": [float(x) for x in direction], "irradiance": list(irradiance)}


def write_json(path: Path, content) -> None:
    path.write_text(json.dumps(content))


def edit_json(path: Path, change) -> None:
    """Change a JSON file in place."""
    content = json.loads(path.read_text())
    change(content)
    write_json(path, content)


def jaxrender(*arguments, cache: Path | None = None) -> int:
    """Run the command line in this process."""
    environment = {} if cache is None else {"XDG_CACHE_HOME": str(cache)}
    with mock.patch.dict(os.environ, environment):
        return cli.main([str(argument) for argument in arguments])


def read_result(folder: Path) -> dict:
    """Read result.json as the strict JSON that it has to be."""

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads((folder / "result.json").read_text(), parse_constant=refuse)


_FITTED: list[Path] = []


def moving_light(factory) -> Path:
    """A finished fit of a ball under a moving source, in ``out`` beside its ``capture``.

    ``factory`` is pytest's ``tmp_path_factory``; the fit is made once a session.
    """
    if not _FITTED:
        folder = factory.mktemp("moving")
        config = write_ball(folder / "capture")
        assert jaxrender("fit", config, f"output={folder / 'out'}") == 0
        _FITTED.append(folder)
    return _FITTED[0]


def standard_errors_off(result: dict) -> dict[str, float]:
    """How far each parameter is from the truth, in stated standard errors; the worst channel."""
    truth = {"kd": np.array(KD), "ks": KS, "sigma": SIGMA, "mu": MU}
    return {
        name: float(np.max(np.abs(np.array(result["brdf"][name]) - truth[name]) / error))
        for name, error in ((n, np.array(e)) for n, e in result["standard_error"].items())
    }
