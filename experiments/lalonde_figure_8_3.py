"""L fig. 8.3: a room whose back wall is a Haar-transformed Phong BRDF of exponent 100.

    python experiments/lalonde_figure_8_3.py [--size 96] [--samples 4] [--seeds 8] [--out FOLDER]

The wall's BRDF is the tree itself, as in the thesis.  Paths that meet it go on in a direction drawn
from the tree (left) or uniformly over the hemisphere (right), 4 a pixel; all else is the same: the
library's path tracer, which connects every vertex to the luminaire and also lets paths run into it.
The thesis prints no number, only that the left image "has considerably less noise".

Noise is the scatter of pixels over seeds, rms, where the wall reflects the room: pixels of the wall
whose light is mostly direct, the luminaire's highlight, are left out, for there the luminaire is
found without the wall's help.  With two reflections that is the wall's part alone.  From the third
on there is light that falls on the room off the wall, a caustic: diffuse surfaces find its source,
the luminaire's mirror image, by chance whichever way the wall is drawn, so that part of the noise
is common to both.  Last, draws a second by table and by slices.  Draws ``lalonde_figure_8_3.png``.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
from lalonde_luminaires import joined, quad

from jaxrender.brdf import CosineLobe, Lambertian, TreeSampler, WaveletBRDF
from jaxrender.brdf.samplers import COSINE, DirectionSampler
from jaxrender.brdf.tables.cell_means import tabulate
from jaxrender.geometry import Mesh, Pinhole, look_at
from jaxrender.lighting.luminaires import Luminaire, Rectangle
from jaxrender.reflection.tracing import LuminaireEmitter, PathSettings, Scene, path_radiance
from jaxrender.wavelets.filters import haar
from jaxrender.wavelets.slices import SlicedDensities
from jaxrender.wavelets.threshold import keep_fraction
from jaxrender.wavelets.transform import analyse_nonstandard
from jaxrender.wavelets.tree import CoefficientTree

matplotlib.use("Agg")
import matplotlib.pyplot as plt

OUT = Path(__file__).parent / "out"
SIZE, EXPONENT, KEPT, SHARE = 32, 100.0, 0.1, 0.1
REFERENCE = 256
# A pixel of the wall with more than this share of direct light belongs to the luminaire's
# highlight.
HIGHLIGHT = 0.5
GREY, RED, GREEN = (0.7, 0.7, 0.7), (0.7, 0.15, 0.1), (0.15, 0.5, 0.15)
BLUE, YELLOW, DARK = (0.15, 0.2, 0.6), (0.75, 0.6, 0.15), (0.4, 0.4, 0.4)
COLOURS = (GREY, RED, GREEN, BLUE, YELLOW, DARK)
# The wall's material; the others are those of the colours.
WALL = len(COLOURS)
# Just below the ceiling, shining down.
LUMINAIRE = Rectangle(np.array([-0.5, 1.0, 1.98]), np.array([0, 1.0, 0]), np.array([1.0, 0, 0]))
RADIANCE = 6.0


class UniformSampler(DirectionSampler):
    """Directions drawn naively: uniform over the hemisphere, density 1 / (2 pi)."""

    def draw(self, outgoing: np.ndarray, uniforms: np.ndarray) -> np.ndarray:
        """The height of a point of the hemisphere is uniform."""
        sine, turn = np.sqrt(1 - uniforms[:, 0] ** 2), 2 * np.pi * uniforms[:, 1]
        return np.stack([sine * np.cos(turn), sine * np.sin(turn), uniforms[:, 0]], axis=-1)

    def density(self, outgoing: np.ndarray, incoming: np.ndarray) -> np.ndarray:
        """The same everywhere above the horizon."""
        return np.where(incoming[:, 2] > 0, 0.5 / np.pi, 0)


class Room(NamedTuple):
    """What is rendered, and the rays and how many rows of pixels they are."""

    mesh: Mesh
    material: np.ndarray
    tree: CoefficientTree
    rays: tuple[np.ndarray, np.ndarray]
    height: int

    def render(self, way: DirectionSampler, settings: PathSettings) -> np.ndarray:
        """Radiance [row, column, channel]."""
        brdfs = [*(Lambertian(np.array(c) / np.pi) for c in COLOURS), WaveletBRDF(self.tree)]
        samplers = [COSINE] * WALL + [way]
        scene = Scene.of(self.mesh, brdfs, self.material, samplers=samplers)
        luminaire = LuminaireEmitter(Luminaire.uniform([LUMINAIRE], RADIANCE * np.ones(3)))
        seen = path_radiance(scene, [luminaire], *self.rays, settings)
        return seen.radiance.reshape(self.height, -1, 3)

    def wall(self) -> np.ndarray:
        """Which pixels see it."""
        hits = self.mesh.first_hits(*self.rays)
        seen = hits.hit & (self.material[hits.face] == WALL)
        luminaire = np.isfinite(LUMINAIRE.crossings(*self.rays).distance)
        return (seen & ~luminaire).reshape(self.height, -1)


def wall_tree() -> CoefficientTree:
    """Means of Phong's lobe over cells, a tenth of the coefficients kept, the channels alike."""
    strength = 0.8 * (EXPONENT + 2) / (2 * np.pi)
    phong = CosineLobe(np.full(3, 0.02), np.full(3, strength), EXPONENT)
    coefficients = analyse_nonstandard(haar(), tabulate(phong, SIZE, cell_samples=2).values)
    return CoefficientTree.of_coefficients(haar(), keep_fraction(coefficients, KEPT).coefficients)


