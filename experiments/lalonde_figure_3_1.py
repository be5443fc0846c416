"""L fig. 3.1: a measured BRDF shaded by the four reconstructions of its table.

    python experiments/lalonde_figure_3_1.py [--out FOLDER] [--size 300] [--samples 512]

A sphere and a vase of the sawtooth of fig. 3.2 under one source, from the table that the virtual
gonioreflectometer makes of it: 15 polar angles by 30 azimuths for either direction, as in the
figure.  The third row is the sphere's slope, where Mach bands are plain.  The thesis prints no
numbers, only what is seen: piecewise constant has facets, quadrilinear has visible artefacts where
slopes break, the interpolating cubic oscillates, the B-spline is smooth.

Printed are the rms errors of the radiance at some pixels of the sphere, for which the very pairs of
directions are measured too; the same for an analytic sawtooth without light from facet to facet,
whose tables have no noise; and how much the largest second difference along rows shrinks in a
picture of twice the size, where the analytic BRDF is smooth: 4 where slopes are continuous, 2
where they break, 1 where values do.  Draws ``lalonde_figure_3_1.png``.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from lalonde_micro_geometry import describe, measured, measured_brdf, meter

from jaxrender.brdf import BRDF
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.tables.reconstruction import RECONSTRUCTIONS
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.geometry import POLAR
from jaxrender.reflection.tracing import MeasureSettings

OUT = Path(__file__).parent / "out"
SIZE = (15, 30, 15, 30)
SOURCE = np.array([-0.55, -0.6, 0.55]) / np.linalg.norm([-0.55, -0.6, 0.55])
VIEW = np.array([0.0, -1.0, 0.0])
# Pixels whose own pairs of directions are measured, and paths for each.
PIXELS, PIXEL_PATHS = 400, 4096

evaluate = eqx.filter_jit(BRDF.evaluate)


class Sawtooth(BRDF):
    """A ridged surface of Lambertian facets (+-slope, 0, 1), light that bounces once.

    From a direction of steepness m = |z / x| below the slope s, the facet that faces it is seen
    from the ridge down over 2 m / (s + m) of its width, the other not at all; of what is lit and
    what is seen, both from the ridge down, the smaller is both.
    """

    albedo: np.ndarray  # [facet, channel]
    slope: float = 1.2

    amplitudes = np.eye(3)
    reciprocal = conserves_energy = True
    isotropic = False

    def transfer(self, incoming, outgoing):
        """Sum over the facets, for each channel."""
        visible, pair = are_visible(incoming, outgoing), (lifted(incoming), lifted(outgoing))
        seen = jnp.minimum(*(self.share(w) for w in pair))
        facets = []
        for sign in (-1, 1):
            facing = [jnp.maximum(w.z + sign * self.slope * w.x, 0) for w in pair]
            length = np.sqrt(1 + self.slope**2)
            facets.append(facing[0] * facing[1] * seen / (2 * np.pi * length * pair[1].z))
        return tuple(
            jnp.where(visible, facets[0] * red + facets[1] * blue, 0) for red, blue in self.albedo.T
        )

    def share(self, w):
        """How much of the facet that faces a direction is not hidden by the next ridge."""
        across = jnp.maximum(jnp.abs(w.x), 1e-9)
        return jnp.minimum(2 * w.z / (self.slope * across + w.z), 1)


SAWTOOTH = Sawtooth(np.array([[0.9, 0.25, 0.15], [0.2, 0.35, 0.9]]))


def sphere(x, z):
    """Normals of a sphere seen along +Y, and where it is."""
    square = x**2 + z**2
    return np.stack([x, -np.sqrt(np.maximum(1 - square, 0)), z], axis=-1), square < 0.998


def vase(x, z):
    """The same of a vase: a radius that swells and narrows with height."""
    radius = 0.52 + 0.26 * np.sin(3.2 * z - 1.2) + 0.08 * np.sin(7 * z)
    slope = 0.26 * 3.2 * np.cos(3.2 * z - 1.2) + 0.08 * 7 * np.cos(7 * z)
    across = np.clip(x / radius, -1, 1)
    normals = np.stack([across, -np.sqrt(1 - across**2), -slope], axis=-1)
    on = (np.abs(x) < 0.998 * radius) & (np.abs(z) < 0.95)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True), on


class Lit(NamedTuple):
    """The pixels that a shape covers: local directions of the source and the viewer."""

    on: np.ndarray
    source: np.ndarray
    view: np.ndarray

    @classmethod
    def of(cls, shape, size: int) -> "Lit":
        """Tangents are horizontal."""
        line = (np.arange(size) + 0.5) / size * 2 - 1
        x, z = np.meshgrid(line, -line)
        normals, on = shape(x, z)
        tangents = np.cross([0.0, 0.0, 1.0], normals)
        tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
        frame = np.stack([tangents, np.cross(normals, tangents), normals], axis=-2)[on]
        return cls(on, frame @ SOURCE, frame @ VIEW)


def picture(brdf: BRDF, shape, size: int) -> np.ndarray:
    """Shade a shape by a source of irradiance pi."""
    lit = Lit.of(shape, size)
    image = np.zeros((size, size, 3))
    image[lit.on] = np.pi * evaluate(brdf, lit.source, lit.view) * np.maximum(lit.source[:, 2:], 0)
    return image


def pixel_errors(tables: dict[str, TabulatedBRDF], size: int) -> dict[str, float]:
    """Relative rms errors of rho cos t_i at some pixels of the sphere, and the reference's own."""
    lit = Lit.of(sphere, size)
    rng = np.random.default_rng(0)
    above = np.flatnonzero((lit.source[:, 2] > 0) & (lit.view[:, 2] > 0))
    row = rng.choice(above, PIXELS, replace=False)
    source, view, bench = lit.source[row], lit.view[row], meter("sawtooth")
    settings = MeasureSettings(samples=PIXEL_PATHS)
    found = [bench.pairs(i[None], o, settings, rng) for i, o in zip(source, view, strict=True)]
    truth, noise = (np.concatenate(part) * source[:, 2:] for part in zip(*found, strict=True))
    whole = np.sqrt(np.mean(truth**2))
    errors = {
        name: float(
            np.sqrt(np.mean((evaluate(t, source, view) * source[:, 2:] - truth) ** 2)) / whole
        )
        for name, t in tables.items()
    }
    return {**errors, "measured itself": float(np.sqrt(np.mean(noise**2)) / whole)}


