"""A textured object's recovery, from observations to what its result folder is made from."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.known_light import prepare_light
from jaxrender.inverse.photographs import Photograph
from jaxrender.inverse.texture import Texture
from jaxrender.inverse.transfer_field import TransferField
from jaxrender.io import write_environment
from jaxrender.io.netcdf import Group
from jaxrender.lighting import positive_environment
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig, TextureConfig
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.recovery import Recovery
from jaxrender.pipelines.result import Result
from jaxrender.pipelines.scene import fault_of
from jaxrender.pipelines.shadows import transfer_field
from jaxrender.pipelines.texture.files import (
    map_images,
    marks_image,
    texture_groups,
    write_maps,
)
from jaxrender.pipelines.texture.known_light import under_known_light
from jaxrender.pipelines.texture.sites import SurfaceSites, regions_of, sites_of
from jaxrender.pipelines.texture.summary import sentence_on, summary_of_surface
from jaxrender.pipelines.texture.surface import Region, Surface, facets_of, lobes_of
from jaxrender.pipelines.texture.unknown_light import model_under, under_unknown_light
from jaxrender.reflection import (
    FACETS,
    DualForward,
    ForwardModel,
    ShadowedDual,
    ShadowedModel,
    dual_light,
)
from jaxrender.shapes import Float, Int

# Rows of a recovered light's image.
_ROWS = 64


class Known(NamedTuple):
    """What a texture is recovered under: the light (None: unknown) and shadows of the shape."""

    light: KnownLight | None
    transfer: TransferField | None


class _Pixels(NamedTuple):
    """All pixels of all photographs that show the object, one after the other."""

    samples: SurfaceSamples
    places: SurfacePlaces
    frame: Int[np.ndarray, "pixel"]
    site: Int[np.ndarray, "pixel"]


class TextureRecovery(Recovery):
    """A recovered texture."""

    def __init__(
        self,
        config: RunConfig,
        surface: Surface,
        sites: SurfaceSites,
        known: tuple[Known, Observations],
        photographs: list[Photograph],
    ):
        self.config, self.surface, self.sites = config, surface, sites
        (self.known, self.observations), self.photographs = known, photographs

    @property
    def texture(self) -> Texture:
        """What is known of every site."""
        return self.surface.texture

    def result(self) -> Result:
        """Sum up the texture."""
        files = ("kd", "ks", "kd_error", "ks_error")
        if self.surface.variation is not None:
            files = (*files, "sigma", "sigma_error")
        named = {name: f"textures/{name}.exr" for name in files} | {"marks": "textures/marks.png"}
        if self.sites.image is None:
            named = {"vertices": "textures/vertices.ply"}
        return summary_of_surface(self.config, self.surface, self.sites, self.photographs, named)

    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph with the recovered texture, by the dual model."""
        pixels = self._pixels()
        values = np.zeros((len(pixels.site), self.texture.kd.shape[1]))
        for number, region in enumerate(self.surface.regions):
            own = self._region_of(pixels.site, number)
            for rows, model in self._models(region, pixels, own):
                samples = SurfaceSamples(*(part[rows] for part in pixels.samples))
                places = SurfacePlaces(*(part[rows] for part in pixels.places))
                widths = self._widths(pixels.site[rows])
                lobes = lobes_of(self._lobe(region), samples, model, places, widths)
                values[rows] = lobes.radiance(self.texture, pixels.site[rows])
        images = []
        for number, photograph in enumerate(self.photographs):
            image = np.zeros((*photograph.view.hit.shape, values.shape[1]))
            image[photograph.view.hit] = np.maximum(values[pixels.frame == number], 0)
            images.append(image)
        return images

    def arrays(self) -> dict[str, Group]:
        """Lay out every site, the lobe of each region, and the light if it was recovered."""
        return texture_groups(self.surface, self.sites)

    def write_images(self, folder: Path) -> None:
        """Write the maps, and the light."""
        reach = (self.config.texture or TextureConfig()).dilate
        write_maps(folder, self.surface, self.sites, reach)
        if self.surface.light is not None:
            light = positive_environment(*self.surface.light, _ROWS)
            write_environment(folder / "lighting.exr", light)
            write_environment(folder / "lighting_slow.exr", light)
        elif self.known.light is not None and self.known.light.environment is not None:
            write_environment(folder / "lighting.exr", self.known.light.environment)

    def contents(self, title: str, result: dict[str, Any], frames: tuple) -> Any:
        """Gather what the report shows."""
        from jaxrender.pipelines.report import TextureContents

        maps = None
        if self.sites.image is not None:
            maps = {**map_images(self.surface, self.sites)}
            maps["marks"] = marks_image(self.texture, self.sites)
        light = self.surface.light
        coefficients = None if light is None else light.coefficients
        return TextureContents(title, result, maps, coefficients, frames)

    def _pixels(self) -> _Pixels:
        views = [photograph.view for photograph in self.photographs]
        hits = [view.hit for view in views]
        samples = SurfaceSamples(
            np.concatenate([view.normals[hit] for view, hit in zip(views, hits)]),
            np.concatenate([view.outgoing[hit] for view, hit in zip(views, hits)]),
        )
        frame = np.repeat(np.arange(len(views)), [int(hit.sum()) for hit in hits])
        site = np.concatenate([s[hit] for s, hit in zip(self.sites.of_photograph, hits)])
        return _Pixels(samples, SurfacePlaces.of_views(views), frame, site)

    def _region_of(self, site: Int[np.ndarray, "pixel"], number: int) -> np.ndarray:
        """Choose the pixels that show a region, by its place among the numbers in use."""
        numbers = np.unique(self.surface.region[self.texture.seen > 0])
        return (site >= 0) & (self.surface.region[site] == numbers[number])

    def _lobe(self, region: Region):
        variant = facets_of(self.config.brdf)
        return variant.with_roughness(region.sigma, None if variant.mu is None else region.mu)

    def _widths(self, site: Int[np.ndarray, "sample"]) -> Float[np.ndarray, "sample"] | None:
        """Look up sigma where it varies; the mean where it is not known, which nothing uses."""
        if self.surface.variation is None:
            return None
        sigma = self.surface.variation.sigma
        return np.nan_to_num(sigma, nan=float(np.nanmean(sigma)))[site]

    def _models(
        self, region: Region, pixels: _Pixels, own: np.ndarray
    ) -> list[tuple[np.ndarray, ForwardModel | ShadowedModel]]:
        """List rows of pixels with the light that they are under."""
        light = self.known.light
        if light is None:
            assert self.surface.light is not None
            return [(np.flatnonzero(own), model_under(self.surface.light))]
        brdf, transfer = self._lobe(region).as_metal(), "exit-cosine"
        if self.surface.variation is not None:
            brdf = brdf.with_roughness(float(np.nanmin(self.surface.variation.sigma)))
        if self.known.transfer is None and self.config.solve.refine == "exact":
            # As the sites were solved.
            transfer = FACETS
        prepared = prepare_light(light, self.observations, brdf, "auto", None, transfer=transfer)

        def model(number: int) -> ForwardModel | ShadowedModel:
            sources = light.sources_of(number)
            dual = dual_light(prepared.split, sources, prepared.dual.band_limit)
            field = self.known.transfer
            if field is None:
                return DualForward(dual, transfer)
            return ShadowedDual(field.shape, dual, field.at)

        if light.per_frame is None:
            return [(np.flatnonzero(own), model(0))]
        return [
            (np.flatnonzero(own & (pixels.frame == number)), model(number))
            for number in range(len(self.photographs))
        ]


