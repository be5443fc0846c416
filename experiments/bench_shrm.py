"""Spherical harmonic reflection maps in real time: what a frame costs on this machine.

    python experiments/bench_shrm.py [--runs 31]

The dynamic map of T 5.35 on a cube of 64 x 64 x 6 texels (60 a second demanded at P = 3), the same
on a latitude-longitude map, pixels of a 512 x 512 picture shaded from it, and pixels shaded
straight from the local map (T 5.10); and what comes before: prefiltering, turning to the global
map, the cube.  Float32, cold (first call, compiling) and warm (median) apart.  Peers in the same
run: NumPy for the dynamic map, and for a shaded pixel the sum over the expansion's own
coefficients, which is what a purely coefficient-based form costs (T 5.5.2).
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Orthographic, Sphere, SurfaceSamples, look_at, observe
from jaxrender.harmonics import CubeGrid, LatLongGrid, looked_up, over_poles, real_basis
from jaxrender.reflection import (
    ViewFilter,
    global_shrm,
    local_shrm,
    mirror_light,
    reflect_mirror_light,
)
from jaxrender.reflection.shrm import specular_spectrum

F, P, SIDE, PICTURE = 20, 3, 64, 512
DEMANDED = 60


def timed(name: str, call: Callable, runs: int) -> float:
    start = time.perf_counter()
    jax.block_until_ready(call())
    cold = time.perf_counter() - start
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    warm = statistics.median(times)
    print(f"{name:58s}{1e3 * cold:9.1f}{1e3 * warm:9.3f}{1 / warm:12,.0f}")
    return warm


@eqx.filter_jit
def shaded(padded: jax.Array, reflected: jax.Array, exit_cosines: jax.Array) -> jax.Array:
    return looked_up(padded, reflected) / exit_cosines[:, None]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=31)
    runs = parser.parse_args().runs
    rng = np.random.default_rng(0)
    brdf = Microfacet(jnp.zeros(3, jnp.float32), jnp.ones(3, jnp.float32), jnp.float32(0.2), None)
    light = jnp.asarray(rng.standard_normal(((F + 1) ** 2, 3)), jnp.float32)
    grid, rows = LatLongGrid(2 * SIDE, 4 * SIDE), 2 * SIDE
    viewer = jnp.asarray([0.6, 0.48, 0.64], jnp.float32)
    camera = Orthographic(
        PICTURE, PICTURE, look_at([2.4, 1.9, 2.6], [0, 0, 0], [0, 0, 1]), scale=2.05 / PICTURE
    )
    view = observe(camera, Sphere(np.zeros(3), 1.0))
    samples = SurfaceSamples(
        *(jnp.asarray(a[view.hit], jnp.float32) for a in (view.normals, view.outgoing))
    )
    reflected, cosines = samples.reflected, samples.exit_cosines
    print(
        f"{os.cpu_count()} cores (load {os.getloadavg()[0]:.1f}), float32, F = {F}, P = {P}; "
        f"{len(cosines):,} pixels of {PICTURE} x {PICTURE}"
    )
    print(f"{'':58s}{'cold ms':>9s}{'warm ms':>9s}{'a second':>12s}")
    spectrum = eqx.filter_jit(specular_spectrum)
    timed("the BRDF's spectrum", lambda: spectrum(brdf, (F, P)).coefficients, runs)
    rho = spectrum(brdf, (F, P))
    timed(f"the local map, {rows} x {2 * rows}", lambda: local_shrm(light, rho, grid).maps, runs)
    local = local_shrm(light, rho, grid)
    timed("local to global", lambda: global_shrm(local).maps, runs)
    whole = global_shrm(local)
    timed(f"global to a cube of {SIDE}", lambda: whole.on(CubeGrid(SIDE)).maps, runs)
    cube = whole.on(CubeGrid(SIDE))
    dynamic = timed("dynamic map on the cube", lambda: cube.dynamic_map(viewer), runs)
    flat = np.asarray(cube.maps)
    around = np.asarray(real_basis(viewer, P))
    peer = timed("  the same, NumPy", lambda: np.einsum("rckd,k->rcd", flat, around), runs)
    timed(f"dynamic map, {rows} x {2 * rows}", lambda: whole.dynamic_map(viewer), runs)
    padded = over_poles(whole.dynamic_map(viewer))
    timed("pixels from the dynamic map", lambda: shaded(padded, reflected, cosines), runs)
    at = eqx.filter_jit(lambda shrm: shrm.at(reflected, samples.outgoing))
    timed("pixels from the local map (T 5.10)", lambda: at(local), max(3, runs // 6))
    few = SurfaceSamples(*(a[::64] for a in samples))

    def by_coefficients():
        seen = mirror_light(few, light, P)
        return reflect_mirror_light(brdf, few.exit_cosines, seen, ViewFilter(P, True))

    slow = timed("  1 pixel in 64 from the coefficients", by_coefficients, 3)
    verdict = "met" if dynamic < 1 / DEMANDED else "NOT met"
    print(
        f"\ndynamic map {1 / dynamic:,.0f} a second, demanded {DEMANDED}: {verdict}; "
        f"{peer / dynamic:.1f} times NumPy's speed; coefficients would take {64 * slow:.1f} s a "
        "picture"
    )


if __name__ == "__main__":
    main()
