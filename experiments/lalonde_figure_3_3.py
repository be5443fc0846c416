"""L fig. 3.3: a velvet of cut threads, and its BRDF on a surface.

    python experiments/lalonde_figure_3_3.py [--out FOLDER] [--samples 2048]

The velvet of ``lalonde_micro_geometry`` measured with 15 samples in each angle, as the thesis's,
and shown by B-splines on a sphere (the thesis: a chair) under a source beside the viewer and under
one behind it.  The last picture is of the same threads with glossy cut ends: these lie level, so
that they mirror the source where the sphere's normal is halfway to it, a pale spot that no velvet
has.

L: much of the reflection is in regions of low incident angle, with a large uniform scattering, and
a small contribution from the surface under the threads; no numbers.  Printed are the
retroreflection at 10, 45 and 75 degrees from the normal, along the lean and against it; what is
reflected in the mirror direction with either kind of ends; and the base's part.  Draws
``lalonde_figure_3_3.png``.
"""

import argparse
from pathlib import Path

import jax
import matplotlib
import numpy as np
from lalonde_figure_3_2 import portrait
from lalonde_micro_geometry import OUT, describe, measured, measured_brdf, meter, threads

from jaxrender.brdf import BRDF, Lambertian
from jaxrender.geometry import POLAR
from jaxrender.reflection.tracing import Gonioreflectometer, MeasureSettings

matplotlib.use("Agg")
import matplotlib.pyplot as plt

SIZE = (15, 15, 15, 15)
GLOSSY_PATHS = 1024
SETTINGS = MeasureSettings(samples=8192)


def sphere(brdf: BRDF, light: np.ndarray, size: int = 260) -> np.ndarray:
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
    value = np.asarray(brdf.evaluate(incoming, outgoing)) * np.maximum(incoming[:, 2:], 0)
    picture = np.zeros((size, size, 3))
    picture[inside] = np.clip(8 * value, 0, 1) ** (1 / 2.2)
    return picture


def towards(degrees: float) -> np.ndarray:
    """A direction in the plane of the lean, which is to +x."""
    angle = np.radians(degrees)
    return np.array([np.sin(angle), 0, np.cos(angle)])


def pair(bench: Gonioreflectometer, incoming: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
    """rho in 1/sr for one pair of directions, the paths the same each time."""
    return bench.pairs(incoming[None], outgoing, SETTINGS, np.random.default_rng(0))[0][0]


def print_reflection() -> None:
    """What a single pair of directions tells, measured by itself."""
    bench = meter("velvet")

    def red(incoming, outgoing, bench=bench) -> float:
        return float(pair(bench, incoming, outgoing)[0])

    print("retroreflection, red, 1/sr    lean towards   lean from   cos times the mean of both")
    for degrees in (10, 45, 75):
        both = [red(towards(sign * degrees), towards(sign * degrees)) for sign in (1, -1)]
        seen = np.cos(np.radians(degrees)) * np.mean(both)
        print(f"{degrees:26d} deg {both[0]:15.4f} {both[1]:11.4f} {seen:12.4f}")
    for material in ("velvet", "velvet, glossy ends"):
        peak = pair(meter(material), towards(-30), towards(30))
        print(f"mirror direction at 30 degrees, {material:20s} {np.round(peak, 4)} 1/sr")
    patch, brdfs = threads()
    black = Gonioreflectometer.of(patch, [Lambertian(np.zeros(3)), *brdfs[1:]])
    for degrees in (0, 60):
        whole, without = (red(towards(degrees), towards(degrees), b) for b in (bench, black))
        share = 1 - without / whole
        print(f"part of the base in what comes back at {degrees:2d} degrees {share:.1%}")


def main() -> None:
    """Measure, draw and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--samples", type=int, default=2048)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    asked.out.mkdir(parents=True, exist_ok=True)
    print(describe(measured("velvet", SIZE, POLAR, asked.samples)))
    print(describe(measured("velvet, glossy ends", SIZE, POLAR, GLOSSY_PATHS)))
    velvet = measured_brdf("velvet", SIZE, POLAR, asked.samples, "b-spline")
    glossy = measured_brdf("velvet, glossy ends", SIZE, POLAR, GLOSSY_PATHS, "b-spline")
    beside, behind = np.array([0.4, -1.0, 0.5]), np.array([0.9, 0.6, 0.5])
    pictures = {
        "threads": portrait(*threads(), size=260),
        "source beside the viewer": sphere(velvet, beside),
        "source behind": sphere(velvet, behind),
        "glossy cut ends, source beside": sphere(glossy, beside),
    }
    figure, axes = plt.subplots(1, 4, figsize=(16, 4.2))
    for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
        axis.imshow(picture)
        axis.set_title(title)
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(asked.out / "lalonde_figure_3_3.png", dpi=90)
    print_reflection()


if __name__ == "__main__":
    main()
