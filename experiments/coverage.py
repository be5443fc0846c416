"""Do 90 % intervals hold the truth in 90 % of repetitions?

    python experiments/coverage.py [--seeds 200]

Three smooth area lights and two lamps; photographs by the polar quadrature (continuous light, no
grid), the fit's exact integral on a 64 x 128 image.  Noise is relative + floor, drawn anew for each
seed and estimated by the fit.  All six parameters of all seeds are counted together and held
against the binomial 99.9 % band; they are correlated within a fit, so each is also counted alone.
"""

import argparse
import time

import jax
import numpy as np
import scenes
from scipy.stats import binom

from jaxrender.brdf import Microfacet
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, KnownLight, MicrofacetUnknowns, fit_brdf
from jaxrender.lighting import DirectionalSources, SmoothLobes

MATERIAL = Microfacet(np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.16, 1.62)
LIGHTS = SmoothLobes(
    scenes.unit(np.array([[1.0, 0.3, 0.8], [-0.6, 0.9, 0.4], [-0.4, -1.0, 0.2]])),
    np.radians([25.0, 40.0, 60.0]),
    np.array([[3.0, 2.8, 2.4], [1.2, 1.4, 1.6], [0.5, 0.6, 0.8]]),
)
LAMPS = DirectionalSources(
    np.array([[0.2, -0.7, 0.6], [-0.9, 0.1, 0.4]]), np.array([[0.5, 0.45, 0.4], [0.3, 0.3, 0.35]])
)
NOISE, FLOOR = 0.02, 0.01
SAMPLES, REFINED_SAMPLES, LOWEST_COSINE = 600, 300, 0.2
ROWS = 64
LABELS = ("kd red", "kd green", "kd blue", "ks", "sigma", "mu")
LEVEL, BAND = 0.9, 0.999


def flat(parameters) -> np.ndarray:
    """List kd of three channels, the shared ks, sigma and mu."""
    return np.array(
        [
            *np.asarray(parameters.kd),
            np.asarray(parameters.ks)[0],
            float(parameters.sigma),
            float(parameters.mu),
        ]
    )


def band(count: int) -> tuple[float, float]:
    low, high = binom.interval(BAND, count, LEVEL)
    return 100 * low / count, 100 * high / count


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    arguments = parser.parse_args()
    seeds, first = arguments.seeds, arguments.first
    jax.config.update("jax_enable_x64", True)
    samples, view = scenes.ring_samples(SAMPLES, LOWEST_COSINE, 0)
    exact = scenes.photograph_function(LIGHTS.radiance, MATERIAL, samples, view, LAMPS)
    light = KnownLight(LIGHTS.to_environment(ROWS), LAMPS)
    noise = NoiseModel(NOISE, FLOOR * float(exact.radiance.mean()))
    settings = FitSettings(refine_samples=REFINED_SAMPLES)
    truth, inside, scores = flat(MATERIAL), [], []
    start = time.perf_counter()
    for seed in range(seeds):
        noisy = exact._replace(
            radiance=noise.add(exact.radiance, np.random.default_rng(5000 + first + seed))
        )
        fit = fit_brdf(noisy, light, MicrofacetUnknowns(), MATERIAL, settings._replace(seed=seed))
        found = fit.parameters
        inside.append((flat(found.lower) <= truth) & (truth <= flat(found.upper)))
        scores.append((flat(found.value) - truth) / flat(found.standard_error))
        if seed % 20 == 19:
            print(
                f"  {seed + 1} seeds, {100 * np.mean(inside):.1f} %, "
                f"{time.perf_counter() - start:.0f} s",
                flush=True,
            )
    report(np.array(inside), np.array(scores))


def report(inside: np.ndarray, scores: np.ndarray):
    """Print the coverage of each parameter and of all together beside the binomial band."""
    seeds = len(inside)
    print(f"\n{seeds} noise seeds: truth inside the 90 % interval, per cent")
    print("  parameter   inside   band 99.9 %     mean and rms of (value - truth) / s.e.")
    low, high = band(seeds)
    for label, column, score in zip(LABELS, inside.T, scores.T):
        print(
            f"  {label:10s} {100 * column.mean():7.1f}   {low:.1f} to {high:.1f}   "
            f"{score.mean():8.2f} {np.sqrt(np.mean(score**2)):6.2f}"
        )
    low, high = band(inside.size)
    together = 100 * inside.mean()
    print(
        f"  {'together':10s} {together:7.1f}   {low:.1f} to {high:.1f}   "
        f"{'inside' if low <= together <= high else 'OUTSIDE'} the band"
    )


if __name__ == "__main__":
    main()
