"""The light of an experiment from a photograph of a mirror ball (T 6.4.1), unwrapped as T fig. 6.4.

    python experiments/figure_6_4.py [--probe FILE.hdr] [--convention cross] [--radius 100]

The thesis takes its known light, and the reference for unknown light, from a mirror sphere.  Here a
ball of known probe (``scenes.py``'s own, or a file) is photographed: every pixel is the mean of
6 x 6 exact reflections in a fine image of the light, taken texel by texel without interpolation.
The ball's circle comes from its silhouette, the panorama from ``light_of_ball``.  Printed are the
errors of the circle in pixels; of the panorama, rms over the directions seen (solid angles count
alike), per cent of the light's own rms, as it is and with both to degree 20; and of the light's
nine first coefficients.

Four photographs: without noise, with noise, with a sensor that saturates at a tenth of the
brightest pixel, and the same joined by an exposure twenty times shorter.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import jax
import matplotlib.pyplot as plt
import numpy as np
import scenes

from jaxrender.geometry import look_at
from jaxrender.harmonics import LatLongGrid, analyse, synthesise
from jaxrender.imaging import NoiseModel, circle_of, saturated
from jaxrender.imaging.silhouette import Circle
from jaxrender.io import read_environment
from jaxrender.lighting import BallLight, Environment, light_of_ball
from jaxrender.pipelines.report.display import tone_key, tone_mapped

OUT = Path(__file__).parent / "out" / "figure_6_4.png"
# Rows of the light that is photographed, and of the panorama that is recovered.
FINE_ROWS, ROWS = 256, 64
SUPERSAMPLING = 6
REFLECTANCE = 0.9
POSE = look_at(np.array([3.0, -2.0, 1.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
NOISE, FLOOR = 0.01, 0.002
# The sensor saturates at this part of the brightest pixel; the other exposure is so much shorter.
SATURATION, SHORTER = 0.1, 1 / 20
# Directions that the ball shows worse than this are not counted as seen (T 6.4.1: the rim).
SEEN = 0.35
COMPARED_DEGREE = 20


class Shot(NamedTuple):
    """A photograph of the ball, which pixels are good, and how much of each the ball covers."""

    name: str
    picture: np.ndarray
    usable: np.ndarray
    coverage: np.ndarray


class Error(NamedTuple):
    """How far a recovered panorama is off, per cent; and the part of all directions it is about."""

    seen: float
    rms: float
    smooth: float
    nine: float
    nine_seen: float


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--probe", type=Path)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--radius", type=float, default=100.0, help="of the ball, in pixels")
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if arguments.probe is None:
        light = scenes.probe("interior", 3, FINE_ROWS)
    else:
        light = read_environment(arguments.probe, arguments.convention, height=FINE_ROWS)
    truth = scenes.coarser(light, FINE_ROWS // ROWS)
    radius = arguments.radius + 0.3
    ball = Circle(1.15 * radius + 0.37, 1.2 * radius - 0.21, radius, 0.0, 1.0)
    rows = []
    for shot in photographs(light, ball):
        circle = circle_of(shot.coverage)
        found = light_of_ball(
            shot.picture, circle, POSE, ROWS, usable=shot.usable, reflectance=REFLECTANCE
        )
        rows.append((shot, circle, found, error_of(found, truth, light)))
    print_table(rows, ball)
    draw(rows, truth, arguments.out)


def photographs(light: Environment, ball: Circle) -> list[Shot]:
    """Photograph the ball in four ways."""
    exact, coverage = photograph(light, ball)
    noise = NoiseModel(NOISE, FLOOR * float(exact.mean()))
    noisy = noise.add(exact, np.random.default_rng(0))
    level = SATURATION * float(exact.max())
    burnt = saturated(noisy, level, grow=1)
    shorter = noise.add(SHORTER * exact, np.random.default_rng(1)) / SHORTER
    both = np.where(burnt[..., None], shorter, noisy)
    every = np.ones(coverage.shape, bool)
    return [
        Shot("exact", exact, every, coverage),
        Shot("noise", noisy, every, coverage),
        Shot("saturated", np.minimum(noisy, level), ~burnt, coverage),
        Shot("two exposures", both, ~saturated(SHORTER * both, level), coverage),
    ]


def photograph(light: Environment, ball: Circle) -> tuple[np.ndarray, np.ndarray]:
    """Reflect the light in the ball, grey around it; returns the picture and the ball's share."""
    size = round(2.4 * ball.radius)
    fine = (np.arange(size * SUPERSAMPLING) + 0.5) / SUPERSAMPLING
    y, x = -(fine[:, None] - ball.row) / ball.radius, (fine[None, :] - ball.column) / ball.radius
    x, y = np.broadcast_arrays(x, y)
    on = x**2 + y**2 < 1
    normals = np.stack([x, y, np.sqrt(np.where(on, 1 - x**2 - y**2, 0))], axis=-1)
    reflected = 2 * normals[..., 2:] * normals - np.array([0.0, 0.0, 1.0])
    seen = REFLECTANCE * radiance_at(light, reflected @ POSE[:3, :3].T)
    grey = 0.5 * float(np.asarray(light.radiance).mean())
    picture = np.where(on[..., None], seen, grey)
    return _block_means(picture), _block_means(on.astype(float)[..., None])[..., 0]


