"""What can be known about a material under light that says little: uniform, and of degree 2.

    python experiments/identifiability.py

Photographs by the polar quadrature (continuous light, no grid) with 1 % noise; kd, ks, sigma and mu
all free.  Under uniform light the frequency model has no sensitivity to sigma at all: what is found
rests on grazing angles, where the horizon cuts the lobe, and is lost without them.
"""

import argparse
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import scenes

from jaxrender.brdf import Microfacet
from jaxrender.harmonics import LatLongGrid, evaluate
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import BRDFFit, FitSettings, KnownLight, fit_brdf, unknowns_of
from jaxrender.inverse.passes import values_of
from jaxrender.lighting import DirectionalSources, Environment

MATERIAL = Microfacet(np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.14, 1.62)
SAMPLES, NOISE, ROWS = 3000, 0.01, 128
LIMIT = 3.5
NAMES = ("kd", "ks", "sigma", "mu")
DEGREE_2 = np.array(
    [
        [3.0, 3.2, 3.4],
        [0.4, 0.3, 0.2],
        [0.7, 0.8, 0.9],
        [-0.5, -0.4, -0.4],
        [0.2, 0.1, 0.3],
        [-0.3, 0.2, 0.1],
        [0.3, 0.3, 0.2],
        [0.1, 0.2, -0.2],
        [0.3, 0.2, 0.3],
    ]
)


def uniform(directions) -> jax.Array:
    """One of each channel from everywhere."""
    return jnp.ones((directions.shape[0], 3))


def degree_two(directions) -> jax.Array:
    """Positive light of degree 2."""
    return evaluate(jnp.asarray(DEGREE_2), directions)


def environment_of(radiance_of: Callable) -> Environment:
    """Sample a light at the texels of an image."""
    directions = LatLongGrid(ROWS, 2 * ROWS).directions()
    image = np.asarray(radiance_of(jnp.asarray(directions.reshape(-1, 3))))
    return Environment(image.reshape(ROWS, 2 * ROWS, 3))


def fit_under(radiance_of: Callable, lowest_cosine: float, seed: int) -> tuple[BRDFFit, float]:
    """Photograph and fit; returns the fit, and its residual against the noise in per cent."""
    samples, view = scenes.ring_samples(SAMPLES, lowest_cosine, seed)
    exact = scenes.photograph_function(radiance_of, MATERIAL, samples, view)
    rng = np.random.default_rng(seed + 1)
    noisy = exact._replace(radiance=NoiseModel(NOISE, 0.0).add(exact.radiance, rng))
    light = KnownLight(environment_of(radiance_of), DirectionalSources.none())
    fit = fit_brdf(noisy, light, unknowns_of(MATERIAL), MATERIAL, FitSettings(seed=seed))
    return fit, scenes.residual_off_noise(fit, exact)


def report(title: str, fit: BRDFFit, off: float):
    """Print values, errors in standard errors, and what the fit says about itself."""
    print(
        f"\n{title}: {fit.outcome.value}; residual {100 * fit.final.relative_rms:.3f} %, "
        f"{off:+.2f} % off the noise; split: {fit.light.needed.count} sources"
    )
    print("           truth   value  frequency fit  standard error %  error / s.e.  identifiable")
    found, error, before = (
        fit.parameters.value,
        fit.parameters.standard_error,
        values_of(fit.frequency),
    )
    for name in NAMES:
        truth, value, spread, first = (
            np.ravel(np.asarray(part, float))
            for part in (getattr(MATERIAL, name), *(p.of(name) for p in (found, error, before)))
        )
        worst = int(np.argmax(np.abs(value - truth) / spread))
        score = (value - truth)[worst] / spread[worst]
        flag = "" if abs(score) <= LIMIT else "  OVER 3.5"
        print(
            f"  {name:6s} {truth[worst]:8.4f} {value[worst]:7.4f} {first[worst]:10.4f} "
            f"{100 * spread[worst] / value[worst]:15.2f} {score:17.2f}"
            f"{fit.identifiable[name]!s:>14s}{flag}"
        )
    print(f"  evidence: {fit.evidence.sentence()}")
    for reason in fit.reasons:
        print(f"  reason: {reason}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    seed = parser.parse_args().seed
    jax.config.update("jax_enable_x64", True)
    start = time.perf_counter()
    for title, light, cosine in (
        ("uniform light, exit cosines above .7", uniform, 0.7),
        ("uniform light, exit cosines down to .15", uniform, 0.15),
        ("light of degree 2, exit cosines down to .15", degree_two, 0.15),
    ):
        report(title, *fit_under(light, cosine, seed))
    print(f"\n{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
