"""The seven classes of inverse problems (T 6.1.1), from one photograph, a ring and a dense set.

    python experiments/taxonomy.py [--only 1 4 ...] [--out F.png]

Which of light L, BRDF and texture T are unknown makes the class.  Each is tried with one
photograph, a ring of 12, and 60 views from all around a ball: the 2D, 3D and 4D data of T 6.1.
Photographs are the exact integral of continuous light (no grid), with 1 % noise that the fits are
told of.  Without texture a photograph is 1200, 300 or 100 pixels; with texture it shows each texel
of 12 x 24 that it sees once.  Printed are the errors against the truth, what the program says is
identifiable or not, and its own words; where an answer cannot be had, what it says instead.

Class 6 is done twice: diffuse, where nobody can, and glossy, where what moves with the view tells.
Light is smooth where light and texture are both unknown or texture alone; one source joins it in
classes 2, 3 and 4.  Texture errors of classes 6 and 7 are those up to one scale of all (7, 6
glossy) or of each channel (6 diffuse), which no photograph tells.
"""

import os

# Read when NumPy is imported: the matrices are too small for a second thread to help.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import textwrap
import time

import jax
import numpy as np
from taxonomy_classes import CLASSES, Cell, attempt
from taxonomy_photographs import COUNTS

KINDS = {1: "one", 12: "ring", 60: "dense"}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(CLASSES), default=list(CLASSES))
    parser.add_argument("--out", default="experiments/out/taxonomy.png")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    start, table = time.perf_counter(), {}
    print("class      unknown               photographs")
    for name in arguments.only:
        unknown, trial = CLASSES[name]
        for count in COUNTS:
            cell = table[name, count] = attempt(trial, count)
            mark = "identifiable" if cell.identifiable else "NOT IDENTIFIABLE"
            print(f"{name:10s} {unknown:22s} {count:2d} {KINDS[count]:6s} {mark:9s} {cell.found}")
            print(textwrap.indent(textwrap.fill(cell.words, 100), " " * 12), flush=True)
    print(f"\n{time.perf_counter() - start:.0f} s")
    draw(table, arguments.only, arguments.out)


def draw(table: dict[tuple[str, int], Cell], names: list[str], out: str):
    """Draw the grid: coloured by the worst error, hatched where it says not identifiable."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Rectangle

    figure, axis = plt.subplots(figsize=(9.5, 0.75 * len(names) + 1.2), layout="constrained")
    errors = np.array([[table[name, count].error for count in COUNTS] for name in names])
    colours = plt.get_cmap("RdYlGn_r").with_extremes(bad="0.75")
    shown = axis.imshow(
        np.ma.masked_invalid(errors), cmap=colours, norm=LogNorm(0.3, 100), aspect="auto"
    )
    for row, name in enumerate(names):
        for column, count in enumerate(COUNTS):
            cell = table[name, count]
            if not cell.identifiable:
                corner = (column - 0.5, row - 0.5)
                axis.add_patch(Rectangle(corner, 1, 1, fill=False, hatch="//", lw=0, alpha=0.35))
            number = "refused" if np.isnan(cell.error) else f"{cell.error:.1f} %"
            text = number if cell.identifiable else f"{number}\nnot\nidentifiable"
            box = {"facecolor": "white", "alpha": 0.7, "lw": 0, "pad": 1.5}
            axis.text(column, row, text, ha="center", va="center", fontsize=9, bbox=box)
    axis.set_xticks(range(len(COUNTS)), [f"{count} ({KINDS[count]})" for count in COUNTS])
    labels = [f"{name}: {CLASSES[name][0]} unknown" for name in names]
    axis.set_yticks(range(len(names)), labels)
    axis.set_xlabel("photographs")
    axis.set_title(
        "T 6.1.1: worst error of what was sought; hatched: the program says it is not identifiable"
    )
    figure.colorbar(shown, label="error, %")
    figure.savefig(out, dpi=110)
    print(f"picture: {out}")


if __name__ == "__main__":
    main()
