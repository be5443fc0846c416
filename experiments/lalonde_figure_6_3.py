"""L fig. 6.3: the back wall of a room with Phong BRDFs of exponents 5, 50 and 200.

    python experiments/lalonde_figure_6_3.py [--size 32] [--pixels 192]

rho = ks (n + 2) / (2 pi) max(R . w_i, 0)^n, without the 1 / cos t_i that makes T 3.34 of it: with
it light from grazing angles would outshine all else.  The radiance is sampled at 32^4
(``lalonde_room``) and so is the BRDF.  As the exponent grows the wall becomes a blurred mirror, in
which the red and blue walls, the light and the ball are to be made out.  L has no numbers here;
ours are the errors that thresholding leaves in the image, and against the plain sum over all
samples.
"""

import argparse
import time

import jax
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from lalonde_figure_6_2 import WALL, view
from lalonde_room import light_tree, room_radiance, sampled, table_of, tree_of

from jaxrender.brdf import Phong
from jaxrender.geometry import NUSSELT, Pinhole, look_at
from jaxrender.reflection.wavelet_shading.plane import shade_plane
from jaxrender.wavelets import haar, linear_spline

EXPONENTS = (5, 50, 200)
SHARE = 0.75


def lobe_table(exponent: int, size: int) -> np.ndarray:
    """Sample Phong's lobe [kappa_i, lambda_i, kappa_r, lambda_r, 1]."""
    material = Phong(np.array([0.0]), np.array([SHARE]), float(exponent))
    cosine = NUSSELT.cell_directions((size, size))[..., 2]
    scale = (exponent + 2) / (exponent + 1)
    return table_of(material, size) * scale * cosine[:, :, None, None, None]


def near_view(pixels: int):
    """From within the room, off the middle."""
    pose = look_at(np.array([0.62, 0.55, 0.9]), np.array([0.5, 0.5, 0]), np.array([0.0, 1, 0]))
    return WALL.seen_by(Pinhole(pixels, pixels, pose, fl_x=0.85 * pixels))


def summed(samples: np.ndarray, table: np.ndarray, seen) -> np.ndarray:
    """4 times the mean over the samples of both, at the nearest ones: what Haar's trees are."""
    size, side = samples.shape[0], table.shape[0]
    texel = np.clip((seen.places * size).astype(int), 0, size - 1)
    cell = np.clip((seen.directions * side).astype(int), 0, side - 1)
    cell = np.broadcast_to(cell, texel.shape)
    image = np.zeros((*seen.seen.shape, 3))
    light = samples[texel[:, 0], texel[:, 1]]
    image[seen.seen] = [
        4 * np.mean(one * table[:, :, k, m], axis=(0, 1)) for one, (k, m) in zip(light, cell)
    ]
    return image


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--pixels", type=int, default=192)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    samples = sampled(arguments.size, room_radiance)
    views = {"straight on": view(arguments.pixels), "from within": near_view(arguments.pixels)}
    light, little = light_tree(samples), light_tree(samples, 0.01)
    figure, axes = plt.subplots(4, 3, figsize=(10, 13.4))
    for column, exponent in enumerate(EXPONENTS):
        table = lobe_table(exponent, arguments.size)
        whole, spline = tree_of(haar(), table), tree_of(linear_spline(), table, 0.01)
        for row, (name, seen) in enumerate(views.items()):
            start = time.perf_counter()
            image = np.asarray(shade_plane(light, [whole], seen))
            took = time.perf_counter() - start
            start = time.perf_counter()
            rough = np.asarray(shade_plane(little, [spline], seen))
            less = time.perf_counter() - start
            off = np.abs(image - summed(samples, table, seen)).max() / image.max()
            rms = np.sqrt(np.mean((rough - image) ** 2)) / image.max()
            print(
                f"n = {exponent:3d} {name}: {off:.0e} off the sum over samples, {took:5.1f} s; "
                f"1 % of both, spline: RMS {rms:.4f} of the maximum, {less:5.1f} s"
            )
            white = np.quantile(image, 0.995)
            for offset, picture in enumerate((image, rough)):
                axis = axes[2 * row + offset, column]
                axis.imshow(np.clip(picture / white, 0, 1) ** (1 / 2.2))
                what = "Haar, all" if offset == 0 else "1 %, linear spline"
                axis.set_title(f"n = {exponent}, {name}: {what}", fontsize=8)
                axis.axis("off")
    figure.savefig("experiments/out/lalonde_figure_6_3.png", dpi=100, bbox_inches="tight")


if __name__ == "__main__":
    main()
