"""L fig. 4.3: Haar beside the linear spline, both thresholded to .1 % of their coefficients.

    python experiments/lalonde_figure_4_3.py [--table FILE ...] [--out FOLDER]

The figure shows that the spline's smooth interpolation hides what Haar's steps show.  Printed are
the image's rms error against the BRDF itself, and the part of the lit sphere's slope that is edges:
the mean size of pixels' second differences over that of the BRDF's own picture (1 is as smooth).
Draws ``lalonde_figure_4_3.png``.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from lalonde_figure_3_1 import picture, sphere
from lalonde_table_4_1 import SIZE, image_rms, materials

from jaxrender.brdf import WaveletBRDF
from jaxrender.brdf.compression.squares import Goal, compression_of
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.wavelets import wavelet_named

OUT = Path(__file__).parent / "out"
FRACTION = 0.001


def roughness(image: np.ndarray) -> float:
    lit = image.mean(axis=-1)
    return float(np.abs(np.diff(lit, 2, axis=1)).mean() + np.abs(np.diff(lit, 2, axis=0)).mean())


def draw(found: dict[str, dict[str, np.ndarray]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(found), 3, figsize=(9, 3.2 * len(found)), squeeze=False)
    for row, (name, images) in zip(axes, found.items(), strict=True):
        bright = np.percentile(images["itself"][images["itself"] > 0], 99)
        for axis, (what, image) in zip(row, images.items(), strict=True):
            axis.imshow(np.clip(image / bright, 0, 1) ** (1 / 2.2))
            axis.set_title(f"{name}: {what}")
            axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", nargs="*", default=[])
    parser.add_argument("--pixels", type=int, default=256)
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for name, brdf in materials(options.table).items():
        table = tabulate(brdf, SIZE).values
        whole = picture(brdf, sphere, options.pixels)
        drawn[name] = {}
        for wavelet in ("haar", "cdf-2-2"):
            found = compression_of(table, wavelet_named(wavelet), Goal(FRACTION))
            image = picture(WaveletBRDF(found.tree), sphere, options.pixels)
            drawn[name][wavelet] = image
            print(
                f"{name:12s} {wavelet:8s} {found.tree.count:4d} coefficients, BRDF rms "
                f"{found.measured:.3f}, image rms {image_rms(image, whole):.4f}, second "
                f"differences x {roughness(image) / roughness(whole):.2f}"
            )
        drawn[name]["itself"] = whole
    draw(drawn, options.out / "lalonde_figure_4_3.png")


if __name__ == "__main__":
    main()
