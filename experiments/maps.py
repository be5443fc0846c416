"""Maps of everything: colour, specular reflectance, roughness and normal at every texel of a ball.

    python experiments/maps.py [--rows 32] [--pixels 72] [--views 24] [--alike]
        [--picture FILE]

All four vary smoothly and apart from each other.  Photographs are sums over all texels of a probe,
and a lamp, at what each pixel itself shows, with 1 % noise.  Printed are the errors of unmarked
texels (medians), the errors in units of those stated, how well the stated errors tell the bad
texels (area under the curve), and the ball relit by another light.  ``--alike`` fits the same
photographs with one sigma and the normals of the shape.  Metals are in
``metal_maps.py``.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scenes import probe, unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Pinhole, Sphere, SurfacePlaces, SurfaceSamples, look_at, observe
from jaxrender.geometry.texels import surface_sites
from jaxrender.harmonics import real_basis
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import KnownLight, Observations, unknowns_of
from jaxrender.inverse.texture import (
    MAPS,
    TextureFit,
    TextureSettings,
    recover_texture,
)
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.reflection import integral_columns

NOISE, DISTANCE, LOWEST_COSINE, MU, LIGHT_ROWS = NoiseModel(0.01, 2e-4), 5.0, 0.2, 1.5, 128
KIND = Microfacet(np.ones(3), np.ones(3), 0.16, MU, "half", "smith")
# Pixels at once.
BATCH = 2048
STEP = 1e-4


class Truth(NamedTuple):
    """Numbers of the material at points of the ball, and its normals there."""

    kd: np.ndarray
    ks: np.ndarray
    sigma: np.ndarray
    normals: np.ndarray


def smooth(directions: np.ndarray, degree: int, seed: int) -> np.ndarray:
    """Make a random function of degrees up to one, of variance one."""
    rng = np.random.default_rng(seed)
    count = (degree + 1) ** 2
    basis = np.asarray(real_basis(jnp.asarray(directions), degree))
    return basis[:, 1:] @ rng.normal(size=count - 1) * np.sqrt(4 * np.pi / (count - 1))


def truth_at(points: np.ndarray) -> Truth:
    """Evaluate what the ball is made of."""
    colours = np.stack([smooth(points, 8, 10 + channel) for channel in range(3)], axis=1)
    height = smooth(points, 10, 30)
    slopes = [(smooth(unit(points + STEP * axis), 10, 30) - height) / STEP for axis in np.eye(3)]
    slope = np.stack(slopes, axis=1)
    normals = unit(points - 0.008 * (slope - np.sum(slope * points, axis=1)[:, None] * points))
    kd, ks = 0.15 * np.exp(0.4 * colours), 0.08 * np.exp(0.3 * smooth(points, 6, 20))
    ks = np.repeat(ks[:, None], 3, axis=1)
    return Truth(
        kd,
        ks,
        np.clip(0.16 * np.exp(0.4 * smooth(points, 6, 21)), 0.07, 0.45),
        normals,
    )


@jax.jit
def _columns(normals, outgoing, widths, nodes):
    return integral_columns(KIND, SurfaceSamples(normals, outgoing), nodes, widths=widths)


def radiance(truth: Truth, outgoing: np.ndarray, light: KnownLight) -> np.ndarray:
    """Integrate over all of a light, some pixels at a time."""
    assert light.environment is not None
    parts = [light.environment.nodes(), light.directional.nodes()]
    found = []
    for first in range(0, len(outgoing), BATCH):
        rows = np.minimum(np.arange(first, first + BATCH), len(outgoing) - 1)
        arrays = truth.normals[rows], outgoing[rows], truth.sigma[rows]
        columns = sum(np.asarray(_columns(*arrays, nodes)) for nodes in parts)
        values = truth.kd[rows] * columns[:, 0] + truth.ks[rows] * columns[:, 1]
        found.append(values[: len(outgoing) - first])
    return np.concatenate(found)


def lit(seed: int) -> KnownLight:
    """Make a room with a lamp, of radiances of order one."""
    room = np.asarray(probe("interior", seed, LIGHT_ROWS).radiance)
    rng = np.random.default_rng(seed)
    towards = unit(rng.normal(size=(1, 3)) + np.array([0, 0, 1.0]))
    lamp = DirectionalSources(towards, np.array([[2.0, 1.8, 1.6]]))
    return KnownLight(Environment(room / room.mean()), lamp)


class Seen(NamedTuple):
    """All pixels that are used: what they show, and the texel of each."""

    samples: SurfaceSamples
    places: SurfacePlaces
    frame: np.ndarray
    pixel: np.ndarray
    site: np.ndarray
    eyes: np.ndarray


def photographed(count: int, pixels: int, image: tuple[int, int]) -> Seen:
    """Look at the ball from all sides."""
    golden = np.pi * (3 - np.sqrt(5))
    parts, eyes = [], []
    for number in range(count):
        z = 0.9 * (1 - 2 * (number + 0.5) / count)
        level, azimuth = np.sqrt(1 - z**2), golden * number
        place = DISTANCE * np.array([level * np.cos(azimuth), level * np.sin(azimuth), z])
        pose = look_at(place, np.zeros(3), np.array([0.0, 0, 1]))
        view = observe(
            Pinhole(pixels, pixels, pose, fl_x=0.95 * pixels / 2 * np.sqrt(DISTANCE**2 - 1)),
            Sphere(),
        )
        used = view.exit_cosines > LOWEST_COSINE
        rows, columns = np.nonzero(used)
        site = surface_sites(Sphere(), view, image).of_pixel[used]
        every = (view.normals, view.outgoing, view.points, view.geometric_normals)
        frame = np.full(len(rows), number)
        parts.append((*(part[used] for part in every), frame, np.stack([rows, columns], 1), site))
        eyes.append(place)
    normals, outgoing, points, facing, frame, pixel, site = map(np.concatenate, zip(*parts))
    samples, places = SurfaceSamples(normals, outgoing), SurfacePlaces(points, facing)
    return Seen(samples, places, frame, pixel, site, np.stack(eyes))


def of_texels(values: np.ndarray, site: np.ndarray, count: int) -> np.ndarray:
    """Average over the pixels that show each texel; NaN where there are none."""
    flat = values.reshape(len(values), -1)
    sums = np.stack([np.bincount(site, column, minlength=count) for column in flat.T], axis=1)
    with np.errstate(invalid="ignore"):
        means = sums / np.bincount(site, minlength=count)[:, None]
    return means.reshape(count, *values.shape[1:])


def area_under_curve(stated: np.ndarray, bad: np.ndarray) -> float:
    """Say how often a bad texel has a larger stated error than a good one."""
    order = np.argsort(np.argsort(stated))
    many = np.count_nonzero(bad)
    few = len(bad) - many
    return float((order[bad].sum() - many * (many - 1) / 2) / max(many * few, 1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--rows", type=int, default=32)
    parser.add_argument("--pixels", type=int, default=72)
    parser.add_argument("--views", type=int, default=24)
    parser.add_argument("--alike", action="store_true")
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    image = options.rows, 2 * options.rows
    count = image[0] * image[1]
    seen = photographed(options.views, options.pixels, image)
    outgoing, shape_normals = (np.asarray(part, float) for part in seen.samples[::-1])
    points = np.asarray(seen.places.points, float)
    truth, light = truth_at(unit(points)), lit(1)
    values = NOISE.add(radiance(truth, outgoing, light), np.random.default_rng(0))
    observations = Observations(
        seen.samples, values, seen.frame, seen.places, pixel=seen.pixel, eyes=seen.eyes
    )
    settings = TextureSettings(maps=() if options.alike else tuple(MAPS))
    print(f"{len(values)} pixels, {count} texels")
    start = time.perf_counter()
    fit = recover_texture(
        observations,
        seen.site,
        count,
        light,
        KIND,
        unknowns=unknowns_of(KIND),
        settings=settings,
        shape=Sphere(),
    )
    print(f"fitted in {time.perf_counter() - start:.0f} s: {fit.outcome}, noise {fit.noise}")
    print(f"mu {fit.mu:.4f} +- {fit.mu_error:.4f}, true {MU}")
    report(fit, truth, seen, shape_normals)
    again(fit, truth, seen, shape_normals, lit(2))
    if options.picture:
        draw(fit, truth, seen, image, options.picture)


def report(fit: TextureFit, truth: Truth, seen: Seen, shape_normals: np.ndarray) -> None:
    """Compare with the truth, texel by texel."""
    count, texture = len(fit.texture.kd), fit.texture
    true = Truth(*(of_texels(part, seen.site, count) for part in truth))
    usable = texture.seen > 0

    def line(name: str, error: np.ndarray, stated: np.ndarray, marked: np.ndarray, bad: float):
        good = usable & ~marked & np.isfinite(stated)
        known = usable & np.isfinite(stated)
        z = np.abs(error / stated)
        area = area_under_curve(stated[known], error[known] > bad)
        print(
            f"{name:10s} unmarked {good.sum():5d} of {usable.sum()}: median error "
            f"{np.median(error[good]):.4f}, stated {np.median(stated[good]):.4f}; "
            f"in units of the stated: 68 % below {np.quantile(z[known], 0.683):.2f}, 90 % below "
            f"{np.quantile(z[known], 0.9):.2f}; bad ones told: {area:.2f}"
        )

    line(
        "colour",
        np.abs(texture.kd / true.kd - 1).mean(axis=1),
        (texture.kd_error / np.maximum(texture.kd, 1e-6)).mean(axis=1),
        texture.kd_marked,
        0.05,
    )
    was = true.ks.mean(axis=1)
    ks_error = texture.ks_error / was
    line("specular", np.abs(texture.ks / was - 1), ks_error, texture.ks_marked, 0.2)
    sigma, normals = fit.variation, fit.lobe.normals
    if sigma is None or normals is None:
        off = np.abs(fit.sigma / true.sigma - 1)
        print(f"one sigma {fit.sigma:.3f}: {np.median(off[usable]):.3f} off in the median")
        return
    off = np.abs(np.log(sigma.sigma / true.sigma))
    line("roughness", off, sigma.error / sigma.sigma, sigma.marked, 0.15)
    mean = of_texels(shape_normals, seen.site, count)
    offset = true.normals / np.sum(true.normals * mean, axis=1)[:, None]
    offset = offset - mean / np.sum(mean**2, axis=1)[:, None]
    away = np.degrees(np.linalg.norm(normals.offset - offset, axis=1))
    # Two axes.
    stated = np.degrees(normals.error) * np.sqrt(2)
    line("normal, deg", away, stated, normals.marked, 2.0)
    print(
        f"normals planted: {np.median(np.degrees(np.linalg.norm(offset, axis=1)[usable])):.1f} deg"
    )


def found_at(fit: TextureFit, seen: Seen, shape_normals: np.ndarray) -> Truth:
    """Look up what was found at every pixel."""
    site, texture = seen.site, fit.texture
    sigma = np.full(len(texture.ks), fit.sigma) if fit.variation is None else fit.variation.sigma
    normals = fit.lobe.normals
    tilted = shape_normals if normals is None else normals.tilted(shape_normals, site)
    ks = texture.ks.reshape(len(texture.ks), -1) * np.ones(3)
    return Truth(texture.kd[site], ks[site], sigma[site], tilted)


def again(
    fit: TextureFit, truth: Truth, seen: Seen, shape_normals: np.ndarray, light: KnownLight
) -> None:
    """Relight the ball in one photograph of every four."""
    rows = np.flatnonzero(seen.frame % 4 == 0)
    outgoing = np.asarray(seen.samples.outgoing, float)[rows]

    def relit(what: Truth) -> np.ndarray:
        some = Truth(*(part[rows] for part in what))
        return radiance(some, outgoing, light)

    true, found = relit(truth), relit(found_at(fit, seen, shape_normals))
    rms = np.sqrt(np.mean((found - true) ** 2) / np.mean(true**2))
    typical = np.median(np.abs(found / true - 1))
    print(f"relit by another room and lamp: {100 * rms:.1f} % rms, {100 * typical:.1f} % median")


def draw(fit: TextureFit, truth: Truth, seen: Seen, image: tuple[int, int], file: Path) -> None:
    """Show the maps beside the truth, and the errors that are stated."""
    count = image[0] * image[1]
    true = Truth(*(of_texels(part, seen.site, count) for part in truth))
    sigma, normals = fit.variation, fit.lobe.normals
    assert sigma is not None
    assert normals is not None
    unseen = fit.texture.seen == 0

    def laid(values: np.ndarray) -> np.ndarray:
        values = np.where(unseen.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)
        return values.reshape(*image, *values.shape[1:])

    rows = (
        ("K_d", true.kd / 0.5, fit.texture.kd / 0.5, fit.texture.kd_error.mean(axis=1), None),
        ("K_s", true.ks.mean(axis=1), fit.texture.ks, fit.texture.ks_error, (0, 0.16)),
        ("sigma", true.sigma, sigma.sigma, sigma.error, (0.05, 0.4)),
        ("normal", (1 + unit(true.normals)) / 2, (1 + normals.normal) / 2, normals.error, None),
    )
    figure, axes = plt.subplots(len(rows), 3, figsize=(11, 8), layout="constrained")
    for line, (name, was, found, error, span) in zip(axes, rows):
        for panel, values, title in zip(line, (was, found, error), ("true", "found", "error")):
            shown = laid(values)
            if shown.ndim == 3:
                panel.imshow(np.clip(np.nan_to_num(shown, nan=1.0), 0, 1))
            else:
                top = np.nanquantile(shown, 0.95) if title == "error" or span is None else span[1]
                low = 0 if title == "error" or span is None else span[0]
                drawn = panel.imshow(shown, vmin=low, vmax=top)
                figure.colorbar(drawn, ax=panel, shrink=0.7)
            panel.set_title(f"{name}, {title}", fontsize=9)
            panel.set_axis_off()
    figure.savefig(file, dpi=90)


if __name__ == "__main__":
    main()
