"""L fig. 4.5: shapes shaded with trees of 10, 5, 1, .5 and .1 %, and the difference images.

    python experiments/lalonde_figure_4_5.py [--table FILE ...] [--wavelet haar] [--out FOLDER]

The thesis shades a chair; here a sphere and a vase (fig. 3.1's) under one source.  Its claims:
images are good at 1 %, and recognisable at .1 %.  Printed are the images' rms errors, pixels scaled
to (0..1], beside the published ones of the chair (ERRATA 65 for Phong).  Below each picture is the
absolute difference from the unthresholded tree's, four times as bright.  Draws
``lalonde_figure_4_5_MATERIAL.png``.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from lalonde_figure_3_1 import picture, sphere, vase
from lalonde_table_4_1 import PUBLISHED, SIZE, image_rms, materials

from jaxrender.brdf import WaveletBRDF
from jaxrender.brdf.compression.squares import Goal, compression_of
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.wavelets import wavelet_named

OUT = Path(__file__).parent / "out"
FRACTIONS = (1.0, 0.1, 0.05, 0.01, 0.005, 0.001)
# Rows of table 4.1 that these are.
ROWS = (0, 2, 3, 4, 5, 6)


def shaded(brdf, wavelet: str, pixels: int) -> list[np.ndarray]:
    table = tabulate(brdf, SIZE).values
    found = []
    for fraction in FRACTIONS:
        tree = WaveletBRDF(compression_of(table, wavelet_named(wavelet), Goal(fraction)).tree)
        found.append(np.concatenate([picture(tree, s, pixels) for s in (sphere, vase)], axis=1))
    return found


def draw(images: list[np.ndarray], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(images), figsize=(4 * len(images), 4.2))
    bright = np.percentile(images[0][images[0] > 0], 99)
    for column, fraction, image in zip(axes.T, FRACTIONS, images, strict=True):
        column[0].imshow(np.clip(image / bright, 0, 1) ** (1 / 2.2))
        column[1].imshow(np.clip(4 * np.abs(image - images[0]) / bright, 0, 1))
        column[0].set_title(f"{100 * fraction:g} %")
    for axis in axes.flat:
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=60)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", nargs="*", default=[])
    parser.add_argument("--wavelet", default="haar")
    parser.add_argument("--pixels", type=int, default=180)
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, brdf in materials(options.table).items():
        images = shaded(brdf, options.wavelet, options.pixels)
        key = next((k for k in PUBLISHED if name.lower().startswith(k.lower())), None)
        for row, fraction, image in zip(ROWS, FRACTIONS, images, strict=True):
            published = PUBLISHED[key][row][1] if key else np.nan
            error = image_rms(image, images[0])
            print(f"{name:12s} {100 * fraction:5g} %  image rms {error:.4f}  chair {published:.4f}")
        draw(images, options.out / f"lalonde_figure_4_5_{name.replace(' ', '_')}.png")


if __name__ == "__main__":
    main()
