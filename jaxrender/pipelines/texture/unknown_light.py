"""Texture and light both unknown (T 6.1.1): what photographs tell, and up to what.

A matte object's (class 6) texture is told up to a factor that depends on the normal alone and has
the few degrees of irradiance; a stated prior picks one.  A glossy object's (class 7) light shows in
what moves with the view, so that only one scale is open.  Noise that is not given is estimated from
what is left, and all of it repeated.
"""

import math

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse import Observations, Outcome
from jaxrender.inverse.texture import (
    DiffuseFactors,
    DiffuseProblem,
    GlossyLight,
    GlossyProblem,
    GlossyTexture,
    SiteMaterial,
    Texture,
    by_site,
    diffuse_problem,
    factor_diffuse,
    recover_glossy,
)
from jaxrender.inverse.texture.whole_surface import TRUSTED_ERROR, TRUSTED_MISFIT
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.config import RunConfig, TextureConfig
from jaxrender.pipelines.scene import settings_of, unknowns_of
from jaxrender.pipelines.texture.sites import SurfaceSites
from jaxrender.pipelines.texture.surface import (
    IDENTIFIABLE_WITHIN,
    NORMAL_90,
    Light,
    Lobes,
    Region,
    Surface,
    facets_of,
    lobes_of,
)
from jaxrender.reflection import DualForward, DualLight
from jaxrender.shapes import Float

# Degrees of an unknown light: what irradiance has, and what glossy lobes pass: of sigma .16 and
# above, and to 1.6 / sigma of narrower ones.  What they do not pass costs time, but no accuracy.
_MATTE_BAND_LIMIT, _GLOSSY_BAND_LIMIT = 2, 10
_BAND_LIMIT_TIMES_SIGMA, _HIGHEST_BAND_LIMIT = 1.6, 16
# The noise that is assumed until it has been estimated.
_FIRST_NOISE = NoiseModel(0.01, 0.0)
# An answer that leaves more than this unexplained is none.
_MUCH_LEFT = 0.2
_MATTE_GAUGE = "the geometric mean of kd is 0.18 / pi in each channel; light scaled to match"
_GLOSSY_GAUGE = "one ks for all channels, mean of kd + ks = 1; light scaled to match"
_SCALE_ALONE = (
    "light and texture are both unknown: light times reflectance is all that photographs tell, so "
    f"the scale is a choice ({_GLOSSY_GAUGE})"
)


def under_unknown_light(
    config: RunConfig, observations: Observations, sites: SurfaceSites
) -> Surface:
    """Recover light and texture; ``ValueError`` where nothing can be told."""
    if not sites.shape.is_convex():
        raise ValueError(
            "the shape is concave, and shadows under unknown light are not modelled: give the "
            "light, or a convex shape"
        )
    matte = config.brdf.model == "lambertian"
    once = _matte if matte else _glossy
    given = settings_of(config).noise
    surface, lobes = once(config, observations, sites, given or _FIRST_NOISE)
    if given is None:
        noise = _noise_left(observations, surface, lobes, sites)
        surface, lobes = once(config, observations, sites, noise)
    return _judged(surface, lobes, observations, sites)


def model_under(light: Light) -> DualForward:
    """Make the model of a light that was recovered as coefficients."""
    return DualForward(DualLight(jnp.asarray(light.coefficients), DirectionalSources.none()))


