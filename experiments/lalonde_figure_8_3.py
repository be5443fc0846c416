"""L fig. 8.3: a room whose back wall is a Haar-transformed Phong BRDF of exponent 100.

    python experiments/lalonde_figure_8_3.py [--size N] [--samples N] [--out F.png]

The wall's BRDF is the tree itself, as in the thesis.  Camera rays that meet it go on in a direction
drawn from the tree (left) or uniformly (right), 4 a pixel; everything else (area light by drawing
points of it everywhere, three bounces in all) is the same.  The wall's noise is the difference from
many samples drawn from the tree.  The thesis prints no number, only that the left image "has
considerably less noise".  Then speed: draws a second by table and by slices.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from jaxrender.brdf import BRDF, Phong
from jaxrender.brdf.samplers import COSINE
from jaxrender.brdf.tree_sampler import TreeSampler
from jaxrender.geometry import NUSSELT, Mesh
from jaxrender.wavelets.filters import haar
from jaxrender.wavelets.slices import SlicedDensities
from jaxrender.wavelets.threshold import keep_fraction
from jaxrender.wavelets.transform import analyse_nonstandard
from jaxrender.wavelets.tree import CoefficientTree

SIZE, EXPONENT, KEPT, SHARE = 32, 100.0, 0.1, 0.1
BOUNCES, REFERENCE = 3, 128
GREY, RED, GREEN, BLUE = (0.7, 0.7, 0.7), (0.7, 0.15, 0.1), (0.15, 0.5, 0.15), (0.15, 0.2, 0.6)
WALL, LIGHT = 0, 1
# The lamp hangs just below the ceiling.
LAMP = np.array([-0.5, 1.0, 1.98]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
RADIANCE = 6.0


class Room(NamedTuple):
    """Triangles, and for each what it is of: the wall, the lamp, or a diffuse colour."""

    mesh: Mesh
    kind: np.ndarray
    colour: np.ndarray
    samples: np.ndarray
    sampler: TreeSampler


def wall_tree() -> CoefficientTree:
    """Samples of rho at pairs of cells' centres, a tenth of the coefficients kept."""
    phong = Phong(np.array([0.02]), np.array([0.8]), EXPONENT)
    directions = NUSSELT.cell_directions((SIZE, SIZE)).reshape(-1, 3)
    covered = np.flatnonzero(NUSSELT.covers(NUSSELT.centres((SIZE, SIZE)).reshape(-1, 2)))
    upper = jnp.asarray(directions[covered])
    evaluate = jax.jit(lambda i, o: BRDF.evaluate(phong, i, o))
    table = np.zeros((SIZE**2, SIZE**2, 1))
    for row, incoming in zip(covered, upper):
        pairs = jnp.broadcast_to(incoming, upper.shape), upper
        table[row, covered] = evaluate(*pairs)
    # Towards grazing the lobe over the cosine has no bound; a wall's reflectance has.
    table = np.minimum(table, phong.ks.max() * EXPONENT / 2)
    coefficients = analyse_nonstandard(haar(), table.reshape(*(SIZE,) * 4, 1))
    return CoefficientTree.of_coefficients(haar(), keep_fraction(coefficients, KEPT).coefficients)


