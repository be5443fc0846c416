"""T figure 5.4: the highest frequency in an image is the lesser of the light's and the BRDF's.

    python experiments/figure_5_4.py [--probe FILE.hdr] [--convention cross] [--out F.png]

Spheres under light that is blurred more and more (rows) and of a BRDF that is more and more diffuse
(columns): Phong lobes and Gaussians of the same widths.  Prints the degree F up to which light,
BRDF and image hold 1 - eps of their energy (T 5.15 to 5.18), and draws the spheres, all at one
exposure, +Z up; inside a yellow delimiter the lesser F is the same.
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scenes import probe

from jaxrender.geometry import Orthographic, Sphere, look_at, observe
from jaxrender.harmonics import LatLongGrid, degrees, looked_up, over_poles, synthesise
from jaxrender.io import read_environment
from jaxrender.spectra import (
    CentralSpectrum,
    light_coefficients,
    missing_light,
    phong_transfer,
    required_orders,
)

ROWS, BAND_LIMIT, SIZE = 256, 80, 128
TOLERANCE = 0.05
# Widths in radians: light is filtered by exp(-w^2 l(l+1)), the lobe has 2 (s + 1) = 1 / w^2.
WIDTHS = (0.03, 0.06, 0.12, 0.24, 0.48)
TOWARDS = np.array([0.0, -1.0, 0.25])
GRID = LatLongGrid(256, 512)


def blurred(light: np.ndarray, width: float) -> np.ndarray:
    degree = degrees(BAND_LIMIT)
    return light * np.exp(-(width**2) * degree * (degree + 1))[:, None]


def exponent_of(width: float) -> float:
    return 1 / (2 * width**2) - 1


def transfer_of(width: float) -> np.ndarray:
    return np.asarray(phong_transfer(np.asarray(exponent_of(width)), BAND_LIMIT))


def brdf_degree(width: float) -> int:
    """F of the lobe; its energy is that of one sphere, in closed form."""
    s, transfer = exponent_of(width), transfer_of(width)
    rho = transfer * np.sqrt(2 * np.arange(BAND_LIMIT + 1) + 1)
    energy = 4 * np.pi * (s + 1) ** 2 / (2 * np.pi * (2 * s + 1))
    spectrum = CentralSpectrum(rho[:, None, None, None], np.array([energy]))
    return required_orders(spectrum, TOLERANCE).light


def degree_of(function: np.ndarray) -> int:
    """F of a function on the sphere given by its coefficients."""
    return int(np.argmax(missing_light(function, float(np.sum(function**2))) < TOLERANCE))


def reflected(light: np.ndarray, width: float) -> np.ndarray:
    return light * transfer_of(width)[degrees(BAND_LIMIT), None]


def mirrored() -> tuple[np.ndarray, np.ndarray]:
    """Reflected directions of the sphere's pixels, and where it is."""
    towards = TOWARDS / np.linalg.norm(TOWARDS)
    pose = look_at(4 * towards, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    view = observe(Orthographic(SIZE, SIZE, pose, scale=2.06 / SIZE), Sphere(np.zeros(3), 1.0))
    normals = view.normals[view.hit]
    return 2 * (normals @ towards)[:, None] * normals - towards, view.hit


def picture(image: np.ndarray, directions: np.ndarray, hit: np.ndarray) -> np.ndarray:
    texels = over_poles(synthesise(GRID, jnp.asarray(image)))
    found = np.ones((SIZE, SIZE, image.shape[1]))
    found[hit] = np.asarray(looked_up(texels, jnp.asarray(directions)))
    return found


def print_table(light: np.ndarray, lobes: list[int]) -> np.ndarray:
    """Print F of every image beside the lesser F; return those of the images."""
    print(f"F that leaves {TOLERANCE:g} of the energy out; image (lesser of light and BRDF)")
    heads = (f"s = {exponent_of(w):.1f}" for w in WIDTHS)
    print(f"{'':22s}" + "".join(f"{head:>12s}" for head in heads))
    print(f"{'light blurred by':18s}{'F':>4s}" + "".join(f"{degree:12d}" for degree in lobes))
    found = np.zeros((len(WIDTHS), len(WIDTHS)), int)
    for row, width in enumerate(WIDTHS):
        lit = blurred(light, width)
        own = degree_of(lit)
        line = f"{np.degrees(width):12.1f} deg  {own:4d}"
        for column, lobe in enumerate(WIDTHS):
            found[row, column] = degree_of(reflected(lit, lobe))
            line += f"{f'{found[row, column]} ({min(own, lobes[column])})':>12s}"
        print(line)
    return found


def summarise(found: np.ndarray, light: np.ndarray, lobes: list[int]):
    lights = np.array([degree_of(blurred(light, width)) for width in WIDTHS])
    least = np.minimum(lights[:, None], np.array(lobes)[None, :])
    apart = np.abs(np.arange(len(WIDTHS))[:, None] - np.arange(len(WIDTHS))[None, :])
    ratio = found / least
    print("published: F of the image is approximately the lesser; measured, image over lesser:")
    for name, chosen in (
        ("equal widths", apart == 0),
        ("a factor of 2 apart", apart == 1),
        ("more", apart > 1),
    ):
        print(f"  {name:20s}{ratio[chosen].min():.2f} to {ratio[chosen].max():.2f}")
    print("two filters of one width are one sqrt(2) times as wide: .71 is to be expected of them,")
    print("but for rounding to whole degrees where F is small")


def draw(light: np.ndarray, found: np.ndarray, lobes: list[int], path: Path):
    directions, hit = mirrored()
    rows = []
    for width in WIDTHS:
        lit = blurred(light, width)
        rows.append([picture(reflected(lit, lobe), directions, hit) for lobe in WIDTHS])
    images = np.array(rows)
    exposure = np.quantile(images[:, :, hit].max(axis=-1), 0.97)
    shown = np.clip(np.maximum(images, 0) / exposure, 0, 1) ** (1 / 2.2)
    shown[:, :, ~hit] = 1
    count = len(WIDTHS)
    mosaic = shown.transpose(0, 2, 1, 3, 4).reshape(count * SIZE, count * SIZE, -1)
    figure, axes = plt.subplots(figsize=(8.2, 8.2), layout="constrained")
    axes.imshow(np.broadcast_to(mosaic, (*mosaic.shape[:2], 3)))
    for row in range(count):
        for column in range(count):
            place = (column * SIZE + 1, row * SIZE + 1)
            axes.annotate(f"F {found[row, column]}", place, va="top", fontsize=8)
    for k in range(1, count):
        edge = k * SIZE - 0.5
        axes.plot([-0.5, edge, edge], [edge, edge, -0.5], color="gold", lw=3)
    centres = (np.arange(count) + 0.5) * SIZE
    names = [f"s = {exponent_of(w):.3g}\nF {f}" for w, f in zip(WIDTHS, lobes)]
    axes.set_xticks(centres, names)
    lights = [degree_of(blurred(light, w)) for w in WIDTHS]
    names = [f"{np.degrees(w):.1f}°\nF {f}" for w, f in zip(WIDTHS, lights)]
    axes.set_yticks(centres, names)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set(xlabel="BRDF, more diffuse to the right", ylabel="light, more blurred downwards")
    axes.set_title("T fig. 5.4: highest frequencies of light, BRDF and image", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    print(f"picture: {path}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probe", type=Path)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_5_4.png"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if arguments.probe:
        environment = read_environment(arguments.probe, arguments.convention, height=ROWS)
    else:
        environment = probe("discs", 1, ROWS)
    light = np.asarray(light_coefficients(environment, BAND_LIMIT))
    lobes = [brdf_degree(width) for width in WIDTHS]
    found = print_table(light, lobes)
    summarise(found, light, lobes)
    draw(light, found, lobes, arguments.out)


if __name__ == "__main__":
    main()
