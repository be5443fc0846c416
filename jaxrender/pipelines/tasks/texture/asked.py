"""What a config asks of a texture: its sites and regions, and how it is found."""

from collections.abc import Sequence

from jaxrender.errors import InputError
from jaxrender.geometry import Shape
from jaxrender.inverse.photographs import Photograph
from jaxrender.inverse.texture import (
    COLOR,
    METALLIC,
    METALLIC_MAPS,
    SurfaceSites,
    TextureSettings,
    UnknownLightSettings,
    sites_of,
)
from jaxrender.pipelines.config import RunConfig, TextureConfig
from jaxrender.pipelines.scene import settings_of

_METHODS = {"variable-projection": "joint", "simplex": "thesis"}


def texture_of(config: RunConfig) -> TextureConfig:
    """Pick the section of a config; one of defaults where there is none."""
    return config.texture or TextureConfig()


def asked_sites(config: RunConfig, shape: Shape, photographs: Sequence[Photograph]) -> SurfaceSites:
    """Find the sites of the photographs, of as many texels and regions as the config asks for.

    Raises ``InputError`` for settings of texels where the sites are a mesh's vertices, and for a
    picture of regions that cannot be used.
    """
    asked = texture_of(config)
    sites = sites_of(shape, photographs, None if asked.size == "auto" else asked.size)
    if sites.image is None:
        _refuse_what_needs_texels(asked)
    return sites if asked.regions is None else sites.with_regions(asked.regions)


def known_light_settings(config: RunConfig) -> TextureSettings:
    """Translate how a texture is found under known light."""
    settings, samples = settings_of(config), config.samples
    if config.brdf.model == "lambertian":
        return TextureSettings(
            settings.noise,
            search_samples=samples.count,
            seed=settings.seed,
            diagnose=config.solve.diagnose,
            free=config.solve.free,
        )
    if config.brdf.model == METALLIC:
        return TextureSettings(
            settings.noise,
            search_samples=samples.count,
            seed=settings.seed,
            maps=asked_maps(texture_of(config)),
        )
    return TextureSettings(
        settings.noise,
        _METHODS[settings.method],
        settings.starts,
        samples.count,
        settings.refine_samples if settings.refine else 0,
        settings.seed,
        config.solve.diagnose,
        config.solve.free,
        asked_maps(texture_of(config)),
    )


def asked_maps(asked: TextureConfig) -> tuple[str, ...]:
    """Name what each site is to have for itself."""
    wanted = {"sigma": asked.sigma == "map", "normal": asked.normals == "map"}
    wanted[COLOR] = asked.ks == "color"
    wanted |= {name: getattr(asked, name) == "map" for name in METALLIC_MAPS}
    return tuple(name for name, is_wanted in wanted.items() if is_wanted)


def unknown_light_settings(config: RunConfig) -> UnknownLightSettings:
    """Translate how texture and light are found together."""
    settings = settings_of(config)
    diffuse = config.brdf.model == "lambertian"
    return UnknownLightSettings(
        settings.noise,
        settings.band_limit,
        True if diffuse else settings.refine,
        texture_of(config).prior if diffuse else None,
        config.solve.diagnose,
        config.solve.free,
    )


def control_points(config: RunConfig) -> int:
    """How many control points of sigma are asked for; 0 where it does not vary."""
    asked = texture_of(config)
    return asked.control_points if asked.sigma == "varying" else 0


def _refuse_what_needs_texels(config: TextureConfig) -> None:
    for name in ("size", "regions", "dilate"):
        value = getattr(config, name)
        if value != TextureConfig.model_fields[name].default:
            raise InputError(
                f"texture.{name}: found {value}, but the mesh has no texture coordinates, so that "
                "each vertex has a material; remove it, or give a mesh with texture coordinates"
            )
