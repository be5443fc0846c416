"""Lalonde figure 3.2: the sawtooth micro-geometry, ridges red on one side and blue on the other.

    python experiments/lalonde_figure_3_2.py [--samples 1024]

Draws the patch as the path tracer sees it, and slices of its measured BRDF: from each of three
incident polar angles across the ridges, over the exit angle in that plane.  The thesis shows the
patch alone, without numbers.  Printed are the two colours at the steepest views from either side:
only the side that faces the viewer is seen, so each view has one colour, but for what bounces.
"""

import argparse
from pathlib import Path

import jax
import matplotlib
import numpy as np

from jaxrender.brdf import Lambertian
from jaxrender.geometry.height_fields import Patch, sawtooth
from jaxrender.geometry.periodic import PeriodicSurface
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection.tracing.emitters import DirectionalEmitter, EnvironmentEmitter
from jaxrender.reflection.tracing.gonioreflectometer import Gonioreflectometer, MeasureSettings
from jaxrender.reflection.tracing.path_tracer import PathSettings, path_radiance
from jaxrender.reflection.tracing.scattering import Scene

matplotlib.use("Agg")
import matplotlib.pyplot as plt

OUT = Path(__file__).parent / "out"
RED = Lambertian(np.array([0.8, 0.08, 0.06]) / np.pi)
BLUE = Lambertian(np.array([0.05, 0.1, 0.8]) / np.pi)
SUN = np.array([[-0.25, -0.55, 0.8]])


def portrait(patch: Patch, brdfs: list, size: int = 160, samples: int = 24) -> np.ndarray:
    """Photograph the endless patch from obliquely above, as sRGB."""
    towards = np.array([0.15, 0.9, -0.8])
    towards /= np.linalg.norm(towards)
    right = np.cross(towards, [0, 0, 1])
    right /= np.linalg.norm(right)
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, size), np.linspace(0.7, -0.7, size))
    places = 0.5 + u[..., None] * right + v[..., None] * np.cross(right, towards)
    origins = (places - 5 * towards).reshape(-1, 3)
    scene = Scene.of(PeriodicSurface(patch), brdfs, patch.material)
    lights = [
        DirectionalEmitter(DirectionalSources(SUN, 2.6 * np.ones((1, 3)))),
        EnvironmentEmitter.uniform(0.25 * np.ones(3)),
    ]
    directions = np.tile(towards, (len(origins), 1))
    seen = path_radiance(scene, lights, origins, directions, PathSettings(samples, 4)).radiance
    return np.clip(seen.reshape(size, size, 3), 0, 1) ** (1 / 2.2)


def main() -> None:
    """Draw and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1024)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    patch = sawtooth(4)
    meter = Gonioreflectometer.of(patch, [RED, BLUE])
    incident = np.radians([-60, 0, 30])
    light = np.stack([np.sin(incident), 0 * incident, np.cos(incident)], axis=-1)
    exits = np.radians(np.arange(-84, 85, 4))
    settings, rng = MeasureSettings(samples=asked.samples, bounces=6), np.random.default_rng(0)
    found = [meter.pairs(light, np.array([np.sin(t), 0, np.cos(t)]), settings, rng) for t in exits]
    values, errors = (np.array(part) for part in zip(*found))
    figure, axes = plt.subplots(1, 4, figsize=(15, 3.8))
    axes[0].imshow(portrait(patch, [RED, BLUE]))
    axes[0].set_title("sawtooth, 45 degrees")
    axes[0].axis("off")
    for index, axis in enumerate(axes[1:]):
        for channel, colour in enumerate("rgb"):
            mean, error = values[:, index, channel], errors[:, index, channel]
            axis.plot(np.degrees(exits), mean, colour)
            axis.fill_between(
                np.degrees(exits), mean - 2 * error, mean + 2 * error, color=colour, alpha=0.3
            )
        axis.set_title(f"light from {np.degrees(incident[index]):.0f} degrees")
        axis.set_xlabel("exit angle, degrees")
    axes[1].set_ylabel("rho, 1/sr")
    OUT.mkdir(exist_ok=True)
    figure.tight_layout()
    figure.savefig(OUT / "lalonde_figure_3_2.png", dpi=90)
    print(f"{'light':>6s} {'view':>6s}   red      green    blue     (light across the ridges)")
    for index in range(len(incident)):
        for row in (0, -1):
            print(
                f"{np.degrees(incident[index]):6.0f} {np.degrees(exits[row]):6.0f}   "
                + " ".join(f"{value:8.4f}" for value in values[row, index])
            )
    print(f"worst standard error {errors.max():.4f}; written {OUT / 'lalonde_figure_3_2.png'}")


if __name__ == "__main__":
    main()
