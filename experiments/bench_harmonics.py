"""Harmonic analysis, synthesis and point evaluation: warm and cold times beside ducc0.

    python experiments/bench_harmonics.py [--rows 512] [--degrees 8 30 64 128]

Cold is the first call (tables, compilation, run); warm the median of the following ones.  The peer
(extra ``peers``) runs in the same process on as many threads as there are cores; ratio = warm time
over the peer's, below 1 is faster than the peer.  ducc0 works in the precision named, one channel
after the other.
"""

import argparse
import os
import statistics
import time

import jax
import numpy as np

from jaxrender import harmonics

try:
    import ducc0
except ImportError:
    ducc0 = None

CHANNELS = 3
POINTS = 12_000
REPEATS = 15


def timed(call) -> tuple[float, float]:
    """Return the time of the first call and the median of the next ones, milliseconds."""
    times = []
    for _ in range(REPEATS + 1):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(1e3 * (time.perf_counter() - start))
    return times[0], statistics.median(times[1:])


def peer_transforms(grid: harmonics.LatLongGrid, band_limit: int, dtype):
    """Return ducc0's (analysis, synthesis) of the same grid, or None."""
    if ducc0 is None:
        return None
    from ducc0.sht import experimental as sht

    complex_type = np.complex64 if dtype == np.float32 else np.complex128
    count = (band_limit + 1) * (band_limit + 2) // 2
    rng = np.random.default_rng(0)
    alm = rng.normal(size=(CHANNELS, 1, count)).astype(complex_type)
    maps = rng.normal(size=(CHANNELS, 1, *grid.shape)).astype(dtype)
    common = {"spin": 0, "lmax": band_limit, "geometry": "F1", "nthreads": os.cpu_count()}

    def analysis():
        return [sht.analysis_2d(map=one, **common) for one in maps]

    def synthesis():
        size = {"ntheta": grid.height, "nphi": grid.width}
        return [sht.synthesis_2d(alm=one, **size, **common) for one in alm]

    return analysis, synthesis


def report(name: str, cold: float, warm: float, peer: float | None):
    against = "" if peer is None else f"{peer:10.2f} {warm / peer:7.2f}"
    print(f"{name:44s} {cold:9.0f} {warm:9.2f} {against}")


def bench_transforms(rows: int, band_limit: int, dtype):
    grid = harmonics.LatLongGrid(rows, 2 * rows)
    rng = np.random.default_rng(1)
    image = jax.numpy.asarray(rng.normal(size=(*grid.shape, CHANNELS)), dtype)
    light = jax.numpy.asarray(rng.normal(size=((band_limit + 1) ** 2, CHANNELS)), dtype)
    peers = peer_transforms(grid, band_limit, dtype)
    ours = (
        ("analyse", lambda: harmonics.analyse(grid, image, band_limit)),
        ("synthesise", lambda: harmonics.synthesise(grid, light)),
    )
    for which, (name, call) in enumerate(ours):
        peer = None if peers is None else timed(peers[which])[1]
        label = f"{name} {rows} x {2 * rows} x 3, degree {band_limit}, {np.dtype(dtype)}"
        report(label, *timed(call), peer)


def bench_points(band_limit: int, dtype):
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(POINTS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = jax.numpy.asarray(directions, dtype)
    light = jax.numpy.asarray(rng.normal(size=((band_limit + 1) ** 2, CHANNELS)), dtype)
    calls = (
        ("real_basis", lambda: harmonics.real_basis(directions, band_limit)),
        ("evaluate", lambda: harmonics.evaluate(light, directions)),
        ("degree_table", lambda: harmonics.degree_table(light, directions)),
    )
    for name, call in calls:
        label = f"{name} {POINTS} points, degree {band_limit}, {np.dtype(dtype)}"
        report(label, *timed(call), None)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=512)
    parser.add_argument("--degrees", type=int, nargs="+", default=[8, 30, 64, 128])
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    peer = "no ducc0" if ducc0 is None else f"ducc0 {ducc0.__version__}"
    print(f"{os.cpu_count()} cores, {jax.default_backend()}, jax {jax.__version__}, {peer}")
    print(f"{'':44s} {'cold ms':>9s} {'warm ms':>9s} {'peer ms':>10s} {'ratio':>7s}")
    for dtype in (np.float32, np.float64):
        for band_limit in arguments.degrees:
            bench_transforms(arguments.rows, band_limit, dtype)
        for band_limit in (8, 32, 128):
            bench_points(band_limit, dtype)


if __name__ == "__main__":
    main()
