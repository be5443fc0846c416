"""Texture and light both unknown (T 6.1.1).

Photographs tell a diffuse object's texture (class 6) up to a factor.  That factor depends on the
normal alone and has the few degrees of irradiance; a stated prior picks one.  A glossy object's
light (class 7) shows in what moves with the view, so that only one scale stays open.  Noise that
is not given is estimated from the residuals, and the recovery is done again.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.models import Columns
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.texture.columns import texture_columns
from jaxrender.inverse.texture.diffuse_light import (
    DiffuseFactors,
    DiffuseProblem,
    diffuse_problem,
    factor_diffuse,
)
from jaxrender.inverse.texture.estimate import (
    TextureEstimate,
    facets_of,
)
from jaxrender.inverse.texture.free_paint_and_light import (
    check_freed_with_light,
    freed_with_light,
)
from jaxrender.inverse.texture.glossy_light import (
    GlossyLight,
    GlossyProblem,
    GlossyTexture,
    recover_glossy,
)
from jaxrender.inverse.texture.harmonic_columns import HarmonicForward
from jaxrender.inverse.texture.judgement import Judging, judged, noise_left
from jaxrender.inverse.texture.measurements import by_site
from jaxrender.inverse.texture.region_lobe import RegionLobe
from jaxrender.inverse.texture.sites import SurfaceSites
from jaxrender.inverse.texture.texture import Texture
from jaxrender.inverse.texture.view_dependent import LightCoefficients
from jaxrender.inverse.unknown_material import UnknownMaterial
from jaxrender.shapes import Float, Int

# Degrees of an unknown light: those of irradiance, and those that glossy lobes pass.  A lobe of
# sigma .16 and above passes 10, a narrower one 1.6 / sigma.  More would cost time only.
_DIFFUSE_BAND_LIMIT, _GLOSSY_BAND_LIMIT = 2, 10
_BAND_LIMIT_TIMES_SIGMA, _HIGHEST_BAND_LIMIT = 1.6, 16
# The width of a lobe that nothing asks about: diffuse paint has none.
_NO_LOBE = 0.1
# The noise that is assumed until it has been estimated.
_FIRST_NOISE = NoiseModel(0.01, 0.0)
# What picks a diffuse object's texture, unless said otherwise.
_PRIOR = "total-variation"
_DIFFUSE_GAUGE = "the geometric mean of kd is 0.18 / pi in each channel; light scaled to match"
_GLOSSY_GAUGE = "one ks for all channels, mean of kd + ks = 1; light scaled to match"
_SCALE_ALONE = (
    "light and texture are both unknown: light times reflectance is all that photographs tell, so "
    f"the scale is a choice ({_GLOSSY_GAUGE})"
)


class UnknownLightSettings(NamedTuple):
    """How a texture and the light are found together.

    ``noise`` is estimated where it is None.  ``band_limit`` is the highest degree of the light;
    None: 2 for diffuse paint, and as far as the lobe passes it for others.  ``exact`` finds these
    on the integral.  ``prior`` picks the texture of diffuse paint: ``total-variation`` (where it is
    None) expects paint of few colours, ``variance`` an even one.  ``diagnose`` names what would
    explain what a glossy texture leaves, and ``free`` nuisances of the capture that are found with
    it, by name or (``auto``) as the diagnosis names them.
    """

    noise: NoiseModel | None = None
    band_limit: int | None = None
    exact: bool = True
    prior: str | None = None
    diagnose: bool = True
    free: tuple[str, ...] | str = ()


def under_unknown_light(
    observations: Observations,
    sites: SurfaceSites,
    material: UnknownMaterial,
    settings: UnknownLightSettings | None = None,
) -> TextureEstimate:
    """Recover light and texture, of one material.

    ``observations`` are all usable pixels of the photographs that ``sites`` are of.  Raises
    ``ValueError`` for concave shapes, models that are not of facets, and several regions.  Raises
    it, too, for settings that the material does not use, for nuisances that are not freed here, and
    where nothing is identifiable.
    """
    settings = settings or UnknownLightSettings()
    facets_of(material)
    if not sites.shape.is_convex():
        raise ValueError(
            "the shape is concave, and shadows under unknown light are not modelled: give the "
            "light, or a convex shape"
        )
    if len(sites.regions.names) > 1:
        raise ValueError(
            f"{len(sites.regions.names)} regions: under unknown light the surface has one lobe; "
            "give the light, or leave the regions out"
        )
    diffuse = material.model == "lambertian"
    if diffuse and not settings.exact:
        raise ValueError("exact=False: diffuse paint has no specular lobe to find; leave it out")
    if not diffuse and settings.prior is not None:
        raise ValueError(
            f"prior={settings.prior!r}: the specular lobe shows in what moves with the view, not "
            "by a prior; leave it out, or choose lambertian"
        )
    if diffuse and settings.free:
        raise ValueError(
            "nothing is freed with diffuse paint under unknown light: leave free out, give the "
            "light, or choose a model of facets"
        )
    check_freed_with_light(settings.free)
    if settings.free == "auto" and not settings.diagnose:
        raise ValueError(
            "free='auto' frees what the diagnosis names: choose diagnose=True, or give names"
        )
    once = _diffuse if diffuse else _glossy

    def found(seen: Observations, freed: tuple[str, ...]) -> TextureEstimate:
        estimate = once(seen, sites, material, settings, settings.noise or _FIRST_NOISE)
        columns = _columns(estimate, seen.samples, settings.exact)
        if settings.noise is None:
            noise = noise_left(seen, estimate, columns)
            estimate = once(seen, sites, material, settings, noise)
            columns = _columns(estimate, seen.samples, settings.exact)
        diagnosing = settings.diagnose and not diffuse
        asked = Judging(settings.noise, settings.exact, diagnosing, freed, observations)
        return judged(estimate, columns, seen, asked)

    estimate = found(observations, ())
    if not settings.free:
        return estimate
    return freed_with_light(estimate, observations, settings.free, found, exact=settings.exact)


def model_under(light: LightCoefficients, exact: bool) -> HarmonicForward:
    """Make the model of a light that was recovered as coefficients; ``exact``: on the integral."""
    return HarmonicForward(jnp.asarray(light.coefficients), exact)


def _glossy(
    observations: Observations,
    sites: SurfaceSites,
    material: UnknownMaterial,
    settings: UnknownLightSettings,
    noise: NoiseModel,
) -> TextureEstimate:
    limit = settings.band_limit
    problem = GlossyProblem(
        by_site(observations, sites.of_observation, sites.count),
        observations,
        facets_of(material),
        _GLOSSY_BAND_LIMIT if limit is None else limit,
        (float(noise.relative), float(noise.floor)),
        settings.exact,
    )
    unknowns = material.unknowns()
    found = recover_glossy(problem, unknowns)
    wanted = min(math.ceil(_BAND_LIMIT_TIMES_SIGMA / found.light.sigma), _HIGHEST_BAND_LIMIT)
    if limit is None and wanted > problem.band_limit:
        found = recover_glossy(problem._replace(band_limit=wanted), unknowns)
    found = _in_gauge(found)
    light, seen = found.light, problem.measured.seen
    outcome, reasons = _outcome(light)
    lobe = RegionLobe(
        0,
        "",
        int(np.count_nonzero(seen)),
        light.sigma,
        float("nan") if light.mu is None else light.mu,
        light.sigma_error,
        light.mu_error,
        outcome,
    )
    return TextureEstimate(
        material,
        _unmarked(found.kd, found.ks, found.kd_error, found.ks_error, seen),
        (lobe,),
        sites,
        noise,
        outcome,
        reasons,
        _GLOSSY_GAUGE,
        _SCALE_ALONE,
        LightCoefficients(light.coefficients, light.standard_error),
    )


def _in_gauge(found: GlossyTexture) -> GlossyTexture:
    """Scale so that the mean of kd + ks over sites and channels is 1."""
    scale = float(np.nanmean(found.kd) + np.nanmean(found.ks))
    light = found.light._replace(
        coefficients=found.light.coefficients * scale,
        covariance=found.light.covariance * scale**2,
    )
    return GlossyTexture(light, *(part / scale for part in found[1:]))


def _outcome(light: GlossyLight) -> tuple[Outcome, tuple[str, ...]]:
    """Name what is not identifiable: sigma, mu, degrees of the light; 0 sets kd against ks."""
    reasons = []
    widths = {"sigma": light.sigma_error / light.sigma}
    if light.mu is not None and light.mu_error is not None:
        widths["mu"] = light.mu_error / (light.mu - 1)
    lost = [name for name, width in widths.items() if not NORMAL_90 * width <= IDENTIFIABLE_WITHIN]
    if lost:
        reasons.append(
            f"{' and '.join(lost)}: what moves with the view does not tell; light and ks rest on "
            "sigma and mu, fix them if they are known"
        )
    errors = NORMAL_90 * light.relative_error_by_degree
    dim = np.flatnonzero(~(errors <= IDENTIFIABLE_WITHIN))
    if dim.size:
        numbers = ", ".join(map(str, dim))
        reasons.append(
            f"the light of degree {numbers} is not determined by what moves with the view"
        )
    if dim.size and dim[0] == 0:
        reasons.append(
            "so the ratio of kd to ks is not identifiable: it rests on the light of degree 0"
        )
    if lost or (dim.size and dim[0] == 0):
        return Outcome.NOT_IDENTIFIABLE, tuple(reasons)
    return (Outcome.CONVERGED if light.converged else Outcome.NOT_CONVERGED), tuple(reasons)


def _diffuse(
    observations: Observations,
    sites: SurfaceSites,
    material: UnknownMaterial,
    settings: UnknownLightSettings,
    noise: NoiseModel,
) -> TextureEstimate:
    measured = by_site(observations, sites.of_observation, sites.count)
    problem = diffuse_problem(
        measured,
        np.asarray(observations.samples.normals),
        sites.neighbours(measured.seen > 0),
        _DIFFUSE_BAND_LIMIT if settings.band_limit is None else settings.band_limit,
        (float(noise.relative), float(noise.floor)),
    )
    prior = settings.prior or _PRIOR
    found = factor_diffuse(problem, prior)
    outcome = Outcome.NOT_IDENTIFIABLE if found.unidentifiable.any() else Outcome.CONVERGED
    if not found.converged:
        outcome = Outcome.NOT_CONVERGED
    seen, none = problem.measured.seen, np.zeros(sites.count)
    lobe = RegionLobe(
        0, "", int(np.count_nonzero(seen)), _NO_LOBE, float("nan"), None, None, outcome
    )
    sentence = _ambiguity(found, prior)
    return TextureEstimate(
        material,
        _unmarked(found.texture, none, _errors(problem, found), none, seen),
        (lobe,),
        sites,
        noise,
        outcome,
        (sentence,),
        _DIFFUSE_GAUGE,
        sentence,
        LightCoefficients(found.light, None),
    )


def _ambiguity(found: DiffuseFactors, prior: str) -> str:
    lost, every = int(found.unidentifiable.sum(axis=1).max()), found.unidentifiable.shape[1]
    return (
        "light and texture are both unknown: photographs of a diffuse object tell its texture up "
        "to a factor that depends on the normal alone and has no degrees above those of irradiance "
        f"(T 6.1.1, class 6); {lost} of {every} directions of the light are not identifiable, and "
        f"these values are those that the prior '{prior}' picks ({_DIFFUSE_GAUGE})"
    )


def _errors(problem: DiffuseProblem, found: DiffuseFactors) -> Float[np.ndarray, "site channel"]:
    """Compute standard errors under the light that was picked."""
    weights, measured = problem.log_error**-2, problem.measured
    total = np.stack([np.bincount(measured.site, w, measured.count) for w in weights.T], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(total > 0, np.nan_to_num(found.texture) / np.sqrt(total), np.inf)


def _unmarked(
    kd: Float[np.ndarray, "site channel"],
    ks: Float[np.ndarray, "site"],
    kd_error: Float[np.ndarray, "site channel"],
    ks_error: Float[np.ndarray, "site"],
    seen: Int[np.ndarray, "site"],
) -> Texture:
    """Lay out a texture whose misfit and marks are still open."""
    nothing, marks = np.full(len(seen), np.nan), np.zeros(len(seen), bool)
    kd, ks, kd_error, ks_error = map(np.asarray, (kd, ks, kd_error, ks_error))
    return Texture(kd, ks, kd_error, ks_error, nothing, seen, marks, marks, kd_error, ks_error, 0.0)


def _columns(estimate: TextureEstimate, samples: SurfaceSamples, exact: bool) -> Columns:
    assert estimate.light is not None
    lobe = estimate.brdf_of(estimate.lobes[0])
    return texture_columns(lobe, samples, model_under(estimate.light, exact))
