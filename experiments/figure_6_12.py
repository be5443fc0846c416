"""T fig. 6.12 in other words: a textured object from photographs under known complex light.

    python experiments/figure_6_12.py [--full] [--out F.png]

A glossy ball wrapped in a procedural texture (K_d in colour, K_s from a fifth to twice its mean),
under an area light, a glow and a source, seen from 12 views.  Photographs are the exact integral of
the continuous light with 1 % noise.  The fit is given photographs, cameras, shape and light (as an
image and sources), nothing else.  Quick: 40 x 20 texels, each of one paint.  ``--full``: 512 x 512,
a million observations, and paint that varies within texels, too.

Demanded: K_d error under 2 % rms where confidence is high; the marked texels are the bad ones (area
under the curve of the predicted relative error, for true errors above 5 %, over .9).
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scenes import unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Orthographic, Sphere, SurfaceSamples, look_at, observe
from jaxrender.geometry.texels import sphere_coordinates, texel_coordinates, texel_sites
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.texture import (
    TextureFit,
    TextureSettings,
    dilated,
    image_of_sites,
    recover_texture,
)
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.pipelines.report.display import tone_key, tone_mapped
from jaxrender.reflection import integral_columns, polar_columns

SIGMA, MU, VIEWS = 0.15, 1.6, 12
NOISE = NoiseModel(0.01, 0.0)
LIGHT = SmoothLobes(
    unit(np.array([[0.9, 0.5, 0.4], [0.0, 0.0, 1.0], [-0.5, -0.8, -0.3]])),
    np.radians([30.0, 60.0, 60.0]),
    np.array([[2.0, 1.9, 1.8], [0.5, 0.55, 0.65], [0.5, 0.45, 0.4]]),
)
SOURCES = DirectionalSources(
    np.array([[-0.35, 0.8, 0.5], [0.6, -0.7, 0.4]]), np.array([[0.5, 0.48, 0.45], [0.3, 0.3, 0.3]])
)
LOWEST_COSINE = 0.2


class Scene(NamedTuple):
    """Photographs and the truth behind them."""

    observations: Observations
    site: np.ndarray
    kd: np.ndarray
    ks: np.ndarray
    views: list
    photograph: np.ndarray


def paint(coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """K_d and K_s at texture coordinates: checks, waves and spots."""
    u, v = 2 * np.pi * coordinates[:, 0], np.pi * coordinates[:, 1]
    checks = np.tanh(6 * np.sin(4 * u) * np.sin(5 * v))
    waves = np.sin(3 * u + 2 * np.sin(3 * v))
    spots = np.exp(-((np.sin(3 * u + 1) ** 2 + np.cos(4 * v) ** 2) / 0.3))
    base = np.stack([0.12 + 0.06 * checks, 0.1 + 0.05 * waves, 0.1 - 0.05 * checks * waves], -1)
    kd = np.clip(base + 0.1 * spots[:, None] * np.array([1.0, 0.6, 0.2]), 0.01, None)
    return kd, 0.15 * np.exp(0.5 * waves + 0.3 * checks - 0.8 * spots)


@eqx.filter_jit
def columns_of(lobe: Microfacet, samples: SurfaceSamples, polar_nodes: int):
    smooth = polar_columns(lobe, samples, LIGHT.radiance, polar_nodes=polar_nodes)
    return smooth + integral_columns(lobe, samples, SOURCES.nodes())


def photograph(image: tuple[int, int], pixels: int, polar_nodes: int, evenly: bool) -> Scene:
    """Photograph the ball from a ring of views, by turns from above and below."""
    ball, azimuth = Sphere(), 2 * np.pi * np.arange(VIEWS) / VIEWS
    height = np.where(np.arange(VIEWS) % 2 == 0, 1.0, -0.5)
    towards = unit(np.stack([np.cos(azimuth), np.sin(azimuth), height], axis=-1))
    poses = [look_at(4 * t, np.zeros(3), np.array([0.0, 0.0, 1.0])) for t in towards]
    views = [observe(Orthographic(pixels, pixels, p, scale=2.02 / pixels), ball) for p in poses]
    used = [view.exit_cosines > LOWEST_COSINE for view in views]
    normals = np.concatenate([view.normals[u] for view, u in zip(views, used)])
    outgoing = np.concatenate([view.outgoing[u] for view, u in zip(views, used)])
    frame = np.repeat(np.arange(VIEWS), [u.sum() for u in used])
    samples = SurfaceSamples(normals, outgoing)
    lobe = Microfacet(np.ones(3), np.ones(3), SIGMA, MU)
    arrays = SurfaceSamples(jnp.asarray(normals), jnp.asarray(outgoing))
    columns = np.asarray(columns_of(lobe, arrays, polar_nodes))
    coordinates = sphere_coordinates(normals)
    site = texel_sites(coordinates, image)
    true_kd, true_ks = paint(texel_coordinates(image))
    kd, ks = (true_kd[site], true_ks[site]) if evenly else paint(coordinates)
    exact = kd * columns[:, 0] + ks[:, None] * columns[:, 1]
    radiance = NOISE.add(exact, np.random.default_rng(0))
    first = np.zeros((pixels, pixels, 3))
    first[used[0]] = radiance[frame == 0]
    seen = Observations(samples, radiance, frame)
    return Scene(seen, site, true_kd, true_ks, used, first)


def area_under_curve(score: np.ndarray, bad: np.ndarray) -> float:
    """The chance that a bad texel scores above a good one."""
    ranks = np.argsort(np.argsort(score))
    count = bad.sum()
    if count in (0, len(bad)):
        return float("nan")
    return float((ranks[bad].sum() - count * (count - 1) / 2) / (count * (len(bad) - count)))


def report(scene: Scene, fit: TextureFit):
    """Print the table's row."""
    texture = fit.texture
    seen = texture.seen > 0
    error = np.abs(texture.kd / scene.kd - 1)
    good = seen & ~texture.kd_marked

    def rms(values: np.ndarray) -> float:
        return 100 * float(np.sqrt(np.mean(values**2)))

    print(f"outcome {fit.outcome.value}; {'; '.join(fit.reasons)}")
    print(f"sigma {fit.sigma:.4f} +- {fit.sigma_error:.4f} (truth {SIGMA})")
    print(f"mu    {fit.mu:.4f} +- {fit.mu_error:.4f} (truth {MU})")
    print(
        f"noise {100 * fit.noise.relative:.2f} % (1), residual {100 * texture.relative_rms:.2f} %"
    )
    print(f"texels seen {seen.sum()} of {seen.size}; marked {(seen & texture.kd_marked).sum()}")
    verdict = "met" if rms(error[good]) < 2 else "NOT MET"
    print(f"K_d error where confidence is high: {rms(error[good]):.2f} % rms (under 2: {verdict})")
    marked = seen & texture.kd_marked
    if marked.any():
        print(f"K_d error of marked texels: {rms(error[marked]):.2f} % rms")
    ks_good = seen & ~texture.ks_marked
    print(
        f"K_s error where it is identifiable: {rms((texture.ks / scene.ks - 1)[ks_good]):.2f} % rms"
    )
    bad = (error.max(axis=1) > 0.05)[seen]
    area = area_under_curve(texture.relative_error[seen], bad)
    print(f"texels more than 5 % off: {bad.sum()}; area under the curve {area:.3f} (over .9)")
    scores = ((texture.kd - scene.kd) / texture.kd_error)[good]
    print(f"error / standard error, rms: {np.sqrt(np.mean(scores**2)):.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_6_12.png"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    image, pixels, rows = ((512, 512), 400, 64) if arguments.full else ((20, 40), 48, 48)
    start = time.perf_counter()
    scene = photograph(image, pixels, 32 if arguments.full else 24, not arguments.full)
    light = KnownLight(LIGHT.to_environment(rows), SOURCES)
    made = time.perf_counter()
    print(f"{scene.observations.count} observations photographed in {made - start:.0f} s")
    variant = Microfacet(np.ones(3), np.ones(3), 0.2, 1.5)
    settings = TextureSettings(search_samples=6000, exact_samples=1000, starts=2)
    fit = recover_texture(
        scene.observations,
        scene.site,
        image[0] * image[1],
        light,
        variant,
        settings=settings,
    )
    print(f"fitted in {time.perf_counter() - made:.0f} s")
    report(scene, fit)
    draw(scene, fit, image, arguments.out)


def draw(scene: Scene, fit: TextureFit, image: tuple[int, int], out: Path):
    """Draw a photograph and its rendering, then the maps beside the truth."""
    texture, site = fit.texture, scene.site
    known = texture.seen > 0
    rendering = np.zeros_like(scene.photograph)
    first = np.asarray(scene.observations.frame) == 0
    arrays = SurfaceSamples(*(jnp.asarray(a)[first] for a in scene.observations.samples))
    columns = np.asarray(
        columns_of(Microfacet(np.ones(3), np.ones(3), fit.sigma, fit.mu), arrays, 24)
    )
    kd, ks = texture.kd[site[first]], texture.ks[site[first]]
    rendering[scene.views[0]] = kd * columns[:, 0] + ks[:, None] * columns[:, 1]
    key = tone_key(scene.photograph[scene.views[0]][None])
    figure, axes = plt.subplots(2, 5, figsize=(17, 5.6))
    albedo = {"vmin": 0, "vmax": 1}
    panels = [
        ("photograph", tone_mapped(scene.photograph, key), {}),
        ("K_d, truth", _shown(scene.kd, image), albedo),
        ("K_s, truth", image_of_sites(scene.ks, image)[..., 0], {"vmin": 0, "vmax": 0.4}),
        ("standard error of K_d, %", 100 * _relative(texture, image), {"vmin": 0, "vmax": 5}),
        ("marked (yellow), unseen (white)", _marks(texture, image), {"vmin": 0, "vmax": 1}),
        ("rendering", tone_mapped(np.nan_to_num(rendering), key), {}),
        ("K_d, recovered", _shown(texture.kd, image, known), albedo),
        (
            "K_s, recovered",
            image_of_sites(texture.ks, image, known)[..., 0],
            {"vmin": 0, "vmax": 0.4},
        ),
        (
            "standard error of K_s, %",
            100 * image_of_sites(_ratio(texture.ks_error, texture.ks), image, known)[..., 0],
            {"vmin": 0, "vmax": 10},
        ),
        (
            "true error of K_d, %",
            100 * image_of_sites(np.abs(texture.kd / scene.kd - 1).max(1), image, known)[..., 0],
            {"vmin": 0, "vmax": 5},
        ),
    ]
    for place, (title, picture, how) in zip(axes.ravel(), panels):
        drawn = place.imshow(picture, interpolation="nearest", **how)
        place.set_title(title, fontsize=9)
        place.set(xticks=[], yticks=[])
        if picture.ndim == 2:
            figure.colorbar(drawn, ax=place, shrink=0.6)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=100, bbox_inches="tight")
    print(f"picture: {out}")


def _ratio(error: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Relative error; infinite where the value has ended at zero."""
    return np.divide(error, value, out=np.full_like(error, np.inf), where=value > 0)


def _shown(kd: np.ndarray, image: tuple[int, int], known: np.ndarray | None = None) -> np.ndarray:
    """K_d as a display shows it, the seams filled."""
    picture = dilated(image_of_sites(kd, image, known), 2, wrap=True)
    return np.nan_to_num(np.clip(picture / 0.3, 0, 1) ** (1 / 2.2), nan=1.0)


def _relative(texture, image: tuple[int, int]) -> np.ndarray:
    error = np.where(texture.seen > 0, texture.relative_error, np.nan)
    return image_of_sites(error, image)[..., 0]


def _marks(texture, image: tuple[int, int]) -> np.ndarray:
    marks = np.where(texture.seen > 0, texture.kd_marked.astype(float), np.nan)
    return image_of_sites(marks, image)[..., 0]


if __name__ == "__main__":
    main()
