"""How exact a fit is under known light: the frequency fit with the automatic split, and refined.

    python experiments/frequency_fit.py [--cases 20] [--probes FILE ...] [--only SEED ...]

Random probes and materials (``scenes.py``), photographed from twelve views on a ring with exit
cosines above .3 by the integral over 256 x 512 texels; the fit is given the light at 128 x 256.
The frequency fit is judged on exact photographs, the refined one on photographs with 1 % noise.
``--probes`` adds vertical cross probes.  Writes ``experiments/out/frequency_fit.png``.
"""

import argparse
import os
import time
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import scenes

from jaxrender.brdf import Microfacet, Parametric
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import BRDFFit, FitSettings, KnownLight, fit_brdf, unknowns_of
from jaxrender.io import read_environment
from jaxrender.lighting import DirectionalSources

OUT = Path(__file__).parent / "out"
NAMES = ("kd", "ks", "sigma", "mu")
# What is demanded, in per cent: the median before refinement (none over four times that) ...
FREQUENCY = {"kd": 0.5, "ks": 1.0, "sigma": 0.5, "mu": 1.0}
# ... and every case after it, or three standard errors where they are larger.
REFINED = {"kd": 0.3, "ks": 0.5, "sigma": 0.3, "mu": 0.7}
SHARP_SIGMA, SHARP_LIMIT = 0.05, 3.0
NOISE, NOISE_LIMIT = 0.01, 3.0
SAMPLES, LOWEST_COSINE = 3000, 0.3


class Row(NamedTuple):
    """One case: errors in per cent before and after refinement, with what they are held against."""

    name: str
    material: Microfacet
    frequency: dict[str, float]
    refined: dict[str, float]
    limit: dict[str, float]
    noise_off: float
    sources: int
    split_error: float
    spread: dict[str, float]


def errors(found: Parametric, material: Microfacet) -> dict[str, float]:
    """Compute the largest relative error over channels, per cent."""
    truth = {name: np.asarray(getattr(material, name), float) for name in NAMES}
    return {
        name: 100 * float(np.max(np.abs(np.asarray(getattr(found, name)) / truth[name] - 1)))
        for name in NAMES
    }


def limits(fit: BRDFFit, material: Microfacet) -> tuple[dict[str, float], dict[str, float]]:
    """Take the larger of the fixed limit and three standard errors, and the latter, per cent."""
    spread = {
        name: 100
        * float(
            np.max(
                fit.parameters.standard_error.of(name) / np.asarray(getattr(material, name), float)
            )
        )
        for name in NAMES
    }
    return {name: max(REFINED[name], 3 * spread[name]) for name in NAMES}, spread


def run_case(scene: scenes.Scene, seed: int, sharp: bool) -> Row:
    """Photograph a scene, fit it without noise in frequency and with noise to the end."""
    samples, view = scenes.ring_samples(SAMPLES, LOWEST_COSINE, seed)
    exact = scenes.photograph(scene.fine.nodes(), scene.material, samples, view)
    light = KnownLight(scenes.coarser(scene.fine), DirectionalSources.none())
    settings = FitSettings(refine=False)
    fit = fit_brdf(exact, light, unknowns_of(scene.material), scene.material, settings)
    before = errors(fit.brdf, scene.material)
    needed = fit.light.needed
    count, split_error = (needed.count, 100 * needed.error) if needed else (0, 0.0)
    if sharp:
        empty = dict.fromkeys(NAMES, np.nan)
        return Row(
            scene.name, scene.material, before, empty, empty, np.nan, count, split_error, empty
        )
    rng = np.random.default_rng(1000 + seed)
    noisy = exact._replace(radiance=NoiseModel(NOISE, 0.0).add(exact.radiance, rng))
    fit = fit_brdf(noisy, light, unknowns_of(scene.material), scene.material, FitSettings())
    after = errors(fit.brdf, scene.material)
    limit, spread = limits(fit, scene.material)
    off = scenes.residual_off_noise(fit, exact)
    return Row(
        scene.name,
        scene.material,
        before,
        after,
        limit,
        off,
        count,
        split_error,
        spread,
    )


def synthetic(seed: int, sigma: float | None = None) -> scenes.Scene:
    """Draw case number ``seed``: the kinds of light take turns."""
    kind = list(scenes.PROBES)[seed % len(scenes.PROBES)]
    brdf = scenes.material(np.random.default_rng(seed), sigma)
    return scenes.Scene(kind, scenes.probe(kind, seed), brdf)


def from_files(paths: list[Path], seed: int) -> list[scenes.Scene]:
    """Put three random materials under each probe that is given as a file."""
    found = []
    for index, path in enumerate(paths):
        fine = read_environment(path, "cross", height=scenes.FINE_ROWS)
        for turn in range(3):
            rng = np.random.default_rng(seed + 10 * index + turn)
            found.append(scenes.Scene(path.stem[:10], fine, scenes.material(rng)))
    return found


def line(index: int, row: Row) -> str:
    brdf = row.material
    truth = f"{float(np.min(brdf.kd)):.2f} {float(brdf.ks[0]):.2f} {brdf.sigma:.3f} {brdf.mu:.2f}"
    before = " ".join(f"{row.frequency[name]:6.2f}" for name in NAMES)
    after = " ".join(f"{row.refined[name]:5.2f}/{row.limit[name]:4.2f}" for name in NAMES)
    return (
        f"{index:3d} {row.name:10s} {truth} | {before} | {after} {row.noise_off:6.2f} | "
        f"{row.sources:5d} {row.split_error:5.1f}"
    )


