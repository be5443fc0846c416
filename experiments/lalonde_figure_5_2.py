"""L fig. 5.2: the luminaires through their light fields, with 100 %, 10 %, 1 % of coefficients.

    python experiments/lalonde_figure_5_2.py [--out FOLDER] [--size 32] [--width 320]

L has 32 samples along each axis and Haar's wavelet; beside it the linear spline, which has no
steps.  Fractions are of the coefficients that are not zero.  L prints pictures only; printed here
are the coefficients kept and the rms error of the picture against that of the wavelet's full tree
and against the traced model, relative to its rms: the latter's first row is what sampling costs.
Draws ``lalonde_figure_5_2.png``.
"""

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from lalonde_luminaires import MODELS, OUT, luminaire, measured, shown, view

from jaxrender.wavelets import haar, linear_spline

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FRACTIONS = (1.0, 0.1, 0.01)
WAVELETS = (haar(), linear_spline())


def relative_rms(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.sqrt(((found - wanted) ** 2).sum() / (wanted**2).sum()))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--width", type=int, default=320)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(3, 6, figsize=(24, 12.6))
    print(f"{'':36s} coefficients   rms to 100 %   rms to the model")
    for row, (name, make) in zip(axes, MODELS.items(), strict=True):
        model = make()
        samples, rays = measured(name, args.size), view(model, args.width)
        traced, full = model.radiance(*rays), np.zeros(0)
        cases = [(wavelet, fraction) for wavelet in WAVELETS for fraction in FRACTIONS]
        for axis, (wavelet, fraction) in zip(row, cases, strict=True):
            lamp = luminaire(name, samples, fraction, wavelet)
            seen = np.asarray(lamp.radiance_along(*rays).radiance)
            full = seen if fraction == 1 else full
            count = sum(tree.count for tree in lamp.trees)
            print(
                f"{name:12s} {wavelet.name:15s} {fraction:7.0%} {count:13d} "
                f"{relative_rms(seen, full):14.3f} {relative_rms(seen, traced):18.3f}"
            )
            axis.imshow(shown(seen, args.width))
            axis.set_title(f"{name}, {wavelet.name}, {fraction:.0%}")
            axis.axis("off")
    figure.tight_layout()
    figure.savefig(args.out / "lalonde_figure_5_2.png", dpi=70)


if __name__ == "__main__":
    main()
