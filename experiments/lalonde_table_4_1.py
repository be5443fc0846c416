"""L table 4.1: what keeping fewer wavelet coefficients costs, in the BRDF, in an image and in time.

    python experiments/lalonde_table_4_1.py [--table FILE ...] [--wavelet haar] [--sphere 128]

Tables of 32^4 samples on Nusselt's square; a tree keeps this fraction of the non-zero coefficients.
"BRDF" is the rms of the samples' error over the samples' own rms, "image" that of a sphere shaded
by one source, the unthresholded tree's pixels scaled to (0..1] as the thesis has it; time is that
of one evaluation, warm and batched (theirs per pixel on a 200 MHz R4400, so only ratios compare).

The published Phong rows are not reproducible exactly (ERRATA 65): the text says exponent 30, the
table 50.  With the printed count of 15051 the relative rms of (R.V)^50 is .137 (Haar) and .075
(linear spline) where .0549 is printed.  How many coefficients are not zero depends on what counts
as zero: of Haar's, in float32, 226744 are above 1e-7 of the largest (ours), 154848 above 1e-5, and
150933 are printed; so equal fractions are not equal counts.

``--table`` adds measured materials, such as the
thesis's velvet and sawtooth from ``jaxrender measure``; fig. 3.1's analytic sawtooth stands in.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from lalonde_figure_3_1 import SAWTOOTH, picture, sphere

from jaxrender.brdf import BRDF, CosineLobe, WaveletBRDF
from jaxrender.brdf.compression.squares import Compression, Goal, compression_of
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.pipelines.brdf_sources import source_of
from jaxrender.wavelets import wavelet_named

FRACTIONS = (1.0, 0.2, 0.1, 0.05, 0.01, 0.005, 0.001, 0.0001)
# Count, image rms, BRDF rms.
PUBLISHED = {
    "Phong": [
        (150933, 0.0000, 0.0000),
        (30183, 0.0020, 0.0244),
        (15051, 0.0031, 0.0549),
        (7542, 0.0054, 0.1049),
        (1503, 0.0159, 0.2334),
        (747, 0.0236, 0.2814),
        (147, 0.0825, 0.4331),
        (12, 0.1877, 0.7486),
    ],
    "velvet": [
        (93911, 0.0000, 0.0000),
        (18779, 0.0010, 0.0437),
        (9388, 0.0028, 0.0944),
        (4692, 0.0029, 0.1612),
        (936, 0.0152, 0.2984),
        (467, 0.0216, 0.3535),
        (91, 0.0362, 0.5160),
        (6, 0.0776, 0.8279),
    ],
    "sawtooth": [
        (127334, 0.0000, 0.0000),
        (25463, 0.0075, 0.0386),
        (12728, 0.0149, 0.0719),
        (6363, 0.0202, 0.1207),
        (1268, 0.0352, 0.3479),
        (632, 0.0459, 0.4639),
        (123, 0.0762, 0.6809),
        (8, 0.1486, 0.9231),
    ],
}
POINTS = 1 << 14
SIZE = 32


def phong(exponent: float) -> BRDF:
    """(R.V)^n as the BRDF itself, without the cosine under it that T 3.34 has."""
    return CosineLobe(np.zeros(1), np.ones(1), exponent)


def materials(files: list[str]) -> dict[str, BRDF]:
    found: dict[str, BRDF] = {"Phong 50": phong(50), "Phong 30": phong(30), "sawtooth": SAWTOOTH}
    return found | {Path(name).stem: source_of(name).brdf for name in files}


class Row(NamedTuple):
    """One fraction: the tree, its sphere, and the time of an evaluation."""

    found: Compression
    image: np.ndarray
    microseconds: float


def rows(brdf: BRDF, wavelet: str, fractions: tuple, pixels: int) -> list[Row]:
    table = tabulate(brdf, SIZE).values[..., :1]
    made = []
    for fraction in fractions:
        found = compression_of(table, wavelet_named(wavelet), Goal(fraction))
        tree = WaveletBRDF(found.tree)
        made.append(Row(found, picture(tree, sphere, pixels), microseconds(tree)))
    return made


def microseconds(brdf: BRDF) -> float:
    """Of one pair of directions, the fastest of three batches."""
    pair = np.random.default_rng(0).normal(size=(2, POINTS, 3)).astype(np.float32)
    pair[..., 2] = np.abs(pair[..., 2])
    pair /= np.linalg.norm(pair, axis=-1, keepdims=True)
    evaluate = eqx.filter_jit(BRDF.evaluate)
    times = []
    for _ in range(4):
        start = time.perf_counter()
        jax.block_until_ready(evaluate(brdf, *pair))
        times.append(time.perf_counter() - start)
    return 1e6 * min(times) / POINTS


def image_rms(image: np.ndarray, whole: np.ndarray) -> float:
    """Rms of the difference over the pixels, the whole image's largest scaled to 1."""
    return float(np.sqrt(np.mean((image - whole) ** 2)) / whole.max())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", nargs="*", default=[])
    parser.add_argument("--wavelet", nargs="*", default=["haar", "cdf-2-2"])
    parser.add_argument("--sphere", type=int, default=128)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    for name, brdf in materials(options.table).items():
        key = next((k for k in PUBLISHED if name.lower().startswith(k.lower())), None)
        for wavelet in options.wavelet:
            print(f"\n{name}, {wavelet}" + (f"; published: {key}" if key else ""))
            print("  size     # coef.  published |   image  published |    BRDF  published |  us")
            found = rows(brdf, wavelet, FRACTIONS, options.sphere)
            published = PUBLISHED.get(key, [(np.nan,) * 3] * len(FRACTIONS))
            for fraction, row, (count, image, error) in zip(FRACTIONS, found, published):
                print(
                    f"  {fraction:<7g}{row.found.tree.count:9d} {count:10.0f} |"
                    f"{image_rms(row.image, found[0].image):8.4f} {image:10.4f} |"
                    f"{row.found.measured:8.4f} {error:10.4f} | {row.microseconds:.3f}"
                )


if __name__ == "__main__":
    main()