def _glossy(
    config: RunConfig, observations: Observations, sites: SurfaceSites, noise: NoiseModel
) -> tuple[Surface, Lobes]:
    limit = config.solve.band_limit
    problem = GlossyProblem(
        by_site(observations, sites.of_observation, sites.count),
        observations,
        facets_of(config.brdf),
        _GLOSSY_BAND_LIMIT if limit == "auto" else limit,
        (float(noise.relative), float(noise.floor)),
        config.solve.refine == "exact",
    )
    unknowns = unknowns_of(config, 0)
    found = recover_glossy(problem, unknowns)
    wanted = min(math.ceil(_BAND_LIMIT_TIMES_SIGMA / found.light.sigma), _HIGHEST_BAND_LIMIT)
    if limit == "auto" and wanted > problem.band_limit:
        found = recover_glossy(problem._replace(band_limit=wanted), unknowns)
    found = _in_gauge(found)
    material = (
        SiteMaterial(found.kd, found.ks),
        SiteMaterial(found.kd_error, found.ks_error),
    )
    texture = _texture(material, problem.measured.seen)
    light = Light(found.light.coefficients, found.light.standard_error)
    mu = float("nan") if found.light.mu is None else found.light.mu
    seen = int(np.count_nonzero(texture.seen))
    outcome, reasons = _told(found.light)
    errors = (found.light.sigma_error, found.light.mu_error)
    region = Region("", seen, found.light.sigma, mu, *errors, outcome)
    everywhere = np.zeros(sites.count, int)
    surface = Surface(
        texture, (region,), everywhere, noise, outcome, reasons, _GLOSSY_GAUGE, _SCALE_ALONE, light
    )
    return surface, _lobes(surface, facets_of(config.brdf), observations.samples)


def _in_gauge(found: GlossyTexture) -> GlossyTexture:
    """Scale so that the mean of kd + ks over sites and channels is 1."""
    scale = float(np.nanmean(found.kd) + np.nanmean(found.ks))
    light = found.light._replace(
        coefficients=found.light.coefficients * scale,
        covariance=found.light.covariance * scale**2,
    )
    return GlossyTexture(light, *(part / scale for part in found[1:]))


def _told(light: GlossyLight) -> tuple[Outcome, tuple[str, ...]]:
    """Say which of sigma, mu and the light's degrees are not told; degree 0 sets kd against ks."""
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
        reasons.append(f"the light of degree {numbers} is not told by what moves with the view")
    if dim.size and dim[0] == 0:
        reasons.append("so the ratio of kd to ks is not told: it rests on the light of degree 0")
    if lost or (dim.size and dim[0] == 0):
        return Outcome.NOT_IDENTIFIABLE, tuple(reasons)
    return (Outcome.CONVERGED if light.converged else Outcome.NOT_CONVERGED), tuple(reasons)


def _matte(
    config: RunConfig, observations: Observations, sites: SurfaceSites, noise: NoiseModel
) -> tuple[Surface, Lobes]:
    texture_config = config.texture or TextureConfig()
    measured = by_site(observations, sites.of_observation, sites.count)
    limit = config.solve.band_limit
    problem = diffuse_problem(
        measured,
        np.asarray(observations.samples.normals),
        sites.neighbours(measured.seen > 0),
        _MATTE_BAND_LIMIT if limit == "auto" else limit,
        (float(noise.relative), float(noise.floor)),
    )
    found = factor_diffuse(problem, texture_config.prior)
    error = _matte_errors(problem, found)
    none = np.zeros(sites.count)
    material = SiteMaterial(found.texture, none), SiteMaterial(error, none)
    texture = _texture(material, problem.measured.seen)
    outcome = Outcome.NOT_IDENTIFIABLE if found.untold.any() else Outcome.CONVERGED
    if not found.converged:
        outcome = Outcome.NOT_CONVERGED
    seen = int(np.count_nonzero(texture.seen))
    region = Region("", seen, 0.1, float("nan"), None, None, outcome)
    sentence = _matte_ambiguity(found, texture_config.prior)
    surface = Surface(
        texture,
        (region,),
        np.zeros(sites.count, int),
        noise,
        outcome,
        (sentence,),
        _MATTE_GAUGE,
        sentence,
        Light(found.light, None),
    )
    return surface, _lobes(surface, facets_of(config.brdf), observations.samples)


def _matte_ambiguity(found: DiffuseFactors, prior: str) -> str:
    untold, every = int(found.untold.sum(axis=1).max()), found.untold.shape[1]
    return (
        "light and texture are both unknown: photographs of a matte object tell its texture up to "
        "a factor that depends on the normal alone and has no degrees above those of irradiance "
        f"(T 6.1.1, class 6); {untold} of {every} directions of the light are not told, and these "
        f"values are those that the prior '{prior}' picks ({_MATTE_GAUGE})"
    )


