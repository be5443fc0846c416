"""T fig. 2.3: the first nine real spherical harmonics on the front of the sphere.

    python experiments/figure_2_3.py [--out FOLDER] [--size 200]

Green is positive, blue negative, as in the thesis.  Prints each harmonic's published polynomial (T
2.27 in real form, T 4.5) beside ours at random directions, and how orthonormal they are.  The front
is seen from +Z with x to the right.  Draws ``figure_2_3.png``.
"""

import argparse
import os
from pathlib import Path

import jax
import numpy as np

from jaxrender.harmonics import LatLongGrid, flat_index, real_basis

OUT = Path(__file__).parent / "out"
POLYNOMIALS = {
    (0, 0): ("sqrt(1/4pi)", lambda x, y, z: np.sqrt(1 / (4 * np.pi)) + 0 * x),
    (1, -1): ("sqrt(3/4pi) y", lambda x, y, z: np.sqrt(3 / (4 * np.pi)) * y),
    (1, 0): ("sqrt(3/4pi) z", lambda x, y, z: np.sqrt(3 / (4 * np.pi)) * z),
    (1, 1): ("sqrt(3/4pi) x", lambda x, y, z: np.sqrt(3 / (4 * np.pi)) * x),
    (2, -2): ("sqrt(15/4pi) xy", lambda x, y, z: np.sqrt(15 / (4 * np.pi)) * x * y),
    (2, -1): ("sqrt(15/4pi) yz", lambda x, y, z: np.sqrt(15 / (4 * np.pi)) * y * z),
    (2, 0): ("sqrt(5/16pi) (3z^2-1)", lambda x, y, z: np.sqrt(5 / (16 * np.pi)) * (3 * z**2 - 1)),
    (2, 1): ("sqrt(15/4pi) xz", lambda x, y, z: np.sqrt(15 / (4 * np.pi)) * x * z),
    (2, 2): (
        "sqrt(15/16pi) (x^2-y^2)",
        lambda x, y, z: np.sqrt(15 / (16 * np.pi)) * (x**2 - y**2),
    ),
}


def print_table():
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(1000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    basis = np.asarray(real_basis(directions, 2))
    grid = LatLongGrid(16, 32)
    nodes = np.asarray(real_basis(grid.directions().reshape(-1, 3), 2))
    gram = nodes.T @ (nodes * grid.weights().reshape(-1, 1))
    print("l   m   published polynomial        at (.6,0,.8)  measured     worst of 1000")
    for (degree, order), (name, polynomial) in POLYNOMIALS.items():
        index = flat_index(degree, order)
        worst = np.abs(polynomial(*directions.T) - basis[:, index]).max()
        published = polynomial(0.6, 0.0, 0.8)
        measured = float(real_basis(np.array([0.6, 0, 0.8]), 2)[index])
        print(f"{degree}  {order:+d}   {name:26s} {published:12.6f} {measured:12.6f}   {worst:.1e}")
    print(f"orthonormal: largest entry of <Y, Y'> - 1 is {np.abs(gram - np.eye(9)).max():.1e}")


def sphere_front(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the visible half of the sphere, and which pixels show it."""
    line = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(line * 1.02, -line * 1.02)
    squared = 1 - x**2 - y**2
    directions = np.stack([x, y, np.sqrt(np.maximum(squared, 0))], axis=-1)
    length = np.linalg.norm(directions, axis=-1, keepdims=True)
    return directions / np.where(length > 0, length, 1), squared > 0


def colours(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    strength = np.clip(np.abs(values), 0, 1)[..., None]
    green, blue = np.array([0.0, 0.75, 0.1]), np.array([0.1, 0.15, 0.95])
    image = strength * np.where(values[..., None] > 0, green, blue)
    return np.where(inside[..., None], image, 1.0)


def draw(size: int, path: Path):
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    directions, inside = sphere_front(size)
    basis = np.asarray(real_basis(directions, 2))
    figure, axes = plt.subplots(3, 5, figsize=(9, 5.6), layout="constrained")
    for axis in axes.ravel():
        axis.axis("off")
    for degree, order in POLYNOMIALS:
        axis, values = axes[degree, 2 + order], basis[..., flat_index(degree, order)]
        axis.imshow(colours(values / np.abs(basis[inside]).max(), inside))
        axis.set_title(rf"$Y_{{{degree},{order}}}$", fontsize=10)
    figure.suptitle("T fig. 2.3: real harmonics, green positive, blue negative")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    print(f"written: {path}")


def main():
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--size", type=int, default=200)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    print_table()
    draw(arguments.size, arguments.out / "figure_2_3.png")


if __name__ == "__main__":
    main()
