"""L fig. 4.4: relative rms error against the part of the coefficients that is kept, four wavelets.

    python experiments/lalonde_figure_4_4.py [--table FILE ...] [--out FOLDER]

The figure's curves are not printed as numbers; its text says that narrow wavelets do as well as
broad ones, and that Daubechies' with 4 vanishing moments is not as efficient as the linear spline.
Tables of 32^4 samples; 1 channel.  Materials as in ``lalonde_table_4_1``, where the published
numbers of one wavelet stand (circles here; ERRATA 65 doubts Phong's).  Draws
``lalonde_figure_4_4.png``.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from lalonde_table_4_1 import PUBLISHED, SIZE, materials

from jaxrender.brdf.compression.squares import Goal, compression_of
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.wavelets import WAVELETS

OUT = Path(__file__).parent / "out"
KEPT = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.001, 0.0001)


def curves(brdf) -> dict[str, list[tuple[float, float]]]:
    """For each wavelet the count over all samples, and the error."""
    table = tabulate(brdf, SIZE).values[..., :1]
    found = {}
    for name, wavelet in WAVELETS.items():
        made = [compression_of(table, wavelet, Goal(fraction)) for fraction in KEPT]
        found[name] = [(one.tree.count, one.measured) for one in made]
    return found


def draw(found: dict[str, dict], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(found), figsize=(4.6 * len(found), 4), squeeze=False)
    for axis, (material, lines) in zip(axes[0], found.items(), strict=True):
        for name, line in lines.items():
            axis.loglog(*np.transpose(line), marker=".", label=name)
        key = next((k for k in PUBLISHED if material.lower().startswith(k.lower())), None)
        if key:
            counts, _, errors = np.transpose(PUBLISHED[key][1:])
            axis.loglog(counts, errors, "ko", fillstyle="none", label="published")
        axis.set_title(material)
        axis.set_xlabel(f"coefficients of {SIZE}^4")
        axis.grid(alpha=0.3)
    axes[0][0].set_ylabel("relative rms error")
    axes[0][0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    found = {name: curves(brdf) for name, brdf in materials(options.table).items()}
    for name, lines in found.items():
        print(f"\n{name}\n{'kept':14s}" + "".join(f"{f:16g}" for f in KEPT))
        for wavelet, line in lines.items():
            cells = "".join(f"{error:9.4f}{count:7d}" for count, error in line)
            print(f"{wavelet:14s}{cells}")
    draw(found, options.out / "lalonde_figure_4_4.png")


if __name__ == "__main__":
    main()
