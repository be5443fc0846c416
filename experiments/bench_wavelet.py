"""Wavelet decompositions of 32 x 32 x 32 x 32 x 3 samples: warm and cold times beside PyWavelets.

    python experiments/bench_wavelet.py [--size 32] [--standard]

Both transform all levels of four axes, periodically, and both get the same precision.  Cold is our
first call, tracing and compilation included; warm the median of the following ones, best the
fastest, taken in turns with the peer's so that a busy machine slows both.  After the peer's turn on
one thread ours finds the other processor asleep and the caches full of other things, so besides the
medians of as many calls in a row are compared, the peer's too.  Ratio = the peer's time over ours:
above 1 is faster; demanded is 12.  The peer runs on one thread, ours on what there is;
the answers are compared first.  In float64 much of our time goes into fresh pages of memory for
results of 25 MB (GLIBC_TUNABLES=glibc.malloc.hugetlb=1 saves a third).
"""

import argparse
import os
import statistics
import time
import warnings
from importlib.metadata import version

import jax
import numpy as np
import pywt

from jaxrender import wavelets

CHANNELS = 3
AXES = range(4)
PYWAVELETS = {
    "haar": "haar",
    "cdf-2-2": "bior2.2",
    "daubechies-2": "db2",
    "daubechies-4": "db4",
}
REPEATS = 15


def once(call) -> float:
    """Return the time of one call, milliseconds."""
    start = time.perf_counter()
    jax.block_until_ready(call())
    return 1e3 * (time.perf_counter() - start)


def timed(peer, ours) -> tuple[float, list[float], list[float], float]:
    """Return our first time, both's next ones in turns, ours rehearsed, and the ratio in a row."""
    cold = once(ours)
    theirs_warm, ours_warm = [], []
    for _ in range(REPEATS):
        theirs_warm.append(once(peer))
        once(ours)
        ours_warm.append(once(ours))
    in_a_row = [statistics.median(once(call) for _ in range(REPEATS)) for call in (peer, ours)]
    return cold, theirs_warm, ours_warm, in_a_row[0] / in_a_row[1]


def nonstandard(name: str, values: np.ndarray, levels: int) -> dict:
    wavelet, samples = wavelets.wavelet_named(name), jax.numpy.asarray(values)
    common = {"wavelet": PYWAVELETS[name], "mode": "periodization", "axes": AXES}
    theirs = pywt.wavedecn(values, level=levels, **common)
    coefficients = wavelets.analyse_nonstandard(wavelet, samples)
    expected = pywt.coeffs_to_array(theirs, axes=AXES)[0]
    return {
        "difference": float(np.abs(np.asarray(coefficients) - expected).max()),
        "analyse": (
            lambda: pywt.wavedecn(values, level=levels, **common),
            lambda: wavelets.analyse_nonstandard(wavelet, samples),
        ),
        "synthesise": (
            lambda: pywt.waverecn(theirs, **common),
            lambda: wavelets.synthesise_nonstandard(wavelet, coefficients),
        ),
    }


def standard(name: str, values: np.ndarray, levels: int) -> dict:
    wavelet, samples = wavelets.wavelet_named(name), jax.numpy.asarray(values)
    common = {"wavelet": PYWAVELETS[name], "mode": "periodization", "axes": AXES}
    theirs = pywt.fswavedecn(values, levels=levels, **common)
    coefficients = wavelets.analyse_standard(wavelet, samples)
    return {
        "difference": float(np.abs(np.asarray(coefficients) - theirs.coeffs).max()),
        "analyse": (
            lambda: pywt.fswavedecn(values, levels=levels, **common),
            lambda: wavelets.analyse_standard(wavelet, samples),
        ),
        "synthesise": (
            lambda: pywt.fswaverecn(theirs),
            lambda: wavelets.synthesise_standard(wavelet, coefficients),
        ),
    }


def bench(decomposition, name: str, size: int, dtype):
    values = np.random.default_rng(0).normal(size=(size,) * len(AXES) + (CHANNELS,)).astype(dtype)
    case = decomposition(name, values, size.bit_length() - 1)
    for what in ("analyse", "synthesise"):
        # Compiled above, in the comparison: forgotten, so that cold is cold.
        jax.clear_caches()
        cold, theirs, ours, in_a_row = timed(*case[what])
        median, best = statistics.median, min
        print(
            f"{decomposition.__name__:11s} {what:10s} {name:12s} {np.dtype(dtype)!s:7s}"
            f" {cold:8.0f} {median(ours):8.2f} {best(ours):8.2f}"
            f" {median(theirs):8.1f} {best(theirs):8.1f}"
            f" {median(theirs) / median(ours):6.1f} {best(theirs) / best(ours):6.1f}"
            f" {in_a_row:7.1f} {case['difference']:9.0e}"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--standard", action="store_true", help="the standard decomposition too")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    # The coarsest levels are shorter than the filters, as they should be.
    warnings.filterwarnings("ignore", "Level value", UserWarning)
    print(
        f"{os.cpu_count()} cores, {jax.default_backend()}, jax {jax.__version__},",
        f"PyWavelets {version('PyWavelets')}; milliseconds",
    )
    print(" " * 43, "    cold     warm     best     peer     best  ratio   best  in row difference")
    for decomposition in (nonstandard, standard) if arguments.standard else (nonstandard,):
        for dtype in (np.float32, np.float64):
            for name in PYWAVELETS:
                bench(decomposition, name, arguments.size, dtype)


if __name__ == "__main__":
    main()
