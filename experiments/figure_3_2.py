"""T fig. 3.2: the Lambertian coefficients rho_l by degree, and how they fall.

    python experiments/figure_3_2.py [--out FOLDER]

Published: odd degrees above 1 vanish; rho_l falls as l^-2 and Lambda_l rho_l as l^(-5/2).  Measures
both slopes on even degrees; draws ``figure_3_2.png`` over the thesis's range.
"""

import argparse
import os
from pathlib import Path

import numpy as np

from jaxrender.spectra import lambertian_transfer

OUT = Path(__file__).parent / "out"
PLOTTED, FAR = 20, 2000
SLOPES = {"rho_l": -2.0, "Lambda_l rho_l": -2.5}


def measured_slope(values: np.ndarray) -> float:
    """Slope of log |value| against log degree over the last even degrees."""
    far, near = FAR, FAR // 2
    return float(np.log(np.abs(values[far] / values[near])) / np.log(far / near))


def print_table(rho: np.ndarray, transfer: np.ndarray):
    print("degree     rho_l   Lambda_l rho_l")
    for degree in range(11):
        print(f"{degree:6d}  {rho[degree]:+8.5f}  {transfer[degree]:+8.5f}")
    odd = np.abs(rho[3::2]).max()
    print(f"odd degrees above 1: published 0, measured at most {odd:.1e}")
    for (name, published), values in zip(SLOPES.items(), (rho, transfer)):
        print(f"{name} falls as l^s: published {published}, measured {measured_slope(values):.4f}")


def draw(rho: np.ndarray, path: Path):
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    degree = np.arange(PLOTTED + 1)
    axes[0].axhline(0, color="0.7", lw=0.8)
    axes[0].plot(degree, rho[: PLOTTED + 1], "o-", ms=4)
    axes[0].set(xlabel="degree l", ylabel=r"$\rho_l$", title="T fig. 3.2")
    even = np.arange(2, FAR + 1, 2)
    axes[1].loglog(even, np.abs(rho[even]), label=r"$|\rho_l|$, even l")
    axes[1].loglog(
        even, np.abs(rho[FAR]) * (even / FAR) ** -2.0, "k:", label=r"$l^{-2}$ (published)"
    )
    axes[1].set(xlabel="degree l", title="how it falls")
    axes[1].legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    print(f"written: {path}")


def main():
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    transfer = lambertian_transfer(FAR)
    rho = transfer * np.sqrt((2 * np.arange(FAR + 1) + 1) / (4 * np.pi))
    print_table(rho, transfer)
    draw(rho, arguments.out / "figure_3_2.png")


if __name__ == "__main__":
    main()
