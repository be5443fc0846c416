"""T 3.33 and 4.12: the Lambertian filter Lambda_l rho_l by degree, beside the closed form.

    python experiments/equation_3_33.py [--out FOLDER]

Prints the thesis's digits, the printed formulas (T 3.32, 4.11, which give other numbers: ERRATA 18
and 19), the corrected one, and the share of the filter's energy up to each degree.  Draws both to
``equation_3_33.png``.
"""

import argparse
import math
import os
from pathlib import Path

import numpy as np

from jaxrender.spectra import lambertian_transfer

OUT = Path(__file__).parent / "out"
PUBLISHED = (3.142, 2.094, 0.785, 0.0, -0.131, 0.0, 0.049)
# "over 99 % of the energy of the BRDF filter is captured by l <= 2"
ENERGY_PUBLISHED = 0.99


def printed_332(degree: int) -> complex:
    """T 3.32 times Lambda_l as printed, the root over everything (even degrees)."""
    inner = (2 * degree + 1) / (4 * math.pi)
    inner *= (-1) ** (degree // 2 - 1) / ((degree + 2) * (degree - 1)) * central(degree)
    return 2 * math.pi * complex(inner) ** 0.5 * math.sqrt(4 * math.pi / (2 * degree + 1))


def printed_411(degree: int) -> float:
    """T 4.11 as printed, with (l! / 2)^2 (even degrees)."""
    sign = (-1) ** (degree // 2 - 1)
    factorials = math.factorial(degree) / (2**degree * (math.factorial(degree) / 2) ** 2)
    return 2 * math.pi * sign / ((degree + 2) * (degree - 1)) * factorials


def central(degree: int) -> float:
    return math.factorial(degree) / (2**degree * math.factorial(degree // 2) ** 2)


def energy_share(transfer: np.ndarray) -> np.ndarray:
    """Share of the clamped cosine's energy up to each degree: sum rho_l^2 over 2 pi / 3."""
    degree = np.arange(len(transfer))
    return np.cumsum(transfer**2 * (2 * degree + 1) / (4 * np.pi)) / (2 * np.pi / 3)


def print_table(transfer: np.ndarray):
    share = energy_share(transfer)
    print("degree  published   measured  off        3.32 printed   4.11 printed   energy up to it")
    for degree, value in enumerate(PUBLISHED):
        even = degree % 2 == 0
        root = f"{printed_332(degree):.3f}" if even else "-"
        factorial = f"{printed_411(degree):.4f}" if even else "-"
        print(
            f"{degree:6d}  {value:9.3f}  {transfer[degree]:9.6f}  {transfer[degree] - value:+.1e}"
            f"  {root:>13s}  {factorial:>13s}   {100 * share[degree]:9.3f} %"
        )
    verdict = "holds" if share[2] > ENERGY_PUBLISHED else "FAILS"
    print(f"energy up to degree 2: published over 99 %, measured {100 * share[2]:.2f} %: {verdict}")
    worst = np.abs(transfer[: len(PUBLISHED)] - PUBLISHED).max()
    print(f"largest difference {worst:.1e} (half a digit of the thesis: 5e-4)")


def draw(transfer: np.ndarray, path: Path):
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(5.5, 3.5), layout="constrained")
    degree = np.arange(len(transfer))
    axis.axhline(0, color="0.7", lw=0.8)
    axis.bar(degree, transfer, width=0.5, color="C0", label="measured (corrected 3.32)")
    axis.plot(range(len(PUBLISHED)), PUBLISHED, "k_", ms=16, mew=2, label="published (3.33)")
    axis.set(
        xlabel="degree l", ylabel=r"$\Lambda_l\,\rho_l$", title="T 3.33: the Lambertian filter"
    )
    axis.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    print(f"written: {path}")


def main():
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    transfer = lambertian_transfer(12)
    print_table(transfer)
    draw(transfer, arguments.out / "equation_3_33.png")


if __name__ == "__main__":
    main()
