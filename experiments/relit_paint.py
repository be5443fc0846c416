"""Measured paints, recovered from photographs under one light and relit by another.

    python experiments/relit_paint.py PAINT [PAINT ...] [--probes FILE FILE --convention cross]
        [--model bank] [--picture relit_paint.png]

A ball of each paint is photographed from twelve sides under a probe and a lamp, with .5 % noise.
The model is fitted to these and corrected by a table.  Then the ball is seen from a new side under
another probe with a small sun: as the measurement has it, as foretold, and their difference.
"""

import argparse
import os
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from measured import Truth, photographed, table
from relit_balls import NOISE, PIXELS, VIEWS, around, ball, fitted, lamp, probes
from scenes import unit

from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.brdf_table import correct_by_table
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel
from jaxrender.lighting import Environment

# Pixels across a picture; where the camera is; the lowest exit cosine that is drawn.
SIDE, CAMERA, LOWEST_COSINE = 120, unit(np.array([1.0, -2.0, 0.7])), 0.15
# A difference of this part of the picture's white is drawn in full colour.
DIFFERENCE_SHOWN = 0.2


class Pictures(NamedTuple):
    """A ball from a new side: in the light of the fit, in another, and as that is foretold."""

    name: str
    fitted: np.ndarray
    truth: np.ndarray
    foretold: np.ndarray


def disc() -> tuple[SurfaceSamples, np.ndarray]:
    """List the pixels of a ball's picture, and where they lie."""
    x, y = np.meshgrid(*2 * [(np.arange(SIDE) + 0.5) / SIDE * 2 - 1])
    there = x**2 + y**2 < 1 - LOWEST_COSINE**2
    right = unit(np.cross([0.0, 0.0, 1.0], CAMERA))
    up = np.cross(CAMERA, right)
    x, y = x[there][:, None], -y[there][:, None]
    normals = x * right + y * up + np.sqrt(1 - x**2 - y**2) * CAMERA
    return SurfaceSamples(normals, np.broadcast_to(CAMERA, normals.shape)), there


def recovered(name: str, truth: Truth, options: argparse.Namespace) -> Pictures:
    """Photograph a ball, recover its material, and foretell it under another light."""
    one, other = probes(options.probes, options.convention)
    told = KnownLight(one, lamp([1.0, -1.0, 1.2], 1.5))
    elsewhere = KnownLight(
        Environment(0.3 * np.asarray(other.radiance)), lamp([-1, -0.6, 0.8], 3.0)
    )
    samples, frame = ball(around(VIEWS), PIXELS // 2, 0)
    exact = photographed(truth, samples, frame, told)
    noise = np.random.default_rng(2).standard_normal(exact.shape)
    observations = Observations(samples, exact * (1 + NOISE * noise), frame)
    fit = fitted(options.model, observations, told)
    correction = correct_by_table(fit, told)
    pixels, there = disc()
    view = np.zeros(len(np.asarray(pixels.normals)), int)
    nodes = exact_nodes(elsewhere, view, float(fit.brdf.width))
    foretold = correction.predict(ExactModel(fit.brdf, pixels, nodes)).radiance
    seen = [photographed(truth, pixels, view, light) for light in (told, elsewhere)]
    off = np.sqrt(np.sum((foretold - seen[1]) ** 2) / np.sum(seen[1] ** 2))
    size = np.linalg.norm(seen[1], axis=1)
    median = np.median(np.linalg.norm(foretold - seen[1], axis=1) / size)
    print(
        f"{name}: {correction.sentence}; relit rms {100 * off:.1f} %, median {100 * median:.1f} %"
    )

    def picture(values: np.ndarray) -> np.ndarray:
        image = np.zeros((SIDE, SIDE, 3))
        image[there] = values
        return image

    return Pictures(name, *map(picture, (*seen, foretold)))


def draw(rows: list[Pictures], path: Path):
    """Draw each ball in a row, with the difference in the last column."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        len(rows), 4, figsize=(8.6, 2.1 * len(rows) + 0.3), layout="constrained", squeeze=False
    )
    for line, row in zip(axes, rows):
        white = [np.quantile(one[one.max(axis=2) > 0], 0.99) for one in row[1:3]]
        for axis, values, own in zip(line, row[1:], (white[0], white[1], white[1])):
            axis.imshow(np.clip(values / own, 0, 1) ** (1 / 2.2))
        difference = (row.foretold - row.truth).mean(axis=2) / white[1]
        reach = DIFFERENCE_SHOWN
        shown = line[3].imshow(difference, cmap="RdBu_r", vmin=-reach, vmax=reach)
        figure.colorbar(shown, ax=line[3], shrink=0.8).set_label("of white", fontsize=8)
        line[0].set_ylabel(row.name.replace("_", " "))
    for axis, name in zip(
        axes[0], ("light of the fit", "another, measured", "another, foretold", "difference")
    ):
        axis.set_title(name, fontsize=10)
    for axis in axes.ravel():
        axis.set(xticks=[], yticks=[])
    figure.savefig(path, dpi=110)
    print(f"written: {path}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paints", nargs="+", type=Path)
    parser.add_argument("--probes", type=Path, nargs=2, default=[])
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--model", default="bank")
    parser.add_argument("--picture", type=Path, default=Path("relit_paint.png"))
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    draw(
        [recovered(path.stem, table(str(path)), options) for path in options.paints],
        options.picture,
    )


if __name__ == "__main__":
    main()
