"""L fig. 6.4: a sawtooth wall under an area light that a ball half hides.

    python experiments/lalonde_figure_6_4.py [--size 32] [--brdf 16] [--pixels 256] [--samples 512]

The radiance is sampled at 32^4, the BRDF at 16^4, measured from the micro-geometry of fig. 3.2
(``lalonde_micro_geometry``): ridges run up the wall, red to the left and blue to the right.  L: 113
ms a pixel with the coefficients of 10 % and 54 ms with 1 %, 2.1 times less; the caption calls the
first image unthresholded, and the spline's share .5 % in the text and 5 % in the caption: both are
made.  Printed are the images' rms differences and the times; columns as in ``lalonde_figure_6_2``.
"""

import argparse

import jax
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from lalonde_figure_6_2 import view
from lalonde_micro_geometry import describe
from lalonde_micro_geometry import measured as measured_table
from lalonde_room import displayed, light_radiance, light_tree, sampled, tree_of
from lalonde_timings import measured, print_costs

from jaxrender.geometry import NUSSELT
from jaxrender.reflection.wavelet_shading.plane import shade_plane
from jaxrender.wavelets import haar, linear_spline


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--brdf", type=int, default=16)
    parser.add_argument("--pixels", type=int, default=256)
    parser.add_argument("--samples", type=int, default=512)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    samples = sampled(arguments.size, light_radiance)
    material = measured_table("sawtooth", (arguments.brdf,) * 4, NUSSELT, arguments.samples)
    print(describe(material))
    table = material.values.astype(float)
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
    costs = [measured(*trees, arguments.pixels, nested=16) for trees in cases.values()]
    print_costs(list(cases)[1:], [113, 54, nan, nan], costs[1:])
    print_costs(list(cases), [nan, 113, 54, nan, nan], costs)
    figure, axes = plt.subplots(1, 6, figsize=(22, 4))
    light = samples.mean(axis=(2, 3))
    axes[0].imshow(displayed(light, light.max()))
    axes[0].set_title("irradiance, to scale")
    for axis, (name, image) in zip(axes[1:], images.items()):
        axis.imshow(np.clip(image / exact.max(), 0, 1) ** (1 / 2.2))
        axis.set_title(name)
    for axis in axes:
        axis.axis("off")
    figure.savefig("experiments/out/lalonde_figure_6_4.png", dpi=90, bbox_inches="tight")


if __name__ == "__main__":
    main()
