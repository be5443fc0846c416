"""Measured materials, photographed by the integral with the measurement as truth, and relit.

    python experiments/materials.py [--paints FILE ...] [--networks ZIP] [--ball FOLDER]
        [--probes FILE FILE --convention cross] [--count 100] [--models ggx bank] [--table]

Paints and networks (small ones fitted to MERL, six inputs: half and difference vector) are balls
under a probe and a lamp, seen from twelve sides with .5 % noise.  What is found is then relit by
another probe, by that with a small sun, and by a lamp, seen from elsewhere, at exit cosines above
.15: rms, median pixel, and the median of error over stated error; with ``--table`` also as
corrected by a table.  ``--lamp`` has the networks
under one lamp at 5 to 105 degrees instead, and tests between.  ``--ball`` is a folder of real
photographs under distant lamps, of which every third is kept back.
"""

import argparse
import time
import zipfile
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from measured import Truth, network, photographed, table
from relit_balls import (
    LOWEST_COSINE,
    NOISE,
    PIXELS,
    VIEWS,
    around,
    ball,
    columns,
    compared,
    fitted,
    found_by,
    lamp,
    pictures,
    probes,
    relit,
)
from scenes import unit

from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse import BRDFFit, KnownLight, Observations
from jaxrender.inverse.brdf_table import correct_by_table
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel
from jaxrender.io import read_image
from jaxrender.lighting import DirectionalSources, Environment

SEEN = 14_000
LAMP_FITTED, LAMP_TESTED = range(5, 106, 20), range(15, 96, 20)
BALL_RADIUS, BALL_CENTRE, SATURATED, HIGHLIGHT = 70.751, (2.370, -8.368), 0.999, 8.0


