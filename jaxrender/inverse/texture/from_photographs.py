"""From a scene and its photographs to a texture (T 6.13, 6.1.1).

scene = Scene(unknown("microfacet", mu=1.5), Sphere(), light)
estimate = estimate_texture(scene, load_capture("photos/transforms.json"))
print(estimate)
estimate.save("texture")
"""

from pathlib import Path

import numpy as np

from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.photographs import LoadedCapture, Photograph, observations_of
from jaxrender.inverse.scene import Scene
from jaxrender.inverse.texture.estimate import TextureEstimate
from jaxrender.inverse.texture.metallic_estimate import (
    MetallicEstimate,
    metallic_under_known_light,
)
from jaxrender.inverse.texture.regions import under_known_light
from jaxrender.inverse.texture.rounds import TextureSettings
from jaxrender.inverse.texture.site_numbers import METALLIC, METALLIC_MAPS
from jaxrender.inverse.texture.sites import sites_of
from jaxrender.inverse.texture.unknown_light import UnknownLightSettings, under_unknown_light


def estimate_texture(
    scene: Scene,
    photographs: LoadedCapture,
    settings: TextureSettings | UnknownLightSettings | None = None,
    rows: int | None = None,
    regions: str | Path | None = None,
    control_points: int = 0,
) -> TextureEstimate | MetallicEstimate:
    """Find kd and ks of every texel or vertex, sigma and mu of the lobe, and an unknown light.

    Of the model ``metallic-roughness`` base colour, and what ``settings.maps`` say of roughness and
    metalness, are found under known light.

    ``settings`` are ``UnknownLightSettings`` where the scene has no light, else
    ``TextureSettings``.  ``rows`` of texels are made; None: as many as the photographs are enough
    for.  ``regions`` is a picture over the texture coordinates whose colours tell materials apart.
    With ``control_points`` sigma varies slowly over the surface.

    Raises ``ValueError`` for settings of the other kind, for what a texture cannot honour, and
    where nothing is identifiable; ``InputError`` for photographs and pictures that no fit can use.
    """
    if scene.free_exposure or scene.free_scale:
        raise ValueError(
            "a texture needs known exposures and a light in known units; leave free_exposure and "
            "free_scale out"
        )
    dark = scene.dark
    if isinstance(scene.light, tuple):
        raise ValueError("a texture takes one set of photographs; give one light")
    wrong, kind = (TextureSettings, "known") if dark else (UnknownLightSettings, "unknown")
    if isinstance(settings, wrong):
        right = UnknownLightSettings if dark else TextureSettings
        raise ValueError(f"{wrong.__name__} are for a light that is {kind}; give {right.__name__}")
    seen = photographs.photographs(scene.shape)
    observations, sites = observations_of(seen), sites_of(scene.shape, seen, rows)
    if regions is not None:
        sites = sites.with_regions(regions)
    if not isinstance(settings, TextureSettings) and dark:
        if control_points:
            raise ValueError(
                f"control_points={control_points}: under unknown light the surface has one sigma; "
                "leave it out, or give the light"
            )
        return under_unknown_light(observations, sites, scene.material, settings)
    assert not isinstance(settings, UnknownLightSettings)
    light = _light_of(scene, photographs, seen)
    if scene.material.model == METALLIC:
        if control_points:
            raise ValueError(
                f"control_points={control_points}: {METALLIC} has no sigma; leave it out, or make "
                "roughness a map"
            )
        settings = settings or TextureSettings(maps=tuple(METALLIC_MAPS))
        return metallic_under_known_light(observations, sites, light, scene.material, settings)
    return under_known_light(observations, sites, light, scene.material, settings, control_points)


def _light_of(scene: Scene, loaded: LoadedCapture, seen: list[Photograph]) -> KnownLight:
    """Pick the light of the photographs that were not skipped."""
    channels = np.asarray(seen[0].radiance).shape[-1]
    light = scene.known_light([len(loaded.capture.frames)], channels)
    return light.of_frames(loaded.capture.numbers_of(one.frame.name for one in seen))
