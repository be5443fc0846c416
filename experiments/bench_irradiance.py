"""Nine coefficients of a large probe, and irradiance at a million normals, beside reading the data.

    python experiments/bench_irradiance.py [--rows 1024] [--normals 1000000] [--runs 25]

Float32.  Reading is the sum of all values, by JAX (all cores) and by NumPy (one).  Cold is the
first call (tables, compilation, run), warm the median of the following ones, in turn with reading.
Twins: the dense sum for the coefficients, N' M N as written for irradiance.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import LatLongGrid, analyse
from jaxrender.reflection import irradiance_matrix, matrix_irradiance, quadratic_irradiance

# What is demanded: times the reading, and times the value.
READING, GRADIENT = 1.5, 4.0


def take_turns(calls: dict[str, Callable], runs: int) -> dict[str, tuple[float, float]]:
    """Return cold and median warm milliseconds of each call."""
    cold, warm = {}, {name: [] for name in calls}
    for name, call in calls.items():
        start = time.perf_counter()
        jax.block_until_ready(call())
        cold[name] = 1e3 * (time.perf_counter() - start)
    for _ in range(runs):
        for name, call in calls.items():
            # Once for the processor's caches, once for the clock.
            jax.block_until_ready(call())
            start = time.perf_counter()
            jax.block_until_ready(call())
            warm[name].append(1e3 * (time.perf_counter() - start))
    return {name: (cold[name], statistics.median(times)) for name, times in warm.items()}


def report(title: str, timed: dict[str, tuple[float, float]], base: str):
    print(f"\n{title}\n{'':34s}{'cold ms':>10s}{'warm ms':>10s}{'ratio':>8s}")
    for name, (cold, warm) in timed.items():
        print(f"{name:34s}{cold:10.1f}{warm:10.2f}{warm / timed[base][1]:8.2f}")


def coefficients(rows: int, runs: int):
    """Time the nine coefficients of a latitude-longitude probe."""
    values = np.random.default_rng(0).uniform(size=(rows, 2 * rows, 3)).astype(np.float32)
    image, grid = jnp.asarray(values), LatLongGrid(rows, 2 * rows)
    total = jax.jit(jnp.sum)
    timed = take_turns(
        {
            "reading, JAX": lambda: total(image),
            "reading, NumPy": lambda: np.sum(np.asarray(image)),
            "nine coefficients": lambda: analyse(grid, image, 2),
        },
        runs,
    )
    report(f"{rows} x {2 * rows} texels of 3 channels", timed, "reading, JAX")
    for name in ("reading, JAX", "reading, NumPy"):
        ratio = timed["nine coefficients"][1] / timed[name][1]
        print(f"  {ratio:.2f} times {name}; demanded {READING}: {_met(ratio <= READING)}")


def at_normals(count: int, runs: int):
    """Time E(n) and its gradient."""
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(count, 3)).astype(np.float32)
    normals = jnp.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    matrix = irradiance_matrix(rng.normal(size=(9, 3)).astype(np.float32))
    weights = jnp.asarray(rng.normal(size=(count, 3)).astype(np.float32))
    value, twin = jax.jit(quadratic_irradiance), jax.jit(matrix_irradiance)

    @jax.jit
    def gradient(matrix, normals, weights):
        return jax.vjp(lambda n: quadratic_irradiance(matrix, n), normals)[1](weights)[0]

    total = jax.jit(jnp.sum)
    timed = take_turns(
        {
            "reading the normals, JAX": lambda: total(normals),
            "E(n)": lambda: value(matrix, normals),
            "its gradient by n": lambda: gradient(matrix, normals, weights),
            "N' M N as written": lambda: twin(matrix, normals),
        },
        runs,
    )
    report(f"{count:,} normals, 3 channels", timed, "E(n)")
    ratio = timed["its gradient by n"][1] / timed["E(n)"][1]
    print(f"  gradient {ratio:.2f} times the value; demanded {GRADIENT}: {_met(ratio <= GRADIENT)}")


def _met(met: bool) -> str:
    return "met" if met else "NOT met"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=1024)
    parser.add_argument("--normals", type=int, default=1_000_000)
    parser.add_argument("--runs", type=int, default=25)
    arguments = parser.parse_args()
    print(f"{os.cpu_count()} cores (load {os.getloadavg()[0]:.1f}), jax {jax.__version__}")
    coefficients(arguments.rows, arguments.runs)
    at_normals(arguments.normals, arguments.runs)


if __name__ == "__main__":
    main()