def _matte_errors(
    problem: DiffuseProblem, found: DiffuseFactors
) -> Float[np.ndarray, "site channel"]:
    """Compute standard errors under the light that was picked."""
    weights, measured = problem.log_error**-2, problem.measured
    total = np.stack([np.bincount(measured.site, w, measured.count) for w in weights.T], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(total > 0, np.nan_to_num(found.texture) / np.sqrt(total), np.inf)


def _texture(material: tuple[SiteMaterial, SiteMaterial], seen: np.ndarray) -> Texture:
    """Lay out a texture, values and errors, whose misfit and marks are still open."""
    values, errors = material
    nothing = np.full(len(seen), np.nan)
    marks = np.zeros(len(seen), bool)
    kd, ks, kd_error, ks_error = (np.asarray(part) for part in (*values, *errors))
    return Texture(kd, ks, kd_error, ks_error, nothing, seen, marks, marks, 0.0)


def _lobes(surface: Surface, variant: Microfacet, samples: SurfaceSamples) -> Lobes:
    assert surface.light is not None
    region = surface.regions[0]
    mu = None if variant.mu is None else region.mu
    lobe = variant.with_roughness(region.sigma, mu)
    return lobes_of(lobe, samples, model_under(surface.light))


def _noise_left(
    observations: Observations, surface: Surface, lobes: Lobes, sites: SurfaceSites
) -> NoiseModel:
    """Estimate the noise, making up for what each site's material has fitted away."""
    radiance = np.asarray(observations.radiance)
    predicted = lobes.radiance(surface.texture, sites.of_observation)
    seen = np.where(sites.of_observation >= 0, surface.texture.seen[sites.of_observation], 0)
    channels = radiance.shape[1]
    measured, fitted = seen * channels, channels + 1
    told = (measured > fitted) & (predicted > 0).all(axis=1)
    inflation = np.sqrt(measured[told] / (measured[told] - fitted))[:, None]
    return estimate_noise((radiance - predicted)[told] * inflation, predicted[told])


def _judged(
    surface: Surface, lobes: Lobes, observations: Observations, sites: SurfaceSites
) -> Surface:
    """Add each site's misfit and marks, and what is left unexplained of all."""
    radiance, texture = np.asarray(observations.radiance), surface.texture
    site = sites.of_observation
    off = (radiance - lobes.radiance(texture, site))[site >= 0]
    known = site[site >= 0]
    level = np.maximum(radiance[site >= 0] - off, 0)
    deviation = np.asarray(surface.noise.standard_deviation(level)) + 1e-12
    squares = np.sum((off / deviation) ** 2, axis=1)
    channels = radiance.shape[1]
    freedom = np.maximum(texture.seen * channels - channels - 1, 1)
    total = np.bincount(known, squares, sites.count)
    misfit = np.where(texture.seen > 0, np.sqrt(total / freedom), np.nan)
    energy = float(np.sum(radiance[site >= 0] ** 2))
    error = texture.relative_error
    left = float(np.sqrt(np.sum(off**2) / energy)) if energy > 0 else 0.0
    if left > _MUCH_LEFT:
        assert surface.light is not None
        limit = int(np.sqrt(len(surface.light.coefficients))) - 1
        much = (
            f"{100 * left:.0f} % of the photographs is left unexplained: light to degree {limit} "
            "is too soft for what lit the object, such as lamps, or the surface is not as "
            "supposed; give the light, or another solve.band_limit"
        )
        surface = surface._replace(outcome=Outcome.NOT_CONVERGED, reasons=(much, *surface.reasons))
    return surface._replace(
        texture=texture._replace(
            misfit=misfit,
            kd_marked=~(error <= TRUSTED_ERROR) | ~(misfit <= TRUSTED_MISFIT),
            ks_marked=~(NORMAL_90 * texture.ks_error <= IDENTIFIABLE_WITHIN * texture.ks),
            relative_rms=left,
        )
    )
