"""L fig. 7.1: a colour map over a plane of one tabulated BRDF, a Phong shader.

    python experiments/lalonde_figure_7_1.py [--out FOLDER] [--size 240]

The map (rings, fine stripes and a cross, drawn here) modulates a monochromatic Phong BRDF
with a low constant term, tabulated with 24 samples an axis and read linearly.  The
thesis shows it without anti-aliasing and prints no number; beside it stand the ordinary MIP pyramid
of the colours, which filters this case as it does any shader's, and 64 rays a pixel, to which
errors are relative.  Draws ``lalonde_figure_7_1.png``.
"""

import argparse
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import textured_surfaces as scene

from jaxrender.brdf import BRDF, Phong
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.brdf.textures.mip import ColourPyramid, level_of

SOURCE = np.array([0.1, 0.75, 0.65])

evaluate = eqx.filter_jit(BRDF.evaluate)


def colour_map(size: int = 256) -> np.ndarray:
    """Rings of two colours, a disc of thin stripes and a bright cross on blue."""
    line = (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(line, line[::-1])
    image = np.tile([0.15, 0.25, 0.7], (size, size, 1))
    radius = np.hypot(x - 0.35, y - 0.6)
    rings = (radius < 0.3) & (np.floor(radius / 0.025) % 2 == 0)
    image[rings] = [0.9, 0.3, 0.1]
    image[(radius < 0.3) & ~rings] = [0.95, 0.85, 0.3]
    striped = np.hypot(x - 0.75, y - 0.3) < 0.2
    image[striped & (np.arange(size) // 2 % 2 == 0)[None, :]] = [0.95, 0.95, 0.95]
    cross = (np.abs(x - 0.2) < 0.02) & (y < 0.25) | (np.abs(y - 0.13) < 0.02) & (x < 0.4)
    image[cross] = [0.2, 0.8, 0.3]
    return image


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=scene.OUT)
    parser.add_argument("--size", type=int, default=240)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    shader = Phong(np.array([0.05]), np.array([0.8]), 8.0)
    brdf = TabulatedBRDF.of(shader, 24)
    colours = ColourPyramid.of(colour_map())
    shape = scene.plane(2)
    eye = scene.camera((0.0, -2.2, 1.1), (options.size * 2 // 3, options.size), 1.3)

    def plain(s: scene.Seen) -> np.ndarray:
        found = colours.evaluate(s.places, np.zeros(len(s.places)), "nearest")
        return np.asarray(found) * np.asarray(evaluate(brdf, s.incoming, s.outgoing))

    def mipped(s: scene.Seen) -> np.ndarray:
        found = colours.evaluate(s.places, np.asarray(level_of(s.size)))
        return np.asarray(found) * np.asarray(evaluate(brdf, s.incoming, s.outgoing))

    def picture(shade: scene.Shader, per_side: int = 1) -> np.ndarray:
        return scene.render(eye, shape, SOURCE, (256, 256), shade, per_side)

    pictures = scene.compare(
        {
            "no anti-aliasing (as L fig. 7.1)": lambda: picture(plain),
            "MIP pyramid of the colours": lambda: picture(mipped),
            "4 rays a pixel": lambda: picture(plain, 2),
        },
        picture(plain, 8),
    )
    scene.draw(pictures, options.out / "lalonde_figure_7_1.png", 0.3, rows=2)


if __name__ == "__main__":
    main()
