"""The seven classes of inverse problems (T 6.1.1), from one photograph, a ring and a dense set.

    python experiments/taxonomy.py [--only 1 4 ...] [--out F.png]

Which of light L, BRDF and texture T are unknown makes the class.  Each is tried with one
photograph, a ring of 12, and 60 views from all around a ball: the 2D, 3D and 4D data of T 6.1.
Photographs are the exact integral of continuous light (no grid), with 1 % noise that the fits are
told of.  Without texture a photograph is 1200, 300 or 100 pixels; with texture it shows each texel
of 12 x 24 that it sees once.  Printed are the errors against the truth, what the program says is
identifiable or not, and its own words; where an answer cannot be had, what it says instead.

Class 6 is done twice: diffuse, where nobody can, and glossy, where what moves with the view tells.
Light is smooth where light and texture are both unknown or texture alone; one source joins it in
classes 2, 3 and 4.  Texture errors of classes 6 and 7 are those up to one scale of all (7, 6
glossy) or of each channel (6 diffuse), which no photograph tells.
"""

import os

# Read when NumPy is imported: the matrices are too small for a second thread to help.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import textwrap
import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scenes import photograph_function, unit

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples, fibonacci_sphere
from jaxrender.geometry.texels import neighbouring_texels, texel_coordinates
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import (
    Factorization,
    FactorSettings,
    FitSettings,
    Known,
    KnownLight,
    Observations,
    Stated,
    Unknowns,
    factorize,
    fit_brdf,
    unknowns_of,
)
from jaxrender.inverse.forecast import Situation, Supposed, forecast_joint, forecast_light
from jaxrender.inverse.texture import (
    GlossyProblem,
    TextureSettings,
    by_site,
    diffuse_problem,
    factor_diffuse,
    recover_glossy,
    recover_texture,
)
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.reflection import polar_columns
from jaxrender.spectra import light_coefficients

NOISE = NoiseModel(0.01, 0.0)
SIGMA, MU = 0.16, 1.62
MATERIAL = Microfacet(np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), SIGMA, MU)
AREA = SmoothLobes(
    unit(np.array([[1.0, 0.3, 0.8], [-0.6, 0.9, 0.4], [-0.4, -1.0, 0.2]])),
    np.radians([35.0, 45.0, 60.0]),
    np.array([[2.0, 1.9, 1.7], [1.2, 1.4, 1.6], [0.5, 0.6, 0.8]]),
)
SOURCE = DirectionalSources(np.array([[0.2, -0.7, 0.6]]), np.array([[0.7, 0.65, 0.6]]))
NO_SOURCE = DirectionalSources.none()
LIGHT_ROWS, LOWEST_COSINE = 64, 0.2
IMAGE = (12, 24)
SITES = IMAGE[0] * IMAGE[1]
# Photographs -> pixels of each where nothing is textured.
PIXELS = {1: 1200, 12: 300, 60: 100}
COUNTS = tuple(PIXELS)
DIFFUSE_DEGREE, GLOSSY_DEGREE = 2, 9
# A number is identifiable when its 90 % interval is within this part of it.
IDENTIFIABLE, NORMAL_90 = 0.25, 1.6448536269514722
KINDS = {1: "one", 12: "ring", 60: "dense"}


class Cell(NamedTuple):
    """What one class gave with one set of photographs.

    ``error`` is the worst of the errors that ``found`` lists, per cent; NaN where none was had.
    ``identifiable`` is the program's own verdict, ``words`` its own words.
    """

    error: float
    found: str
    identifiable: bool
    words: str


class Textured(NamedTuple):
    """Photographs of a textured ball, and the texture."""

    observations: Observations
    site: np.ndarray
    kd: np.ndarray
    ks: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """The photographs that each site is in."""
        return np.bincount(self.site, minlength=SITES)


# --- photographs ------------------------------------------------------------------------------


def views(count: int) -> np.ndarray:
    """Directions towards the cameras: one or a ring at one height, or from all around."""
    if count > 12:
        return fibonacci_sphere(count)
    azimuth = 2 * np.pi * np.arange(count) / count + 0.1
    return unit(np.stack([np.cos(azimuth), np.sin(azimuth), 0.25 + 0 * azimuth], axis=-1))


