"""A real flat card under a flash at the camera: maps beside those of Mitsuba and Adam.

    python experiments/card.py FOLDER [--size 256] [--left-out 3] [--steps 400] [--alike]

FOLDER is what ``jaxrender import`` made of the nine photographs of the card.  Some of these are
left out in turn.  From all others K_d, K_s, roughness and normal of every texel are found by a fit,
and in the same run by Mitsuba 3 (extra ``peers``), whose renderings of the same maps Adam improves
photograph by photograph.  Both predict the photograph that was left out.  Compared are pixels as
displays show them (sRGB, 1 is white), by PSNR, and times.  Adam's loss is the square of the
differences of square roots, which are near to sRGB.  Mitsuba's renderer needs LLVM 17 or later
(``DRJIT_LIBLLVM_PATH`` names its library).  ``--alike`` gives K_s one value for all channels in our
fit, and leaves Mitsuba out.
"""

import argparse
import json
import math
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import yaml

from jaxrender.geometry import Pinhole, SurfaceView, observe
from jaxrender.io import Capture, read_image, read_mesh
from jaxrender.io.exports.gltf import srgb
from jaxrender.lighting import PointSources
from jaxrender.pipelines import fit, load_run_config
from jaxrender.pipelines.captures import captures_of
from jaxrender.pipelines.result import read_run
from jaxrender.pipelines.tasks.texture.subject import TexturedSubject
from jaxrender.reflection import NearForward

RATE, LAST_RATE, SAMPLES = 0.03, 0.003, 4
# Where Adam begins, and what no map goes beyond.
START = {"kd": 0.03, "ks": 0.03, "alpha": 0.3}
LEAST, MOST_ALPHA = 1e-3, 1.0


class Card(NamedTuple):
    """What was photographed, from where, in which light; photographs are linear."""

    folder: Path
    config: dict
    capture: Capture
    lamps: dict
    photographs: list[np.ndarray]

    @classmethod
    def read(cls, folder: Path) -> "Card":
        """Read what was imported."""
        config = yaml.safe_load((folder / "capture.yaml").read_text())
        capture = captures_of(load_run_config(folder / "capture.yaml"))[0].capture
        codes = [read_image(one.image_path).pixels[..., :3] for one in capture.frames]
        lamps = json.loads((folder / "lights.json").read_text())
        return cls(folder, config, capture, lamps, [linear(one) for one in codes])

    def flash(self, number: int) -> PointSources:
        """Return the light of a photograph."""
        (lamp,) = self.lamps[self.capture.frames[number].name]
        return PointSources(*(np.array([lamp[key]]) for key in ("position", "intensity")))