def radiance_at(light: Environment, directions: np.ndarray) -> np.ndarray:
    """Look up the texel that each direction falls into."""
    rows, columns = light.grid.shape
    x, y, z = np.moveaxis(directions, -1, 0)
    row = np.clip(np.arccos(np.clip(z, -1, 1)) / np.pi * rows, 0, rows - 1).astype(int)
    column = (np.arctan2(y, x) / (2 * np.pi) % 1 * columns).astype(int) % columns
    return np.asarray(light.radiance)[row, column]


def _block_means(picture: np.ndarray) -> np.ndarray:
    rows, columns = (side // SUPERSAMPLING for side in picture.shape[:2])
    blocks = picture.reshape(rows, SUPERSAMPLING, columns, SUPERSAMPLING, -1)
    return blocks.mean(axis=(1, 3))


def error_of(found: BallLight, truth: Environment, light: Environment) -> Error:
    """Compare in the directions seen; and the nine coefficients of all that was recovered."""
    weights = truth.grid.weights() * (found.confidence > SEEN)
    grid = LatLongGrid(*found.confidence.shape)
    recovered = np.asarray(found.environment.radiance)
    pair = (recovered, np.asarray(truth.radiance))
    soft = [np.asarray(synthesise(grid, analyse(grid, image, COMPARED_DEGREE))) for image in pair]
    true_nine = np.asarray(analyse(light.grid, light.radiance, 2))
    mended = np.where((found.confidence > SEEN)[..., None], *pair)
    nine = [np.asarray(analyse(grid, image, 2)) - true_nine for image in (recovered, mended)]
    size = np.linalg.norm(true_nine)
    return Error(
        100 * float(weights.sum() / (4 * np.pi)),
        _relative(*pair, weights),
        _relative(soft[0], soft[1], weights),
        *(100 * float(np.linalg.norm(off) / size) for off in nine),
    )


def _relative(found: np.ndarray, truth: np.ndarray, weights: np.ndarray) -> float:
    squares = (np.sum(weights[..., None] * image**2) for image in (found - truth, truth))
    return 100 * float(np.sqrt(next(squares) / next(squares)))


def print_table(rows: list, ball: Circle):
    """Print the errors of every photograph's circle and panorama."""
    print(f"ball of radius {ball.radius:.1f} pixels, panorama of {ROWS} x {2 * ROWS} texels")
    print(
        "photograph      circle off, pixels (row, column, radius)   its s.e.   "
        "unusable, %   seen, %   rms, %   to degree 20, %   nine coefficients, %   "
        "blind spot known, %"
    )
    for shot, circle, _, error in rows:
        off = [getattr(circle, n) - getattr(ball, n) for n in ("row", "column", "radius")]
        inside = shot.coverage == 1
        bad = 100 * np.mean(~shot.usable[inside])
        print(
            f"{shot.name:15s} {off[0]:+10.4f} {off[1]:+10.4f} {off[2]:+10.4f} "
            f"{circle.standard_error:18.4f} {bad:12.2f} {error.seen:9.1f} {error.rms:8.2f} "
            f"{error.smooth:14.2f} {error.nine:18.2f} {error.nine_seen:20.2f}"
        )


def draw(rows: list, truth: Environment, out: Path):
    """Draw photographs, the panoramas of them (paler where not seen), and the true one."""
    figure, axes = plt.subplots(
        3, len(rows), figsize=(3.6 * len(rows), 6.6), height_ratios=[2, 1, 1], layout="constrained"
    )
    light = np.asarray(truth.radiance)
    key = tone_key(light)
    for column, (shot, _, found, error) in zip(axes.T, rows):
        recovered = tone_mapped(np.asarray(found.environment.radiance), key)
        # Directions that the ball did not show are drawn paler.
        pale = (found.confidence <= SEEN)[..., None]
        shown = np.where(pale, 128 + recovered // 2, recovered).astype(np.uint8)
        column[0].imshow(tone_mapped(shot.picture, key))
        column[1].imshow(shown)
        column[2].imshow(tone_mapped(light, key))
        column[0].set_title(f"{shot.name}: {error.rms:.1f} % rms, nine {error.nine:.2f} %")
        for axis in column:
            axis.set(xticks=[], yticks=[])
    for axis, name in zip(axes[:, 0], ("photograph", "recovered", "true")):
        axis.set_ylabel(name)
    out.parent.mkdir(exist_ok=True)
    figure.savefig(out, dpi=110)
    print(f"picture: {out}")


if __name__ == "__main__":
    main()
