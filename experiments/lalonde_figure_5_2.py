"""L fig. 5.2: the luminaires through their light fields, with 100 %, 10 %, 1 % of coefficients.

    python experiments/lalonde_figure_5_2.py [--out FOLDER] [--size 16] [--width 220]

L has 32 samples along each axis (``--size 32``).  Fractions are of the coefficients that are not
zero.  L prints pictures only; printed here are the coefficients kept and the error of the picture
against that of the full tree, relative to its mean square.  Draws ``lalonde_figure_5_2.png``.
"""

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from lalonde_luminaires import MODELS, OUT, luminaire, measured, shown, view

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FRACTIONS = (1.0, 0.1, 0.01)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--size", type=int, default=16)
    parser.add_argument("--width", type=int, default=220)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(3, 3, figsize=(11, 11.3))
    for column, (name, make) in enumerate(MODELS.items()):
        samples, rays = measured(name, args.size), view(make(), args.width)
        full = np.zeros(0)
        for row, fraction in enumerate(FRACTIONS):
            lamp = luminaire(name, samples, fraction)
            seen = np.asarray(lamp.radiance_along(*rays).radiance)
            full = seen if row == 0 else full
            error = np.sqrt(((seen - full) ** 2).sum() / (full**2).sum())
            count = sum(tree.count for tree in lamp.trees)
            print(f"{name:12s} {fraction:6.0%} {count:8d} coefficients, relative rms {error:.3f}")
            axes[row, column].imshow(shown(seen, args.width))
            axes[row, column].set_title(f"{name}, {fraction:.0%}")
            axes[row, column].axis("off")
    figure.tight_layout()
    figure.savefig(args.out / "lalonde_figure_5_2.png", dpi=100)


if __name__ == "__main__":
    main()
