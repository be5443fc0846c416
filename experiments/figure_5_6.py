"""T figure 5.6: a reflection map of the simplified microfacet for growing P, beside the integral.

    python experiments/figure_5_6.py [--probe FILE.hdr] [--convention cross] [--out F.png]

rho^ = exp(-(t_h / sigma)^2) / (4 pi sigma^2), sigma = .2 (T 5.34), F_B = 30, S_B = 128, two views;
without a probe under a random interior.  The exact image is a sum over all texels of the light
above each pixel's horizon, in NumPy and without harmonics.  Prints the relative rms of the images
beside sqrt(eps) of the BRDF, which the thesis takes as a conservative estimate.  Demanded: below
sqrt(.03) at P = 2, and falling with P.  Differences are shown as in the thesis, not amplified, and
below them multiplied by the factor that stands beside them; +Z is up.
"""

import argparse
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scenes import probe

from jaxrender.geometry import Orthographic, Sphere, look_at, observe
from jaxrender.harmonics import LatLongGrid
from jaxrender.io import read_environment
from jaxrender.lighting import Environment
from jaxrender.reflection.shrm import exit_cosine, local_shrm
from jaxrender.spectra import FacetLobe, central_spectrum, light_coefficients, missing_energy

SIGMA, BAND_LIMIT, MAP_ROWS = 0.2, 30, 128
ORDERS = range(5)
LIGHT_ROWS, SIZE = 128, 120
DEMANDED_ORDER, DEMANDED = 2, np.sqrt(0.03)
# Azimuth and elevation of the two viewers, degrees.
VIEWS = ((-60, 15), (100, -20))


