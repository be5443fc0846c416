"""What a finished result can be rendered as: one material, a texture, or a BRDF as coefficients."""

import abc
from pathlib import Path

import numpy as np

from jaxrender.brdf import Microfacet, Parametric, material_named
from jaxrender.errors import InputError
from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.geometry.texels import surface_sites
from jaxrender.inverse.brdf_spectrum import HarmonicBRDF
from jaxrender.inverse.texture import texture_columns
from jaxrender.io.netcdf import opened
from jaxrender.pipelines.brdf_spectrum import read_spectrum
from jaxrender.pipelines.result import ARRAYS, ARRAYS_FORMAT, FinishedRun
from jaxrender.pipelines.scene import lobe_of
from jaxrender.reflection import ForwardModel, ShadowedModel, render_view, sensitivities
from jaxrender.shapes import Float

# An image of a light is summed as finely as a lobe of this part of the finest wave asks for.
_WIDTH_PER_WAVE = 0.5


class Subject(abc.ABC):
    """A surface that can be rendered.

    ``lobe`` is the material for which a light is prepared; None where there is no lobe.  ``width``
    is the width of the finest detail, in radians.
    """

    lobe: Parametric | None
    width: float

    @abc.abstractmethod
    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render a view; zero where nothing is hit."""

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Name the amplitudes of the lobe."""
        return () if self.lobe is None else self.lobe.amplitude_names

    @property
    def numbers(self) -> tuple[str, ...]:
        """Name the numbers of the lobe."""
        return () if self.lobe is None else tuple(self.lobe.numbers)

    def slopes(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "pixel number channel"] | None:
        """Differentiate by amplitudes and numbers; None where it has none of these."""
        return None


class UniformSubject(Subject):
    """One material everywhere."""

    def __init__(self, lobe: Parametric):
        self.lobe, self.width = lobe, float(lobe.width)

    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render a view."""
        assert self.lobe is not None
        return np.asarray(render_view(self.lobe, view, model))

    def slopes(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "pixel number channel"]:
        """Differentiate by amplitudes and numbers."""
        assert self.lobe is not None
        return np.asarray(sensitivities(self.lobe, view, model))


class SpectrumSubject(Subject):
    """A BRDF known by coefficients.  The series may ring; negative radiance is shown black."""

    def __init__(self, folder: Path):
        spectrum = read_spectrum(folder / ARRAYS)
        self.lobe, self.brdf = None, HarmonicBRDF.of(spectrum)
        self.width = _WIDTH_PER_WAVE * np.pi / max(spectrum.basis.band_limit, 1)

    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render a view."""
        return np.maximum(render_view(self.brdf, view, model), 0)


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
        size = ks.shape if ks.ndim == 2 else (1, 1)
        self.shape, self.size = shape, (int(size[0]), int(size[1]))
        self.kd = np.nan_to_num(kd.reshape(-1, kd.shape[-1]))
        self.ks, self.region = np.nan_to_num(ks.ravel()), region.ravel()
        variant = lobe_of(run.config.brdf)
        assert isinstance(variant, Microfacet)
        self.lobes = [
            variant.with_roughness(float(s), None if variant.mu is None else float(m))
            for s, m in zip(sigmas, mus)
        ]
        seen = np.isfinite(kd.reshape(-1, kd.shape[-1])).all(axis=1)
        self.regions = np.unique(self.region[seen])
        self.width = float(sigmas.min() if own is None else np.nanmin(own))
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
        values = np.zeros((len(site), self.kd.shape[1]))
        places = SurfacePlaces.of_views([view])
        for number, lobe in zip(self.regions, self.lobes):
            rows = np.flatnonzero(self.region[site] == number)
            if not rows.size:
                continue
            samples = SurfaceSamples(view.normals[view.hit][rows], view.outgoing[view.hit][rows])
            own = SurfacePlaces(*(part[rows] for part in places))
            widths = None if self.sigma is None else self.sigma[site[rows]]
            columns = texture_columns(lobe, samples, model, own, widths)
            kd, ks = self.kd[site[rows]], self.ks[site[rows]][:, None]
            values[rows] = kd * columns.diffuse + ks * columns.specular
        image = np.zeros((*view.hit.shape, values.shape[1]))
        image[view.hit] = values
        return image


def subject_of(run: FinishedRun, shape: Shape) -> Subject:
    """Make what a finished run has recovered."""
    if run.config.task == "texture":
        return TexturedSubject(run, shape)
    if run.config.task == "brdf-spectrum":
        return SpectrumSubject(run.folder)
    brdf = run.summary["brdf"]
    return UniformSubject(material_named(brdf["model"], brdf))
