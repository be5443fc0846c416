"""Stanford-ORB's layout made with Mitsuba: light maps a little off, and Adam on the same input.

    python experiments/orb_layout.py [--materials 2] [--probes 2] [--crosses FILE ...]
                                     [--mesh FILE] [--views 6] [--size 128] [--rows 64]
                                     [--samples 2000] [--steps 300] [--out FOLDER]

Materials of Mitsuba 3 (extra ``peers``) on an ellipsoid or a mesh, under probes; each photograph's
light map is turned by 3 degrees and off by 5 % in brightness (``orb_scenes.py``).  The commands
``import``, ``fit`` and ``evaluate`` run as typed: the fit takes the maps as a prior, and frees
rotation and brightness of each (``solve.free: [exposure, environment]``).  Beside it Adam improves
Mitsuba's ``principled`` material on the same photographs and maps, with a gain for each.  Its
renderer needs LLVM 17 or later (``DRJIT_LIBLLVM_PATH`` names its library).

Both predict views that were left out, and these under the next probe; the light is then the true
one.  Printed are PSNR-H, PSNR-L and SSIM by Stanford-ORB's protocol, the turn and the brightness
that are left in the maps, and seconds.  All is ``--materials 14 --probes 6 --crosses FILE FILE``.
Other probes than the crosses are drawn by ``scenes.py``.
"""

import argparse
import itertools
import json
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scenes
from commands import run
from first_hour import cameras
from orb_scenes import MATERIALS, SEEN, Maps, World, write_part, write_scene

from jaxrender.geometry import Mesh
from jaxrender.imaging import similarity
from jaxrender.imaging.display import exposure_for
from jaxrender.io import read_environment, read_mesh, write_environment, write_mesh
from jaxrender.lighting import Environment

# What Adam does: steps of one photograph each, its rates, samples a pixel, and where it begins.
STEPS, RATE, LAST_RATE, SAMPLES, LEAST = 300, 0.03, 0.003, 16, 0.02
PRINCIPLED = {
    "type": "principled",
    "base_color": {"type": "rgb", "value": [0.5, 0.5, 0.5]},
    "roughness": 0.4,
    "metallic": 0.5,
    "specular": 0.5,
}
FREE = [
    f"object.bsdf.{end}"
    for end in ("base_color.value", "roughness.value", "metallic.value", "specular")
]
# Probes that are drawn, after the crosses.
DRAWN = ("soft boxes", "sky", "interior", "broken", "discs")
MEASURES = ("psnr_hdr", "psnr_ldr", "ssim")


class Trial(NamedTuple):
    """A material under a probe, photographed there and under another."""

    folder: Path
    world: World
    probe: str
    other: str
    shots: dict[str, dict[int, np.ndarray]]
    maps: Maps
    samples: int

    @property
    def exposure(self) -> float:
        """The exposure of displays."""
        inside = [p[..., :3][p[..., 3] > SEEN] for p in self.shots[self.probe].values()]
        return float(exposure_for(np.concatenate(inside).ravel()))

    def ours(self) -> tuple[dict[str, np.ndarray], tuple[float, float], float]:
        """Type the commands: measures by light, what is left of the maps' faults, seconds."""
        scene = write_scene(self.folder, self.world, self.shots[self.probe], self.maps, self.probe)
        capture, result = self.folder / "capture", self.folder / "result"
        seconds = run("import", scene, "--out", capture)
        options = [f"output={result}", "solve.free=[exposure,environment]"]
        options += ["brdf.ks_per_channel=true", f"samples.count={self.samples}"]
        seconds += run("fit", capture / "capture.yaml", *options)
        found = json.loads((result / "result.json").read_text())
        print(f"outcome {found['outcome']}: {found['brdf']}", flush=True)
        measured = {}
        for light in (self.probe, self.other):
            place = self.folder / light.replace(" ", "_")
            held = {at: self.shots[light][at] for at in self.world.left_out}
            cameras_of = write_part(place, "held", self.world, held)
            write_environment(place / "light.exr", self.world.coarse(light))
            told = ("--photographs", cameras_of, "--environment", place / "light.exr")
            shown = ("--exposure", f"{self.exposure:.4g}", "--out", place / "compared")
            run("evaluate", result, *told, *shown)
            mean = json.loads((place / "compared" / "evaluation.json").read_text())["mean"]
            measured[light] = np.array([mean[name] for name in MEASURES])
        return measured, self.maps.left(found["calibration"]), seconds