def towards(view: tuple[int, int]) -> np.ndarray:
    azimuth, elevation = np.radians(view)
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def seen(outgoing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals of the sphere's pixels, and where it is."""
    pose = look_at(4 * outgoing, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    view = observe(Orthographic(SIZE, SIZE, pose, scale=2.06 / SIZE), Sphere(np.zeros(3), 1.0))
    return view.normals[view.hit], view.hit


def integrated(light: Environment, normals: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
    """Sum T 5.34 times the radiance over every texel above each normal's horizon."""
    grid = light.grid
    nodes = grid.directions().reshape(-1, 3)
    energy = (grid.weights()[..., None] * np.asarray(light.radiance)).reshape(len(nodes), -1)
    half = nodes + outgoing
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    image = np.empty((len(normals), energy.shape[1]))
    for rows in np.array_split(np.arange(len(normals)), 128):
        angle = np.arccos(np.clip(normals[rows] @ half.T, -1, 1))
        lobe = np.exp(-((angle / SIGMA) ** 2)) / (4 * np.pi * SIGMA**2)
        image[rows] = np.where(normals[rows] @ nodes.T > 0, lobe, 0) @ energy
    return image


def mapped(shrm, normals: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
    """Look the map up at the reflected directions; the weighted rho^ is T 5.34 itself."""
    centres = jnp.asarray(2 * (normals @ outgoing)[:, None] * normals - outgoing)
    away = jnp.broadcast_to(jnp.asarray(outgoing), centres.shape)
    return np.asarray(shrm.at(centres, away) * exit_cosine(centres, away)[:, None])


def relative_rms(image: np.ndarray, exact: np.ndarray) -> float:
    return float(np.sqrt(np.sum((image - exact) ** 2) / np.sum(exact**2)))


def tone(values: np.ndarray, scale: float) -> np.ndarray:
    return np.clip(np.maximum(values, 0) / scale, 0, 1) ** (1 / 2.2)


def displayed(values: np.ndarray, hit: np.ndarray, background: float) -> np.ndarray:
    picture = np.full((*hit.shape, 3), background)
    picture[hit] = values
    return picture


def amplification(missed: list[np.ndarray]) -> int:
    """The largest power of two by which at most 1 % of each picture's differences exceed 1."""
    most = max(float(np.quantile(one.max(axis=1), 0.99)) for one in missed)
    return 2 ** max(int(np.floor(-np.log2(max(most, 2.0**-10)))), 0)


def draw(views: list, estimates: np.ndarray, path: Path):
    """Three rows a view: images, what they miss, and that amplified."""
    figure, axes = plt.subplots(
        3 * len(views), len(ORDERS) + 1, figsize=(11.5, 12), layout="constrained"
    )
    curves = [partial(tone, scale=np.quantile(e.max(axis=1), 0.98)) for _, e, _ in views]
    # Of the pictures as they are displayed.
    missed = [
        [np.abs(curve(image) - curve(exact)) for image in images]
        for curve, (_, exact, images) in zip(curves, views)
    ]
    # P = 0 misses so much that a factor for it would leave the others black.
    factor = amplification([one for each in missed for one in each[DEMANDED_ORDER:]])
    for number, (curve, (hit, exact, images)) in enumerate(zip(curves, views)):
        above, middle, below = axes[3 * number : 3 * number + 3]
        above[0].imshow(displayed(curve(exact), hit, 1.0))
        above[0].set_ylabel(f"view {number + 1}")
        for place, text in ((middle[0], "difference"), (below[0], f"difference x {factor}")):
            place.text(0.5, 0.5, text, ha="center", transform=place.transAxes)
        for order, image in zip(ORDERS, images):
            above[order + 1].imshow(displayed(curve(image), hit, 1.0))
            middle[order + 1].imshow(displayed(missed[number][order], hit, 0.0))
            amplified = np.minimum(factor * missed[number][order], 1)
            below[order + 1].imshow(displayed(amplified, hit, 0.0))
            error = 100 * relative_rms(image, exact)
            middle[order + 1].set_title(f"{error:.1f} % rms", fontsize=9)
    axes[0, 0].set_title("exact")
    for order in ORDERS:
        axes[0, order + 1].set_title(f"P = {order}: {100 * (1 - estimates[order]):.1f} %")
    for place in axes.ravel():
        place.set(xticks=[], yticks=[])
        for side in place.spines.values():
            side.set_visible(False)
    figure.suptitle(
        f"T fig. 5.6: microfacet, sigma = {SIGMA}, energy of the BRDF held; differences below, "
        f"as displayed and x {factor}"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    print(f"picture: {path}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probe", type=Path)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_5_6.png"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if arguments.probe:
        light = read_environment(arguments.probe, arguments.convention, height=LIGHT_ROWS)
    else:
        light = probe("interior", 1, LIGHT_ROWS)
    lobe = FacetLobe(SIGMA)
    spectrum = central_spectrum(lobe, (BAND_LIMIT, ORDERS[-1]), *lobe.extent, weighted=True)
    missing = missing_energy(spectrum)[BAND_LIMIT]
    coefficients = light_coefficients(light, BAND_LIMIT)
    grid = LatLongGrid(MAP_ROWS, MAP_ROWS)
    maps = [local_shrm(coefficients, spectrum.cut((BAND_LIMIT, order)), grid) for order in ORDERS]
    views, errors = [], []
    for view in VIEWS:
        outgoing = towards(view)
        normals, hit = seen(outgoing)
        exact = integrated(light, normals, outgoing)
        images = [mapped(one, normals, outgoing) for one in maps]
        errors.append([relative_rms(image, exact) for image in images])
        views.append((hit, exact, images))
    print(f"F = {BAND_LIMIT}, S = {MAP_ROWS}; relative rms of the image against the integral")
    heads = "".join(f"{f'view {k + 1}':>9s}" for k in range(len(VIEWS)))
    print(f"  P  BRDF's eps  sqrt(eps){heads}")
    for order in ORDERS:
        line = f"{order:3d}{missing[order]:12.4f}{np.sqrt(missing[order]):11.4f}"
        line += "".join(f"{error[order]:9.4f}" for error in errors)
        conservative = all(error[order] <= np.sqrt(missing[order]) for error in errors)
        print(f"{line}  {'below the estimate' if conservative else 'ABOVE the estimate'}")
    print("eps is of all views together: one image may miss more, where it sees much of the limb")
    met = all(error[DEMANDED_ORDER] < DEMANDED for error in errors)
    falling = all(np.all(np.diff(error) < 0) for error in errors)
    print(f"demanded below {DEMANDED:.3f} at P = 2: {'met' if met else 'NOT met'}", end="; ")
    print(f"falling with P: {'met' if falling else 'NOT met'}")
    draw(views, missing, arguments.out)


if __name__ == "__main__":
    main()
