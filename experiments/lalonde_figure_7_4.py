"""L fig. 7.4: the sawtooth texture on a shape (there a chair), with and without the pyramid.

    python experiments/lalonde_figure_7_4.py [--out FOLDER] [--size 260]

A vase instead of the chair; the pyramid is figure 7.3's.  The thesis prints no number; errors are
relative to 64 rays a pixel.  Directions in cells of Nusselt's square whose centres lie beyond the
horizon are dark, as in L 4.1: a table of 16 samples an axis loses some of the grazing light.
Draws ``lalonde_figure_7_4.png``.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
import textured_surfaces as scene
from lalonde_figure_7_3 import TEXELS, measured_pyramid

SOURCE = np.array([-0.5, -0.8, 0.5])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=scene.OUT)
    parser.add_argument("--size", type=int, default=260)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    pyramid = measured_pyramid()
    shape = scene.vase((80, 40))
    eye = scene.camera((0.0, -4.5, 0.9), (options.size, options.size * 4 // 5), 1.7)

    def picture(shade: scene.Shader, per_side: int = 1) -> np.ndarray:
        return scene.render(eye, shape, SOURCE, TEXELS, shade, per_side)

    plain = scene.unfiltered(pyramid)
    pictures = scene.compare(
        {
            "without the pyramid": lambda: picture(plain),
            "with the pyramid": lambda: picture(scene.filtered(pyramid)),
        },
        picture(plain, 8),
    )
    scene.draw(pictures, options.out / "lalonde_figure_7_4.png", 1.3)


if __name__ == "__main__":
    main()
