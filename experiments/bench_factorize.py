"""A step of the factorization: samples in blocks or all at once, BLAS with its threads or one.

    python experiments/bench_factorize.py [--samples 4000] [--runs 15]

``reduced_system`` of photographs of a ball under a sky, light to degree 10 and 48 sources: what a
step of the joint fit costs.  The twin takes all samples as one block.  Either is measured while
BLAS keeps to one thread, as ``factorize`` asks it to, and while its threads do as they like.  Cold
is the first call, with compilation: blocks need it once for every number of samples.  Warm are
medians of calls in turns.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import jax
import jax.numpy as jnp
import numpy as np
import scenes

from jaxrender.brdf import Microfacet
from jaxrender.geometry import fibonacci_sphere
from jaxrender.inverse.blas import one_blas_thread
from jaxrender.inverse.factorization import FactorSettings
from jaxrender.inverse.factorization.blocks import Measured, in_blocks
from jaxrender.inverse.factorization.projection import reduced_system
from jaxrender.inverse.factorization.response import Guess, MirrorResponse
from jaxrender.inverse.factorization.state import Task, begin, measured

MATERIAL = Microfacet(np.array([0.45, 0.4, 0.3]), np.full(3, 0.3), 0.12, 1.6)
SOURCES = FactorSettings().most_sources


def problem(count: int) -> tuple[MirrorResponse, Measured, Guess]:
    """Photograph a ball, and stand at the true material with sources all around."""
    samples, view = scenes.ring_samples(count, 0.15, seed=0)
    light = scenes.probe("sky", 2).nodes()
    photographs = scenes.photograph(light, MATERIAL, samples, view)
    response = MirrorResponse.of_convex(MATERIAL, samples, 10, SOURCES)
    task = Task(photographs, response)
    state = begin(task)
    guess = state.guess._replace(directions=jnp.asarray(fibonacci_sphere(SOURCES)))
    return response, measured(task, state), guess


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=4000)
    parser.add_argument("--runs", type=int, default=15)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    response, data, guess = problem(options.samples)
    ways = {
        "blocks": in_blocks(response, data),
        "all at once": in_blocks(response, data, options.samples),
    }
    cold, results = {}, []
    for name, blocks in ways.items():
        start = time.perf_counter()
        results.append(jax.block_until_ready(reduced_system(blocks, guess)))
        cold[name] = time.perf_counter() - start
    leaves = zip(*(jax.tree.leaves(result) for result in results))
    apart = max(float(np.max(np.abs(a - b)) / np.max(np.abs(a))) for a, b in leaves)
    print(f"{options.samples} samples; the two differ by {apart:.0e} of the largest number")
    threads: dict[str, Callable[[], AbstractContextManager]] = {
        "one BLAS thread": one_blas_thread,
        "BLAS threads": nullcontext,
    }
    taken = {(name, kind): [] for kind in threads for name in ways}
    for _ in range(options.runs):
        for (name, kind), seconds in taken.items():
            with threads[kind]():
                # The first wakes what the second then suffers from.
                jax.block_until_ready(reduced_system(ways[name], guess))
                start = time.perf_counter()
                jax.block_until_ready(reduced_system(ways[name], guess))
                seconds.append(time.perf_counter() - start)
    base = statistics.median(taken["blocks", "one BLAS thread"])
    for (name, kind), seconds in taken.items():
        median = statistics.median(seconds)
        print(
            f"{name:12s} {kind:16s} {1e3 * median:7.1f} ms warm ({median / base:.2f}), "
            f"{cold[name]:.1f} s cold"
        )


if __name__ == "__main__":
    main()
