"""Lalonde figure 3.3: a velvet of cut threads, and its BRDF on a surface.

    python experiments/lalonde_figure_3_3.py [--samples 128]

Measures the patch in polar angles (the thesis's resolution was 15 samples in each angle; here 10 by
20, which is coarser in polar angle), and shows the threads beside a sphere (the thesis: a chair)
under one lamp near the viewer and under one behind it.  The thesis says that much of the reflection
is in regions of low incident angle (grazing): printed is the retroreflection at 10, 45 and 75
degrees from the normal, across the lean and against it.
"""

import argparse

import jax
import matplotlib
import numpy as np
from lalonde_figure_3_2 import OUT, portrait

from jaxrender.brdf import Lambertian, Phong
from jaxrender.brdf.tabulated import TabulatedBRDF
from jaxrender.geometry import POLAR
from jaxrender.geometry.height_fields import velvet
from jaxrender.reflection.tracing.gonioreflectometer import Gonioreflectometer, MeasureSettings

matplotlib.use("Agg")
import matplotlib.pyplot as plt

BASE = Lambertian(np.array([0.10, 0.01, 0.02]) / np.pi)
THREAD = Phong(np.array([0.45, 0.05, 0.08]) / np.pi, np.full(3, 0.15), 10.0)


def sphere(table: TabulatedBRDF, light: np.ndarray, size: int = 160) -> np.ndarray:
    """A sphere seen from -y whose nap leans downwards, as sRGB."""
    x, z = np.meshgrid(np.linspace(-1.05, 1.05, size), np.linspace(1.05, -1.05, size))
    inside = x**2 + z**2 < 1
    y = -np.sqrt(np.where(inside, 1 - x**2 - z**2, 0))
    normals = np.stack([x, y, z], axis=-1)[inside]
    down = np.array([0, 0, -1.0]) + normals[:, 2:] * normals
    down /= np.maximum(np.linalg.norm(down, axis=1, keepdims=True), 1e-9)
    frames = np.stack([down, np.cross(normals, down), normals], axis=1)
    light = light / np.linalg.norm(light)
    incoming, outgoing = frames @ light, frames @ np.array([0, -1.0, 0])
    value = np.asarray(table.evaluate(incoming, outgoing)) * np.maximum(incoming[:, 2:], 0)
    picture = np.zeros((size, size, 3))
    picture[inside] = np.clip(6 * value, 0, 1) ** (1 / 2.2)
    return picture


def main() -> None:
    """Measure, draw and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=128)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    patch = velvet(500, 0.25, 0.012, 0.35)
    meter = Gonioreflectometer.of(patch, [BASE, THREAD])
    settings = MeasureSettings((10, 20, 10, 20), POLAR, asked.samples, 3)
    found = meter.measure(settings)
    table = TabulatedBRDF(found.values, POLAR)
    pictures = {
        "threads": portrait(patch, [BASE, THREAD]),
        "lamp beside the viewer": sphere(table, np.array([0.4, -1.0, 0.5])),
        "lamp behind": sphere(table, np.array([0.9, 0.6, 0.5])),
    }
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.2))
    for axis, (title, picture) in zip(axes, pictures.items()):
        axis.imshow(picture)
        axis.set_title(title)
        axis.axis("off")
    figure.tight_layout()
    OUT.mkdir(exist_ok=True)
    figure.savefig(OUT / "lalonde_figure_3_3.png", dpi=90)
    rng = np.random.default_rng(0)
    print("retroreflection, red, 1/sr, viewer on the side that the threads")
    print(f"{'angle':>6s} {'lean towards':>13s} {'lean from':>10s}")
    for angle in np.radians([10, 45, 75]):
        row = []
        for sign in (1, -1):
            way = np.array([sign * np.sin(angle), 0, np.cos(angle)])
            row.append(meter.pairs(way[None], way, settings._replace(samples=2048), rng)[0][0, 0])
        print(f"{np.degrees(angle):6.0f} {row[0]:13.4f} {row[1]:10.4f}")
    relative = found.standard_errors.mean() / found.values.mean()
    print(f"mean standard error {100 * relative:.1f} % of the mean")


if __name__ == "__main__":
    main()