def room(tree: CoefficientTree) -> Room:
    """Four walls (the camera looks in at the front), a lamp, two blocks."""
    quads, kinds, colours = [], [], []

    def add(origin, u, v, kind, colour=GREY):
        origin, u, v = (np.asarray(a, float) for a in (origin, u, v))
        quads.append([origin, origin + u, origin + u + v, origin + v])
        kinds.append(kind)
        colours.append(colour)

    add((-1.5, 3, 0), (3, 0, 0), (0, 0, 2), WALL)
    add(*LAMP[:1], LAMP[2], LAMP[1], LIGHT)
    add((-1.5, -1, 0), (3, 0, 0), (0, 4, 0), 2)
    add((-1.5, -1, 2), (0, 4, 0), (3, 0, 0), 2)
    add((-1.5, -1, 0), (0, 4, 0), (0, 0, 2), 2, RED)
    add((1.5, -1, 0), (0, 0, 2), (0, 4, 0), 2, GREEN)
    add((-1.5, -1, 0), (0, 0, 2), (3, 0, 0), 2, (0.4, 0.4, 0.4))
    for corner, side, height, colour in (
        ((-0.9, 1.6, 0), 0.5, 0.9, BLUE),
        ((0.35, 1.9, 0), 0.55, 0.55, (0.75, 0.6, 0.15)),
    ):
        o, x, y, z = (np.array(a, float) for a in (corner, (side, 0, 0), (0, side, 0), (0, 0, 1)))
        z = z * height
        for face in ((o + z, x, y), (o, x, z), (o + x, y, z), (o + x + y, -x, z), (o + y, -y, z)):
            add(*face, 2, colour)
    corners = np.array(quads).reshape(-1, 3)
    first = 4 * np.arange(len(quads))[:, None]
    faces = np.stack([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])], axis=1).reshape(
        -1, 3
    )
    sampler = TreeSampler.of(tree, SHARE)
    samples = np.maximum(np.asarray(tree.samples())[..., 0], 0)
    return Room(
        Mesh(corners, faces), np.repeat(kinds, 2), np.repeat(colours, 2, axis=0), samples, sampler
    )


def of_wall(scene: Room, incoming: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
    """rho cos t_i of the (clamped) tree."""
    (i, j), (k, m) = (
        np.clip((d[:, :2] + 1) / 2 * SIZE, 0, SIZE - 1).astype(int).T for d in (incoming, outgoing)
    )
    return scene.samples[i, j, k, m] * np.maximum(incoming[:, 2], 0)


def frames(normals: np.ndarray) -> np.ndarray:
    """Columns are two tangents and the normal."""
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, [[0.0, 0, 1]], [[1.0, 0, 0]])
    first = np.cross(helper, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first), normals], axis=-1)


def uniform_hemisphere(uniforms: np.ndarray) -> np.ndarray:
    sine, turn = np.sqrt(1 - uniforms[:, 0] ** 2), 2 * np.pi * uniforms[:, 1]
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), uniforms[:, 0]], axis=-1)


def from_lamp(scene: Room, points, local, rng) -> tuple[np.ndarray, np.ndarray]:
    """Local directions to one point of the lamp each, and the irradiance over the cosine."""
    u = rng.random((len(points), 2))
    towards = LAMP[0] + u[:, :1] * LAMP[1] + u[:, 1:] * LAMP[2] - points
    distance = np.linalg.norm(towards, axis=1)
    towards /= distance[:, None]
    geometry = np.maximum(towards[:, 2], 0) / distance**2
    hits = scene.mesh.first_hits(points, towards)
    seen = hits.hit & (scene.kind[hits.face] == LIGHT)
    return np.einsum("rij,ri->rj", local, towards), RADIANCE * np.where(seen, geometry, 0)


def radiance(scene: Room, origins, directions, way: str, rng) -> np.ndarray:
    """One path for each ray; every place looks for the lamp, which only the camera meets."""
    total, carried = np.zeros((len(origins), 3)), np.ones((len(origins), 3))
    path = np.arange(len(origins))
    for bounce in range(BOUNCES):
        hits = scene.mesh.first_hits(origins, directions)
        kind = np.where(hits.hit, scene.kind[hits.face], -1)
        facing = np.einsum("ri,ri->r", hits.geometric_normals, directions) < 0
        if not bounce:
            total[(kind == LIGHT) & facing] = RADIANCE
        on = np.flatnonzero((kind != LIGHT) & hits.hit & facing)
        path, carried, kind = path[on], carried[on], kind[on]
        local = frames(hits.geometric_normals[on])
        points = hits.points[on] + 1e-4 * hits.geometric_normals[on]
        outgoing = -np.einsum("rij,ri->rj", local, directions[on])
        wall, colour = kind == WALL, scene.colour[hits.face[on]]
        incoming, lamp = from_lamp(scene, points, local, rng)
        reflected = colour / np.pi * np.maximum(incoming[:, 2:], 0)
        reflected[wall] = of_wall(scene, incoming[wall], outgoing[wall])[:, None]
        total[path] += carried * reflected * lamp[:, None]
        if bounce + 1 == BOUNCES:
            break
        u = rng.random((len(on), 2))
        incoming = COSINE.draw(outgoing, u)
        weight = colour.copy()
        if wall.any():
            if way == "tree":
                drawn = np.asarray(scene.sampler.draw(outgoing[wall], u[wall]), float)
                density = np.asarray(scene.sampler.density(outgoing[wall], drawn), float)
            else:
                drawn = uniform_hemisphere(u[wall])
                density = np.full(len(drawn), 0.5 / np.pi)
            reflected = of_wall(scene, drawn, outgoing[wall])
            incoming[wall] = drawn
            weight[wall] = (reflected / np.where(density > 0, density, np.inf))[:, None]
        carried = carried * weight
        origins, directions = points, np.einsum("rij,rj->ri", local, incoming)
    return total


