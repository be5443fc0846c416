"""One pass over the pixels: time, cost of an outer evaluation, and memory, by number of rows.

    python experiments/bench_stream.py [--full]

Rows are made as they are asked for, a chunk at a time, three channels with one weight for all, and
streamed into the binned sums of degree 12 (diffuse 8).  Every count runs in a process of its own;
its memory is the largest that it ever occupied, Python and the compiler included.  An outer
evaluation solves for the light of one channel for a guess of K_s and mu (T 6.4.4).  Demanded: under
5 ms, and under 1 GiB however many rows.  ``--full`` goes on to 10^8 rows.
"""

import os

# Read when NumPy is imported: matrices of degree 12 are too small for a second thread to help.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.factorization.nested import BAND_LIMIT, factor_gram, light_of_gram
from jaxrender.inverse.factorization.stream import Block, binned_gram

CHUNK, LOWEST_COSINE = 8192, 0.15
COUNTS = (10_000, 100_000, 1_000_000, 10_000_000)
DEMANDED_MS, DEMANDED_MIB = 5.0, 1024.0


def synthetic_rows(count: int) -> Iterator[Block]:
    """Make rows on the fly: random normals and views, smooth radiance with noise."""
    rng = np.random.default_rng(0)
    for start in range(0, count, CHUNK):
        rows = min(CHUNK, count - start)
        outgoing = rng.normal(size=(rows, 3))
        outgoing /= np.linalg.norm(outgoing, axis=1, keepdims=True)
        across = np.cross(outgoing, rng.normal(size=(rows, 3)))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        cosines = np.sqrt(rng.uniform(LOWEST_COSINE**2, 1, (rows, 1)))
        normals = cosines * outgoing + np.sqrt(1 - cosines**2) * across
        reflected = 2 * cosines * normals - outgoing
        radiance = 1 + 0.3 * normals[:, [2]] + 0.2 * reflected**2
        radiance *= 1 + 0.01 * rng.normal(size=radiance.shape)
        yield Block(SurfaceSamples(normals, outgoing), radiance)


def measure(count: int) -> dict:
    """Stream so many rows and time the pass, outer evaluations, and a whole search."""
    binned_gram(synthetic_rows(CHUNK), BAND_LIMIT)
    start = time.perf_counter()
    gram = binned_gram(synthetic_rows(count), BAND_LIMIT)
    seconds = time.perf_counter() - start
    channel = jax.tree.map(jnp.asarray, gram.of_channel(0))
    solve = eqx.filter_jit(light_of_gram)
    times = []
    for share in np.linspace(0.1, 0.5, 51):
        start = time.perf_counter()
        jax.block_until_ready(solve(channel, jnp.asarray(share), jnp.asarray(1.5)))
        times.append(1e3 * (time.perf_counter() - start))
    factor_gram(gram)
    start = time.perf_counter()
    factor_gram(gram)
    search = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    evaluation = statistics.median(times[1:])
    return {"count": count, "pass": seconds, "ms": evaluation, "search": search, "mib": peak}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--count", type=int, help="measure one count in this process")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if arguments.count is not None:
        print(json.dumps(measure(arguments.count)))
        return
    print(
        f"{'rows':>11s} {'pass s':>8s} {'s / 10^6':>9s} {'evaluation ms':>14s} {'search s':>9s} MiB"
    )
    found = []
    for count in (*COUNTS, 100_000_000) if arguments.full else COUNTS:
        command = [sys.executable, __file__, "--count", str(count)]
        output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        one = json.loads(output.splitlines()[-1])
        found.append(one)
        print(
            f"{count:11d} {one['pass']:8.2f} {one['pass'] / count * 1e6:9.2f} {one['ms']:14.2f}"
            f" {one['search']:9.2f} {one['mib']:.0f}",
            flush=True,
        )
    slowest, most = (max(one[key] for one in found) for key in ("ms", "mib"))
    met = slowest < DEMANDED_MS and most < DEMANDED_MIB
    print(
        f"evaluation {slowest:.2f} ms (demanded {DEMANDED_MS:.0f}), memory {most:.0f} MiB "
        f"(demanded {DEMANDED_MIB:.0f}): {'met' if met else 'NOT MET'}"
    )


if __name__ == "__main__":
    main()
