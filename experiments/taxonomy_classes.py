"""The seven classes of inverse problems (T 6.1.1): what each finds from so many photographs."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scenes import unit
from taxonomy_photographs import (
    AREA,
    IMAGE,
    MATERIAL,
    MU,
    NO_SOURCE,
    NOISE,
    SIGMA,
    SITES,
    SOURCE,
    plain,
    textured,
)

from jaxrender.brdf import Microfacet
from jaxrender.geometry.texels import neighbouring_texels
from jaxrender.inverse import (
    Factorization,
    FactorSettings,
    FitSettings,
    Known,
    KnownLight,
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
from jaxrender.spectra import light_coefficients

LIGHT_ROWS = 64
DIFFUSE_DEGREE, GLOSSY_DEGREE = 2, 9
# A number is identifiable when its 90 % interval is within this part of it.
IDENTIFIABLE, NORMAL_90 = 0.25, 1.6448536269514722
KNOWN_LOBE = unknowns_of(MATERIAL, {"sigma": Stated(fixed=SIGMA), "mu": Stated(fixed=MU)})
NOTHING_KNOWN = unknowns_of(MATERIAL)
# The specular share, sigma and mu of the untextured ball, all known.
SHARES = np.asarray(MATERIAL.ks) / (np.asarray(MATERIAL.kd) + np.asarray(MATERIAL.ks))
ALL_KNOWN = Known(tuple(SHARES.tolist()), KNOWN_LOBE["sigma"], KNOWN_LOBE["mu"])


class Cell(NamedTuple):
    """What one class gave with one set of photographs.

    ``error`` is the worst of the errors that ``found`` lists, per cent; NaN where none was had.
    ``identifiable`` is the program's own verdict, ``words`` its own words.
    """

    error: float
    found: str
    identifiable: bool
    words: str


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
