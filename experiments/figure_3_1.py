"""T fig. 3.1: the clamped cosine and its sums of harmonics up to degree 0, 1, 2 and 4.

    python experiments/figure_3_1.py [--out FOLDER]

Published: "for l = 2, we already get a very good approximation", and over 99 % of the energy.
Prints each sum's error and energy; draws ``figure_3_1.png``.
"""

import argparse
import os
from pathlib import Path

import numpy as np

from jaxrender.spectra import lambertian_transfer

OUT = Path(__file__).parent / "out"
SHOWN = (0, 1, 2, 4)
PUBLISHED = {2: "very good; over 99 % of the energy"}


def approximation(cosines: np.ndarray, band_limit: int) -> np.ndarray:
    """sum_l rho_l Y_l0 = sum_l (2l + 1) / (4 pi) A_l P_l (T 3.28)."""
    degree = np.arange(band_limit + 1)
    series = (2 * degree + 1) / (4 * np.pi) * lambertian_transfer(band_limit)
    return np.polynomial.legendre.legval(cosines, series)


def print_table():
    x, w = np.polynomial.legendre.leggauss(2000)
    exact = np.maximum(x, 0)
    print("degree  energy kept   rms error  largest error  published")
    for band_limit in (*SHOWN, 6, 8):
        error = approximation(x, band_limit) - exact
        left = np.sum(w * error**2) / np.sum(w * exact**2)
        rms = np.sqrt(np.sum(w * error**2) / 2)
        print(
            f"{band_limit:6d}  {100 * (1 - left):9.3f} %  {rms:9.5f}  {np.abs(error).max():13.5f}"
            f"  {PUBLISHED.get(band_limit, '')}"
        )


def draw(path: Path):
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    angle = np.linspace(0, np.pi, 600)
    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    axis.plot(angle, np.maximum(np.cos(angle), 0), "k", lw=2.5, label="clamped cosine")
    for band_limit in SHOWN:
        axis.plot(angle, approximation(np.cos(angle), band_limit), label=f"l ≤ {band_limit}")
    axis.axhline(0, color="0.7", lw=0.8)
    axis.set(
        xlabel="angle from the normal, radians",
        xlim=(0, np.pi),
        title="T fig. 3.1: the Lambertian filter by degree",
    )
    axis.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    print(f"written: {path}")


def main():
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    print_table()
    draw(arguments.out / "figure_3_1.png")


if __name__ == "__main__":
    main()
