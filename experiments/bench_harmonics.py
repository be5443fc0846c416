"""Harmonic analysis, synthesis and point evaluation: warm and cold times beside SHTns and ducc0.

    python experiments/bench_harmonics.py [--rows 512] [--degrees 30 64 255] [--points]

Everyone transforms the same 3 channels on two threads.  Cold is the first call (tables, compilation
and run); warm the median of the following ones, taken in turns so that a busy machine slows all
alike, best the fastest.  Ratio = our warm time over the peer's: below 1 is faster.  Each side's
precision is printed: SHTns has doubles only, and takes planar channels; ours are interleaved, as
images are.  Everyone runs twice and is timed the second time, when the processor's caches are his
own.  Both peers are optional (``pip install shtns`` needs FFTW).
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "2")
# SHTns's threads would spin on, after their own turn, and take the next one's processor.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import statistics
import time

import jax
import numpy as np

from jaxrender import harmonics

try:
    import ducc0
except ImportError:
    ducc0 = None
try:
    import shtns
except ImportError:
    shtns = None

CHANNELS = 3
THREADS = int(os.environ["OMP_NUM_THREADS"])
POINTS = 12_000
REPEATS = 25


def once(call) -> float:
    """Return the time of one call, milliseconds."""
    start = time.perf_counter()
    jax.block_until_ready(call())
    return 1e3 * (time.perf_counter() - start)


def timed(calls: dict) -> dict:
    """Return for each call its first time, median and least of the next ones, taken in turns."""
    cold = {name: once(call) for name, call in calls.items()}
    warm = {name: [] for name in calls}
    for _ in range(REPEATS):
        for name, call in calls.items():
            once(call)
            warm[name].append(once(call))
    return {name: (cold[name], statistics.median(warm[name]), min(warm[name])) for name in calls}


def ours(grid: harmonics.LatLongGrid, band_limit: int, dtype) -> dict:
    rng = np.random.default_rng(1)
    image = jax.numpy.asarray(rng.normal(size=(*grid.shape, CHANNELS)), dtype)
    light = jax.numpy.asarray(rng.normal(size=((band_limit + 1) ** 2, CHANNELS)), dtype)
    name = f"jaxrender {np.dtype(dtype)}"
    return {
        (name, "analyse"): lambda: harmonics.analyse(grid, image, band_limit),
        (name, "synthesise"): lambda: harmonics.synthesise(grid, light),
    }


def ducc_calls(grid: harmonics.LatLongGrid, band_limit: int) -> dict:
    """Return ducc0's transforms of the same grid in float32, one channel after the other."""
    if ducc0 is None:
        return {}
    from ducc0.sht import experimental as sht

    count = (band_limit + 1) * (band_limit + 2) // 2
    rng = np.random.default_rng(0)
    alm = rng.normal(size=(CHANNELS, 1, count)).astype(np.complex64)
    maps = rng.normal(size=(CHANNELS, 1, *grid.shape)).astype(np.float32)
    common = {"spin": 0, "lmax": band_limit, "geometry": "F1", "nthreads": THREADS}
    size = {"ntheta": grid.height, "nphi": grid.width}
    return {
        ("ducc0 float32", "analyse"): lambda: [sht.analysis_2d(map=one, **common) for one in maps],
        ("ducc0 float32", "synthesise"): lambda: [
            sht.synthesis_2d(alm=one, **size, **common) for one in alm
        ],
    }


def shtns_calls(grid: harmonics.LatLongGrid, band_limit: int) -> dict:
    """Return SHTns's transforms of the same grid, one channel after the other."""
    if shtns is None:
        return {}
    plan = shtns.sht(band_limit, band_limit, 1, shtns.sht_orthonormal, THREADS)
    plan.set_grid(*grid.shape, shtns.sht_reg_fast | shtns.SHT_PHI_CONTIGUOUS)
    maps = np.random.default_rng(0).normal(size=(CHANNELS, *grid.shape))
    alm = [plan.analys(one.copy()) for one in maps]
    return {
        # A copy, because the analysis overwrites its input.
        ("SHTns float64", "analyse"): lambda: [plan.analys(one) for one in maps.copy()],
        ("SHTns float64", "synthesise"): lambda: [plan.synth(one) for one in alm],
    }


def bench_transforms(rows: int, band_limit: int):
    grid = harmonics.LatLongGrid(rows, 2 * rows)
    calls = {
        **shtns_calls(grid, band_limit),
        **ducc_calls(grid, band_limit),
        **ours(grid, band_limit, np.float32),
        **ours(grid, band_limit, np.float64),
    }
    times = timed(calls)
    for (who, what), (cold, warm, best) in times.items():
        ratios = ""
        if who.startswith("jaxrender"):
            for peer in ("SHTns float64", "ducc0 float32"):
                if (peer, what) in times:
                    peer_warm, peer_best = times[peer, what][1:]
                    ratios += f"  {warm / peer_warm:5.2f} ({best / peer_best:.2f}) of {peer}"
        label = f"degree {band_limit:4d} {what:11s} {who:18s}"
        print(f"{label} {cold:9.1f} {warm:9.2f} {best:9.2f}{ratios}")


def bench_points(band_limit: int, dtype):
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(POINTS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = jax.numpy.asarray(directions, dtype)
    light = jax.numpy.asarray(rng.normal(size=((band_limit + 1) ** 2, CHANNELS)), dtype)
    calls = {
        "real_basis": lambda: harmonics.real_basis(directions, band_limit),
        "evaluate": lambda: harmonics.evaluate(light, directions),
        "degree_table": lambda: harmonics.degree_table(light, directions),
    }
    for name, (cold, warm, best) in timed(calls).items():
        label = f"{np.dtype(dtype)} {POINTS} points"
        print(f"degree {band_limit:4d} {name:12s} {label:20s} {cold:6.1f} {warm:9.2f} {best:9.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=512)
    parser.add_argument("--degrees", type=int, nargs="+", default=[30, 64, 255])
    parser.add_argument("--points", action="store_true", help="time evaluation at points too")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    peers = [f"{m.__name__} {m.__version__}" if m else "peer missing" for m in (shtns, ducc0)]
    print(
        f"{os.cpu_count()} cores, {jax.default_backend()}, jax {jax.__version__}", *peers, sep=", "
    )
    print(
        f"{arguments.rows} x {2 * arguments.rows} x {CHANNELS}, {THREADS} threads; cold, warm, best"
    )
    print("in milliseconds; ratio of warm (of best) times")
    for band_limit in arguments.degrees:
        bench_transforms(arguments.rows, band_limit)
    for band_limit in (8, 32, 128) if arguments.points else ():
        for dtype in (np.float32, np.float64):
            bench_points(band_limit, dtype)


if __name__ == "__main__":
    main()