def plain_samples(count: int) -> tuple[SurfaceSamples, np.ndarray]:
    """Draw pixels evenly over the disc that each photograph shows of the ball."""
    rng = np.random.default_rng(count)
    frame = np.repeat(np.arange(count), PIXELS[count])
    outgoing = views(count)[frame]
    radius = np.sqrt(rng.uniform(0, 1 - LOWEST_COSINE**2, len(frame)))[:, None]
    turn = rng.uniform(0, 2 * np.pi, len(frame))[:, None]
    right = unit(np.cross([0.1, 0.2, 1.0], outgoing))
    across = right * np.cos(turn) + np.cross(outgoing, right) * np.sin(turn)
    normals = unit(radius * across + np.sqrt(1 - radius**2) * outgoing)
    return SurfaceSamples(normals, outgoing), frame


def plain(count: int) -> Observations:
    """Photograph the untextured ball under the area light and the source."""
    samples, frame = plain_samples(count)
    exact = photograph_function(AREA.radiance, MATERIAL, samples, frame, SOURCE)
    rng = np.random.default_rng(100 + count)
    return exact._replace(radiance=NOISE.add(np.asarray(exact.radiance), rng))


def textured(count: int, glossy: bool) -> Textured:
    """Photograph the textured ball under the area light: each texel that a view sees, once."""
    coordinates = texel_coordinates(IMAGE)
    azimuth, polar = 2 * np.pi * coordinates[:, 0], np.pi * (1 - coordinates[:, 1])
    around = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1) * np.sin(polar)[:, None]
    normals = np.concatenate([around, np.cos(polar)[:, None]], axis=-1)
    frame, site = np.nonzero(views(count) @ normals.T > LOWEST_COSINE)
    samples = SurfaceSamples(normals[site], views(count)[frame])
    kd, ks = paint(coordinates, glossy)
    columns = np.asarray(_under_area(SurfaceSamples(*map(jnp.asarray, samples))))
    exact = kd[site] * columns[:, 0] + ks[site][:, None] * columns[:, 1]
    radiance = NOISE.add(exact, np.random.default_rng(200 + count))
    return Textured(Observations(samples, radiance, frame), site, kd, ks)


def paint(coordinates: np.ndarray, glossy: bool) -> tuple[np.ndarray, np.ndarray]:
    """Paint of three colours in large patches, and K_s that varies by a third about .2."""
    label = np.floor(4 * coordinates[:, 0]) + np.floor(3 * coordinates[:, 1])
    colours = np.array([[0.05, 0.1, 0.2], [0.25, 0.2, 0.1], [0.12, 0.05, 0.06]])
    spread = np.random.default_rng(0).normal(0, 0.3, len(coordinates))
    return colours[label.astype(int) % 3], (0.2 * np.exp(spread) if glossy else 0 * spread)


@eqx.filter_jit
def _under_area(samples: SurfaceSamples) -> jax.Array:
    lobe = Microfacet(np.ones(3), np.ones(3), SIGMA, MU)
    return polar_columns(lobe, samples, AREA.radiance, polar_nodes=32)


# --- the classes ------------------------------------------------------------------------------

KNOWN_LOBE = unknowns_of(MATERIAL, {"sigma": Stated(fixed=SIGMA), "mu": Stated(fixed=MU)})
NOTHING_KNOWN = unknowns_of(MATERIAL)
# The specular share, sigma and mu of the untextured ball, all known.
SHARES = np.asarray(MATERIAL.ks) / (np.asarray(MATERIAL.kd) + np.asarray(MATERIAL.ks))
ALL_KNOWN = Known(tuple(SHARES.tolist()), KNOWN_LOBE["sigma"], KNOWN_LOBE["mu"])


def area_alone() -> KnownLight:
    """The light of textured balls, as an image."""
    return KnownLight(AREA.to_environment(LIGHT_ROWS), NO_SOURCE)


def whole_light() -> KnownLight:
    """The light of plain balls."""
    return KnownLight(AREA.to_environment(LIGHT_ROWS), SOURCE)


def texture_alone(count: int) -> Cell:
    """Class 1: light, sigma and mu known."""
    return _texture_cell(count, KNOWN_LOBE)


def texture_and_brdf(count: int) -> Cell:
    """Class 5: light known."""
    return _texture_cell(count, NOTHING_KNOWN)


