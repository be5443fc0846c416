"""L fig. 8.4: an environment lit by two fluorescent luminaires, and by the sphere lamp.

    python experiments/lalonde_figure_8_4.py [--out FOLDER] [--size 16] [--width 160] [--samples 4]

Direct light only, from the measured light fields alone, 30 % of their coefficients, drawn by
geometry as L 8.6 does, four samples a pixel.  L prints pictures only.  Printed: the mean radiance
and the noise, the scatter between samples over the mean.  Draws ``lalonde_figure_8_4.png``.
"""

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from lalonde_luminaires import OUT, joined, measured, quad, shown

from jaxrender.brdf.lambertian import Lambertian
from jaxrender.geometry import Pinhole, Sphere, look_at
from jaxrender.lighting.luminaires.luminaire import Luminaire
from jaxrender.lighting.luminaires.measured import compressed
from jaxrender.lighting.luminaires.surfaces import Rectangle, box_faces
from jaxrender.reflection.tracing.luminaire_sampling import LuminaireSampler, sampled_light
from jaxrender.reflection.tracing.luminaires import ShadedPoints

matplotlib.use("Agg")
import matplotlib.pyplot as plt

KEEP = 0.3


def environment() -> list:
    """Shapes and albedos: a room without its front wall, three balls and a table."""
    grey = np.full(3, 0.7)
    walls = [
        (quad([-2, -2, 0], [4, 0, 0], [0, 4, 0]), np.array([0.6, 0.5, 0.4])),
        (quad([-2, 2, 0], [4, 0, 0], [0, 0, 3]), grey),
        (quad([-2, -2, 0], [0, 4, 0], [0, 0, 3]), np.array([0.7, 0.5, 0.4])),
        (quad([2, -2, 0], [0, 4, 0], [0, 0, 3]), np.array([0.4, 0.5, 0.7])),
        (quad([-2, -2, 3], [4, 0, 0], [0, 4, 0]), grey),
    ]
    legs = [(x, y) for x in (-1.05, 0.05) for y in (0.15, 0.85)]
    faces = [
        f
        for x, y in legs
        for f in box_faces(np.array([x, y, 0]), np.array([x + 0.1, y + 0.1, 0.6]))
    ]
    faces += box_faces(np.array([-1.2, 0.0, 0.6]), np.array([0.3, 1.1, 0.68]))
    table = joined([quad(f.corner, f.along_u, f.along_v) for f in faces])
    balls = [
        (Sphere(np.array([-0.6, 0.5, 0.98]), 0.3), grey),
        (Sphere(np.array([1.0, 0.2, 0.5]), 0.5), np.array([0.7, 0.3, 0.3])),
        (Sphere(np.array([0.4, -0.8, 0.25]), 0.25), np.array([0.3, 0.6, 0.3])),
    ]
    return [*walls, (table, np.array([0.5, 0.35, 0.2])), *balls]


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


def picture(lamp: Luminaire, things: list, width: int, samples: int) -> tuple[np.ndarray, float]:
    pose = look_at(np.array([0, -5.4, 1.7]), np.array([0, 0, 1.4]), np.array([0, 0, 1.0]))
    rays = Pinhole(width, width * 3 // 4, pose, fl_x=1.15 * width).rays()
    origins, directions = (a.reshape(-1, 3).copy() for a in rays)
    nearest, albedo = np.full(len(origins), np.inf), np.zeros((len(origins), 3))
    points, normals = np.zeros((2, len(origins), 3))
    for shape, colour in things:
        hits = shape.first_hits(origins, directions)
        row = np.flatnonzero(hits.distance < nearest)
        nearest[row], albedo[row] = hits.distance[row], colour
        points[row], normals[row] = hits.points[row], hits.geometric_normals[row]
    normals *= -np.sign(np.einsum("ri,ri->r", normals, directions))[:, None]
    seen = lamp.radiance_along(origins, directions)
    radiance = np.asarray(seen.radiance, float).copy()
    row = np.flatnonzero((nearest < seen.distance) & np.isfinite(nearest))
    shaded = ShadedPoints.of(points[row], normals[row], -directions[row])
    uniforms = np.random.default_rng(0).uniform(size=(len(row), samples, 2))
    estimates = shadowed(shaded, lamp, uniforms, things)
    radiance[row] = albedo[row] * estimates.mean(axis=1)
    noise = estimates.std(axis=1, ddof=1).mean() / np.sqrt(samples) / estimates.mean()
    return radiance, float(noise)


class Together:
    """Several shapes as one occluder."""

    def __init__(self, things: list):
        self.shapes = [shape for shape, _ in things]

    def diagonal(self) -> float:
        """Of the room."""
        return 5.0

    def first_hits(self, origins, directions):
        """Keep the distances; nothing else is asked of an occluder."""
        found = [shape.first_hits(origins, directions) for shape in self.shapes]
        distance = np.min([hits.distance for hits in found], axis=0)
        return found[0]._replace(distance=distance)


def shadowed(shaded: ShadedPoints, lamp: Luminaire, uniforms: np.ndarray, things: list):
    white = Lambertian(np.full(3, 1 / np.pi))
    return np.asarray(
        sampled_light(shaded, white, LuminaireSampler(lamp), uniforms, Together(things))
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--size", type=int, default=16)
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("--samples", type=int, default=4)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(1, 2, figsize=(12, 4.8))
    things = environment()
    lamps = {"two fluorescents": fluorescents(args.size), "sphere lamp": hanging(args.size)}
    for axis, (name, lamp) in zip(axes, lamps.items()):
        radiance, noise = picture(lamp, things, args.width, args.samples)
        middle = np.median(radiance.mean(axis=1)[radiance.mean(axis=1) > 0])
        print(f"{name:17s} median radiance {middle:.4f}, noise {noise:.0%} of the mean")
        axis.imshow(shown(0.25 / middle * radiance, args.width * 3 // 4))
        axis.set_title(name)
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(args.out / "lalonde_figure_8_4.png", dpi=100)


if __name__ == "__main__":
    main()