def header():
    print(
        f"{'':14s} {'kd ks sigma mu (truth)':19s} | {'frequency fit, error %':27s} | "
        f"{'refined, error % / allowed':44s} rms off | sources, split error %"
    )
    print(
        f"{'':34s} | {'    kd     ks  sigma     mu':27s} | "
        f"{'kd         ks         sigma      mu':44s}"
    )


def report(rows: list[Row]):
    """Print medians and the worst beside what is demanded."""
    print("\nfrequency fit with the automatic split, exact data")
    print("          median  demanded   worst  demanded")
    for name in NAMES:
        all_errors = np.array([row.frequency[name] for row in rows])
        print(
            f"  {name:6s} {np.median(all_errors):7.2f} {FREQUENCY[name]:8.2f} "
            f"{all_errors.max():8.2f} {4 * FREQUENCY[name]:8.2f}  "
            f"cases over: {int(np.sum(all_errors > 4 * FREQUENCY[name]))} of {len(rows)}"
        )
    print("\nafter refinement, 1 % noise (allowed: the larger of a constant and 3 standard errors)")
    for name in NAMES:
        ratio = np.array([row.refined[name] / row.limit[name] for row in rows])
        median = np.median([row.refined[name] for row in rows])
        print(
            f"  {name:6s} median error {median:5.2f} %, worst error / allowed "
            f"{ratio.max():5.2f}  cases over: {int(np.sum(ratio > 1))} of {len(rows)}"
        )
    off = np.array([row.noise_off for row in rows])
    print(
        f"  relative rms against the noise: worst {np.abs(off).max():.2f} % off, demanded "
        f"{NOISE_LIMIT:.0f} %  cases over: {int(np.sum(np.abs(off) > NOISE_LIMIT))}"
    )


def compare_splits(seed: int):
    """Repeat the trial's comparison for one case: what the split is worth."""
    scene = synthetic(seed)
    samples, view = scenes.ring_samples(SAMPLES, LOWEST_COSINE, seed)
    exact = scenes.photograph(scene.fine.nodes(), scene.material, samples, view)
    noisy = exact._replace(
        radiance=NoiseModel(NOISE, 0.0).add(exact.radiance, np.random.default_rng(seed))
    )
    light = KnownLight(scenes.coarser(scene.fine), DirectionalSources.none())
    print(f"\nthe split, case {seed} ({scene.name}), 1 % noise, frequency fit, errors %")
    print("  split         sources  energy %     kd     ks  sigma     mu  residual %")
    # A number is the energy left in the slow part: "rough" takes the 64 strongest, unchecked.
    for split in ("off", "rough", "auto"):
        settings = FitSettings(split=split, refine=False)
        fit = fit_brdf(noisy, light, unknowns_of(scene.material), scene.material, settings)
        taken = fit.light.split
        found = errors(fit.brdf, scene.material)
        print(
            f"  {split:12s} {taken.sources.directions.shape[0]:8d} "
            f"{100 * (1 - taken.slow_energy):9.0f} "
            + " ".join(f"{found[name]:6.2f}" for name in NAMES)
            + f" {100 * fit.frequency.relative_rms:11.2f}"
        )


def draw(rows: list[Row]):
    """Draw every case's errors before and after refinement."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), sharey=True, layout="constrained")
    sigma = [row.material.sigma for row in rows]
    for axis, name in zip(axes, NAMES):
        axis.loglog(sigma, [row.frequency[name] for row in rows], "o", label="frequency fit")
        axis.loglog(sigma, [row.refined[name] for row in rows], "x", label="refined, 1 % noise")
        axis.loglog(sigma, [row.limit[name] for row in rows], "_", label="allowed, refined")
        axis.axhline(FREQUENCY[name], color="tab:blue", lw=0.7)
        axis.axhline(4 * FREQUENCY[name], color="tab:blue", lw=0.7, ls=":")
        axis.set(title=name, xlabel="sigma")
    axes[0].set_ylabel("error, per cent")
    axes[0].legend(fontsize=8)
    OUT.mkdir(exist_ok=True)
    figure.savefig(OUT / "frequency_fit.png", dpi=130)
    print(f"\nwritten: {OUT / 'frequency_fit.png'}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--probes", type=Path, nargs="*", default=[])
    parser.add_argument("--only", type=int, nargs="*")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    start = time.perf_counter()
    header()
    seeds = range(arguments.cases) if arguments.only is None else arguments.only
    scene_of_case = [(seed, synthetic(seed)) for seed in seeds]
    files = from_files(arguments.probes, 100)
    scene_of_case += [(100 + index, scene) for index, scene in enumerate(files)]
    rows = []
    for index, scene in scene_of_case:
        rows.append(run_case(scene, index, sharp=False))
        print(line(index, rows[-1]), flush=True)
    if rows:
        report(rows)
        draw(rows)
    print(f"\nsigma {SHARP_SIGMA} before refinement, error of sigma % (demanded {SHARP_LIMIT}):")
    for seed in range(5):
        row = run_case(synthetic(seed, SHARP_SIGMA), seed, sharp=True)
        found = " ".join(f"{name} {row.frequency[name]:5.2f}" for name in NAMES)
        print(f"  {row.name:10s} {found}, {row.sources} sources", flush=True)
    compare_splits(3)
    print(f"\n{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