def under_probes(truths: dict[str, Truth], options: argparse.Namespace) -> None:
    one, other = probes(options.probes, options.convention)
    told = KnownLight(one, lamp([1.0, -1.0, 1.2], 1.5))
    others = {
        "probe": KnownLight(other, DirectionalSources.none(3)),
        "sun": KnownLight(Environment(0.3 * np.asarray(other.radiance)), lamp([-1, 0.4, 0.8], 3.0)),
        "lamp": KnownLight(None, lamp([0.2, 1.0, 0.3], 3.0)),
    }
    samples, frame = ball(around(VIEWS), PIXELS // 2, 0)
    aside, frame_aside = ball(around(7), PIXELS // 4, 1)
    every: dict[str, list[np.ndarray]] = {}
    for name, truth in truths.items():
        exact = photographed(truth, samples, frame, told)
        noise = np.random.default_rng(2).standard_normal(exact.shape)
        observations = Observations(samples, exact * (1 + NOISE * noise), frame)
        pictures = {key: photographed(truth, aside, frame_aside, by) for key, by in others.items()}
        for model in options.models:
            start = time.perf_counter()
            fit = fitted(model, observations, told)
            seconds = time.perf_counter() - start
            results = [
                relit(fit, pictures[key], columns(found_by(fit), aside, frame_aside, by))
                for key, by in others.items()
            ]
            if options.table:
                elsewhere = Aside(aside, frame_aside, others, pictures)
                corrected(f"{name:28s} {model:6s}", fit, told, elsewhere)
            used = int(np.sum(np.any(np.asarray(fit.brdf.amplitudes) > 0, axis=1)))
            print(
                f"{name:28s} {model:6s} left {100 * fit.final.relative_rms:5.2f}  "
                + "  ".join(
                    f"{key} {r.rms:5.2f} {r.median:5.2f} z {r.stated:4.1f}"
                    for key, r in zip(others, results)
                )
                + f"  {used} lobes, {seconds:.1f} s",
                flush=True,
            )
            every.setdefault(model, []).append(np.array(results).ravel())
    for model, rows in every.items():
        median, most = np.median(rows, axis=0), np.quantile(rows, 0.9, axis=0)
        print(f"{model}: median {np.round(median, 2)}, 90th percentile {np.round(most, 2)}")


class Aside(NamedTuple):
    """Where the material is looked at from elsewhere, under which lights, and what is seen."""

    samples: SurfaceSamples
    frame: np.ndarray
    lights: dict[str, KnownLight]
    pictures: dict[str, np.ndarray]


def corrected(title: str, fit: BRDFFit, told: KnownLight, aside: Aside) -> None:
    """Correct the material by a table, and relight it."""
    start = time.perf_counter()
    correction = correct_by_table(fit, told)
    seconds = time.perf_counter() - start
    results = []
    for key, light in aside.lights.items():
        nodes = exact_nodes(light, aside.frame, float(fit.brdf.width))
        found = correction.predict(ExactModel(fit.brdf, aside.samples, nodes))
        stated = np.maximum(found.deviation, 1e-30)
        results.append((key, compared(found.radiance, stated, aside.pictures[key])))
    print(
        f"{title} and its table: left {100 * correction.before:.1f}, {100 * correction.after:.2f}  "
        + "  ".join(f"{key} {r.rms:5.2f} {r.median:5.2f} z {r.stated:4.1f}" for key, r in results)
        + f"  {seconds:.1f} s",
        flush=True,
    )


def lamps_about(degrees: range) -> tuple[DirectionalSources, ...]:
    angles = np.radians(list(degrees))
    return tuple(lamp([np.sin(a), 0.0, np.cos(a)], np.pi) for a in angles)


def under_a_lamp(truths: dict[str, Truth], options: argparse.Namespace) -> None:
    none = DirectionalSources.none(3)
    every: dict[str, list[float]] = {}
    for name, truth in truths.items():
        taken = {}
        for key, degrees in (("fitted", LAMP_FITTED), ("tested", LAMP_TESTED)):
            sources = lamps_about(degrees)
            samples, frame = pictures(len(sources))
            light = KnownLight(None, none, sources)
            pixels = photographed(truth, samples, frame, light)
            lit = np.any(pixels > 0, axis=1)
            # As many of every material, so that all share their programs.
            kept = np.resize(np.random.default_rng(3).permutation(np.nonzero(lit)[0]), SEEN)
            samples = SurfaceSamples(*(np.asarray(a)[kept] for a in samples))
            taken[key] = Observations(samples, pixels[kept], frame[kept]), light
        seen, light = taken["tested"]
        for model in options.models:
            start = time.perf_counter()
            fit = fitted(model, *taken["fitted"])
            seconds = time.perf_counter() - start
            found = columns(found_by(fit), seen.samples, seen.frame, light)
            result = relit(fit, np.asarray(seen.radiance), found)
            every.setdefault(model, []).append(result.rms)
            print(f"{name:28s} {model:6s} {result} {seconds:.1f} s", flush=True)
    for model, found in every.items():
        print(
            f"{model}: {len(found)} materials, rms of pictures kept back: median "
            f"{np.median(found):.1f} %, 90th percentile {np.quantile(found, 0.9):.1f} %"
        )


def real_ball(options: argparse.Namespace) -> None:
    folder = options.ball
    directions = np.loadtxt(folder / "light_directions.txt")
    energies = np.loadtxt(folder / "light_intensities.txt")
    files = sorted(folder.glob("[0-9]*.png"))
    mask = read_image(folder / "mask.png").pixels[..., 0] > 0.5
    rows, places = np.nonzero(mask)
    x = (places + 0.5 - mask.shape[1] / 2 - BALL_CENTRE[0]) / BALL_RADIUS
    y = (mask.shape[0] / 2 - rows - 0.5 - BALL_CENTRE[1]) / BALL_RADIUS
    there = x**2 + y**2 < 1 - LOWEST_COSINE**2
    rows, places, x, y = rows[there], places[there], x[there], y[there]
    normals = np.stack([x, y, np.sqrt(1 - x**2 - y**2)], axis=1)
    outgoing = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    rng = np.random.default_rng(0)

    def gathered(numbers: list[int], part: float) -> Observations:
        pixels, kept, frames = [], [], []
        for at, number in enumerate(numbers):
            image = read_image(files[number]).pixels[rows, places]
            used = np.all(image < SATURATED, axis=1) & (normals @ directions[number] > 0.05)
            used &= rng.uniform(size=len(used)) < part
            pixels.append(image[used] / energies[number])
            kept.append(np.nonzero(used)[0])
            frames.append(np.full(int(used.sum()), at))
        index = np.concatenate(kept)
        samples = SurfaceSamples(normals[index], outgoing[index])
        return Observations(samples, np.concatenate(pixels).astype(float), np.concatenate(frames))

    def light(numbers: list[int]) -> KnownLight:
        own = (DirectionalSources(directions[[n]], np.ones((1, 3))) for n in numbers)
        return KnownLight(None, DirectionalSources.none(3), tuple(own))

    back = [n for n in range(len(files)) if n % 3 == 1]
    fit_to = [n for n in range(len(files)) if n % 3 != 1]
    observations, kept_back = gathered(fit_to, 0.1), gathered(back, 0.3)
    half = unit(directions[back] + np.array([0.0, 0.0, 1.0]))[kept_back.frame]
    cosine = np.sum(np.asarray(kept_back.samples.normals) * half, axis=1)
    highlight = cosine > np.cos(np.radians(HIGHLIGHT))
    truth = np.asarray(kept_back.radiance)
    for model in options.models:
        start = time.perf_counter()
        fit = fitted(model, observations, light(fit_to))
        seconds = time.perf_counter() - start
        found = columns(found_by(fit), kept_back.samples, kept_back.frame, light(back))
        off = np.einsum("skc,kc->sc", found, np.asarray(found_by(fit).amplitudes)) - truth
        rms = [
            100 * np.sqrt(np.sum(off[part] ** 2) / np.sum(truth[part] ** 2))
            for part in (slice(None), highlight)
        ]
        print(
            f"real ball {model:6s} kept back {rms[0]:.2f} %, highlight {rms[1]:.1f} %, "
            f"{fit.outcome.value}, {seconds:.1f} s"
        )
        print("  " + "; ".join((f"narrowest {float(fit.brdf.width):.3g}", *fit.reasons)))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paints", nargs="+", default=[])
    parser.add_argument("--networks", type=Path)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--lamp", action="store_true")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--ball", type=Path)
    parser.add_argument("--probes", type=Path, nargs=2, default=[])
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--models", nargs="+", default=["ggx", "bank"])
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    truths = {Path(path).stem: table(path) for path in options.paints}
    if options.networks is not None:
        with zipfile.ZipFile(options.networks) as archive:
            names = sorted(name for name in archive.namelist() if name.endswith(".h5"))
            step = max(1, len(names) // options.count)
            truths |= {Path(n).stem: network(archive, n) for n in names[::step][: options.count]}
    if truths:
        (under_a_lamp if options.lamp else under_probes)(truths, options)
    if options.ball is not None:
        real_ball(options)


if __name__ == "__main__":
    main()