def picture(
    scene: Room, size: int, samples: int, way: str, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Render the room, and say which pixels see the wall."""
    width, height = 3 * size // 2, size
    rng = np.random.default_rng(seed)
    total = np.zeros((height * width, 3))
    for _ in range(samples):
        column, row = np.meshgrid(np.arange(width), np.arange(height))
        jitter = rng.random((2, height, width))
        x = ((column + jitter[0]) / width - 0.5) * 1.5
        y = 0.5 - (row + jitter[1]) / height
        rays = np.stack([x, np.full_like(x, 0.9), y], axis=-1).reshape(-1, 3)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        origins = np.broadcast_to([0.0, -0.9, 1.0], rays.shape)
        total += radiance(scene, origins, rays, way, rng)
    hits = scene.mesh.first_hits(np.array(origins), rays)
    wall = hits.hit & (scene.kind[hits.face] == WALL)
    return (total / samples).reshape(height, width, 3), wall.reshape(height, width)


def speed(tree: CoefficientTree) -> None:
    """Draws a second with a different outgoing direction each."""
    rng = np.random.default_rng(3)
    for name, sampler, count in (
        ("table", TreeSampler.of(tree), 1 << 20),
        ("slices", TreeSampler.of(tree, kind=SlicedDensities), 1 << 13),
    ):
        outgoing = jnp.asarray(uniform_hemisphere(rng.random((count, 2))), np.float32)
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
    parser.add_argument("--size", type=int, default=160)
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--out", type=Path, default=Path("experiments/out/lalonde_figure_8_3.png"))
    given = parser.parse_args()
    tree = wall_tree()
    print(f"tree of {tree.count} coefficients of {SIZE}^4 samples")
    scene = room(tree)
    reference, wall = picture(scene, given.size, REFERENCE, "tree", 1)
    shown = {}
    for way in ("tree", "uniform"):
        start = time.perf_counter()
        shown[way], _ = picture(scene, given.size, given.samples, way, 2)
        seconds = time.perf_counter() - start
        error = shown[way] - reference
        noise = np.sqrt(np.mean(error[wall] ** 2)), np.median(np.abs(error[wall]))
        mean = shown[way][wall].mean(), reference[wall].mean()
        print(
            f"{way:8s} wall rms {noise[0]:.4f} ({noise[0] / mean[1]:.1%} of the mean), median "
            f"{noise[1]:.4f}; wall's mean {mean[0]:.4f} (reference {mean[1]:.4f}); {seconds:.1f} s"
        )
    print("published: considerably less noise at 4 samples a pixel, no number (L 8.7)")
    speed(tree)
    figure, axes = plt.subplots(1, 3, figsize=(15, 3.8))
    names = ("drawn from the tree", "drawn uniformly", f"{REFERENCE} samples")
    for axis, image, name in zip(axes, (shown["tree"], shown["uniform"], reference), names):
        axis.imshow(np.clip(image, 0, 1) ** (1 / 2.2))
        axis.set_title(name)
        axis.axis("off")
    given.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(given.out, dpi=110, bbox_inches="tight")


if __name__ == "__main__":
    main()