def linear(codes: np.ndarray) -> np.ndarray:
    """Decode sRGB."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def psnr(predicted: np.ndarray, photograph: np.ndarray) -> float:
    """Compare what a display shows of both, in decibel."""
    off = srgb(np.clip(predicted, 0, 1)) - srgb(photograph)
    return float(-10 * np.log10(np.mean(off**2)))


def ours(card: Card, left_out: int, size: int, ks: str) -> tuple[float, float, str]:
    """Fit without a photograph, and predict it: PSNR, seconds (compiling apart), what is left."""
    with tempfile.TemporaryDirectory() as place:
        folder, name = Path(place), card.capture.frames[left_out].name
        told = json.loads((card.folder / "transforms.json").read_text())
        told["frames"].pop(left_out)
        (folder / "transforms.json").write_text(json.dumps(told))
        lamps = {key: value for key, value in card.lamps.items() if key != name}
        (folder / "lights.json").write_text(json.dumps(lamps))
        mesh = str((card.folder / "shape.obj").resolve())
        config = card.config | {
            "texture": {"size": size, "sigma": "map", "normals": "map", "ks": ks},
            "output": str(folder / "out"),
        }
        config["capture"] = card.config["capture"] | {"geometry": {"mesh": mesh}}
        (folder / "run.yaml").write_text(yaml.safe_dump(config))
        fit(load_run_config(folder / "run.yaml"))
        run = read_run(folder / "out")
        view = seen(card, left_out)
        subject = TexturedSubject(run, read_mesh(Path(mesh)))
        image = subject.image(view, NearForward(card.flash(left_out), None, None))
        left = f"{100 * run.summary['residual']['relative_rms']:.2f} % left"
        return psnr(image, card.photographs[left_out]), run.summary["seconds"]["texture"], left


def seen(card: Card, number: int) -> SurfaceView:
    """See the card from where a photograph was taken."""
    return observe(card.capture.frames[number].camera, read_mesh(card.folder / "shape.obj"))


class Adam:
    """The same maps in Mitsuba, one scene and sensor for each photograph."""

    def __init__(self, card: Card, size: int):
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        self.mi, self.card = mi, card
        (low, _, _), (high, _, _) = read_mesh(card.folder / "shape.obj").bounds()
        shape = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().scale([(high - low) / 2, (high - low) / 2, 1]),
            "bsdf": self._material(size),
        }
        light = {"type": "point", "position": [0, 0, 1], "intensity": _rgb(1.0)}
        self.scene = mi.load_dict({"type": "scene", "light": light, "card": shape})
        self.integrator = mi.load_dict({"type": "direct"})
        self.sensors = [mi.load_dict(_sensor(mi, one.camera)) for one in card.capture.frames]
        self.params = mi.traverse(self.scene)
        keys = [key for key, _ in self.params if key.endswith(".data")]
        ends = {
            "kd": ".reflectance.data",
            "ks": ".specular_reflectance.data",
            "alpha": ".alpha.data",
            "normal": ".normalmap.data",
        }
        self.maps = {name: next(k for k in keys if k.endswith(end)) for name, end in ends.items()}

    def _material(self, size: int) -> dict:
        def bitmap(value: float | list[float], channels: int) -> dict:
            image = np.full((size, size, channels), value, np.float32)
            return {"type": "bitmap", "bitmap": self.mi.Bitmap(image), "raw": True}

        facets = {
            "type": "roughconductor",
            "distribution": "ggx",
            "material": "none",
            "alpha": bitmap(START["alpha"], 1),
            "specular_reflectance": bitmap(2 * START["ks"], 3),
        }
        diffuse = {"type": "diffuse", "reflectance": bitmap(2 * np.pi * START["kd"], 3)}
        both = {"type": "blendbsdf", "weight": 0.5, "diffuse": diffuse, "facets": facets}
        return {"type": "normalmap", "normalmap": bitmap([0.5, 0.5, 1.0], 3), "bsdf": both}

    def render(self, number: int, seed: int = 0):
        """Render a photograph with the maps as they are."""
        flash = self.card.flash(number)
        position, intensity = np.asarray(flash.positions)[0], np.asarray(flash.intensity)[0]
        light = next(key.split(".")[0] for key, _ in self.params if "intensity" in key)
        self.params[f"{light}.position"] = self.mi.Point3f(*map(float, position))
        self.params[f"{light}.intensity.value"] = self.mi.Color3f(*map(float, intensity))
        self.params.update()
        sensor = self.sensors[number]
        return self.mi.render(
            self.scene,
            self.params,
            sensor=sensor,
            integrator=self.integrator,
            spp=SAMPLES,
            seed=seed,
        )

    def found(self, left_out: int, steps: int) -> tuple[float, float]:
        """Improve the maps without a photograph, and predict it: PSNR and seconds."""
        import drjit as dr

        mi, others = self.mi, [n for n in range(len(self.sensors)) if n != left_out]
        roots = {
            n: mi.TensorXf(np.sqrt(self.card.photographs[n]).astype(np.float32)) for n in others
        }
        begun, rng = time.perf_counter(), np.random.default_rng(0)
        adam = mi.ad.Adam(lr=RATE)
        for key in self.maps.values():
            adam[key] = self.params[key]
        self.params.update(adam)
        for step in range(steps):
            adam.set_learning_rate(RATE * (LAST_RATE / RATE) ** (step / steps))
            number = int(rng.choice(others))
            image = self.render(number, step)
            loss = dr.mean(dr.square(dr.sqrt(dr.maximum(image, 1e-6)) - roots[number]), axis=None)
            dr.backward(loss)
            adam.step()
            for name, key in self.maps.items():
                most = MOST_ALPHA if name in ("alpha", "normal") else math.inf
                adam[key] = dr.clip(adam[key], 0.0 if name == "normal" else LEAST, most)
            self.params.update(adam)
        image = np.asarray(self.render(left_out, steps))
        return psnr(image, self.card.photographs[left_out]), time.perf_counter() - begun


def _rgb(value: float) -> dict:
    return {"type": "rgb", "value": [value] * 3}


def _sensor(mi, camera) -> dict:
    assert isinstance(camera, Pinhole)
    flipped = camera.world_from_camera @ np.diag([-1.0, 1.0, -1.0, 1.0])
    film = {"type": "hdrfilm", "width": camera.width, "height": camera.height}
    return {
        "type": "perspective",
        "fov": math.degrees(2 * math.atan(camera.width / 2 / camera.fl_x)),
        "fov_axis": "x",
        "principal_point_offset_x": 0.5 - camera.cx / camera.width,
        "principal_point_offset_y": 0.5 - camera.cy / camera.height,
        "to_world": mi.ScalarTransform4f(flipped),
        "film": film | {"rfilter": {"type": "box"}, "pixel_format": "rgb"},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--left-out", type=int, default=3)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--alike", action="store_true")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    card = Card.read(options.folder)
    rows = []
    for left_out in np.linspace(0, len(card.photographs) - 1, options.left_out).astype(int):
        name = card.capture.frames[left_out].name
        decibel, seconds, left = ours(
            card, left_out, options.size, "single" if options.alike else "color"
        )
        rows.append([decibel, seconds])
        print(f"{name}: fit {decibel:.2f} dB in {seconds:.1f} s, {left}", flush=True)
        if not options.alike:
            rows[-1] += Adam(card, options.size).found(left_out, options.steps)
            print(f"{name}: Adam {rows[-1][2]:.2f} dB in {rows[-1][3]:.1f} s", flush=True)
    print("means:", " ".join(f"{mean:.2f}" for mean in np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