class Adam:
    """Mitsuba's ``principled`` material on the photographs and maps of a trial, improved."""

    def __init__(self, trial: Trial):
        world, mi = trial.world, trial.world.mi
        self.trial, self.world = trial, world
        self.scenes, self.roots, self.masks = [], [], []
        for place, at in enumerate(world.given):
            own = trial.maps.map(world, trial.probe, place, np.eye(3))
            self.scenes.append(world.scene(PRINCIPLED, own))
            picture = trial.shots[trial.probe][at]
            root = np.sqrt(trial.exposure * picture[..., :3].clip(0))
            self.roots.append(mi.TensorXf(root.astype(np.float32)))
            self.masks.append(mi.TensorXf((picture[..., 3:] > SEEN).astype(np.float32)))
        self.params = [mi.traverse(one) for one in self.scenes]
        self.sensors = [world.sensor(at) for at in world.given]
        self.adam = mi.ad.Adam(lr=RATE)
        for key in FREE:
            self.adam[key] = self.params[0][key]
        for place in range(len(self.scenes)):
            self.adam[f"gain {place}"] = mi.Float(1.0)

    def improve(self, steps: int) -> float:
        """Take steps of a photograph each; returns seconds."""
        import drjit as dr

        mi, begun, rng = self.world.mi, time.perf_counter(), np.random.default_rng(0)
        direct = self.world.integrator()
        for step in range(steps):
            self.adam.set_learning_rate(RATE * (LAST_RATE / RATE) ** (step / steps))
            place = int(rng.integers(len(self.scenes)))
            params = self.told(self.params[place])
            scene, sensor = self.scenes[place], self.sensors[place]
            image = mi.render(
                scene, params, sensor=sensor, integrator=direct, spp=SAMPLES, seed=step
            )
            shown = self.trial.exposure * self.adam[f"gain {place}"] * image[..., :3]
            off = dr.sqrt(dr.maximum(shown, 1e-6)) - self.roots[place]
            dr.backward(dr.mean(dr.square(self.masks[place] * off), axis=None))
            self.adam.step()
            for key in FREE:
                self.adam[key] = dr.clip(self.adam[key], LEAST, 1.0)
        return time.perf_counter() - begun

    def told(self, params: Any) -> Any:
        """Tell a scene the material as it is now."""
        for key in FREE:
            params[key] = self.adam[key]
        params.update()
        return params

    def measured(self) -> dict[str, np.ndarray]:
        """Compare the views that were left out with what is predicted, as ``evaluate`` does."""
        trial, found = self.trial, {}
        values = {key: np.array(self.adam[key]).ravel().round(3).tolist() for key in FREE}
        print(f"Adam: {values}", flush=True)
        for name in (trial.probe, trial.other):
            scene = self.world.scene(PRINCIPLED, self.world.coarse(name))
            self.told(self.world.mi.traverse(scene))
            pictures = self.world.photographs(scene, self.world.left_out)
            alike = []
            for at, predicted in zip(self.world.left_out, pictures):
                truth = trial.shots[name][at]
                both, mask = (predicted[..., :3], truth[..., :3]), truth[..., 3] > SEEN
                alike.append(similarity(*both, mask, exposure=trial.exposure))
            every = [[getattr(one, measure) for measure in MEASURES] for one in alike]
            found[name] = np.mean(every, axis=0)
        return found


def probes(count: int, crosses: list[Path]) -> dict[str, Environment]:
    """Read crosses, and draw the other probes."""
    rows = scenes.FINE_ROWS
    found = {path.stem: read_environment(path, "cross", height=rows) for path in crosses}
    found |= {name: scenes.probe(name, 1) for name in DRAWN}
    return dict(list(found.items())[:count])


def trial(world: World, name: str, at: int, number: int, shots: dict, samples: int) -> Trial:
    """Photograph a material under a probe and the next, unless it was before."""
    folder = world.mesh.parent / f"{number:02d}"
    names = list(world.probes)
    probe, other = names[at], names[(at + 1) % len(names)]
    for light in (probe, other):
        if (name, light) not in shots:
            scene = world.scene(MATERIALS[name], world.probes[light])
            pictures = world.photographs(scene, list(range(len(world.eyes))))
            shots[name, light] = dict(enumerate(pictures))
    own = {light: shots[name, light] for light in (probe, other)}
    maps = Maps.drawn(len(world.given), number)
    return Trial(folder, world, probe, other, own, maps, samples)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("orb_layout"))
    parser.add_argument("--materials", type=int, default=2, choices=range(1, len(MATERIALS) + 1))
    parser.add_argument("--probes", type=int, default=2, choices=range(2, 7))
    parser.add_argument("--crosses", type=Path, nargs="*", default=[])
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--views", type=int, default=6)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--rows", type=int, default=64, choices=(64, 128))
    parser.add_argument("--samples", type=int, default=2000)
    parser.add_argument("--steps", type=int, default=STEPS)
    options = parser.parse_args()
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mesh = (
        Mesh.ellipsoid(np.array([1.0, 0.8, 0.65]), 5)
        if options.mesh is None
        else read_mesh(options.mesh)
    )
    options.out.mkdir(parents=True)
    write_mesh(options.out / "mesh.ply", mesh)
    eyes = cameras(mesh, options.views, options.size)
    light = probes(options.probes, options.crosses)
    world = World(mi, options.out / "mesh.ply", eyes, light, options.rows)
    rows, shots = [], {}
    names = list(MATERIALS)[: options.materials]
    for number, (name, at) in enumerate(itertools.product(names, range(len(world.probes)))):
        one = trial(world, name, at, number, shots, options.samples)
        ours, left, seconds = one.ours()
        adam = Adam(one)
        spent = adam.improve(options.steps)
        theirs = adam.measured()
        rows.append([*np.concatenate([m[light] for light in ours for m in (ours, theirs)])])
        rows[-1] += [*left, seconds, spent]
        row(f"{name}, {one.probe}", rows[-1])
    print("\nPSNR-H, PSNR-L, SSIM, left out under the same light: ours, Adam; relit: ours, Adam;")
    print("turn and brightness left in the maps: degrees, per cent; seconds of both")
    for values, (name, at) in zip(rows, itertools.product(names, world.probes)):
        row(f"{name}, {at}", values)
    row("mean", np.mean(rows, axis=0).tolist())


def row(name: str, values: list[float]) -> None:
    """Print the measures of one trial."""
    parts = [f"{values[k]:6.2f} {values[k + 1]:6.2f} {values[k + 2]:.4f}" for k in range(0, 12, 3)]
    turn, bright, seconds, spent = values[12:]
    print(
        f"{name:28s}", " | ".join(parts), f"| {turn:.2f} {bright:.2f} | {seconds:.0f} {spent:.0f}"
    )


if __name__ == "__main__":
    main()
