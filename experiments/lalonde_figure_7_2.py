"""L fig. 7.2: a checkerboard of a Blinn-Phong shader and a sawtooth surface, 16 rays a pixel.

    python experiments/lalonde_figure_7_2.py [--out FOLDER] [--size 240]

The sawtooth BRDF is measured by the gonioreflectometer from a ridge whose sides are red and blue.
The thesis shows the supersampled picture and prints no number.  Beside it stand one ray a pixel and
the pyramid, for which each square is 16 x 16 texels; it has three trees all the same.  Errors are
relative to 64 rays a pixel.  Draws ``lalonde_figure_7_2.png``.
"""

import argparse
import time
from pathlib import Path

import jax
import numpy as np
import textured_surfaces as scene

from jaxrender.brdf import BlinnPhong, Lambertian
from jaxrender.brdf.textures.pyramid import BRDFPyramid
from jaxrender.brdf.textures.texture import BRDFTexture, tree_of
from jaxrender.geometry.height_fields import sawtooth
from jaxrender.reflection.tracing.gonioreflectometer import Gonioreflectometer, MeasureSettings
from jaxrender.wavelets import CoefficientTree, analyse_nonstandard, haar

SOURCE = np.array([0.5, 0.6, 0.65])
SIDES = [
    Lambertian(np.array([0.04, 0.08, 0.25])),
    Lambertian(np.array([0.25, 0.06, 0.03])),
]
SIZE = 16


def sawtooth_tree(region=(0.0, 0.0, 1.0, 1.0), samples: int = 128) -> CoefficientTree:
    """Measure a part of one ridge whose sides rise by 40 degrees, two reflections at most."""
    instrument = Gonioreflectometer.of(sawtooth(1, 0.7, 0.7), SIDES)
    settings = MeasureSettings((SIZE, SIZE, SIZE, SIZE), samples=samples, bounces=2, region=region)
    values = instrument.measure(settings).values
    return CoefficientTree.of_coefficients(haar(), np.asarray(analyse_nonstandard(haar(), values)))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=scene.OUT)
    parser.add_argument("--size", type=int, default=240)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    start = time.perf_counter()
    shiny = BlinnPhong(np.full(3, 0.08), np.full(3, 0.25), 10.0)
    trees = [tree_of(shiny, SIZE), sawtooth_tree()]
    board = np.kron([[0, 1], [1, 0]], np.ones((16, 16), int))
    pyramid = BRDFPyramid.averaging(BRDFTexture.of(board, trees))
    print(f"measured and built in {time.perf_counter() - start:.1f} s")
    print(f"{len(pyramid.trees)} trees of {[tree.count for tree in pyramid.trees]} coefficients")
    shape = scene.plane(10)
    eye = scene.camera((0.0, -2.2, 1.0), (options.size * 2 // 3, options.size), 1.3)

    def picture(shade: scene.Shader, per_side: int = 1) -> np.ndarray:
        return scene.render(eye, shape, SOURCE, (32, 32), shade, per_side)

    plain = scene.unfiltered(pyramid)
    pictures = scene.compare(
        {
            "16 rays a pixel (as L fig. 7.2)": lambda: picture(plain, 4),
            "one ray a pixel": lambda: picture(plain),
            "pyramid, trilinear": lambda: picture(scene.filtered(pyramid)),
        },
        picture(plain, 8),
    )
    scene.draw(pictures, options.out / "lalonde_figure_7_2.png", 1.2, rows=2)


if __name__ == "__main__":
    main()
