"""L fig. 5.4: compression against error for the three luminaires, for four wavelets.

    python experiments/lalonde_figure_5_4.py [--out FOLDER] [--size 32]

32 samples along each axis, as L has.  Its figure is a plot without a table: there are no published
numbers to print beside these.  Fractions are of the coefficients that are not zero.
Errors are measured on the reconstruction, relative to the rms of the samples.  Of the box the
brightest face, the lower one.  Draws ``lalonde_figure_5_4.png``.
"""

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from lalonde_luminaires import MODELS, OUT, measured

from jaxrender.wavelets import WAVELETS, analyse_nonstandard, keep_fraction, synthesise_nonstandard

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FRACTIONS = (0.003, 0.01, 0.03, 0.1, 0.3)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--size", type=int, default=32)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.3), sharey=True)
    print(f"{'relative rms error':27s}" + "".join(f"{f:9.1%}" for f in FRACTIONS))
    for axis, name in zip(axes, MODELS):
        samples = measured(name, args.size)
        brightest = max(samples, key=lambda s: float(s.mean()))
        size = np.sqrt((brightest**2).mean())
        for wavelet in WAVELETS.values():
            coefficients = analyse_nonstandard(wavelet, brightest)
            errors = []
            for fraction in FRACTIONS:
                kept = keep_fraction(coefficients, fraction).coefficients
                found = np.asarray(synthesise_nonstandard(wavelet, kept))
                errors.append(np.sqrt(((found - brightest) ** 2).mean()) / size)
            print(f"{name:13s} {wavelet.name:13s}" + "".join(f"{e:9.4f}" for e in errors))
            axis.loglog(100 * np.array(FRACTIONS), errors, "o-", label=wavelet.name)
        axis.set_title(name)
        axis.set_xlabel("coefficients kept (%)")
    axes[0].set_ylabel("relative rms error")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(args.out / "lalonde_figure_5_4.png", dpi=100)


if __name__ == "__main__":
    main()
