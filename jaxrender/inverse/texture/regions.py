"""A texture under known light whose materials lie in regions: each region by itself (T 6.13)."""

from typing import NamedTuple, TypeVar

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.models import DiffuseModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import concave
from jaxrender.inverse.stated import Stated
from jaxrender.inverse.texture.account import TextureFit
from jaxrender.inverse.texture.calibrate import End, recovered
from jaxrender.inverse.texture.estimate import (
    TextureEstimate,
    facets_of,
    worst_outcome,
)
from jaxrender.inverse.texture.examination import Painted
from jaxrender.inverse.texture.fit import fit_texture
from jaxrender.inverse.texture.forward import Forward, ModelOf
from jaxrender.inverse.texture.known_light import forward_under, recover_texture
from jaxrender.inverse.texture.measurements import by_site
from jaxrender.inverse.texture.region_lobe import RegionLobe
from jaxrender.inverse.texture.rounds import TextureSettings
from jaxrender.inverse.texture.site_numbers import NormalMap
from jaxrender.inverse.texture.sites import SurfaceSites
from jaxrender.inverse.texture.varying import SigmaField, SigmaMap
from jaxrender.inverse.transfer_field import with_field
from jaxrender.inverse.unknown_material import UnknownMaterial
from jaxrender.inverse.unknowns import unknowns_of
from jaxrender.shapes import Bool, Int

_Map = TypeVar("_Map", SigmaMap, NormalMap)
# A lobe that nothing asks about: diffuse paint has none.
_NO_LOBE = 0.1


class _Found(NamedTuple):
    """What was found of one region."""

    lobe: RegionLobe
    fit: TextureFit


def under_known_light(
    observations: Observations,
    sites: SurfaceSites,
    light: KnownLight,
    material: UnknownMaterial,
    settings: TextureSettings | None = None,
    control_points: int = 0,
) -> TextureEstimate:
    """Recover the texture of each region by itself, and put them together.

    ``observations`` are all usable pixels of the photographs that ``sites`` are of.  With
    ``control_points`` sigma varies slowly over each region.  Raises ``ValueError`` for models that
    are not of facets, and for settings that diffuse paint does not use.  Raises it, too, where
    nothing is identifiable, such as for sites that are seen only once.
    """
    settings, variant = settings or TextureSettings(), facets_of(material)
    diffuse = material.model == "lambertian"
    if diffuse:
        _check_diffuse(settings, control_points)
    if concave(sites.shape) is not None:
        observations = with_field(observations, sites.shape, light.diffuse_degrees)
    regions, found = sites.regions, []
    if settings.free and len(regions.names) > 1:
        raise ValueError(
            f"{len(regions.names)} regions: nuisances are freed where the surface has one material "
            "alone; leave free out, or the regions"
        )
    texture, variation, normals = None, None, None
    for number, name in enumerate(regions.names):
        site = sites.of_region(number)
        if not (site >= 0).any():
            continue
        if diffuse:
            fit = _diffuse(observations, site, sites, light, variant, settings)
        else:
            field = _field(sites, site, control_points) if control_points else None
            fit = recover_texture(
                observations,
                site,
                sites.count,
                light,
                variant,
                unknowns=material.unknowns(),
                settings=settings,
                shape=sites.shape,
                field=field,
                sites=sites,
            )
        own = regions.of_site == number
        texture = fit.texture if texture is None else texture.with_sites(own, fit.texture)
        variation = _joined(variation, fit.variation, own)
        normals = _joined(normals, fit.lobe.normals, own)
        seen = int(np.count_nonzero(fit.texture.seen))
        sigma_error, mu_error = (None, None) if diffuse else (fit.sigma_error, fit.mu_error)
        lobe = RegionLobe(
            number,
            name,
            seen,
            fit.sigma,
            fit.mu,
            sigma_error,
            mu_error,
            fit.outcome,
            None if diffuse else fit.if_exact,
        )
        found.append(_Found(lobe, fit))
    if texture is None:
        raise ValueError("no observation has a site: do the cameras see the textured surface?")
    largest = max(found, key=lambda one: one.lobe.sites).fit
    return TextureEstimate(
        material,
        texture,
        tuple(one.lobe for one in found),
        sites,
        largest.noise,
        worst_outcome([one.lobe.outcome for one in found]),
        tuple(reason for one in found for reason in _reasons(one)),
        variation=variation,
        normals=normals,
        maps=settings.maps,
        misfit=largest.misfit,
        diagnosis=largest.diagnosis,
        calibration=largest.calibration,
    )


def _reasons(found: _Found) -> list[str]:
    where = f" in region {found.lobe.name}" if found.lobe.name else ""
    return [f"{reason}{where}" for reason in found.fit.reasons]


def _check_diffuse(settings: TextureSettings, control_points: int) -> None:
    usual = TextureSettings()
    for name in ("method", "starts", "exact_samples"):
        if getattr(settings, name) != getattr(usual, name):
            raise ValueError(
                f"{name}={getattr(settings, name)!r}: diffuse paint is found without a search and "
                "without refinement; leave it out"
            )
    if settings.maps:
        raise ValueError(
            f"maps={', '.join(settings.maps)}: diffuse paint has K_d alone; leave maps out, or "
            "choose a model with a specular lobe"
        )
    if control_points:
        raise ValueError(
            f"control_points={control_points}: diffuse paint has no sigma that could vary; leave "
            "it out, or choose a model with a specular lobe"
        )


def _field(sites: SurfaceSites, site: Int[np.ndarray, "sample"], control_points: int) -> SigmaField:
    """Spread control points over the sites of a region, no more than these are."""
    own = np.zeros(sites.count, bool)
    own[site[site >= 0]] = True
    places = np.where(own[:, None], sites.places, np.nan)
    return SigmaField.over(places, min(control_points, int(own.sum())))


def _joined(before: _Map | None, own: _Map | None, chosen: Bool[np.ndarray, "site"]) -> _Map | None:
    """Add a region's sigma, or its normals, to those of the regions before it."""
    if own is None or before is None:
        return own
    return type(own)(
        *(
            np.where(chosen[:, None] if np.ndim(new) == 2 else chosen, new, old)
            for new, old in zip(own, before)
        )
    )


def _diffuse(
    observations: Observations,
    site: Int[np.ndarray, "sample"],
    sites: SurfaceSites,
    light: KnownLight,
    variant: Microfacet,
    settings: TextureSettings,
) -> TextureFit:
    """Divide by the irradiance (T 6.1.1, class 1), each site by all its observations."""
    reach, shape = (_NO_LOBE, 1.01 * _NO_LOBE), concave(sites.shape)
    unknowns = unknowns_of(variant.as_metal(), {"sigma": Stated(fixed=_NO_LOBE)})

    def refit(
        observations: Observations, site: Int[np.ndarray, "sample"], light: KnownLight
    ) -> End:
        if shape is not None:
            observations = with_field(observations, shape, light.diffuse_degrees)
        forward = forward_under(
            light, observations, variant, _NO_LOBE, reach, exact=False, shape=shape
        )
        without_specular = Forward(*(_without_specular(forward.final) for _ in range(2)))
        fit = fit_texture(
            by_site(observations, site, sites.count), without_specular, unknowns, settings
        )
        final, seed = without_specular.final, settings.seed
        return End(Painted(observations, site, light, variant, sites.shape, final, seed), fit)

    return recovered(observations, site, light, refit, settings, sites)


def _without_specular(model_of: ModelOf) -> ModelOf:
    return lambda index: DiffuseModel(model_of(index))
