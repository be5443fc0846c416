"""A texture under known light: each region's sigma and mu, then every site (T 6.13)."""

import numpy as np

from jaxrender import inverse
from jaxrender.brdf import Microfacet
from jaxrender.geometry import Shape
from jaxrender.inverse import KnownLight, Observations, Told
from jaxrender.inverse.models import MatteModel
from jaxrender.inverse.shadowing import concave
from jaxrender.inverse.texture import (
    Forward,
    SigmaField,
    SigmaMap,
    TextureFit,
    TextureSettings,
    by_site,
    fit_texture,
    forward_under,
    recover_texture,
)
from jaxrender.pipelines.config import RunConfig, TextureConfig
from jaxrender.pipelines.scene import settings_of, unknowns_of
from jaxrender.pipelines.texture.sites import SurfaceSites
from jaxrender.pipelines.texture.surface import Region, Surface, facets_of, worst_outcome
from jaxrender.shapes import Bool, Int

# A lobe that nothing asks about: matte paint has none.
_NO_LOBE = 0.1
_METHODS = {"variable-projection": "joint", "simplex": "thesis"}


def texture_settings(config: RunConfig) -> TextureSettings:
    """Translate how a texture is to be found."""
    settings = settings_of(config)
    return TextureSettings(
        settings.noise,
        _METHODS[settings.method],
        settings.starts,
        config.samples.count,
        settings.refine_samples,
        settings.seed,
    )


def under_known_light(
    config: RunConfig,
    observations: Observations,
    light: KnownLight,
    sites: SurfaceSites,
    regions: tuple[Int[np.ndarray, "site"], list[str]],
) -> Surface:
    """Recover every region by itself and put them together.

    Raises ``ValueError`` where nothing can be told, such as for sites that are seen only once.
    """
    region, names = regions
    texture, variation, found, reasons = None, None, [], []
    for number, name in enumerate(names):
        own = (sites.of_observation >= 0) & (region[sites.of_observation] == number)
        if not own.any():
            continue
        site = np.where(own, sites.of_observation, -1)
        fit = _fit(config, observations, light, (site, sites))
        texture = (
            fit.texture if texture is None else texture.with_sites((region == number), fit.texture)
        )
        variation = _joined(variation, fit.variation, region == number)
        seen = int(np.count_nonzero(fit.texture.seen))
        errors = (fit.sigma_error, fit.mu_error)
        if config.brdf.model == "lambertian":
            errors = (None, None)
        found.append((Region(name, seen, fit.sigma, fit.mu, *errors, fit.outcome), fit))
        reasons += [f"{reason}{f' in region {name}' if name else ''}" for reason in fit.reasons]
    assert texture is not None
    largest = max(found, key=lambda pair: pair[0].sites)[1]
    return Surface(
        texture,
        tuple(pair[0] for pair in found),
        region,
        largest.noise,
        worst_outcome([pair[0].outcome for pair in found]),
        tuple(reasons),
        "given",
        variation=variation,
    )


def _joined(
    before: SigmaMap | None, own: SigmaMap | None, chosen: Bool[np.ndarray, "site"]
) -> SigmaMap | None:
    """Add a region's sigma to those of the regions before it."""
    if own is None or before is None:
        return own
    return SigmaMap(*(np.where(chosen, new, old) for new, old in zip(own, before)))


def _fit(
    config: RunConfig,
    observations: Observations,
    light: KnownLight,
    where: tuple[Int[np.ndarray, "sample"], SurfaceSites],
) -> TextureFit:
    site, sites = where
    variant, settings = facets_of(config.brdf), texture_settings(config)
    shape: Shape | None = concave(sites.shape)
    if config.brdf.model == "lambertian":
        return _fit_matte(observations, light, (variant, settings), where)
    field = None
    texture = config.texture or TextureConfig()
    if texture.sigma == "varying":
        own = np.zeros(sites.count, bool)
        own[site[site >= 0]] = True
        places = np.where(own[:, None], sites.places, np.nan)
        field = SigmaField.over(places, min(texture.control_points, int(own.sum())))
    return recover_texture(
        observations,
        site,
        sites.count,
        light,
        variant,
        unknowns=unknowns_of(config, 0),
        settings=settings,
        exact=config.solve.refine == "exact",
        shape=shape,
        field=field,
    )


def _fit_matte(
    observations: Observations,
    light: KnownLight,
    how: tuple[Microfacet, TextureSettings],
    where: tuple[Int[np.ndarray, "sample"], SurfaceSites],
) -> TextureFit:
    """Divide by the irradiance (T 6.1.1, class 1), each site by all its observations."""
    (variant, settings), (site, sites) = how, where
    reach, shape = (_NO_LOBE, 1.01 * _NO_LOBE), concave(sites.shape)
    forward = forward_under(light, observations, variant, _NO_LOBE, reach, exact=False, shape=shape)
    dark = Forward(*(_darkened(model) for model in (forward.final, forward.final)))
    told = {"sigma": Told(fixed=_NO_LOBE)}
    unknowns = inverse.unknowns_of(variant.as_metal(), told)
    return fit_texture(by_site(observations, site, sites.count), dark, unknowns, settings)


def _darkened(model_of):
    return lambda index: MatteModel(model_of(index))
