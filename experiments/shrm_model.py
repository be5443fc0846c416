"""The reflection map as a model of slow light, beside the azimuthal mean and the integral.

    python experiments/shrm_model.py [PROBE --convention cross] [--degree 16]

Specular column of samples all over a sphere, by range of the exit cosine: root mean square errors
relative to the integral (``reflect_slow_light``: every azimuthal order).  The mean keeps h_l of the
exact exit cosine and no azimuth; ``shrm-P`` keeps the orders to P and the viewer to degree P;
``azimuthal-P`` the same orders at the exact exit cosine.  Below, fits of a material whose light has
no source taken out of it, so that what is left of their errors is the model's: ``solve.model``
dual, shrm and azimuthal, none refined.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from scenes import unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import LatLongGrid, analyse, degrees, synthesise
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, KnownLight, Observations, fit_brdf, unknowns_of
from jaxrender.io import read_environment
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.reflection import (
    ViewFilter,
    integral_columns,
    mirror_light,
    radiance,
    reflect_mirror_light,
    reflect_slow_light,
)
from jaxrender.reflection.dual import slow_specular

VIEW_DEGREES = (0, 1, 2, 3, 4, 6, 8, 12)
COSINES = ((0.5, 1.0), (0.15, 0.5), (0.05, 0.15))


def light_of(options) -> np.ndarray:
    """Coefficients of the probe, or of a synthetic light of the same fall."""
    if options.probe is not None:
        probe = read_environment(options.probe, options.convention)
        return np.asarray(analyse(probe.grid, np.asarray(probe.radiance), options.degree))
    rng = np.random.default_rng(0)
    light = rng.standard_normal(((options.degree + 1) ** 2, 3))
    light = 0.3 * light / (1 + degrees(options.degree)[:, None])
    light[0] = 4
    return light


def samples_of(count: int, lowest: float, highest: float, seed: int) -> SurfaceSamples:
    """Normals all over the sphere, exit cosines uniform in a range."""
    rng = np.random.default_rng(seed)
    normals, aside = unit(rng.standard_normal((2, count, 3)))
    across = unit(aside - np.sum(aside * normals, axis=1, keepdims=True) * normals)
    cosine = rng.uniform(lowest, highest, (count, 1))
    return SurfaceSamples(normals, cosine * normals + np.sqrt(1 - cosine**2) * across)


def columns(light: np.ndarray, sigma: float) -> None:
    brdf = Microfacet(np.zeros(3), np.ones(3), sigma, 1.5)
    print(f"\nsigma {sigma}: relative rms error of the specular column, %, for P =")
    print(f"{'exit cosines':>14s}{'mean':>8s}" + "".join(f"{p:9d}" for p in VIEW_DEGREES))
    for lowest, highest in COSINES:
        samples = samples_of(600, lowest, highest, 1)
        exact = np.asarray(reflect_slow_light(brdf, samples, light))

        def error(found, exact=exact):
            return 100 * np.sqrt(np.sum((np.asarray(found) - exact) ** 2) / np.sum(exact**2))

        mean = error(slow_specular(brdf, samples, light))
        print(f"{lowest:7.2f} to {highest:.2f}{mean:8.2f}")
        for name in ("shrm", "azimuthal"):
            cells = [f"{name:>22s}"]
            for p in VIEW_DEGREES:
                seen, view = mirror_light(samples, light, p), ViewFilter.named(f"{name}-{p}")
                found = reflect_mirror_light(brdf, samples.exit_cosines, seen, view)
                cells.append(f"{error(found):9.2f}")
            print("".join(cells))


def fits(light: np.ndarray) -> None:
    grid = LatLongGrid(96, 192)
    image = np.asarray(synthesise(grid, light))
    image = np.maximum(image, 0)
    dark = DirectionalSources(np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3)))
    known = KnownLight(Environment(image), dark)
    truth = Microfacet(np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.2, 1.5)
    print("\nfits without refinement, 1 % noise: errors in % of kd (mean), ks, sigma, mu - 1")
    for lowest in (0.15, 0.05):
        samples = samples_of(3000, lowest, 1.0, 2)
        clean = np.asarray(radiance(truth, integral_columns(truth, samples, known_nodes(known))))
        noisy = NoiseModel(0.01, 1e-4).add(clean, np.random.default_rng(3))
        observations = Observations(samples, noisy, np.zeros(len(clean), int))
        for transfer in ("exit-cosine", "shrm-3", "shrm-4", "shrm-8", "azimuthal-2", "azimuthal-4"):
            settings = FitSettings(split="off", refine=False, transfer=transfer, starts=4)
            found = fit_brdf(observations, known, unknowns_of(truth), truth, settings).brdf
            off = (
                np.mean(np.asarray(found.kd) / truth.kd) - 1,
                np.mean(np.asarray(found.ks) / truth.ks) - 1,
                float(found.sigma) / 0.2 - 1,
                (float(found.mu) - 1) / 0.5 - 1,
            )
            print(
                f"  exit cosines from {lowest:.2f}  {transfer:13s}"
                + "".join(f"{100 * x:+8.2f}" for x in off)
            )


def known_nodes(light: KnownLight):
    assert light.environment is not None
    return light.environment.nodes()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("probe", type=Path, nargs="?")
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--degree", type=int, default=16)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    light = light_of(options)
    print(f"light to degree {options.degree}: {options.probe or 'synthetic'}")
    for sigma in (0.1, 0.2, 0.4):
        columns(light, sigma)
    fits(light)


if __name__ == "__main__":
    main()