def bend(image: np.ndarray) -> float:
    """The largest second difference along rows where the sphere is lit and its BRDF is smooth."""
    size = len(image)
    inside = slice(size // 3, 2 * size // 3), slice(11 * size // 20, 13 * size // 20)
    return np.abs(np.diff(image[inside].mean(axis=-1), 2, axis=1)).max()


def draw(pictures: dict[str, list[np.ndarray]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, len(pictures), figsize=(3 * len(pictures), 9.2))
    for column, (name, images) in zip(axes.T, pictures.items(), strict=True):
        for axis, image in zip(column[:2], images, strict=True):
            axis.imshow(np.clip(1.6 * image, 0, 1) ** (1 / 2.2))
        slope = np.hypot(*np.gradient(images[0].mean(axis=-1))) * len(images[0])
        column[2].imshow(np.clip(slope, 0, 3), cmap="magma")
        column[0].set_title(name)
    for axis in axes.flat:
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--size", type=int, default=300)
    parser.add_argument("--samples", type=int, default=512)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    print(describe(measured("sawtooth", SIZE, POLAR, options.samples)))
    tables = {
        name: measured_brdf("sawtooth", SIZE, POLAR, options.samples, name)
        for name in RECONSTRUCTIONS
    }
    pixels = pixel_errors(tables, options.size)
    truth = picture(SAWTOOTH, sphere, options.size)
    print("reconstruction    measured: rms error   analytic: rms error   bend shrinks by")
    for name in RECONSTRUCTIONS:
        analytic = TabulatedBRDF.of(SAWTOOTH, SIZE, POLAR, name)
        ball = picture(analytic, sphere, options.size)
        error = np.sqrt(np.mean((ball - truth) ** 2) / np.mean(truth**2))
        finer = picture(analytic, sphere, 2 * options.size)
        print(f"{name:16s} {pixels[name]:20.4f} {error:21.4f} {bend(ball) / bend(finer):17.2f}")
    print(f"{'measured itself':16s} {pixels['measured itself']:20.4f}")
    pictures = {
        name: [picture(table, shape, options.size) for shape in (sphere, vase)]
        for name, table in tables.items()
    }
    draw(pictures, options.out / "lalonde_figure_3_1.png")


if __name__ == "__main__":
    main()
