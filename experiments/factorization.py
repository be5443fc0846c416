"""Light and material from photographs alone, under whole light probes: the flagship trial.

    python experiments/factorization.py [--pairs 10] [--probes FILE.hdr ...] [--samples 4000]

Random probes and materials (``scenes.py``; ``--probes`` adds vertical cross probes, which take
turns with them), photographed from twelve views on a ring with exit cosines above .15 by the
integral over 256 x 512 texels, with 1 % noise.  Given are photographs, cameras and shape alone.
Printed: the error of ks / (kd + ks), mu - 1 and sigma of every pair as sources are added, whether
the program said that it could tell, and the seconds of a second, warm run.  Writes
``experiments/out/factorization.png``: the path of the errors as sources are added, and the light of
the first pair, true and recovered.
"""

import argparse
import os
import time
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import scenes

from jaxrender.brdf import Microfacet
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.factorization import Factorization, FactorSettings, factorize
from jaxrender.io import read_environment
from jaxrender.lighting import Environment
from jaxrender.pipelines.tasks.light import light_images

OUT = Path(__file__).parent / "out"
# What is demanded of the medians: absolute, and per cent.
SHARE, INDEX, ROUGHNESS, SECONDS = 0.005, 3.0, 1.5, 10.0
LOWEST_COSINE, NOISE = 0.15, NoiseModel(0.01, 0.0)


class Pair(NamedTuple):
    """One probe and material: what was found, and by how much it is off."""

    scene: scenes.Scene
    found: Factorization
    share: float
    index: float
    roughness: float
    seconds: float


def errors(material: Microfacet, share: np.ndarray, sigma: float, mu: float) -> tuple:
    """Largest error of ks / (kd + ks), absolute; of mu - 1 and sigma, per cent."""
    kd, ks = np.asarray(material.kd), np.asarray(material.ks)
    return (
        float(np.max(np.abs(share - ks / (kd + ks)))),
        100 * abs((mu - 1) / (float(material.mu) - 1) - 1),
        100 * abs(sigma / float(material.sigma) - 1),
    )


def run(scene: scenes.Scene, seed: int, count: int) -> Pair:
    """Photograph a scene and factorize it."""
    samples, view = scenes.ring_samples(count, LOWEST_COSINE, seed)
    exact = scenes.photograph(scene.fine.nodes(), scene.material, samples, view)
    noisy = NOISE.add(exact.radiance, np.random.default_rng(1000 + seed))
    observations = exact._replace(radiance=noisy)
    settings = FactorSettings()
    # What depends on the number of sources taken up at once is compiled for each pair anew.
    factorize(observations, scene.material, settings)
    start = time.perf_counter()
    found = factorize(observations, scene.material, settings)
    seconds = time.perf_counter() - start
    last = found.rounds[-1]
    return Pair(scene, found, *errors(scene.material, last.share, last.sigma, last.mu), seconds)


def pairs(count: int, files: list[Path]) -> list[scenes.Scene]:
    """Draw materials; probes from files and synthetic ones take turns."""
    kinds, found = list(scenes.PROBES), []
    for seed in range(count):
        material = scenes.material(np.random.default_rng(100 + seed), None)
        if files and seed % 2 == 0:
            path = files[seed // 2 % len(files)]
            light = read_environment(path, "cross", height=scenes.FINE_ROWS)
            mean = float(np.mean(np.asarray(light.radiance)))
            light = Environment(np.asarray(light.radiance) / mean)
            found.append(scenes.Scene(path.stem, light, material))
        else:
            kind = kinds[seed % len(kinds)]
            found.append(scenes.Scene(kind, scenes.probe(kind, seed), material))
    return found


def report(found: list[Pair]):
    """Print every pair, and the medians beside what is demanded."""
    print(f"{'light':16s} sigma    mu  sources residual %  share  mu-1 %  sigma %  seconds  said")
    for pair in found:
        material, last = pair.scene.material, pair.found.rounds[-1]
        print(
            f"{pair.scene.name:16s} {float(material.sigma):5.3f} {float(material.mu):5.2f} "
            f"{last.sources:8d} {100 * last.relative_rms:10.2f} {pair.share:6.4f} "
            f"{pair.index:7.2f} {pair.roughness:8.2f} {pair.seconds:8.1f}  "
            f"{pair.found.outcome.value}{': ' if pair.found.reasons else ''}"
            f"{'; '.join(pair.found.reasons)[:60]}"
        )
    for name, demanded in (
        ("share", SHARE),
        ("index", INDEX),
        ("roughness", ROUGHNESS),
        ("seconds", SECONDS),
    ):
        median = float(np.median([getattr(pair, name) for pair in found]))
        verdict = "met" if median <= demanded else "MISSED"
        print(f"median {name:10s} {median:8.4f}  (demanded {demanded:g}: {verdict})")


def draw(found: list[Pair]):
    """Draw the errors as sources are added, and the first pair's light."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(12, 5.6), layout="constrained")
    titles = ("ks / (kd + ks), absolute", "mu - 1, %", "sigma, %")
    for pair in found:
        path = [
            errors(pair.scene.material, one.share, one.sigma, one.mu) for one in pair.found.rounds
        ]
        for axis, title, values in zip(axes[0], titles, zip(*path)):
            axis.semilogy(values, marker="o", ms=3, lw=1, label=pair.scene.name)
            axis.set(title=f"error of {title}", xlabel="round (last: refined)")
    axes[0, 0].legend(fontsize=6)
    first = found[0]
    material = first.scene.material
    total = np.asarray(material.kd) + np.asarray(material.ks)
    drawn = light_images(first.found.scene, first.found.rounds[-1].sigma)
    whole, slow = drawn.whole / total, drawn.slow / total
    truth = np.asarray(first.scene.fine.radiance)
    white = np.quantile(truth, 0.98)
    pictures = (truth, whole, slow)
    names = ("true light", "recovered: slow part and sources", "slow part alone")
    for axis, image, name in zip(axes[1], pictures, names):
        axis.imshow(np.clip(image / white, 0, 1) ** (1 / 2.2), extent=(0, 360, 0, 180))
        axis.set(title=name, xticks=[], yticks=[])
    x, y, z = np.asarray(first.found.scene.sources.directions).T
    energy = np.asarray(first.found.scene.sources.irradiance).sum(axis=1)
    axes[1, 1].scatter(
        np.degrees(np.arctan2(y, x)) % 360,
        180 - np.degrees(np.arccos(z)),
        s=120 * np.sqrt(energy / energy.max()),
        facecolors="none",
        edgecolors="orange",
    )
    OUT.mkdir(exist_ok=True)
    figure.savefig(OUT / "factorization.png", dpi=130)
    print("written: experiments/out/factorization.png")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--probes", nargs="*", type=Path, default=[])
    parser.add_argument("--samples", type=int, default=4000)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    found = []
    for seed, scene in enumerate(pairs(arguments.pairs, arguments.probes)):
        found.append(run(scene, seed, arguments.samples))
        print(f"{scene.name}: {found[-1].seconds:.0f} s", flush=True)
    report(found)
    draw(found)


if __name__ == "__main__":
    main()
