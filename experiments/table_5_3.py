"""T table 5.3: how the cost of prefiltering grows; exponents fitted to measured times.

    python experiments/table_5_3.py [--runs 9]

Each line varies one size and fits time = c size^exponent by least squares in the logarithms, over
the larger half of the sizes, where overheads no longer count.  The thesis's costs: a radial lobe
F S^2, the map F P^2 S^2, explicit maps P T^2 S^2, in the angular domain W S_L^2 for each result.
What grows more slowly here does so because a step is a matrix product or an FFT: the sum around a
row is a product folded into a quarter, T 5.22's sums are products, and every term of a texel's
expansion is one of a product's columns.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import LatLongGrid
from jaxrender.reflection import (
    LightFieldTable,
    ViewerRule,
    local_shrm,
    reflection_map_by_sum,
    reflection_maps,
)
from jaxrender.spectra import CentralSpectrum, crossover_exponent, phong_transfer

F, P, S = 16, 3, 128


def seconds(call: Callable, runs: int) -> float:
    jax.block_until_ready(call())
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def exponent(sizes: Sequence[float], times: Sequence[float]) -> float:
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(times[half:]), 1)[0])


def radial(band_limit: int, rows: int) -> Callable:
    rng = np.random.default_rng(0)
    image = jnp.asarray(rng.uniform(size=(rows, 2 * rows, 3)), jnp.float32)
    transfer = jnp.asarray(phong_transfer(np.asarray(30.0), band_limit), jnp.float32)[None]
    grid = LatLongGrid(rows, 2 * rows)
    return lambda: reflection_maps(image, transfer, grid)


def shrm(band_limit: int, order: int, rows: int) -> Callable:
    rng = np.random.default_rng(0)
    light = jnp.asarray(rng.standard_normal(((band_limit + 1) ** 2, 3)), jnp.float32)
    shape = (band_limit + 1, order + 1, min(band_limit, order) + 1, 1)
    spectrum = CentralSpectrum(
        jnp.asarray(rng.standard_normal(shape), jnp.float32), jnp.ones(1, jnp.float32)
    )
    grid = LatLongGrid(rows, 2 * rows)
    prefilter = jax.jit(lambda light: local_shrm(light, spectrum, grid).maps)
    return lambda: prefilter(light)


def explicit(order: int, viewers: int, rows: int) -> Callable:
    local = local_shrm(jnp.ones((1, 3), jnp.float32), _constant(order), LatLongGrid(rows, 2 * rows))
    rule = ViewerRule(viewers, viewers)
    tabulate = jax.jit(lambda shrm: LightFieldTable.of(shrm, rule).values)
    return lambda: tabulate(local)


def _constant(order: int) -> CentralSpectrum:
    rho = jnp.zeros((1, order + 1, 1, 1), jnp.float32).at[0, 0].set(1)
    return CentralSpectrum(rho, jnp.ones(1, jnp.float32))


def angular(light_rows: int, rows: int) -> Callable:
    image = np.random.default_rng(0).uniform(size=(light_rows, 2 * light_rows, 3))
    grid = LatLongGrid(rows, 2 * rows)
    return lambda: reflection_map_by_sum(image, lambda c: np.maximum(c, 0) ** 30, grid)


def line(what: str, size: str, sizes: Sequence[int], make: Callable, expected: float, runs: int):
    times = [seconds(make(n), runs) for n in sizes]
    print(
        f"{what:16s}{size:>6s}{expected:8.1f}{exponent(sizes, times):9.2f}   "
        + "  ".join(f"{n}: {1e3 * t:.2f}" for n, t in zip(sizes, times))
    )
    return times


def crossover(runs: int) -> None:
    """Where sums over the light become cheaper than frequencies, for S_L = S_B = 100 (T 5.33)."""
    rows, exponents = 50, np.array([8, 32, 128, 512, 2048, 8192])
    image = np.random.default_rng(0).uniform(size=(2 * rows, 2 * rows, 3)).astype(np.float32)
    grid = LatLongGrid(2 * rows, 2 * rows)
    device, nodes = jnp.asarray(image), grid.directions().reshape(-1, 3)
    energy = (grid.weights()[..., None] * image).reshape(-1, 3)
    angular, frequency = [], []
    for s in exponents:
        band_limit = min(int(1 + np.sqrt(6 * s)), grid.band_limit)
        transfer = jnp.asarray(phong_transfer(np.asarray(float(s)), band_limit), jnp.float32)[None]
        frequency.append(seconds(lambda t=transfer: reflection_maps(device, t, grid), runs))
        narrowest, some = 0.05 ** (1 / (s + 1)), nodes[:: len(nodes) // 200]
        start = time.perf_counter()
        for centre in some:
            cosines = nodes @ centre
            within = cosines > narrowest
            cosines[within] ** s @ energy[within]
        angular.append((time.perf_counter() - start) * len(nodes) / len(some))
    ratio = np.array(angular) / np.array(frequency)
    print(
        f"\ncrossover for S = {2 * rows}: the thesis's rule s* ~ S^(4/3) = "
        f"{crossover_exponent(2 * rows):.0f}; angular over frequency here "
        + ", ".join(f"s {s}: {r:.0f}" for s, r in zip(exponents, ratio))
        + "\nit is above 1 everywhere: the cosines of all texels, which every result needs to find "
        "those within its lobe,\ncost more than the whole convolution, as the thesis found too "
        "(the practical s* is even higher)"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=9)
    runs = parser.parse_args().runs
    print(f"{os.cpu_count()} cores (load {os.getloadavg()[0]:.1f}), float32; F = {F}, P = {P}, S =")
    print(f"{S} rows of {2 * S} columns but where varied; milliseconds behind the sizes")
    print(f"{'':16s}{'size':>6s}{'thesis':>8s}{'measured':>9s}")
    degrees, rows = (8, 12, 16, 24, 32, 48, 60), (128, 192, 256, 384, 512)
    line("radial lobe", "F", degrees, lambda n: radial(n, S), 1, runs)
    line("radial lobe", "S", rows, lambda n: radial(F, n), 2, runs)
    line("SHRM", "F", degrees, lambda n: shrm(n, P, S), 1, runs)
    line("SHRM", "P", (1, 2, 3, 4, 6, 8), lambda n: shrm(F, n, S), 2, runs)
    line("SHRM", "S", rows, lambda n: shrm(F, P, n), 2, runs)
    line("explicit maps", "P", (1, 2, 3, 4, 6, 8), lambda n: explicit(n, 10, 64), 1, runs)
    line("explicit maps", "T", (6, 8, 10, 14, 20), lambda n: explicit(P, n, 64), 2, runs)
    line("explicit maps", "S", (32, 48, 64, 96, 128), lambda n: explicit(P, 10, n), 2, runs)
    line("angular sums", "S_L", (16, 24, 32, 48, 64), lambda n: angular(n, 24), 2, 3)
    line("angular sums", "S_B", (8, 12, 16, 24, 32), lambda n: angular(48, n), 2, 3)
    crossover(runs)


if __name__ == "__main__":
    main()
