"""L fig. 8.4: an environment lit by two fluorescent luminaires, and by the sphere lamp.

    python experiments/lalonde_figure_8_4.py [--out FOLDER] [--size 32] [--width 160] [--samples 4]

Path traced with two reflections, the luminaires' measured light fields alone for light, 10 % of
their 32^4 coefficients, places of them drawn by geometry as L 8.6 does, four samples a pixel;
beside them the same with 256.  L prints pictures only, and puts extra noise down to the variance
across the luminaires' surface.  Printed are the noise of surfaces, the rms difference from the 256
samples over the mean, and that under luminaires of the same shape and power that shine evenly.
Draws ``lalonde_figure_8_4.png``.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from lalonde_luminaires import OUT, joined, measured, quad, shown

from jaxrender.brdf import Lambertian
from jaxrender.geometry import Mesh, Pinhole, look_at
from jaxrender.lighting.luminaires import Luminaire, Rectangle
from jaxrender.lighting.luminaires.measured import compressed
from jaxrender.lighting.luminaires.surfaces import box_faces
from jaxrender.reflection.tracing import LuminaireEmitter, PathSettings, Scene, path_radiance

matplotlib.use("Agg")
import matplotlib.pyplot as plt

KEEP, BOUNCES, REFERENCE = 0.1, 2, 256


class Picture(NamedTuple):
    """Rays, and which of them meet a surface first."""

    rays: tuple[np.ndarray, np.ndarray]
    on_surface: np.ndarray

    def render(self, scene: Scene, luminaire: Luminaire, samples: int, seed: int = 0) -> np.ndarray:
        """Radiance [ray, channel]."""
        settings = PathSettings(samples, BOUNCES, seed=seed)
        return path_radiance(scene, [LuminaireEmitter(luminaire)], *self.rays, settings).radiance

    def noise(self, noisy: np.ndarray, smooth: np.ndarray) -> float:
        """The rms difference on surfaces, over their mean."""
        wanted = smooth[self.on_surface]
        square = np.mean((noisy[self.on_surface] - wanted) ** 2)
        return float(np.sqrt(square) / wanted.mean())


def environment() -> Scene:
    """A room without its front wall, three balls and a table."""
    legs = [(x, y) for x in (-1.05, 0.05) for y in (0.15, 0.85)]
    faces = [
        f
        for x, y in legs
        for f in box_faces(np.array([x, y, 0]), np.array([x + 0.1, y + 0.1, 0.6]))
    ]
    faces += box_faces(np.array([-1.2, 0.0, 0.6]), np.array([0.3, 1.1, 0.68]))
    table = joined([quad(f.corner, f.along_u, f.along_v) for f in faces])
    parts = [
        (quad([-2, -2, 0], [4, 0, 0], [0, 4, 0]), (0.6, 0.5, 0.4)),
        (quad([-2, 2, 0], [4, 0, 0], [0, 0, 3]), (0.7, 0.7, 0.7)),
        (quad([-2, -2, 0], [0, 4, 0], [0, 0, 3]), (0.7, 0.5, 0.4)),
        (quad([2, -2, 0], [0, 4, 0], [0, 0, 3]), (0.4, 0.5, 0.7)),
        (quad([-2, -2, 3], [4, 0, 0], [0, 4, 0]), (0.7, 0.7, 0.7)),
        (table, (0.5, 0.35, 0.2)),
        (Mesh.icosphere(5, 0.3, np.array([-0.6, 0.5, 0.98])), (0.7, 0.7, 0.7)),
        (Mesh.icosphere(5, 0.5, np.array([1.0, 0.2, 0.5])), (0.7, 0.3, 0.3)),
        (Mesh.icosphere(5, 0.25, np.array([0.4, -0.8, 0.25])), (0.3, 0.6, 0.3)),
    ]
    material = np.repeat(np.arange(len(parts)), [len(mesh.faces) for mesh, _ in parts])
    brdfs = [Lambertian(np.array(albedo) / np.pi) for _, albedo in parts]
    return Scene.of(joined([mesh for mesh, _ in parts]), brdfs, material, two_sided=True)


def fluorescents(size: int) -> Luminaire:
    tree = compressed(measured("fluorescent", size)[0], KEEP)
    patches = [
        Rectangle(np.array([-1.0, y, 2.9]), np.array([0, 0.9, 0]), np.array([2.0, 0, 0]))
        for y in (-1.0, 0.6)
    ]
    return Luminaire(patches, [tree, tree], convex=True)


def hanging(size: int) -> Luminaire:
    trees = [compressed(samples, KEEP) for samples in measured("sphere lamp", size)]
    middle = np.array([0.2, 0.4, 2.25])
    return Luminaire(box_faces(middle - 0.4, middle + 0.4), trees, convex=True)


def even(luminaire: Luminaire) -> Luminaire:
    """The same patches, power and colour, but one radiance everywhere."""
    area = sum(patch.lengths.prod() for patch in luminaire.patches if isinstance(patch, Rectangle))
    radiance = np.asarray(luminaire.power(), float) / (np.pi * area)
    return Luminaire.uniform(luminaire.patches, radiance, convex=True)


def view(scene: Scene, luminaire: Luminaire, width: int) -> Picture:
    pose = look_at(np.array([0, -5.4, 1.7]), np.array([0, 0, 1.4]), np.array([0, 0, 1.0]))
    pinhole = Pinhole(width, width * 3 // 4, pose, fl_x=1.15 * width).rays()
    origins, directions = (a.reshape(-1, 3).copy() for a in pinhole)
    reach = scene.shape.first_hits(origins, directions).distance
    lit = luminaire.crossings(origins, directions).distance
    return Picture((origins, directions), np.isfinite(reach) & (reach < lit))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("--samples", type=int, default=4)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(2, 2, figsize=(12, 9.4))
    scene = environment()
    luminaires = {"two fluorescents": fluorescents(args.size), "sphere lamp": hanging(args.size)}
    for row, (name, luminaire) in zip(axes, luminaires.items(), strict=True):
        picture = view(scene, luminaire, args.width)
        start = time.perf_counter()
        few = picture.render(scene, luminaire, args.samples, seed=1)
        seconds = time.perf_counter() - start
        many = picture.render(scene, luminaire, REFERENCE)
        evenly = [
            picture.render(scene, even(luminaire), n, seed)
            for n, seed in ((args.samples, 1), (REFERENCE // 4, 0))
        ]
        print(
            f"{name:17s} mean radiance {few[picture.on_surface].mean():.4f} (reference "
            f"{many[picture.on_surface].mean():.4f}), {args.samples} samples in {seconds:.1f} s: "
            f"noise {picture.noise(few, many):.0%}; shining evenly {picture.noise(*evenly):.0%}"
        )
        middle = np.median(many[picture.on_surface].mean(axis=1))
        for axis, (image, count) in zip(row, ((few, args.samples), (many, REFERENCE)), strict=True):
            axis.imshow(shown(0.2 / middle * image, args.width * 3 // 4))
            axis.set_title(f"{name}, {count} samples")
            axis.axis("off")
    figure.tight_layout()
    figure.savefig(args.out / "lalonde_figure_8_4.png", dpi=90)


if __name__ == "__main__":
    main()
