"""T fig. 3.3: the Phong coefficients Lambda_l rho_l beside their Gaussian approximation.

    python experiments/figure_3_3.py [--out FOLDER]

For s = 8, 32, 128, 512: the exact transfer (T 3.37), T 3.40's exp(-l^2 / 2s), and exp(-l(l+1) /
2(s+1)), which ERRATA 22 proposes and the thesis does not have.  The figure's caption says that a
larger s is a wider lobe; the frequency width where the transfer falls to 1/e shows that it is a
narrower one (ERRATA 23).  Prints widths, and worst errors beside those of ERRATA 22, as the thesis
states none; draws ``figure_3_3.png``.
"""

import argparse
import os
from pathlib import Path

import jax
import numpy as np

from jaxrender.spectra import gaussian_phong_transfer, matched_phong_transfer, phong_transfer

OUT = Path(__file__).parent / "out"
EXPONENTS = (8, 32, 128, 512)
# Worst errors of T 3.40 and of the better form.
ERRATA_22 = {8: (0.052, 0.0116), 32: (0.039, 0.0031), 128: (0.023, 0.0008), 512: (0.0125, 0.0002)}
BAND_LIMIT = 120


def width(transfer: np.ndarray) -> float:
    """Degree at which a transfer first falls to 1/e."""
    first = int(np.argmax(transfer < np.exp(-1)))
    above, below = transfer[first - 1], transfer[first]
    return first - 1 + (above - np.exp(-1)) / (above - below)


def print_table():
    print("         worst error of 3.40   of exp(-l(l+1)/2(s+1))   1/e at degree     lobe: half")
    print("     s   ERRATA 22  measured  ERRATA 22    measured   T 3.40: sqrt(2s) exact  value at")
    for s in EXPONENTS:
        exact = np.asarray(phong_transfer(float(s), BAND_LIMIT))
        gaussian = np.abs(np.asarray(gaussian_phong_transfer(float(s), BAND_LIMIT)) - exact).max()
        matched = np.abs(np.asarray(matched_phong_transfer(float(s), BAND_LIMIT)) - exact).max()
        half = np.degrees(np.arccos(0.5 ** (1 / s)))
        print(
            f"{s:6d}   {ERRATA_22[s][0]:6.4f}    {gaussian:8.5f}    {ERRATA_22[s][1]:6.4f}"
            f"     {matched:8.5f}    {np.sqrt(2 * s):10.2f}  {width(exact):9.2f}  {half:6.1f} deg"
        )


def draw(path: Path):
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6.5, 4.2), layout="constrained")
    degree = np.arange(61)
    for number, s in enumerate(EXPONENTS):
        colour = f"C{number}"
        axis.plot(degree, phong_transfer(float(s), 60), "o", ms=3, color=colour, label=f"s = {s}")
        axis.plot(degree, gaussian_phong_transfer(float(s), 60), "-", lw=1, color=colour)
        axis.plot(degree, matched_phong_transfer(float(s), 60), "--", lw=1, color=colour)
    axis.plot([], [], "ko", ms=3, label="exact (T 3.37)")
    axis.plot([], [], "k-", lw=1, label=r"$\exp(-l^2/2s)$ (T 3.40)")
    axis.plot([], [], "k--", lw=1, label=r"$\exp(-l(l+1)/2(s+1))$ (ERRATA 22)")
    axis.set(xlabel="degree l", ylabel=r"$\Lambda_l\,\rho_l$", title="T fig. 3.3: Phong by degree")
    axis.legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    print(f"written: {path}")


def main():
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    print_table()
    draw(arguments.out / "figure_3_3.png")


if __name__ == "__main__":
    main()