def _texture_cell(count: int, unknowns: Unknowns) -> Cell:
    ball = textured(count, glossy=True)
    variant = Microfacet(np.ones(3), np.ones(3), 0.2, 1.5)
    settings = TextureSettings(NOISE, search_samples=6000, exact_samples=1000, starts=2)
    fit = recover_texture(
        ball.observations,
        ball.site,
        SITES,
        area_alone(),
        variant,
        unknowns=unknowns,
        settings=settings,
    )
    texture, seen = fit.texture, ball.seen > 0
    sure, known_ks = seen & ~texture.kd_marked, seen & ~texture.ks_marked
    every = _rms(texture.kd[seen] / ball.kd[seen] - 1)
    parts = [f"K_d {every:.1f} % rms of {seen.sum()} texels seen"]
    errors = [every]
    if sure.any() and not sure[seen].all():
        errors = [_rms(texture.kd[sure] / ball.kd[sure] - 1)]
        parts.append(f"{errors[0]:.1f} % of {sure.sum()} not marked")
    if known_ks.any():
        parts.append(
            f"K_s {_rms(texture.ks[known_ks] / ball.ks[known_ks] - 1):.1f} % of {known_ks.sum()}"
        )
    words = [*fit.reasons]
    marked = seen & ~sure
    if marked.any():
        words.append(f"K_d of {marked.sum()} texels seen is marked as not to be trusted")
    if not known_ks[seen].all():
        words.append(f"K_s of {(seen & ~known_ks).sum()} texels is the prior's more than their own")
    if unknowns.names:
        lobe = [100 * (fit.sigma / SIGMA - 1), 100 * ((fit.mu - 1) / (MU - 1) - 1)]
        parts.append(f"sigma {lobe[0]:+.1f} %, mu - 1 {lobe[1]:+.1f} %")
        errors += [abs(one) for one in lobe]
    identifiable = fit.outcome.value == "converged" and sure[seen].mean() > 0.5
    return Cell(
        max(errors), ", ".join(parts), identifiable, f"{fit.outcome.value}: " + "; ".join(words)
    )


def brdf_alone(count: int) -> Cell:
    """Class 2: the light known."""
    fit = fit_brdf(
        plain(count),
        whole_light(),
        NOTHING_KNOWN,
        Microfacet(np.ones(3), np.ones(3), 0.2, 1.5),
        FitSettings(noise=NOISE, refine_samples=1000),
    )
    value = fit.parameters.value
    errors = {
        "kd": _worst(value.kd, MATERIAL.kd),
        "ks": _worst(value.ks, MATERIAL.ks),
        "sigma": _worst(value.of("sigma"), SIGMA),
        "mu - 1": _worst(np.asarray(value.of("mu")) - 1, MU - 1),
    }
    words = f"{fit.outcome.value}: {_flags(fit.identifiable)}; {'; '.join(fit.reasons)}"
    return Cell(max(errors.values()), _listed(errors), all(fit.identifiable.values()), words)


def light_alone(count: int) -> Cell:
    """Class 3: the material known."""
    observations = plain(count)
    fit = factorize(observations, MATERIAL, FactorSettings(noise=NOISE), ALL_KNOWN)
    errors, nine_error = _light_errors(fit)
    samples, frame = observations.samples, np.asarray(observations.frame)
    forecast = forecast_light(Situation(samples, frame, whole_light()), Supposed(MATERIAL, NOISE))
    words = (
        f"nine coefficients known to {100 * nine_error:.1f} % (standard error); forecast: "
        + "; ".join(forecast.sentences)
    )
    identifiable = NORMAL_90 * nine_error < IDENTIFIABLE
    return Cell(errors["nine coefficients"], _listed(errors, sources=True), identifiable, words)


def light_and_brdf(count: int) -> Cell:
    """Class 4: nothing known; all in the gauge kd + ks = 1."""
    observations = plain(count)
    fit = factorize(observations, MATERIAL, FactorSettings(noise=NOISE))
    value = fit.parameters.value
    errors = {
        "ks / (kd + ks)": _worst(value.ks, SHARES),
        "sigma": _worst(value.of("sigma"), SIGMA),
        "mu - 1": _worst(np.asarray(value.of("mu")) - 1, MU - 1),
    }
    light, _ = _light_errors(fit)
    words = f"{fit.outcome.value}: {_flags(fit.identifiable)}; {'; '.join(fit.reasons)}"
    identifiable = all(fit.identifiable.values())
    if not identifiable:
        samples, frame = observations.samples, np.asarray(observations.frame)
        supposed = Supposed(MATERIAL, NOISE)
        forecast = forecast_joint(Situation(samples, frame, whole_light()), supposed)
        words += "; forecast: " + "; ".join(forecast.sentences)
    worst = max(*errors.values(), light["nine coefficients"])
    return Cell(worst, _listed(errors) + ", " + _listed(light, sources=True), identifiable, words)


