"""The thesis's factorization beside ours: area light of degree 2 and a source, material unknown.

    python experiments/factorization_trial.py [--samples 8000] [--lowest 0.5]

Exact photographs (polar quadrature of the area light, the source's lobe as it is) of a ball from 12
views, 1 % noise.  The truth: ks / (kd + ks) .333, mu 1.5, sigma .12.  The nested method (T 6.4.4:
simplex over K_s and mu, light to degree 12 by F alone, roughness from the source by T 6.25, printed
and corrected) and ``factorize`` see the same samples.  Beside them the numbers of the trial that
the design rests on, whose light was another of this kind.
"""

import os

# Read when NumPy is imported: matrices of degree 12 are too small for a second thread to help.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scenes import photograph_function, ring_samples

from jaxrender.brdf import Microfacet
from jaxrender.harmonics import evaluate
from jaxrender.inverse import Observations
from jaxrender.inverse.factorization import FactorSettings, factorize
from jaxrender.inverse.factorization.gram import BinnedGram
from jaxrender.inverse.factorization.nested import BAND_LIMIT, Nested, factor_gram
from jaxrender.inverse.factorization.roughness import lobe_filter
from jaxrender.inverse.factorization.stream import Block, binned_gram
from jaxrender.lighting import DirectionalSources

MATERIAL = Microfacet(np.full(3, 0.2), np.full(3, 0.1), 0.12, 1.5)
AREA = np.array(
    [
        [3.0, 2.8, 2.6],
        [0.3, 0.2, 0.1],
        [0.8, 0.8, 0.9],
        [0.6, 0.5, 0.4],
        [0.2, 0.2, 0.1],
        [-0.2, -0.2, -0.2],
        [0.1, 0.1, 0.2],
        [0.15, 0.1, 0.1],
        [0.2, 0.1, 0.0],
    ]
)
SOURCE = DirectionalSources(np.array([[-0.35, 0.8, 0.5]]), np.array([[1.2, 1.15, 1.05]]))
NOISE = 0.01


class Trial(NamedTuple):
    """Noisy photographs, their binned sums, and what the nested method makes of them."""

    photographs: Observations
    gram: BinnedGram
    nested: Nested


def nested_trial(count: int, lowest_cosine: float) -> Trial:
    """Photograph the ball and factor the photographs by the nested method."""
    samples, view = ring_samples(count, lowest_cosine, seed=3)
    exact = photograph_function(
        lambda towards: evaluate(jnp.asarray(AREA), towards), MATERIAL, samples, view, SOURCE
    )
    noise = 1 + NOISE * np.random.default_rng(1).standard_normal(exact.radiance.shape)
    photographs = Observations(samples, np.asarray(exact.radiance) * noise, view)
    gram = binned_gram([Block(samples, photographs.radiance)], BAND_LIMIT)
    return Trial(photographs, gram, factor_gram(gram))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=8000)
    parser.add_argument("--lowest", type=float, default=0.5, help="lowest exit cosine")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    start = time.perf_counter()
    trial = nested_trial(arguments.samples, arguments.lowest)
    nested, middle = trial.nested, time.perf_counter()
    assert nested.mu is not None
    seen = lobe_filter(nested.brdf(0.1), BAND_LIMIT, trial.gram.nodes, trial.gram.counts)
    plain, averaged = nested.roughness(), nested.roughness(filtered_by=seen)
    ours = factorize(trial.photographs, MATERIAL, FactorSettings(2, 4))
    end = time.perf_counter()
    value = ours.parameters.value
    print(f"{'':44s} {'ks/(kd+ks)':>18s} {'mu':>7s} {'sigma':>7s} {'residual':>9s}")
    print(_row("truth", (1 / 3,), 1.5, 0.12, NOISE))
    print(_row("nested, the design's trial", (0.223,), 1.34, None, None))
    mu, rms = float(np.mean(nested.mu)), float(np.mean(nested.relative_rms))
    print(_row("nested, T 6.25 printed", nested.ks, mu, plain.printed, rms))
    print(_row("nested, T 6.25 corrected (T 6.7)", nested.ks, mu, plain.sigma, rms))
    print(_row("nested, corrected, lobe over exit angles", nested.ks, mu, averaged.sigma, rms))
    print(_row("factorize, the design's trial", (0.331,), 1.501, 0.1198, 0.0101))
    found = ours.relative_rms
    mu, sigma = (float(value.of(name)) for name in ("mu", "sigma"))
    print(_row("factorize", value.ks, mu, sigma, found))
    print(f"nested {middle - start:.1f} s with photographs, factorize {end - middle:.1f} s, cold")


def _row(name: str, share, mu: float, sigma: float | None, residual: float | None) -> str:
    shares = " ".join(f"{one:.3f}" for one in np.asarray(share))
    last = "" if residual is None else f"{100 * residual:.2f} %"
    rough = "" if sigma is None else f"{sigma:.4f}"
    return f"{name:44s} {shares:>18s} {mu:7.3f} {rough:>7s} {last:>9s}"


if __name__ == "__main__":
    main()
