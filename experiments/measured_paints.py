"""Measured paints as trees: what 1 % of the coefficients costs, their spectra, a sphere in a probe.

    python experiments/measured_paints.py FILE [FILE ...] [--probe PANORAMA] [--convention cross]

Each file (any that ``jaxrender compress`` reads) is tabulated at 32^4, thresholded to 1 %, and both
the BRDF and the tree are asked for the degrees (F, P) about the reflected ray that hold 97 % of the
energy of rho^ cos t_o (T 5.5; the tree's isotropic mean over 12 turns), for the nearest model, and
for the picture of a sphere in the probe.  Draws ``measured_paints.png``.
"""

import argparse
import time
from pathlib import Path

import jax
import numpy as np

from jaxrender.brdf import BRDF, WaveletBRDF
from jaxrender.brdf.compression.squares import Goal, compression_of
from jaxrender.brdf.isotropic_mean import IsotropicMean
from jaxrender.brdf.tables.cell_means import CELL_SAMPLES, tabulate
from jaxrender.geometry import Pinhole, Sphere, look_at
from jaxrender.inverse.nearest_models import best_models
from jaxrender.io import read_environment
from jaxrender.lighting.base import LightNodes
from jaxrender.pipelines.brdf_sources import source_of
from jaxrender.reflection import ExactForward
from jaxrender.reflection.render import render
from jaxrender.spectra.central import central_spectrum_of
from jaxrender.spectra.orders import missing_energy, required_orders
from jaxrender.wavelets import haar

OUT = Path(__file__).parent / "out"
LIMITS, TOLERANCE = (24, 12), 0.03
ROWS = 32


def orders_of(brdf: BRDF) -> str:
    spectrum = central_spectrum_of(brdf, LIMITS, weighted=True)
    try:
        found = required_orders(spectrum, TOLERANCE)
    except ValueError:
        return f"more than {LIMITS} ({missing_energy(spectrum)[-1, -1]:.3f} missing)"
    return f"(F, P) = ({found.light}, {found.viewer})"


def probe_light(path: Path, convention: str) -> ExactForward:
    """The probe as few nodes: blocks of its texels, each at its texels' mean direction."""
    nodes = read_environment(path, convention).nodes()
    directions, irradiance = (np.asarray(part, float) for part in nodes)
    polar = np.arccos(np.clip(directions[:, 2], -1, 1)) * ROWS / np.pi
    azimuth = (np.arctan2(directions[:, 1], directions[:, 0]) / np.pi + 1) * ROWS
    cell = np.minimum(polar, ROWS - 1).astype(int) * 2 * ROWS
    cell = cell + np.minimum(azimuth, 2 * ROWS - 1).astype(int)
    sums = np.zeros((2 * ROWS**2, 6))
    np.add.at(sums, cell, np.concatenate([directions, irradiance], axis=1))
    sums = sums[np.linalg.norm(sums[:, :3], axis=1) > 0]
    ahead = sums[:, :3] / np.linalg.norm(sums[:, :3], axis=1, keepdims=True)
    return ExactForward(LightNodes(ahead, sums[:, 3:]))


def draw(found: dict[str, list[np.ndarray]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(found), 3, figsize=(9, 3.2 * len(found)), squeeze=False)
    for row, (name, images) in zip(axes, found.items(), strict=True):
        bright = np.percentile(images[0][images[0] > 0], 98)
        pictures = [*images, 4 * np.abs(images[1] - images[0])]
        for axis, what, image in zip(row, ("", "tree, 1 %", "4 x difference"), pictures):
            axis.imshow(np.clip(image / bright, 0, 1) ** (1 / 2.2))
            axis.set_title(f"{name} {what}")
            axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--probe", type=Path)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--pixels", type=int, default=96)
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    pose = look_at(np.array([12.0, 0, 0]), np.zeros(3), np.array([0.0, 0, 1]))
    camera = Pinhole(options.pixels, options.pixels, pose, fl_x=5.6 * options.pixels)
    light = probe_light(options.probe, options.convention) if options.probe else None
    drawn = {}
    for name in options.files:
        source = source_of(name)
        print(f"\n{source.name}: " + "; ".join(source.said))
        table = tabulate(source.brdf, 32, cell_samples=CELL_SAMPLES).values
        found = compression_of(table, haar(), Goal(0.01))
        tree = WaveletBRDF(found.tree)
        channels = " ".join(f"{100 * error:.2f}" for error in found.by_channel)
        print(f"  {found.tree.count} of {found.non_zero} coefficients, rms error {channels} %")
        start = time.perf_counter()
        print(f"  the BRDF {orders_of(source.brdf)}, {time.perf_counter() - start:.1f} s")
        start = time.perf_counter()
        print(
            f"  its tree {orders_of(IsotropicMean(tree, 12))}, {time.perf_counter() - start:.1f} s"
        )
        for one in best_models(tree)[:3]:
            numbers = {k: np.round(v, 4).tolist() for k, v in one.parameters.items()}
            print(f"  {one.name}: {100 * one.relative_rms:.1f} % rms, {numbers}")
        if light is not None:
            ball = Sphere(np.zeros(3), 1.0)
            images = [render(brdf, camera, ball, light) for brdf in (source.brdf, tree)]
            error = np.sqrt(np.sum((images[1] - images[0]) ** 2) / np.sum(images[0] ** 2))
            print(f"  sphere under {options.probe.name}: {100 * error:.2f} % rms")
            drawn[source.name] = images
    if drawn:
        draw(drawn, options.out / "measured_paints.png")


if __name__ == "__main__":
    main()