def light_and_diffuse_texture(count: int) -> Cell:
    """Class 6, diffuse."""
    ball = textured(count, glossy=False)
    measured = by_site(ball.observations, ball.site, SITES)
    pairs = neighbouring_texels(IMAGE, measured.seen > 0, wrap=True)
    normals = np.asarray(ball.observations.samples.normals)
    problem = diffuse_problem(measured, normals, pairs, DIFFUSE_DEGREE, (0.01, 0.0))
    found = factor_diffuse(problem, "total-variation")
    ratio = found.texture / ball.kd
    off = _rms(ratio / np.nanmedian(ratio, axis=0) - 1)
    seen = int((measured.seen > 0).sum())
    lost, every = int(found.unidentifiable.sum(axis=1).max()), found.unidentifiable.shape[1]
    words = (
        f"{lost} of {every} directions of the light are not identifiable: texture is known up to a "
        "factor of the normal; these values are those that the prior of few colours picks"
    )
    return Cell(off, f"K_d {off:.1f} % rms off scale, {seen} texels", lost == 0, words)


def light_and_glossy_texture(count: int) -> Cell:
    """Class 6, glossy: sigma and mu known."""
    return _glossy_cell(count, KNOWN_LOBE)


def everything(count: int) -> Cell:
    """Class 7."""
    return _glossy_cell(count, NOTHING_KNOWN)


def _glossy_cell(count: int, unknowns: Unknowns) -> Cell:
    ball = textured(count, glossy=True)
    measured = by_site(ball.observations, ball.site, SITES)
    variant = Microfacet(np.ones(3), np.ones(3), 0.2, 1.5)
    problem = GlossyProblem(measured, ball.observations, variant, GLOSSY_DEGREE, (0.01, 0.0))
    found = recover_glossy(problem, unknowns)
    ratio = np.concatenate([found.kd, found.ks[:, None]], axis=1)
    ratio = ratio / np.concatenate([ball.kd, ball.ks[:, None]], axis=1)
    often = ball.seen > 2
    # One scale for all: what K_s and K_d share is the light's.
    scale = np.nanmedian(ratio[often])
    errors = {
        "K_d": _rms(ratio[often, :3] / scale - 1),
        "K_s": _rms(ratio[often, 3] / scale - 1),
    }
    truth = np.asarray(light_coefficients(AREA.to_environment(LIGHT_ROWS), 2))
    nine = found.light.coefficients[:9] * scale
    errors["nine coefficients"] = _norm_off(nine, truth)
    lobe = {}
    if unknowns.names:
        lobe["sigma"] = _worst(found.light.sigma, SIGMA)
        lobe["mu - 1"] = _worst(np.asarray(found.light.mu) - 1, MU - 1)
    by_degree = NORMAL_90 * found.light.relative_error_by_degree
    lost = np.flatnonzero(by_degree > IDENTIFIABLE)
    words = "every degree of the light is determined by what moves with the view"
    if lost.size:
        numbers = ", ".join(map(str, lost))
        words = f"the light of degree {numbers} is not determined by what moves with the view"
        if lost[0] == 0:
            words += ", so the ratio of K_d to K_s is not identifiable"
    words += "; the scale of all is a choice"
    identifiable = not (lost.size and lost[0] <= 2)
    return Cell(max((errors | lobe).values()), _listed(errors | lobe), identifiable, words)


# --- errors and words -------------------------------------------------------------------------


def _light_errors(fit: Factorization) -> tuple[dict[str, float], float]:
    """The source's angle and energy, the nine coefficients in per cent; and their stated error."""
    total = np.asarray(MATERIAL.kd) + np.asarray(MATERIAL.ks)
    slow = np.asarray(light_coefficients(AREA.to_environment(LIGHT_ROWS), 2))
    whole = np.asarray(light_coefficients(SOURCE, 2)) + slow
    scene = fit.scene
    errors = {"nine coefficients": _norm_off(scene.total[:9], whole * total)}
    if len(scene.sources.directions):
        towards = np.asarray(scene.sources.directions)[0] @ unit(np.asarray(SOURCE.directions)[0])
        errors["source off, degrees"] = float(np.degrees(np.arccos(np.clip(towards, -1, 1))))
        energy = np.asarray(scene.sources.irradiance)[0]
        errors["its energy"] = _worst(energy, np.asarray(SOURCE.irradiance)[0] * total)
    stated = np.linalg.norm(scene.slow_error[:9]) / np.linalg.norm(scene.total[:9])
    errors["sources"] = len(scene.sources.directions)
    return errors, float(stated)