def recover_surface(
    config: RunConfig,
    known: tuple[Observations, KnownLight | None],
    seen: tuple[list[Photograph], Shape],
    clock: Clock,
    progress: Progress,
) -> TextureRecovery:
    """Recover the material of every texel or vertex; the observations are all usable pixels.

    Raises ``InputError`` where nothing can be told.
    """
    (observations, light), (photographs, shape) = known, seen
    texture = config.texture or TextureConfig()
    place = str(config.capture.transforms)
    with fault_of(place):
        sites = sites_of(shape, photographs, texture)
    progress.note(f"texture: {sites.sentence}")
    field = None
    if light is not None and not shape.is_convex():
        with clock.stage("shadows"):
            places = observations.count
            places += sum(int(np.count_nonzero(p.view.hit)) for p in photographs)
            field = transfer_field(shape, light.diffuse_degrees, places)
            observations = field.of_observations(observations)
    with clock.stage("texture"), fault_of(place):
        if light is None:
            surface = under_unknown_light(config, observations, sites)
        else:
            regions = regions_of(texture.regions, sites)
            surface = under_known_light(config, observations, light, sites, regions)
    recovery = TextureRecovery(
        config, surface, sites, (Known(light, field), observations), photographs
    )
    progress.note(sentence_on(recovery.result().own["texture"]))
    return recovery
