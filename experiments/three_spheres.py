"""How good a recovered light is to relight with: three spheres under the true and the found light.

    python experiments/three_spheres.py [--materials 2] [--first 0] [--probes FILE.hdr ...]

A ball of a random material (``scenes.py``) is photographed from nine sides under a probe, by the
integral over all texels, with 1 % noise.  Light and material are found from the photographs alone.
Then three spheres are rendered under both lights: a diffuse one, a matte silver one (GGX, width
.3), and a mirror.  ``--probes`` adds vertical cross probes to the five kinds of ``scenes.py``.

Printed for each sphere: the root mean square difference after the best scale, relative to the mean
radiance, and the mean angle between colours, in degrees.  A mirror shows detail that the lobe of
the photographed ball passes on nowhere.  So both lights are also compared as a metal of the ball's
own sigma shows them: that much is attainable.  A learned method from one photograph states .086,
.253, .482 and 1.26, 1.59, 2.00 degrees.  Writes ``experiments/out/three_spheres.png``: the spheres
of the first material under both lights.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import ball_worlds  # noqa: E402
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
import scenes  # noqa: E402

from jaxrender.brdf import Microfacet  # noqa: E402
from jaxrender.inverse import Observations  # noqa: E402
from jaxrender.inverse.factorization import Factorization, factorize  # noqa: E402
from jaxrender.inverse.leverage import draw, sharpness  # noqa: E402
from jaxrender.io import read_environment  # noqa: E402
from jaxrender.lighting import Environment  # noqa: E402
from jaxrender.pipelines.tasks.light import light_images  # noqa: E402
from jaxrender.reflection import LightDifference, compare_lights, three_spheres  # noqa: E402

OUT = Path(__file__).parent / "out"
VIEWS, SAMPLES, ROWS = 9, 12_000, 96
SPHERES = ("diffuse", "matte silver", "mirror", "attainable")
DEMANDED = {"diffuse": 0.03, "matte silver": 0.08}


class Trial(NamedTuple):
    """A probe and a material, what was found, and the spheres under it."""

    name: str
    material: Microfacet
    found: Factorization
    differences: dict[str, LightDifference]
    spheres: tuple[dict[str, np.ndarray], dict[str, np.ndarray]]
    seconds: float


def photographed(environment: Environment, material: Microfacet, seed: int) -> Observations:
    """Photograph a ball from nine sides."""
    plain = ball_worlds.clean(seed)
    world = plain._replace(
        cameras=plain.cameras[:VIEWS],
        environment=environment,
        material=material,
        irradiance=np.zeros(3),
    )
    return ball_worlds.photographs(world, world, seed)


def trial(name: str, environment: Environment, seed: int) -> Trial:
    """Photograph, factorize and compare."""
    environment = Environment(
        np.asarray(environment.radiance) / np.mean(np.asarray(environment.radiance))
    )
    material = scenes.material(np.random.default_rng(100 + seed))
    pool = photographed(environment, material, seed)
    some = draw(pool, sharpness(pool), SAMPLES, 0).observations
    begun = time.perf_counter()
    found = factorize(some, material, gauge="dielectric", pool=pool)
    seconds = time.perf_counter() - begun
    light = Environment(light_images(found.scene, found.rounds[-1].sigma).whole)
    own = compare_lights(light, environment, silver_width=float(material.sigma))
    differences = compare_lights(light, environment) | {"attainable": own["matte silver"]}
    spheres = three_spheres(environment), three_spheres(light)
    return Trial(name, material, found, differences, spheres, seconds)


def probes(files: list[Path], seed: int) -> dict[str, Environment]:
    """One probe of each kind, and those of files."""
    drawn = {kind: scenes.probe(kind, seed, ROWS) for kind in scenes.PROBES}
    read = {path.stem: read_environment(path, "cross", height=ROWS) for path in files}
    return {**drawn, **read}


def line(one: Trial) -> str:
    """Say it in a line."""
    scores = "  ".join(f"{d.scaled_rms:6.3f} {d.angle:5.2f}" for d in one.differences.values())
    return (
        f"{one.name:16s} {float(one.material.sigma):5.3f}  {scores}  "
        f"{one.found.outcome.value:10s} {one.seconds:5.1f} s"
    )


def painted(trials: list[Trial]) -> None:
    """Draw the spheres of every trial under the true light, and below under the found one."""
    kinds = SPHERES[:3]
    figure, axes = plt.subplots(
        2 * len(trials), len(kinds), figsize=(4.5, 3 * len(trials)), squeeze=False
    )
    for row, one in enumerate(trials):
        for column, kind in enumerate(kinds):
            top = np.quantile(one.spheres[0][kind], 0.98)
            for below, spheres in enumerate(one.spheres):
                panel = axes[2 * row + below, column]
                panel.imshow(np.clip(np.maximum(spheres[kind], 0) / top, 0, 1) ** (1 / 2.2))
                panel.axis("off")
                if not below:
                    scaled = one.differences[kind].scaled_rms
                    panel.set_title(f"{one.name}: {kind}, {scaled:.3f}", fontsize=7)
    figure.tight_layout()
    OUT.mkdir(exist_ok=True)
    figure.savefig(OUT / "three_spheres.png", dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--materials", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="the seed of the first material")
    parser.add_argument("--probes", nargs="*", type=Path, default=[])
    asked = parser.parse_args()
    print(f"{'light':16s} sigma  " + "  ".join(f"{kind:>12s}" for kind in SPHERES), flush=True)
    trials = []
    for seed in range(asked.first, asked.first + asked.materials):
        every = probes(asked.probes, seed)
        for number, (name, environment) in enumerate(every.items()):
            trials.append(trial(name, environment, (10 + len(every)) * seed + number))
            print(line(trials[-1]), flush=True)
        # Every case compiles programs of its own; more of them exhaust a process's memory maps.
        jax.clear_caches()
    for kind in SPHERES:
        rms, degrees = (
            np.array([getattr(one.differences[kind], name) for one in trials])
            for name in ("scaled_rms", "angle")
        )
        demanded = f" (demanded {DEMANDED[kind]})" if kind in DEMANDED else ""
        print(
            f"{kind}: median rms {np.median(rms):.3f}, largest {rms.max():.3f}{demanded}; "
            f"median {np.median(degrees):.2f} degrees"
        )
    painted(trials[: len(scenes.PROBES) + len(asked.probes)])


if __name__ == "__main__":
    main()