def room(tree: CoefficientTree, height: int) -> Room:
    """Four walls (the camera looks in at the front), two blocks."""
    parts: list[tuple[Mesh, int]] = [
        (quad((-1.5, 3, 0), (3, 0, 0), (0, 0, 2)), WALL),
        (quad((-1.5, -1, 0), (3, 0, 0), (0, 4, 0)), COLOURS.index(GREY)),
        (quad((-1.5, -1, 2), (0, 4, 0), (3, 0, 0)), COLOURS.index(GREY)),
        (quad((-1.5, -1, 0), (0, 4, 0), (0, 0, 2)), COLOURS.index(RED)),
        (quad((1.5, -1, 0), (0, 0, 2), (0, 4, 0)), COLOURS.index(GREEN)),
        (quad((-1.5, -1, 0), (0, 0, 2), (3, 0, 0)), COLOURS.index(DARK)),
    ]
    for corner, side, tall, colour in (
        ((-0.9, 1.6, 0), 0.5, 0.9, BLUE),
        ((0.35, 1.9, 0), 0.55, 0.55, YELLOW),
    ):
        o, x, y, z = (np.array(a, float) for a in (corner, (side, 0, 0), (0, side, 0), (0, 0, 1)))
        z = z * tall
        for face in ((o + z, x, y), (o, x, z), (o + x, y, z), (o + x + y, -x, z), (o + y, -y, z)):
            parts.append((quad(*face), COLOURS.index(colour)))
    material = np.repeat([index for _, index in parts], [len(part.faces) for part, _ in parts])
    pose = look_at(np.array([0, -0.9, 1.0]), np.array([0, 3.0, 1.0]), np.array([0, 0, 1.0]))
    rays = Pinhole(3 * height // 2, height, pose, fl_x=0.9 * height).rays()
    origins, directions = (a.reshape(-1, 3).copy() for a in rays)
    mesh = joined([part for part, _ in parts])
    return Room(mesh, material, tree, (origins, directions), height)


def noise(images: list[np.ndarray], where: np.ndarray) -> tuple[float, float]:
    """The rms scatter between images, and the standard error of its square, relative."""
    variance = np.var(images, axis=0, ddof=1).mean(axis=-1)[where]
    uncertainty = variance.std() / variance.mean() / np.sqrt(len(variance))
    return float(np.sqrt(variance.mean())), float(uncertainty)


def compare(scene: Room, given: argparse.Namespace) -> dict[str, np.ndarray]:
    """Print the noise of each way, and return the pictures."""
    ways = {
        "tree": TreeSampler.of(scene.tree, SHARE),
        "cosine": COSINE,
        "uniform": UniformSampler(),
    }
    shown = {"reference": scene.render(ways["tree"], PathSettings(REFERENCE, 3))}
    direct = scene.render(ways["tree"], PathSettings(REFERENCE // 4, 1)).mean(axis=-1)
    wall = scene.wall()
    where = wall & (direct < HIGHLIGHT * shown["reference"].mean(axis=-1))
    print(f"{where.sum()} pixels of the {wall.sum()} of the wall are outside the highlight")
    print("published: considerably less noise at 4 samples a pixel, no number (L 8.7)")
    print(
        "reflections  drawn     wall's mean  rms noise  of the mean  variance to the tree's  time"
    )
    for bounces in (2, 3):
        least = 0.0
        for name, way in ways.items():
            start = time.perf_counter()
            images = [
                scene.render(way, PathSettings(given.samples, bounces, seed=seed + 1))
                for seed in range(given.seeds)
            ]
            seconds = (time.perf_counter() - start) / given.seeds
            rms, uncertainty = noise(images, where)
            least, mean = least or rms, np.mean(images, axis=0)[where].mean()
            print(
                f"{bounces:11d}  {name:8s} {mean:12.4f} {rms:10.4f} {rms / mean:12.0%} "
                f"{(rms / least) ** 2:14.1f} (+-{uncertainty:4.0%}) {seconds:5.1f} s"
            )
            shown[name] = images[0]
    there = shown["reference"][where].mean()
    print(f"mean of {REFERENCE} samples drawn from the tree, 3 reflections: {there:.4f}")
    return shown


def speed(tree: CoefficientTree) -> None:
    """Draws a second with a different outgoing direction each."""
    rng = np.random.default_rng(3)
    for name, sampler, count in (
        ("table", TreeSampler.of(tree), 1 << 20),
        ("slices", TreeSampler.of(tree, kind=SlicedDensities), 1 << 13),
    ):
        outgoing = UniformSampler().draw(np.zeros(0), rng.random((count, 2)))
        outgoing = jnp.asarray(outgoing, np.float32)
        uniforms = jnp.asarray(rng.random((count, 2)), np.float32)
        for what in ("draws", "densities"):
            work = sampler.draw if what == "draws" else sampler.density
            given = uniforms if what == "draws" else sampler.draw(outgoing, uniforms)
            work(outgoing, given).block_until_ready()
            start = time.perf_counter()
            work(outgoing, given).block_until_ready()
            rate = count / (time.perf_counter() - start)
            print(f"{name}: {rate:.3g} {what} a second, float32, {jax.devices()[0]}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    tree = wall_tree()
    print(f"tree of {tree.count} coefficients of {SIZE}^4 samples")
    speed(tree)
    shown = compare(room(tree, given.size), given)
    figure, axes = plt.subplots(1, 3, figsize=(18, 4.4))
    titles = {
        "tree": f"drawn from the tree, {given.samples} samples",
        "uniform": f"drawn uniformly, {given.samples} samples",
        "reference": f"{REFERENCE} samples",
    }
    for axis, (name, title) in zip(axes, titles.items(), strict=True):
        axis.imshow(np.clip(shown[name], 0, 1) ** (1 / 2.2))
        axis.set_title(title)
        axis.axis("off")
    figure.savefig(given.out / "lalonde_figure_8_3.png", dpi=100, bbox_inches="tight")


if __name__ == "__main__":
    main()
