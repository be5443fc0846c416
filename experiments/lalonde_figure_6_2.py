"""L fig. 6.2: the back wall of a room, Lambertian, from its radiance field, and thresholded to 1 %.

    python experiments/lalonde_figure_6_2.py [--size 32] [--pixels 256]

The radiance is sampled at 32^4 (``lalonde_room``); the BRDF is one coefficient.  L: 90 ms a pixel
without thresholding, 17 ms with, 5.3 times less.  ``nested`` is L's own traversal in Python,
``one view`` the fast path for an orthographic view, ``own views`` that for a camera near by.
"""

import argparse

import jax
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from lalonde_room import displayed, light_tree, room_radiance, sampled, tree_of
from lalonde_timings import measured, print_costs

from jaxrender.geometry import Orthographic, look_at
from jaxrender.reflection.wavelet_shading.plane import Plane, shade_plane
from jaxrender.wavelets import haar

WALL = Plane(np.zeros(3), np.array([1.0, 0, 0]), np.array([0.0, 1, 0]))
ALBEDO = 0.75


def view(pixels: int):
    """Straight onto the wall."""
    middle = np.array([0.5, 0.5, 0])
    pose = look_at(np.array([0.5, 0.5, 2]), middle, np.array([0.0, 1, 0]))
    return WALL.seen_by(Orthographic(pixels, pixels, pose, scale=1 / pixels))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--pixels", type=int, default=256)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    samples = sampled(arguments.size, room_radiance)
    brdf = tree_of(haar(), np.full((1, 1, 1, 1, 3), ALBEDO / np.pi))
    trees = [light_tree(samples, fraction) for fraction in (None, 0.1, 0.01)]
    for tree in trees:
        print(f"{tree.count:8d} places with coefficients of {arguments.size**4}")
    seen = view(arguments.pixels)
    images = [np.asarray(shade_plane(tree, [brdf], seen)) for tree in trees]
    exact = 4 * ALBEDO / np.pi * samples.mean(axis=(2, 3))
    size = arguments.size
    texel = np.minimum((seen.places * size).astype(int), size - 1)
    off = np.abs(images[0].reshape(-1, 3) - exact[texel[:, 0], texel[:, 1]]).max()
    print(f"unthresholded against the sum over samples: {off:.1e}")
    for name, image in zip(("10 %", "1 %"), images[1:]):
        error = np.sqrt(np.mean((image - images[0]) ** 2)) / images[0].max()
        print(f"image RMS with {name} kept: {error:.4f} of the maximum")
    costs = [measured(tree, brdf, arguments.pixels) for tree in (trees[0], trees[2])]
    print_costs(["all coefficients", "1 % of the radiance's"], [90, 17], costs)
    figure, axes = plt.subplots(1, 4, figsize=(15, 4))
    white = images[0].max()
    titles = ("the samples' sum", "all coefficients", "10 %", "1 %")
    pictures = [displayed(exact, white), *(np.clip(i / white, 0, 1) ** (1 / 2.2) for i in images)]
    for axis, title, picture in zip(axes, titles, pictures):
        axis.imshow(picture)
        axis.set_title(title)
        axis.axis("off")
    figure.savefig("experiments/out/lalonde_figure_6_2.png", dpi=110, bbox_inches="tight")


if __name__ == "__main__":
    main()
