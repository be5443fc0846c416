"""Maps of glTF's material: base colour, roughness and metalness at every texel of a ball.

    python experiments/metal_maps.py [--rows 32] [--pixels 64] [--views 24] [--picture FILE]

Parts of the ball are gold and copper, worn at their edges, and the rest is plastic of many colours;
roughness varies apart from both.  Photographs are sums over all texels of a probe, and a lamp, of
glTF's own definition, (1 - m) dielectric + m metal, at what each pixel itself shows, with 1 %
noise.  Printed are the errors of unmarked texels (medians), the errors in units of those stated,
how well the stated errors tell the bad texels (area under the curve), and the ball relit by another
room and lamp.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import jax
import matplotlib.pyplot as plt
import numpy as np
from maps import BATCH, NOISE, area_under_curve, lit, of_texels, photographed, smooth
from scenes import unit

from jaxrender.brdf import MetallicRoughness
from jaxrender.geometry import Sphere, SurfaceSamples
from jaxrender.inverse import KnownLight, Observations, unknowns_of
from jaxrender.inverse.texture import MetallicSites, TextureSettings, recover_metallic
from jaxrender.reflection import integral_columns

KIND = MetallicRoughness(np.ones(3), np.ones(3), 0.3, 0.4)
GOLD, COPPER = np.array([1.0, 0.77, 0.34]), np.array([0.95, 0.64, 0.54])
# Texels are marked where standard errors are larger: of the colour and the roughness beside these.
COLOR, ROUGH, SHARE = 0.05, 0.15, 0.15
# Metal begins here, and is whole so much further.
BEYOND, WORN = 0.35, 0.1


class Truth(NamedTuple):
    """Numbers of the material at points of the ball."""

    color: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray


def truth_at(points: np.ndarray) -> Truth:
    """Evaluate what the ball is made of."""
    paints = np.stack([smooth(points, 8, 10 + channel) for channel in range(3)], axis=1)
    where = smooth(points, 3, 40)
    metallic = np.clip((np.abs(where) - BEYOND) / WORN, 0, 1)
    metal = np.where(where[:, None] > 0, GOLD, COPPER)
    plastic = np.clip(0.35 * np.exp(0.5 * paints), 0.03, 0.9)
    color = plastic + metallic[:, None] * (metal - plastic)
    alpha = np.clip(0.16 * np.exp(0.4 * smooth(points, 6, 21)), 0.07, 0.45)
    return Truth(color, np.sqrt(alpha), metallic)


@jax.jit
def _columns(normals, outgoing, widths, metallic, nodes):
    lobe = KIND.with_numbers({"metallic": metallic})
    return integral_columns(lobe, SurfaceSamples(normals, outgoing), nodes, widths=widths)


def radiance(
    truth: Truth, normals: np.ndarray, outgoing: np.ndarray, light: KnownLight
) -> np.ndarray:
    """Integrate over all of a light, some pixels at a time."""
    assert light.environment is not None
    parts = [light.environment.nodes(), light.directional.nodes()]
    found = []
    for first in range(0, len(outgoing), BATCH):
        rows = np.minimum(np.arange(first, first + BATCH), len(outgoing) - 1)
        values = np.zeros((BATCH, 3))
        for metallic, share in ((0.0, 1 - truth.metallic), (1.0, truth.metallic)):
            arrays = normals[rows], outgoing[rows], truth.roughness[rows] ** 2, metallic
            base, clear = np.moveaxis(sum(np.asarray(_columns(*arrays, n)) for n in parts), 1, 0)
            values += share[rows, None] * (truth.color[rows] * base + clear)
        found.append(values[: len(outgoing) - first])
    return np.concatenate(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--rows", type=int, default=32)
    parser.add_argument("--pixels", type=int, default=64)
    parser.add_argument("--views", type=int, default=24)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    image = options.rows, 2 * options.rows
    count = image[0] * image[1]
    seen = photographed(options.views, options.pixels, image)
    outgoing, normals = (np.asarray(part, float) for part in seen.samples[::-1])
    truth, light = truth_at(unit(np.asarray(seen.places.points, float))), lit(1)
    start = time.perf_counter()
    exact = radiance(truth, normals, outgoing, light)
    print(f"{len(exact)} pixels, {count} texels; integrated in {time.perf_counter() - start:.0f} s")
    observations = Observations(
        seen.samples,
        NOISE.add(exact, np.random.default_rng(0)),
        seen.frame,
        seen.places,
        pixel=seen.pixel,
        eyes=seen.eyes,
    )
    settings = TextureSettings(maps=("roughness", "metalness"))
    start = time.perf_counter()
    fit = recover_metallic(
        observations, seen.site, count, light, KIND, unknowns_of(KIND), settings, Sphere()
    )
    print(f"fitted in {time.perf_counter() - start:.0f} s: noise {fit.noise}")
    true = Truth(*(of_texels(part, seen.site, count) for part in truth))
    report(fit, true)
    rows = np.flatnonzero(seen.frame % 4 == 0)
    again(fit, truth, true, seen.site, normals, outgoing, rows)
    if options.picture:
        draw(fit, true, image, options.picture)


def report(fit: MetallicSites, true: Truth) -> None:
    """Compare with the truth, texel by texel."""
    usable = fit.seen > 0

    def line(name: str, error: np.ndarray, stated: np.ndarray, trusted: np.ndarray, bad: float):
        known = usable & np.isfinite(stated)
        good = known & (stated <= trusted)
        z = error[known] / stated[known]
        area = area_under_curve(stated[known], error[known] > bad)
        print(
            f"{name:10s} unmarked {good.sum():5d} of {usable.sum()}: median error "
            f"{np.median(error[good]):.4f}, stated {np.median(stated[good]):.4f}; in units of the "
            f"stated: 68 % below {np.quantile(z, 0.683):.2f}, 90 % below "
            f"{np.quantile(z, 0.9):.2f}; bad ones ({np.mean(error[known] > bad):.1%}) told: "
            f"{area:.2f}"
        )

    color, error = fit.base_color, fit.color_error
    off = np.abs(color / true.color - 1).mean(axis=1)
    line("colour", off, np.max(error / np.maximum(color, 1e-6), axis=1), COLOR, 0.05)
    value, error = fit.numbers["roughness"]
    line("roughness", np.abs(np.log(value / true.roughness)), error / value, ROUGH, 0.15)
    value, error = fit.numbers["metallic"]
    off = np.abs(value - true.metallic)
    line("metalness", off, error, SHARE, 0.1)
    whole = usable & (error <= SHARE)
    for name, own in (
        ("plastic", true.metallic == 0),
        ("metal", true.metallic == 1),
        ("worn", (true.metallic > 0) & (true.metallic < 1)),
    ):
        part = off[whole & own]
        print(
            f"  {name:8s} {part.size:5d} texels: median {np.median(part):.4f}, "
            f"90 % within {np.quantile(part, 0.9):.4f}"
        )


def marked(fit: MetallicSites) -> np.ndarray:
    """Say where a number is not to be trusted."""
    (rough, error), (_, share) = fit.numbers["roughness"], fit.numbers["metallic"]
    bad = (error > ROUGH * rough) | (share > SHARE)
    return bad | np.any(fit.color_error > COLOR * fit.base_color, axis=1)


def again(fit, truth: Truth, true: Truth, site, normals, outgoing, rows) -> None:
    """Relight the ball in one photograph of every four, by a room and a lamp of another seed.

    The same by the true numbers of texels is what texels of this size can do.
    """
    light, own = lit(2), site[rows]
    found = Truth(fit.base_color, fit.number("roughness"), fit.number("metallic"))

    def relit(what: Truth, at: np.ndarray) -> np.ndarray:
        return radiance(Truth(*(part[at] for part in what)), normals[rows], outgoing[rows], light)

    exact, sure = relit(truth, rows), ~marked(fit)[own]
    for name, what in (("found", found), ("true texels", true)):
        off = relit(what, own) - exact
        for pixels, kept in (("all pixels", own >= 0), ("unmarked texels", sure)):
            rms = np.sqrt(np.mean(off[kept] ** 2) / np.mean(exact[kept] ** 2))
            typical = np.median(np.abs(off / exact)[kept])
            print(
                f"relit by another room and lamp, {name}, {pixels}: {100 * rms:.1f} % rms, "
                f"{100 * typical:.1f} % median"
            )


def draw(fit: MetallicSites, true: Truth, image: tuple[int, int], file: Path) -> None:
    """Show the maps beside the truth, and the errors that are stated."""
    unseen = fit.seen == 0
    rough, metal = fit.numbers["roughness"], fit.numbers["metallic"]
    rows = (
        ("base colour", true.color, fit.base_color, fit.color_error.max(axis=1), None),
        ("roughness", true.roughness, *rough, (0.2, 0.7)),
        ("metalness", true.metallic, *metal, (0, 1)),
    )
    figure, axes = plt.subplots(len(rows), 3, figsize=(11, 6.2), layout="constrained")
    for line, (name, was, found, error, span) in zip(axes, rows):
        for panel, values, title in zip(line, (was, found, error), ("true", "found", "error")):
            shown = np.where(unseen.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)
            shown = shown.reshape(*image, *values.shape[1:])
            if shown.ndim == 3:
                panel.imshow(np.clip(np.nan_to_num(shown, nan=1.0), 0, 1) ** (1 / 2.2))
            else:
                low, top = (0, np.nanquantile(shown, 0.95)) if title == "error" else span
                figure.colorbar(panel.imshow(shown, vmin=low, vmax=top), ax=panel, shrink=0.7)
            panel.set_title(f"{name}, {title}", fontsize=9)
            panel.set_axis_off()
    figure.savefig(file, dpi=90)


if __name__ == "__main__":
    main()
