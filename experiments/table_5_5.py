"""T table 5.5: 100 explicit reflection maps of the microfacet of T 5.34, by angle and by frequency.

    python experiments/table_5_5.py [--runs 15] [--results 400]

Light of 128 x 128 texels, 10 x 10 maps of 128 x 128, degrees (F, P) that miss less than 3 % of the
BRDF's energy: P's pairs, and the true minima found by the order analysis (ERRATA 41).

Frequency: analysis of the light, coefficients of the tabulated BRDF (T 5.22), the map B_pq (T 5.24)
and the hundred explicit maps, in float32; warm medians of the whole and of the map alone.  Angle:
for every texel of every map the sum over the light's texels that hold 95 % of the lobe's energy,
measured on some results and scaled to all; first as the papers describe it, result by result
(NumPy), then at its best, the lobe evaluated in one fused loop over the rows it reaches on every
core (JAX).  Errors are against the sum over all texels.
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

from jaxrender.geometry import rotation
from jaxrender.harmonics import LatLongGrid, analyse
from jaxrender.reflection import LightFieldTable, ViewerRule, local_shrm
from jaxrender.spectra import (
    CentralTable,
    FacetLobe,
    central_spectrum,
    missing_energy,
    required_orders,
    tabulated_spectrum,
)

SIZE, VIEWERS, TOLERANCE = 128, ViewerRule(10, 10), 0.03
# The paper's pairs, its total angular and total frequency seconds, and those of the map alone.
PUBLISHED = {
    0.1: ((24, 3), 923.0, 2.70, 1.55),
    0.2: ((12, 2), 2744.0, 1.55, 0.72),
    0.3: ((7, 2), 5731.0, 1.49, 0.67),
    0.4: ((5, 2), 9034.0, 1.47, 0.65),
    0.5: ((5, 2), 12580.0, 1.45, 0.64),
}
# Nodes of the BRDF's table: t'_i, t'_o, phi.
TABLE = (128, 20, 20)
KEPT_ENERGY = 0.95


def microfacet(incoming: np.ndarray, outgoing: np.ndarray, sigma: float) -> np.ndarray:
    """T 5.34 of directions seen from R = +Z, with its horizon: the normal is half way to V."""
    normal = outgoing + np.array([0.0, 0.0, 1.0])
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    half = incoming + outgoing
    half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    angle = np.arccos(np.clip(np.sum(half * normal, axis=-1), -1, 1))
    above = np.sum(incoming * normal, axis=-1) > 0
    return np.where(above, np.exp(-((angle / sigma) ** 2)) / (4 * np.pi * sigma**2), 0)


def table_of(sigma: float) -> CentralTable:
    polar_in, polar_out = (CentralTable.polar_angles(n) for n in TABLE[:2])
    azimuth = CentralTable.azimuths(TABLE[2])
    t_i, t_o, phi = np.meshgrid(polar_in, polar_out, azimuth, indexing="ij")
    incoming = np.stack([np.sin(t_i), 0 * t_i, np.cos(t_i)], axis=-1)
    outgoing = np.stack([np.sin(t_o) * np.cos(phi), np.sin(t_o) * np.sin(phi), np.cos(t_o)], -1)
    values = microfacet(incoming, outgoing, sigma)[..., None]
    return CentralTable(jnp.asarray(values, jnp.float32))


def minima_of(sigma: float) -> tuple[tuple[int, int], Callable[[tuple[int, int]], float]]:
    """The true minimum (F, P), and what any pair misses, from the accurate spectrum."""
    lobe = FacetLobe(jnp.asarray(sigma))
    # F D / (4 cos t_o) times cos t_o is T 5.34 with its horizon.
    spectrum = central_spectrum(lobe, (40, 5), *lobe.extent, weighted=True)
    orders = required_orders(spectrum, TOLERANCE)
    missing = missing_energy(spectrum)
    return (orders.light, orders.viewer), lambda pair: float(missing[pair])


@eqx.filter_jit
def maps_of(image: jax.Array, table: CentralTable, orders: tuple[int, int]):
    grid = LatLongGrid(SIZE, SIZE)
    spectrum = tabulated_spectrum(table, orders)
    return local_shrm(analyse(grid, image, orders[0]), spectrum, grid)


@eqx.filter_jit
def explicit_of(image: jax.Array, table: CentralTable, orders: tuple[int, int]) -> jax.Array:
    return LightFieldTable.of(maps_of(image, table, orders), VIEWERS).values


def median_seconds(call: Callable, runs: int) -> float:
    jax.block_until_ready(call())
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return statistics.median(times)


class Angular:
    """Sums over the light, for chosen results (texel of the map, viewer)."""

    def __init__(self, image: np.ndarray, sigma: float, results: int):
        grid, rng = LatLongGrid(SIZE, SIZE), np.random.default_rng(1)
        self.sigma = sigma
        self.nodes = grid.directions().reshape(-1, 3)
        self.energy = (grid.weights()[..., None] * image).reshape(-1, 3)
        self.rows, self.columns = rng.integers(0, SIZE, (2, results))
        self.viewers = rng.integers(0, VIEWERS.rows * VIEWERS.columns, results)
        alpha, beta = grid.polar_angles()[self.rows], grid.azimuths()[self.columns]
        self.frames = np.asarray(rotation(alpha, beta, np.zeros(results)))
        self.outgoing = VIEWERS.directions().reshape(-1, 3)[self.viewers]
        # The lobe about R with 95 % of its energy, for R = N; wider at grazing exit.
        self.width = min(2 * sigma * np.sqrt(-np.log(1 - KEPT_ENERGY) / 2), np.pi)
        self.narrowest = np.cos(self.width)

    def result_by_result(self) -> np.ndarray:
        """As the papers describe it: the texels within the lobe's width, one result at a time."""
        found = np.empty((len(self.rows), 3))
        for k, (frame, outgoing) in enumerate(zip(self.frames, self.outgoing)):
            local = self.nodes @ frame
            within = local[:, 2] > self.narrowest
            found[k] = microfacet(local[within], outgoing, self.sigma) @ self.energy[within]
        return found

    def fused(self, rows: int) -> Callable[[], jax.Array]:
        """At its best: so many rows of the light around R, one fused loop a block of results."""
        shape = (SIZE, SIZE, 3)
        texels = jnp.asarray(np.stack([self.nodes, self.energy]).reshape(2, *shape), jnp.float32)
        first = jnp.asarray(np.clip(self.rows - rows // 2, 0, SIZE - rows))
        frames = jnp.asarray(self.frames, jnp.float32)
        outgoing = jnp.asarray(self.outgoing, jnp.float32)
        reflected = frames[:, :, 2]
        viewer = jnp.einsum("xij,xj->xi", frames, outgoing)
        normal = reflected + viewer
        normal = normal / jnp.linalg.norm(normal, axis=1, keepdims=True)
        width, scale = 1 / self.sigma**2, 1 / (4 * np.pi * self.sigma**2)

        @jax.jit
        def sums(texels, viewer, normal, first):
            def one(result):
                view, up, top = result
                band = jax.lax.dynamic_slice_in_dim(texels, top, rows, axis=1)
                nodes, energy = band.reshape(2, -1, 3)
                x, y, z = (nodes[:, k] + view[k] for k in range(3))
                squared = x * x + y * y + z * z
                cosine = (x * up[0] + y * up[1] + z * up[2]) * jax.lax.rsqrt(squared + 1e-12)
                # arccos^2 near 1, to 1e-4 up to half a radian: 2 d (1 + d / 6 + 2 d^2 / 45).
                d = 1 - jnp.clip(cosine, -1, 1)
                angle2 = 2 * d * (1 + d * (1 / 6 + d * (2 / 45 + d / 70)))
                lobe = jnp.exp(-width * angle2)
                above = nodes @ up > 0
                return jnp.where(above, lobe, 0) @ energy * scale

            return jax.lax.map(one, (viewer, normal, first), batch_size=32)

        return lambda: sums(texels, viewer, normal, first)


def row(sigma: float, orders: tuple[int, int], image: np.ndarray, options) -> None:
    (pair, angular_s, frequency_s, map_s) = PUBLISHED[sigma]
    minimum, missed = minima_of(sigma)
    device, table = jnp.asarray(image), table_of(sigma)
    whole = median_seconds(lambda: explicit_of(device, table, orders), options.runs)
    alone = median_seconds(lambda: maps_of(device, table, orders), options.runs)
    angular = Angular(image, sigma, options.results)
    start = time.perf_counter()
    loop = angular.result_by_result()
    scale = SIZE * SIZE * VIEWERS.rows * VIEWERS.columns / options.results
    slow = (time.perf_counter() - start) * scale
    band = min(SIZE, 2 * int(np.ceil(angular.width / np.pi * SIZE)) + 1)
    best = median_seconds(angular.fused(band), 3) * scale
    exact = np.asarray(angular.fused(SIZE)(), float)
    values = np.asarray(explicit_of(device, table, orders), float)
    values = values.reshape(-1, SIZE, SIZE, 3)[angular.viewers, angular.rows, angular.columns]
    error, loop_error = (
        np.sqrt(np.sum((a - exact) ** 2) / np.sum(exact**2)) for a in (values, loop)
    )
    print(
        f"{sigma:4.1f} {orders!s:>8s}{'' if orders == pair else '*':1s}{100 * missed(orders):6.2f}"
        f"{minimum!s:>9s}{angular_s / frequency_s:8.0f}{slow / whole:9.0f}{best / whole:8.0f}"
        f"{frequency_s:9.2f}{1e3 * whole:8.2f}{map_s:8.2f}{1e3 * alone:8.2f}"
        f"{angular_s:8.0f}{slow:8.0f}{best:8.2f}{100 * error:8.1f}{100 * loop_error:7.1f}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--results", type=int, default=400)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    grid = LatLongGrid(SIZE, SIZE)
    source = np.exp((grid.directions() @ [0.6, 0.48, 0.64] - 1) * 60)[..., None]
    image = (0.2 + 0.1 * rng.uniform(size=(SIZE, SIZE, 3)) + 5 * source).astype(np.float32)
    print(f"{os.cpu_count()} cores (load {os.getloadavg()[0]:.1f}), float32; * the true minimum")
    print(
        f"{'':22s}{'true':>6s}{'angular over frequency':>25s}{'frequency, all':>17s}"
        f"{'the map alone':>16s}{'angular, seconds':>24s}{'error %':>15s}"
    )
    print(
        f"{'sigma':>5s}{'(F, P)':>8s}{'misses %':>9s}{'minimum':>8s}{'paper':>6s}{'loop':>9s}"
        f"{'best':>8s}{'paper s':>9s}{'ms':>8s}{'paper s':>8s}{'ms':>8s}{'paper':>8s}"
        f"{'loop':>8s}{'best':>8s}{'ours':>8s}{'loop':>7s}"
    )
    jax.config.update("jax_enable_x64", True)
    for sigma, (pair, *_) in PUBLISHED.items():
        row(sigma, pair, image, options)
        minimum, _ = minima_of(sigma)
        if minimum != pair:
            row(sigma, minimum, image, options)


if __name__ == "__main__":
    main()
