"""Photographs predicted by a recovered texture, with the model that its sites were solved by."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.prepared_light import prepare_light
from jaxrender.inverse.texture.columns import texture_columns
from jaxrender.inverse.texture.estimate import TextureEstimate
from jaxrender.inverse.texture.known_light import finest_of, most_cells, site_cells
from jaxrender.inverse.texture.region_lobe import RegionLobe
from jaxrender.inverse.texture.sites import SurfaceSites
from jaxrender.inverse.texture.unknown_light import model_under
from jaxrender.inverse.transfer_field import TransferField
from jaxrender.lighting import LightNodes
from jaxrender.reflection import (
    FACETS,
    DualForward,
    ExactForward,
    ForwardModel,
    FrameNodes,
    NearForward,
    ShadowedDual,
    ShadowedModel,
    dual_light,
)
from jaxrender.shapes import Bool, Float, Int

# The model of the light of one photograph, by its number.
ModelOf = Callable[[int], ForwardModel | ShadowedModel]


class LitTexture(NamedTuple):
    """A texture under the light that it was recovered under.

    ``observations`` are those that it was recovered from, and ``light`` None where that was
    recovered as well.  ``exact`` says whether the sites were solved on the integral wherever the
    light has few enough cells.  ``transfer`` are the transfer vectors of a concave shape.
    """

    estimate: TextureEstimate
    observations: Observations
    light: KnownLight | None
    exact: bool = True
    transfer: TransferField | None = None

    def predict(
        self, views: Sequence[SurfaceView]
    ) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph, given what its camera sees, as the sites were solved."""
        pixels = _Pixels.of(views, self.estimate.sites)
        if self.estimate.normals is not None:
            tilted = self.estimate.normals.tilted(pixels.samples.normals, pixels.site)
            pixels = pixels._replace(samples=pixels.samples._replace(normals=tilted))
        values = np.zeros((len(pixels.site), self.estimate.texture.kd.shape[1]))
        for lobe in self.estimate.lobes:
            own = pixels.site >= 0
            own &= self.estimate.sites.regions.of_site[pixels.site] == lobe.number
            model_of = self._model_of(lobe)
            for number, rows in self._by_light(pixels, own, len(views)):
                samples = SurfaceSamples(*(part[rows] for part in pixels.samples))
                places = SurfacePlaces(*(part[rows] for part in pixels.places))
                site = pixels.site[rows]
                columns = texture_columns(
                    self.estimate.brdf_of(lobe),
                    samples,
                    model_of(number),
                    places,
                    self._widths(site),
                )
                values[rows] = self.estimate.texture.radiance(columns, site)
        images = []
        for number, view in enumerate(views):
            image = np.zeros((*view.hit.shape, values.shape[1]))
            image[view.hit] = np.maximum(values[pixels.frame == number], 0)
            images.append(image)
        return images

    def _by_light(
        self, pixels: "_Pixels", own: Bool[np.ndarray, "pixel"], frames: int
    ) -> list[tuple[int, Int[np.ndarray, "row"]]]:
        """List photographs that have a light of their own, or one for all, with their pixels."""
        if self.light is None or self.light.per_frame is None:
            return [(0, np.flatnonzero(own))]
        return [
            (number, np.flatnonzero(own & (pixels.frame == number))) for number in range(frames)
        ]

    def _model_of(self, lobe: RegionLobe) -> ModelOf:
        """Split the light as it was split for the sites of this lobe."""
        light, field = self.light, self.transfer
        if light is None:
            assert self.estimate.light is not None
            found = model_under(self.estimate.light, self.exact)
            return lambda number: found
        brdf, transfer = self.estimate.brdf_of(lobe).as_metal(), "exit-cosine"
        maps = self.estimate.maps
        if self.estimate.variation is not None:
            brdf = brdf.with_roughness(finest_of(self.estimate.variation.sigma, maps))
        if field is None and self.exact:
            # As the sites were solved.
            most = most_cells(self.observations.count, maps)
            if site_cells(light, None, float(brdf.sigma), most) is not None:
                far, finest = light.distant, float(brdf.sigma)
                cells = None if far is None else site_cells(far, None, finest, most)

                def exact(number: int) -> ForwardModel | ShadowedModel:
                    others = None if cells is None else _integral(cells, number)
                    return self._beside_points(others, number)

                return exact
            transfer = FACETS
        prepared = prepare_light(light, self.observations, brdf, "auto", None, transfer=transfer)

        def model(number: int) -> ForwardModel | ShadowedModel:
            sources = light.far_of(number)
            dual = dual_light(prepared.split, sources, prepared.dual.band_limit)
            if field is None:
                return self._beside_points(DualForward(dual, transfer), number)
            return self._beside_points(ShadowedDual(field.shape, dual, field.at), number)

        return model

    def _beside_points(
        self, others: ForwardModel | ShadowedModel | None, number: int
    ) -> ForwardModel | ShadowedModel:
        """Add the sources of a photograph that have a place, if there are any."""
        points = None if self.light is None else self.light.points_of(number)
        if points is None:
            assert others is not None
            return others
        return NearForward(points, others, None if self.transfer is None else self.transfer.shape)

    def _widths(self, site: Int[np.ndarray, "sample"]) -> Float[np.ndarray, "sample"] | None:
        """Look up sigma where it varies; the mean where it is not known, which nothing uses."""
        if self.estimate.variation is None:
            return None
        sigma = self.estimate.variation.sigma
        return np.nan_to_num(sigma, nan=float(np.nanmean(sigma)))[site]


def _integral(cells: Sequence[LightNodes | FrameNodes], number: int) -> ExactForward:
    """Sum over what lights one photograph."""
    own = [
        (part.directions[number], part.irradiance[number])
        if isinstance(part, FrameNodes)
        else tuple(part)
        for part in cells
    ]
    directions, irradiance = (jnp.asarray(np.concatenate(parts)) for parts in zip(*own))
    return ExactForward(LightNodes(directions, irradiance))


class _Pixels(NamedTuple):
    """All pixels of all photographs that show the object, one after the other."""

    samples: SurfaceSamples
    places: SurfacePlaces
    frame: Int[np.ndarray, "pixel"]
    site: Int[np.ndarray, "pixel"]

    @classmethod
    def of(cls, views: Sequence[SurfaceView], sites: SurfaceSites) -> "_Pixels":
        hits = [view.hit for view in views]
        samples = SurfaceSamples(
            np.concatenate([view.normals[hit] for view, hit in zip(views, hits)]),
            np.concatenate([view.outgoing[hit] for view, hit in zip(views, hits)]),
        )
        frame = np.repeat(np.arange(len(views)), [int(hit.sum()) for hit in hits])
        site = np.concatenate([sites.of_view(view)[view.hit] for view in views])
        return cls(samples, SurfacePlaces.of_views(views), frame, site)