def _rms(values: np.ndarray) -> float:
    return 100 * float(np.sqrt(np.nanmean(values**2)))


def _worst(found, truth) -> float:
    return 100 * float(np.max(np.abs(np.asarray(found) / np.asarray(truth) - 1)))


def _norm_off(found: np.ndarray, truth: np.ndarray) -> float:
    return 100 * float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def _listed(errors: dict[str, float], sources: bool = False) -> str:
    parts = []
    for name, error in errors.items():
        if name == "sources":
            parts.append(f"{error:.0f} sources found (1)")
        elif name.endswith("degrees"):
            parts.append(f"{name.split(',')[0]} {error:.2f} degrees")
        else:
            parts.append(f"{name} {error:.1f} %")
    return ", ".join(parts)


def _flags(identifiable: dict[str, bool]) -> str:
    lost = [name for name, known in identifiable.items() if not known]
    return f"not identifiable: {', '.join(lost)}" if lost else "all identifiable"


# --- the table --------------------------------------------------------------------------------

CLASSES: dict[str, tuple[str, Callable[[int], Cell]]] = {
    "1": ("texture", texture_alone),
    "2": ("BRDF", brdf_alone),
    "3": ("light", light_alone),
    "4": ("light, BRDF", light_and_brdf),
    "5": ("texture, BRDF", texture_and_brdf),
    "6 diffuse": ("light, texture", light_and_diffuse_texture),
    "6 glossy": ("light, texture", light_and_glossy_texture),
    "7": ("light, texture, BRDF", everything),
}


def attempt(trial: Callable[[int], Cell], count: int) -> Cell:
    """Try a class; a refusal in the program's own words is an answer, too."""
    try:
        return trial(count)
    except ValueError as error:
        return Cell(float("nan"), "refused", False, str(error))


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(CLASSES), default=list(CLASSES))
    parser.add_argument("--out", default="experiments/out/taxonomy.png")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    start, table = time.perf_counter(), {}
    print("class      unknown               photographs")
    for name in arguments.only:
        unknown, trial = CLASSES[name]
        for count in COUNTS:
            cell = table[name, count] = attempt(trial, count)
            mark = "identifiable" if cell.identifiable else "NOT IDENTIFIABLE"
            print(f"{name:10s} {unknown:22s} {count:2d} {KINDS[count]:6s} {mark:9s} {cell.found}")
            print(textwrap.indent(textwrap.fill(cell.words, 100), " " * 12), flush=True)
    print(f"\n{time.perf_counter() - start:.0f} s")
    draw(table, arguments.only, arguments.out)


def draw(table: dict[tuple[str, int], Cell], names: list[str], out: str):
    """Draw the grid: coloured by the worst error, hatched where it says not identifiable."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Rectangle

    figure, axis = plt.subplots(figsize=(9.5, 0.75 * len(names) + 1.2), layout="constrained")
    errors = np.array([[table[name, count].error for count in COUNTS] for name in names])
    colours = plt.get_cmap("RdYlGn_r").with_extremes(bad="0.75")
    shown = axis.imshow(
        np.ma.masked_invalid(errors), cmap=colours, norm=LogNorm(0.3, 100), aspect="auto"
    )
    for row, name in enumerate(names):
        for column, count in enumerate(COUNTS):
            cell = table[name, count]
            if not cell.identifiable:
                corner = (column - 0.5, row - 0.5)
                axis.add_patch(Rectangle(corner, 1, 1, fill=False, hatch="//", lw=0, alpha=0.35))
            number = "refused" if np.isnan(cell.error) else f"{cell.error:.1f} %"
            text = number if cell.identifiable else f"{number}\nnot\nidentifiable"
            box = {"facecolor": "white", "alpha": 0.7, "lw": 0, "pad": 1.5}
            axis.text(column, row, text, ha="center", va="center", fontsize=9, bbox=box)
    axis.set_xticks(range(len(COUNTS)), [f"{count} ({KINDS[count]})" for count in COUNTS])
    labels = [f"{name}: {CLASSES[name][0]} unknown" for name in names]
    axis.set_yticks(range(len(names)), labels)
    axis.set_xlabel("photographs")
    axis.set_title(
        "T 6.1.1: worst error of what was sought; hatched: the program says it is not identifiable"
    )
    figure.colorbar(shown, label="error, %")
    figure.savefig(out, dpi=110)
    print(f"picture: {out}")


if __name__ == "__main__":
    main()
