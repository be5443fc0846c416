"""L fig. 7.5: a bump map unfiltered, with the pyramid, and supersampled.

    python experiments/lalonde_figure_7_5.py [--out FOLDER] [--size 240]

A 32 x 32 map of round bumps over a glossy plane.  Its normals, rounded, give tilted BRDFs, whose
means are the pyramid (L 7.12).  The thesis prints no numbers; it shows the three pictures and says
that the bump map's pyramid was made fast compared to the micro-geometry's, of 1600 polygons.  Here
errors are relative to 64 rays a pixel.  The same bumps as a height field of 2048 facets are put
under the gonioreflectometer as a whole (the top of such a pyramid): seconds, and how far the bump
map's top is from it, as bump maps have it and with the facets' shares of the view (``projected``),
over pairs with both cosines above .3, where little is hidden.  Draws ``lalonde_figure_7_5.png``.
"""

import argparse
import time
from pathlib import Path

import jax
import numpy as np
import textured_surfaces as scene

from jaxrender.brdf import BlinnPhong
from jaxrender.brdf.textures.bump import bump_texture, normals_of_heights, quantised
from jaxrender.brdf.textures.pyramid import BRDFPyramid
from jaxrender.geometry import NUSSELT
from jaxrender.geometry.height_fields import height_field
from jaxrender.reflection.tracing.gonioreflectometer import Gonioreflectometer, MeasureSettings

SOURCE = np.array([0.5, 0.6, 0.65])
GLOSSY = BlinnPhong(np.array([0.08]), np.array([0.3]), 20.0)
TEXELS, SIZE, STEP = 32, 16, 0.08


def bumps() -> np.ndarray:
    """Four bumps a side, heights in units of the texture's side, row 0 at v = 1."""
    line = (np.arange(TEXELS) + 0.5) / TEXELS
    u, v = np.meshgrid(line, line[::-1])
    return 0.03 * np.cos(2 * np.pi * 2 * u) * np.cos(2 * np.pi * 2 * v)


def timed(text: str, make):
    """Print how long something takes; return it."""
    start = time.perf_counter()
    found = make()
    print(f"{text}: {time.perf_counter() - start:.1f} s")
    return found


def pyramid_of(projected: bool) -> BRDFPyramid:
    """Build the bump map's pyramid."""
    normals = normals_of_heights(bumps())
    texture = bump_texture(GLOSSY, normals, STEP, size=SIZE, projected=projected)
    return BRDFPyramid.averaging(texture)


def compare_tops(plain: BRDFPyramid, projected: BRDFPyramid) -> None:
    """Measure the height field as a whole, and print how far the means are from it."""
    # Normals are at the texels' centres, so are the mesh's vertices but for half a texel's shift.
    instrument = Gonioreflectometer.of(height_field(bumps()[::-1]), [GLOSSY])
    settings = MeasureSettings((SIZE, SIZE, SIZE, SIZE), samples=512, bounces=1)
    measured = timed("micro-geometry, one texel", lambda: instrument.measure(settings))
    places = NUSSELT.cell_directions((SIZE, SIZE))[..., 2]
    steep = np.asarray(NUSSELT.covers(NUSSELT.centres((SIZE, SIZE)))) & (places > 0.3)
    both = steep[:, :, None, None] & steep
    truth = measured.values[both]
    noise = np.sqrt(np.mean(measured.standard_errors[both] ** 2) / np.mean(truth**2))
    print(f"the measurement's own standard error: {noise:.4f}")
    for name, pyramid in (("bump map", plain), ("with facets' shares", projected)):
        top = np.asarray(pyramid.level(5).trees[0].samples())[both]
        apart = np.sqrt(np.mean((top - truth) ** 2) / np.mean(truth**2))
        print(f"top of the pyramid, {name:20s}: differs by {apart:.4f} (relative rms)")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=scene.OUT)
    parser.add_argument("--size", type=int, default=240)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    normals = normals_of_heights(bumps())
    print(f"{TEXELS}^2 texels, {len(quantised(normals, STEP)[1])} different normals after rounding")
    plain = timed("bump map's pyramid", lambda: pyramid_of(False))
    print(f"{len(plain.trees)} trees, {sum(t.count for t in plain.trees):,} coefficients")
    compare_tops(plain, timed("the same with facets' shares", lambda: pyramid_of(True)))
    shape = scene.plane(6)
    eye = scene.camera((0.0, -2.2, 1.2), (options.size * 2 // 3, options.size), 1.3)

    def picture(shade: scene.Shader, per_side: int = 1) -> np.ndarray:
        return scene.render(eye, shape, SOURCE, (TEXELS, TEXELS), shade, per_side)

    raw = scene.unfiltered(plain)
    pictures = scene.compare(
        {
            "unfiltered": lambda: picture(raw),
            "pyramid": lambda: picture(scene.filtered(plain)),
            "4 rays a pixel": lambda: picture(raw, 2),
        },
        picture(raw, 8),
    )
    scene.draw(pictures, options.out / "lalonde_figure_7_5.png", 0.8, rows=2)


if __name__ == "__main__":
    main()
