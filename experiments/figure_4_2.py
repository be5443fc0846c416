"""T figure 4.2: irradiance maps from nine coefficients beside standard prefiltering.

    python experiments/figure_4_2.py PROBE.hdr [PROBE.hdr ...] [--convention cross] [--out F.png]

Maps are laid out as the thesis's: straight ahead in the middle, straight back at the rim, the
radius growing with the angle.  Errors are parts of the light's total intensity, the integral of its
radiance; published for natural light: under 1 % on average, under 5 % at the worst pixel.
"""

import argparse
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

from jaxrender.harmonics import LatLongGrid, analyse
from jaxrender.io import read_environment
from jaxrender.pipelines.report.display import tone_key, tone_mapped
from jaxrender.reflection import irradiance_error, irradiance_matrix, quadratic_irradiance

SIZE = 128
# Rows of the light that standard prefiltering sums over.
LIGHT_ROWS = 128


def disc() -> tuple[np.ndarray, np.ndarray]:
    """Return the unit directions of a SIZE x SIZE angular map, and where the map is."""
    across = (2 * np.arange(SIZE) + 1) / SIZE - 1
    x, y = np.meshgrid(across, -across)
    radius = np.hypot(x, y)
    polar = np.pi * radius
    scale = np.sin(polar) / np.maximum(radius, 1e-12)
    return np.stack([scale * x, scale * y, np.cos(polar)], axis=-1), radius <= 1


def standard(environment, normals: np.ndarray) -> np.ndarray:
    """Sum cosine times radiance over all texels above each normal."""
    nodes = environment.nodes()
    directions, energy = np.asarray(nodes.directions), np.asarray(nodes.irradiance)
    found = [np.maximum(part @ directions.T, 0) @ energy for part in np.array_split(normals, 64)]
    return np.concatenate(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("probes", nargs="+", type=Path)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_4_2.png"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    directions, inside = disc()
    figure, axes = plt.subplots(
        len(arguments.probes), 4, figsize=(13, 3.3 * len(arguments.probes)), squeeze=False
    )
    bound = irradiance_error(2)
    print(f"bounds, of the light's total intensity: worst {bound.worst:.4f}, mean {bound.mean:.4f}")
    for path, row in zip(arguments.probes, axes):
        light = read_environment(path, arguments.convention, height=LIGHT_ROWS, axes="probe")
        exact = standard(light, directions[inside])
        light_coefficients = analyse(light.grid, light.radiance, 2)
        found = quadratic_irradiance(irradiance_matrix(light_coefficients), directions[inside])
        total = np.asarray(light.nodes().irradiance).sum(axis=0)
        off = np.abs(np.asarray(found) - exact) / total
        # Equal solid angles count alike: a texel of the map stands for sin(t) / t of one.
        polar = np.arccos(np.clip(directions[inside][:, 2], -1, 1))
        solid = np.sinc(polar / np.pi)
        mean = (solid @ off / solid.sum()).mean()
        print(
            f"{path.name}: mean error {100 * mean:.2f} % (published: under 1), "
            f"largest {100 * off.max():.2f} % (under 5)"
        )
        grid: LatLongGrid = light.grid
        lit = np.asarray(light.radiance)
        rows = (np.arccos(np.clip(directions[..., 2], -1, 1)) / np.pi * grid.height).astype(int)
        angle = np.arctan2(directions[..., 1], directions[..., 0]) % (2 * np.pi)
        columns = (angle / (2 * np.pi) * grid.width).astype(int)
        probe = lit[rows.clip(0, grid.height - 1), columns.clip(0, grid.width - 1)]
        pictures = {"environment": probe}
        for name, values in (("standard", exact), ("nine coefficients", np.asarray(found))):
            pictures[name] = np.zeros((SIZE, SIZE, 3))
            pictures[name][inside] = values
        for place, (name, picture) in zip(row, pictures.items()):
            key = tone_key(probe if name == "environment" else pictures["standard"][inside][None])
            shown = tone_mapped(np.maximum(picture, 0), key)
            shown[~inside] = 255
            place.imshow(shown)
            place.set(title=name, xticks=[], yticks=[])
        error = np.full((SIZE, SIZE), np.nan)
        error[inside] = 100 * off.max(axis=1)
        drawn = row[3].imshow(error, cmap="magma")
        row[3].set(title="difference, % of the total", xticks=[], yticks=[])
        figure.colorbar(drawn, ax=row[3], shrink=0.8)
        row[0].set_ylabel(path.stem)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.out, dpi=110, bbox_inches="tight")
    print(f"picture: {arguments.out}")


if __name__ == "__main__":
    main()
