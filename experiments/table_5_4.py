"""T table 5.4: Phong prefiltering of 128 x 128 maps in the angular and the frequency domain.

    python experiments/table_5_4.py [--runs 31] [--lobes 16]

Degrees to F_B = 1 + sqrt(6 s) as in the thesis.  ``angular`` is the brute-force loop over all
texels that carry 95 % of the lobe's energy, result by result (NumPy); its ratio to ours stands
beside the published one.  The honest rival transforms along the azimuth and multiplies each order
by one matrix made beforehand, which knows nothing of degrees: all orders, float32, the quicker of
JAX and NumPy.  Ours analyses, multiplies and synthesises; once for one lobe, once for many at once.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import LatLongGrid
from jaxrender.reflection import reflection_map_by_sum, reflection_maps
from jaxrender.spectra import phong_transfer

SIZE = 128
PUBLISHED = {8: 830.6, 16: 333.6, 32: 137.1, 64: 52.6, 128: 21.9, 256: 7.7, 512: 3.3}
# Against the rival: one lobe up to this exponent, and per lobe when many are filtered at once.
ONE_LOBE, UP_TO, MANY_LOBES = 1.5, 64, 5.0
KEPT_ENERGY = 0.95


def median_ms(call: Callable, runs: int) -> float:
    jax.block_until_ready(call())
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


def angular(image: np.ndarray, exponent: int, grid: LatLongGrid) -> np.ndarray:
    """Loop over all results; each sums the texels within the lobe's width (T 5.30)."""
    nodes = grid.directions().reshape(-1, 3)
    energy = (grid.weights()[..., None] * image).reshape(-1, 3)
    narrowest = (1 - KEPT_ENERGY) ** (1 / (exponent + 1))
    found = np.empty_like(energy)
    for k, centre in enumerate(nodes):
        cosines = nodes @ centre
        within = cosines > narrowest
        found[k] = cosines[within] ** exponent @ energy[within]
    return ((exponent + 1) / (2 * np.pi) * found).reshape(image.shape)


def order_matrices(transfer: np.ndarray, grid: LatLongGrid) -> np.ndarray:
    """What the rival prepares: the lobe's matrix from rows to rows, for each order."""
    # The response to one texel in column 0 of every row, transformed along the azimuth.
    directions = grid.directions()
    series = transfer * (2 * np.arange(len(transfer)) + 1) / (4 * np.pi)
    cosines = np.einsum("rcx,ix->irc", directions, directions[:, 0])
    kernel = np.polynomial.legendre.legval(np.clip(cosines, -1, 1), series)
    # [from row, to row, order]
    spectrum = np.fft.rfft(kernel, axis=2).real
    return np.moveaxis(spectrum, 2, 0).swapaxes(1, 2) * grid.row_weights()[None, None, :]


def rivals(image: np.ndarray, matrices: np.ndarray) -> dict[str, Callable]:
    matrices = matrices.astype(np.float32)
    device, tables = jnp.asarray(image), jnp.asarray(matrices)

    @jax.jit
    def by_jax(image, tables):
        waves = jnp.fft.rfft(image, axis=1)
        parts = jnp.concatenate([waves.real, waves.imag], axis=-1)
        mixed = jnp.einsum("mij,jmc->imc", tables, parts)
        return jnp.fft.irfft(mixed[..., :3] + 1j * mixed[..., 3:], n=image.shape[1], axis=1)

    def by_numpy():
        waves = np.fft.rfft(image, axis=1)
        parts = np.concatenate([waves.real, waves.imag], axis=-1)
        mixed = np.matmul(matrices, np.ascontiguousarray(parts.swapaxes(0, 1)))
        mixed = mixed[..., :3] + 1j * mixed[..., 3:]
        return np.fft.irfft(mixed.swapaxes(0, 1), n=image.shape[1], axis=1)

    return {"JAX": lambda: by_jax(device, tables), "NumPy": by_numpy}


def row(exponent: int, runs: int, lobes: int, image: np.ndarray):
    """Measure and print one line of the table."""
    grid = LatLongGrid(SIZE, SIZE)
    band_limit = int(1 + np.sqrt(6 * exponent))
    transfer = np.asarray(phong_transfer(np.asarray(float(exponent)), band_limit))
    device, one = jnp.asarray(image), jnp.asarray(transfer[None], jnp.float32)
    many = jnp.tile(one, (lobes, 1))
    ours = median_ms(lambda: reflection_maps(device, one, grid), runs)
    each = median_ms(lambda: reflection_maps(device, many, grid), runs) / lobes
    peers = rivals(image, order_matrices(transfer, grid))
    rival = min(median_ms(call, runs) for call in peers.values())
    answer = np.asarray(reflection_maps(device, one, grid)[0])
    off = max(np.abs(np.asarray(call()) - answer).max() for call in peers.values())
    start = time.perf_counter()
    slow = angular(image, exponent, grid)
    brute = 1e3 * (time.perf_counter() - start)
    exact = reflection_map_by_sum(
        image, lambda c: (exponent + 1) / (2 * np.pi) * np.maximum(c, 0) ** exponent, grid
    )
    verdict = _met(rival / each >= MANY_LOBES)
    if exponent <= UP_TO:
        verdict = f"{_met(rival / ours >= ONE_LOBE)}, {verdict}"
    print(
        f"{exponent:5d}{band_limit:5d}{PUBLISHED[exponent]:11.1f}{brute / ours:11.0f}"
        f"{ours:10.3f}{each:10.3f}{rival:10.3f}{rival / ours:8.1f}{rival / each:8.1f}"
        f"{off:10.1e}{np.abs(answer - exact).max():10.1e}{np.abs(slow - exact).max():10.1e}"
        f"  {verdict}"
    )


def _met(met: bool) -> str:
    return "met" if met else "NOT met"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=31)
    parser.add_argument("--lobes", type=int, default=16)
    arguments = parser.parse_args()
    image = np.random.default_rng(0).uniform(size=(SIZE, SIZE, 3)).astype(np.float32)
    print(f"{os.cpu_count()} cores (load {os.getloadavg()[0]:.1f}), float32, {SIZE} x {SIZE}")
    print(
        f"{'':10s}{'angular over frequency':>22s}{'ours':>10s}{'ours of':>10s}{'rival':>10s}"
        f"{'rival over':>16s}{'rival':>10s}{'error':>10s}{'error':>10s}"
    )
    print(
        f"{'s':>5s}{'F':>5s}{'published':>11s}{'measured':>11s}{'one ms':>10s}"
        f"{f'{arguments.lobes}, ms':>10s}{'ms':>10s}{'one':>8s}{'each':>8s}"
        f"{'differs':>10s}{'ours':>10s}{'angular':>10s}"
        f"  demanded: one {ONE_LOBE}, each {MANY_LOBES}"
    )
    for exponent in PUBLISHED:
        row(exponent, arguments.runs, arguments.lobes, image)


if __name__ == "__main__":
    main()
