"""T figure 5.8: reflection maps beside Kautz and McCool's, which know no azimuth of the viewer.

    python experiments/figure_5_8.py [--probe FILE.hdr] [--convention cross] [--paint FILE.brdf]
        [--out F.png]

Kautz and McCool's three-dimensional texture B(R, t'_o) is the terms q = 0 alone, here of the same
local map to (F, P) = (30, 5), at 64 angles.  The thesis shows the velvet of CURET; here a velvet of
Lafortune lobes, which reflects forwards and backwards at grazing, a measured paint where its file
is given, and for comparison the microfacet of T 5.34, whose lobe is nearly round.  The correct
image is the integral over every texel of the light above each pixel's horizon, by the BRDF itself.

Prints the relative rms of each over the sphere's pixels, by exit cosine.  The thesis has no number:
its approximation "introduces large errors, while the SHRM with P_B = 5 is accurate".  Demanded: the
SHRM nearer wherever the azimuth matters.  Differences are of the pictures as displayed, shown as
they are and multiplied by the factor that stands above them.
"""

import argparse
import itertools
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from figure_5_1 import LEAST_COSINE, Frames, integrated, light_from, mapped, relative_rms, seen
from figure_5_6 import amplification
from shrm_materials import Material, microfacet, paint, velvet

from jaxrender.geometry import Sphere
from jaxrender.imaging.display import exposed
from jaxrender.lighting import LightNodes
from jaxrender.reflection.shrm import AzimuthalTexture, exit_cosine
from jaxrender.spectra import missing_energy

LIMITS, ANGLES = (30, 5), 64
SIZE, VIEW, WHITE = 96, (-60, 15), 0.9
# Edges of the exit cosine.
EDGES = (0.0, 0.3, 0.6, 1.0)


class Comparison(NamedTuple):
    """One material's correct image and two approximations of it, pixels of the object."""

    name: str
    frames: Frames
    exact: np.ndarray
    images: tuple[np.ndarray, np.ndarray]


def as_shown(material: Material, values, frames: Frames) -> np.ndarray:
    """What an approximation shows: near grazing exit divided by no less than a given cosine."""
    cosines = exit_cosine(frames.centres, frames.samples.outgoing)[:, None]
    if material.spectrum.weighted:
        divisor = jnp.maximum(cosines, LEAST_COSINE) if material.divided else 1
        values = values * cosines / divisor
    return np.asarray(jnp.maximum(values, 0))


def compared(name: str, material: Material, light) -> Comparison:
    """Render the sphere three ways."""
    frames = seen(Sphere(np.zeros(3), 1.0), VIEW, size=SIZE)
    nodes = LightNodes(*(jnp.asarray(a, jnp.float32) for a in light.nodes()))
    exact = np.asarray(integrated(material, frames, nodes))
    local, _ = mapped(light, material.spectrum)
    textures = AzimuthalTexture.of(local, ANGLES)
    places = frames.centres, frames.samples.outgoing
    images = tuple(as_shown(material, one.at(*places), frames) for one in (local, textures))
    return Comparison(name, frames, exact, images)


def print_table(rows: list[Comparison], names: tuple[str, str]):
    """Relative rms of both, of all pixels and by exit cosine."""
    bands = list(itertools.pairwise(EDGES))
    heads = "".join(f"{f'{low:g} to {high:g}':>12s}" for low, high in bands)
    print(f"\n{'relative rms, per cent':44s}{'all':>8s}{heads}   (exit cosine)")
    for row in rows:
        cosines = np.asarray(row.frames.samples.exit_cosines)
        for name, image in zip(names, row.images):
            line = f"{100 * relative_rms(image, row.exact):8.1f}"
            for low, high in bands:
                inside = (cosines >= low) & (cosines < high)
                line += f"{100 * relative_rms(image[inside], row.exact[inside]):12.1f}"
            print(f"{row.name:22s}{name:22s}{line}")


def draw(rows: list[Comparison], names: tuple[str, str], title: str, path: Path):
    """The correct image, and each approximation with what it misses, as it is and amplified."""
    figure, axes = plt.subplots(
        len(rows), 7, squeeze=False, figsize=(15, 2.4 * len(rows) + 0.6), layout="constrained"
    )
    # So that highlights are not all white: what both miss in them is to be seen.
    exposures = [WHITE / np.percentile(row.exact.max(axis=1), 99) for row in rows]
    codes = [
        [exposed(image[None], exposure)[0].astype(int) for image in (row.exact, *row.images)]
        for row, exposure in zip(rows, exposures)
    ]
    missed = [[np.abs(one - exact) for one in both] for exact, *both in codes]
    factor = amplification([np.abs(own) / 255 for own, _ in missed])
    for places, row, (exact, *both), apart in zip(axes, rows, codes, missed):
        places[0].imshow(displayed(exact, row.frames, 255))
        places[0].set_ylabel(row.name)
        for first, image, code, off in zip((1, 4), row.images, both, apart):
            places[first].imshow(displayed(code, row.frames, 255))
            places[first].set_xlabel(
                f"{100 * relative_rms(image, row.exact):.1f} % rms", fontsize=9
            )
            places[first + 1].imshow(displayed(off, row.frames, 0))
            places[first + 2].imshow(displayed(np.minimum(factor * off, 255), row.frames, 0))
    apart = "difference", f"difference x {factor}"
    for place, head in zip(axes[0], ("correct", names[0], *apart, names[1], *apart)):
        place.set_title(head, fontsize=10)
    for place in axes.ravel():
        place.set(xticks=[], yticks=[])
        for side in place.spines.values():
            side.set_visible(False)
    figure.suptitle(title)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    print(f"picture: {path}")


def displayed(codes: np.ndarray, frames: Frames, background: int) -> np.ndarray:
    found = np.full((*frames.view.hit.shape, 3), background, np.uint8)
    found[frames.view.hit] = codes
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probe", type=Path)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--paint", type=Path)
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_5_8.png"))
    arguments = parser.parse_args()
    light = light_from(arguments.probe, arguments.convention)
    materials = {"velvet": velvet(LIMITS), "microfacet": microfacet(LIMITS)}
    if arguments.paint:
        materials[arguments.paint.stem.replace("_", " ")] = paint(arguments.paint, LIMITS)
    for name, material in materials.items():
        missed = missing_energy(material.spectrum)[-1, -1]
        print(f"{name}: (F, P) = {LIMITS} miss {100 * missed:.1f} % of the BRDF's energy")
    rows = [compared(name, material, light) for name, material in materials.items()]
    names = f"SHRM, P = {LIMITS[1]}", "Kautz and McCool"
    print_table(rows, names)
    nearer = all(
        relative_rms(one.images[0], one.exact) < relative_rms(one.images[1], one.exact)
        for one in rows
    )
    verdict = "met" if nearer else "NOT met"
    print(f"published: q = 0 large errors, SHRM accurate; SHRM nearer for each: {verdict}")
    draw(rows, names, "T fig. 5.8: the azimuth of the viewer kept and left out", arguments.out)


if __name__ == "__main__":
    main()
