"""Do 90 % intervals hold the truth in 90 % of repetitions?

    python experiments/coverage_known_light.py [--seeds 200] [--model anisotropic-ward]

Three smooth area lights and two sources; photographs by the polar quadrature (continuous light, no
grid), the fit's exact integral on a 64 x 128 image.  Noise is relative + floor, drawn anew for each
seed and estimated by the fit.  All parameters of all seeds are counted together and held against
the binomial 99.9 % band; they are correlated within a fit, so each is also counted alone.  Models
besides the thesis's are those without a frequency view, fitted by the integral alone, and
he-torrance's series, which is dear to compile.
"""

import argparse
import time

import jax
import numpy as np
import scenes
from scipy.stats import binom

from jaxrender.brdf import (
    AnisotropicWard,
    HeTorranceLobe,
    KajiyaKay,
    Microfacet,
    OrenNayarLobe,
    Parametric,
)
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, KnownLight, fit_brdf, unknowns_of
from jaxrender.inverse.parameters import Parameters
from jaxrender.lighting import DirectionalSources, SmoothLobes

KD, KS = np.array([0.19, 0.11, 0.07]), np.full(3, 0.21)
MODELS = {
    "microfacet": Microfacet(KD, KS, 0.16, 1.62),
    "anisotropic-ward": AnisotropicWard(KD, KS, 0.12, 0.35),
    "he-torrance": HeTorranceLobe(KD, KS, 0.16),
    "kajiya-kay": KajiyaKay(KD, KS, 30.0),
    "oren-nayar": OrenNayarLobe(KD, 0.5),
}
LIGHTS = SmoothLobes(
    scenes.unit(np.array([[1.0, 0.3, 0.8], [-0.6, 0.9, 0.4], [-0.4, -1.0, 0.2]])),
    np.radians([25.0, 40.0, 60.0]),
    np.array([[3.0, 2.8, 2.4], [1.2, 1.4, 1.6], [0.5, 0.6, 0.8]]),
)
SOURCES = DirectionalSources(
    np.array([[0.2, -0.7, 0.6], [-0.9, 0.1, 0.4]]), np.array([[0.5, 0.45, 0.4], [0.3, 0.3, 0.35]])
)
NOISE, FLOOR = 0.02, 0.01
SAMPLES, REFINED_SAMPLES, LOWEST_COSINE = 600, 300, 0.2
ROWS = 64
LEVEL, BAND = 0.9, 0.999


def flat(parameters: Parameters, material: Parametric) -> dict[str, float]:
    """List what the material has, by its own names: an amplitude of each channel, or one of all."""
    found = {}
    for name in (*material.amplitude_names, *material.numbers):
        values = np.ravel(parameters.of(name))
        own = name == "kd"
        labels = [f"{name} {c}" for c in ("red", "green", "blue")] if own else [name]
        found |= dict(zip(labels, map(float, values)))
    return found


def band(count: int) -> tuple[float, float]:
    low, high = binom.interval(BAND, count, LEVEL)
    return 100 * low / count, 100 * high / count


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--model", choices=tuple(MODELS), default="microfacet")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    arguments = parser.parse_args()
    seeds, first = arguments.seeds, arguments.first
    jax.config.update("jax_enable_x64", True)
    samples, view = scenes.ring_samples(SAMPLES, LOWEST_COSINE, 0)
    material = MODELS[arguments.model]
    exact = scenes.photograph_function(LIGHTS.radiance, material, samples, view, SOURCES)
    light = KnownLight(LIGHTS.to_environment(ROWS), SOURCES)
    noise = NoiseModel(NOISE, FLOOR * float(exact.radiance.mean()))
    settings = FitSettings(refine_samples=REFINED_SAMPLES)
    one = np.ones(())
    amplitudes = dict(zip(material.amplitude_names, np.asarray(material.amplitudes)))
    true_parameters = Parameters(amplitudes, material.numbers, one[None], one)
    truth = flat(true_parameters, material)
    kind = material.with_roughness(0.1, None if material.mu is None else 1.5)
    unknowns = unknowns_of(kind)
    inside, scores = [], []
    start = time.perf_counter()
    for seed in range(seeds):
        noisy = exact._replace(
            radiance=noise.add(exact.radiance, np.random.default_rng(5000 + first + seed))
        )
        fit = fit_brdf(noisy, light, unknowns, kind, settings._replace(seed=seed))
        value, low, high, error = (
            np.array(list(flat(part, material).values())) for part in fit.parameters[:4]
        )
        true = np.array(list(truth.values()))
        inside.append((low <= true) & (true <= high))
        scores.append((value - true) / error)
        if seed % 20 == 19:
            print(
                f"  {seed + 1} seeds, {100 * np.mean(inside):.1f} %, "
                f"{time.perf_counter() - start:.0f} s",
                flush=True,
            )
    report(list(truth), np.array(inside), np.array(scores))


def report(labels: list[str], inside: np.ndarray, scores: np.ndarray):
    """Print the coverage of each parameter and of all together beside the binomial band."""
    seeds = len(inside)
    print(f"\n{seeds} noise seeds: truth inside the 90 % interval, per cent")
    print("  parameter    inside   band 99.9 %     mean and rms of (value - truth) / s.e.")
    low, high = band(seeds)
    for label, column, score in zip(labels, inside.T, scores.T):
        print(
            f"  {label:11s} {100 * column.mean():7.1f}   {low:.1f} to {high:.1f}   "
            f"{score.mean():8.2f} {np.sqrt(np.mean(score**2)):6.2f}"
        )
    low, high = band(inside.size)
    together = 100 * inside.mean()
    print(
        f"  {'together':11s} {together:7.1f}   {low:.1f} to {high:.1f}   "
        f"{'inside' if low <= together <= high else 'OUTSIDE'} the band"
    )


if __name__ == "__main__":
    main()
