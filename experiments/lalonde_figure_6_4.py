"""L fig. 6.4: a sawtooth wall under an area light that a ball half hides.

    python experiments/lalonde_figure_6_4.py [--size 32] [--brdf 16] [--pixels 256]

The radiance is sampled at 32^4, the BRDF at 16^4.  L's sawtooth was measured from micro-geometry;
here it is a stand-in: facets of two slopes along kappa, each a Phong lobe about its own normal n',

    rho = sum over both of w (n' . w_i) / (n . w_i) rho_phong(in the facet's frame),

without shadows or light between facets (ERRATA 72 has this factor).  L: 113 ms a pixel with the
coefficients of 10 % and 54 ms with 1 %, 2.1 times less; the caption calls the first image
unthresholded, and the spline's share .5 % in the text and 5 % in the caption: both are made.
Columns as in ``lalonde_figure_6_2``.
"""

import argparse

import jax
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from lalonde_figure_6_2 import view
from lalonde_room import lamp_radiance, light_tree, sampled, tree_of
from lalonde_timings import measured, print_costs

from jaxrender.brdf import Phong
from jaxrender.geometry import NUSSELT
from jaxrender.reflection.wavelet_shading.plane import shade_plane
from jaxrender.wavelets import haar, linear_spline

# The teeth's two sides: steep and short, flat and long; degrees and shares of the area.
SLOPES = ((-35.0, 0.35), (18.0, 0.65))
LOBE = Phong(np.array([0.08]), np.array([0.5]), 25.0)


def sawtooth_table(size: int) -> np.ndarray:
    """Sample the stand-in [kappa_i, lambda_i, kappa_r, lambda_r, 1], 0 off the disc."""
    directions = NUSSELT.cell_directions((size, size)).reshape(-1, 3)
    above = np.asarray(NUSSELT.covers(NUSSELT.centres((size, size)))).ravel()
    total = np.zeros((size * size, size * size))
    for degrees, share in SLOPES:
        s, c = np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))
        # Columns are the facet's axes.
        facet = directions @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        pairs = np.repeat(facet, len(facet), axis=0), np.tile(facet, (len(facet), 1))
        cosine = np.maximum(facet[:, 2], 0) / np.maximum(directions[:, 2], 0.05)
        found = np.asarray(LOBE.evaluate(*pairs)).reshape(total.shape)
        # Phong's lobe over its cosine, as T 3.34 has it, times the cosine again.
        total += share * cosine[:, None] * found * np.maximum(facet[:, 2], 0)[:, None]
    total *= above[:, None] & above[None, :]
    return total.reshape((size,) * 4)[..., None]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--brdf", type=int, default=16)
    parser.add_argument("--pixels", type=int, default=256)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    samples, table = sampled(arguments.size, lamp_radiance)[..., :1], sawtooth_table(arguments.brdf)
    lights = {share: light_tree(samples, share) for share in (None, 0.1, 0.01)}
    haars = {share: tree_of(haar(), table, share) for share in (None, 0.1, 0.01)}
    splines = {share: tree_of(linear_spline(), table, share) for share in (0.05, 0.005)}
    for name, trees in (("radiance", lights), ("Haar BRDF", haars), ("spline BRDF", splines)):
        print(name, {share: tree.count for share, tree in trees.items()})
    cases = {
        "all": (lights[None], haars[None]),
        "10 % of both": (lights[0.1], haars[0.1]),
        "1 % of both": (lights[0.01], haars[0.01]),
        "1 %, 5 % of the spline": (lights[0.01], splines[0.05]),
        "1 %, .5 % of the spline": (lights[0.01], splines[0.005]),
    }
    seen = view(arguments.pixels)
    images = {
        name: np.asarray(shade_plane(light, [brdf], seen)) for name, (light, brdf) in cases.items()
    }
    exact = images["all"]
    for name, image in images.items():
        error = np.sqrt(np.mean((image - exact) ** 2)) / exact.max()
        print(f"{name:26s} image RMS {error:.4f} of the maximum")
    nan = float("nan")
    costs = [measured(*trees, arguments.pixels, nested=2) for trees in cases.values()]
    print_costs(list(cases)[1:], [113, 54, nan, nan], costs[1:])
    print_costs(list(cases), [nan, 113, 54, nan, nan], costs)
    figure, axes = plt.subplots(1, 6, figsize=(22, 4))
    light = np.moveaxis(samples.mean(axis=(2, 3)), 1, 0)[::-1]
    axes[0].imshow(light[..., 0], cmap="gray")
    axes[0].set_title("irradiance, to scale")
    for axis, (name, image) in zip(axes[1:], images.items()):
        picture = np.clip(image / exact.max(), 0, 1)[..., 0] ** (1 / 2.2)
        axis.imshow(picture, cmap="gray", vmin=0, vmax=1)
        axis.set_title(name)
    for axis in axes:
        axis.axis("off")
    figure.savefig("experiments/out/lalonde_figure_6_4.png", dpi=90, bbox_inches="tight")


if __name__ == "__main__":
    main()
