"""A recovered texture as something that can be rendered."""

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.errors import InputError
from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.geometry.texels import surface_sites
from jaxrender.inverse.texture import NormalMap, finest_of, texture_columns
from jaxrender.io.netcdf import Reader, opened
from jaxrender.pipelines.result import ARRAYS, ARRAYS_FORMAT, FinishedRun
from jaxrender.pipelines.scene import lobe_of
from jaxrender.pipelines.subject import Subject
from jaxrender.pipelines.tasks.texture.asked import asked_maps
from jaxrender.reflection import ForwardModel, ShadowedModel
from jaxrender.shapes import Float


class TexturedSubject(Subject):
    """A material for every texel or vertex, with one lobe for each region; unseen sites are black.

    Raises ``InputError`` where the result's arrays have gone or are damaged.
    """

    def __init__(self, run: FinishedRun, shape: Shape):
        with opened(run.folder / ARRAYS, ARRAYS_FORMAT) as file:
            group, lobe = file.group("texture"), file.group("lobe")
            kd, ks, region = (group.array(name) for name in ("kd", "ks", "region"))
            sigmas, mus = (lobe.array(name, ("region",)) for name in ("sigma", "mu"))
            own = group.array("sigma").ravel() if "sigma" in group else None
            self.normals = _normals(group)
        size = region.shape if region.ndim == 2 else (1, 1)
        self.shape, self.size = shape, (int(size[0]), int(size[1]))
        self.kd = np.nan_to_num(kd.reshape(-1, kd.shape[-1]))
        self.ks = np.nan_to_num(ks.reshape(region.size, -1))
        self.region = region.ravel()
        variant = lobe_of(run.config.brdf)
        assert isinstance(variant, Microfacet)
        self.lobes = [
            variant.with_roughness(float(s), None if variant.mu is None else float(m))
            for s, m in zip(sigmas, mus)
        ]
        seen = np.isfinite(kd.reshape(-1, kd.shape[-1])).all(axis=1)
        self.regions = np.unique(self.region[seen])
        maps = () if run.config.texture is None else asked_maps(run.config.texture)
        # What the light is split for.
        self.width = float(sigmas.min()) if own is None else finest_of(own, maps)
        self.lobe = self.lobes[int(np.argmin(sigmas))]
        # Only where sigma varies.  An unseen site is black at any sigma.
        self.sigma = None if own is None else np.nan_to_num(own, nan=float(np.nanmean(own)))
        self.lobe = self.lobe.with_roughness(self.width, self.lobe.mu)

    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render B = K_d(x) D + K_s(x) S (T 6.13)."""
        found = surface_sites(self.shape, view, self.size)
        if found.count != len(self.ks):
            raise InputError(
                f"{found.sentence} of the shape, {len(self.ks)} in the result: its geometry has "
                "changed since; run fit again with --force"
            )
        site = found.of_pixel[view.hit]
        normals = np.asarray(view.normals[view.hit])
        if self.normals is not None:
            normals = self.normals.tilted(normals, site)
        values = np.zeros((len(site), self.kd.shape[1]))
        places = SurfacePlaces.of_views([view])
        for number, lobe in zip(self.regions, self.lobes):
            rows = np.flatnonzero(self.region[site] == number)
            if not rows.size:
                continue
            samples = SurfaceSamples(normals[rows], view.outgoing[view.hit][rows])
            own = SurfacePlaces(*(part[rows] for part in places))
            widths = None if self.sigma is None else self.sigma[site[rows]]
            columns = texture_columns(lobe, samples, model, own, widths)
            kd, ks = self.kd[site[rows]], self.ks[site[rows]]
            values[rows] = kd * columns.diffuse + ks * columns.specular
        image = np.zeros((*view.hit.shape, values.shape[1]))
        image[view.hit] = values
        return image


def _normals(group: Reader) -> NormalMap | None:
    """Read what sites add to the shape's normals, where they do."""
    if "normal_offset" not in group:
        return None
    offset, normal = (group.array(name).reshape(-1, 3) for name in ("normal_offset", "normal"))
    return NormalMap(offset, normal, group.array("normal_error").ravel())
