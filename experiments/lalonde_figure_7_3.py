"""L fig. 7.3: a plane of a sawtooth surface, with and without the pyramid; the base is 4 x 4.

    python experiments/lalonde_figure_7_3.py [--out FOLDER] [--size 240]

Every texel of every level is measured by the gonioreflectometer, which looks at its part of one
ridge among endless ridges (L 7.3); a ridge along v is the same in all rows, so one of them is
measured.  The thesis prints no number.  Errors are relative to 64 rays a pixel of the base texture.
Measuring a part in its surroundings leaves no shadow out, so here coarser levels are the means of
finer ones but for the measurement's noise: how far they are from that is printed, and so is L's
filter, which takes the nearest texel of either level.  Draws ``lalonde_figure_7_3.png``.
"""

import argparse
import time
from pathlib import Path

import jax
import numpy as np
import textured_surfaces as scene
from lalonde_figure_7_2 import sawtooth_tree

from jaxrender.brdf.textures.pyramid import BRDFPyramid
from jaxrender.wavelets import CoefficientTree

SOURCE = np.array([0.6, 0.5, 0.65])
TEXELS = (4, 4)


def measured_pyramid() -> BRDFPyramid:
    """Measure each column of each level once."""
    columns: dict[tuple[float, float], CoefficientTree] = {}

    def measure(level: int, u0: float, v0: float, u1: float, v1: float) -> CoefficientTree:
        if (u0, u1) not in columns:
            columns[u0, u1] = sawtooth_tree((u0, 0.0, u1, 1.0))
        return columns[u0, u1]

    start = time.perf_counter()
    found = BRDFPyramid.measured(measure, TEXELS)
    print(f"{len(found.trees)} texels measured in {time.perf_counter() - start:.1f} s")
    return found


def report_means(measured: BRDFPyramid) -> BRDFPyramid:
    """Print how far the measured levels are from means; return the pyramid of means."""
    means = BRDFPyramid.averaging(measured.level(0))
    for level in (1, 2):
        one, other = (p.level(level) for p in (measured, means))
        a, b = (np.asarray(t.trees[t.index[0, 0]].samples()) for t in (one, other))
        apart = np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2))
        print(f"level {level}: measured and averaged differ by {apart:.4f} (relative rms)")
    return means


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=scene.OUT)
    parser.add_argument("--size", type=int, default=240)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    pyramid = measured_pyramid()
    means = report_means(pyramid)
    shape = scene.plane(70)
    eye = scene.camera((-0.5, -2.2, 1.7), (options.size * 2 // 3, options.size), 1.2)

    def picture(shade: scene.Shader, per_side: int = 1) -> np.ndarray:
        return scene.render(eye, shape, SOURCE, TEXELS, shade, per_side)

    plain = scene.unfiltered(pyramid)
    pictures = scene.compare(
        {
            "without the pyramid": lambda: picture(plain),
            "with it, as L: nearest texels": lambda: picture(scene.filtered(pyramid, "levels")),
            "with it, trilinear": lambda: picture(scene.filtered(pyramid)),
            "pyramid of means, trilinear": lambda: picture(scene.filtered(means)),
            "4 rays a pixel": lambda: picture(plain, 2),
        },
        picture(plain, 8),
    )
    scene.draw(pictures, options.out / "lalonde_figure_7_3.png", 1.3, rows=3)


if __name__ == "__main__":
    main()
