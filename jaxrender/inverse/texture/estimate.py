"""A recovered texture: every site, the lobe of each material, the light if it was found as well."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Mesh
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.any_estimate import AnyEstimate
from jaxrender.inverse.calibration import Calibration
from jaxrender.inverse.diagnosis import Diagnosis
from jaxrender.inverse.intervals import NORMAL_90
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.own_words import plain
from jaxrender.inverse.texture.maps import image_of_sites, write_maps
from jaxrender.inverse.texture.region_lobe import ORIGIN, RegionLobe, interval90
from jaxrender.inverse.texture.site_numbers import NormalMap
from jaxrender.inverse.texture.sites import SurfaceSites
from jaxrender.inverse.texture.texture import Texture
from jaxrender.inverse.texture.varying import SigmaMap
from jaxrender.inverse.texture.view_dependent import LightCoefficients
from jaxrender.inverse.unknown_material import UnknownMaterial
from jaxrender.io import write_mesh
from jaxrender.shapes import Bool, Float

_MAPS = ("kd", "ks", "kd_error", "ks_error")
# Texels by which saved maps are continued beyond what was seen, so that seams do not show.
_REACH = 2


@dataclass(frozen=True, eq=False)
class TextureEstimate(AnyEstimate):
    """A recovered texture, and how well it is known.

    ``values`` have kd [site, channel] and ks [site], or [site, channel] where it has a colour, NaN
    where nothing was seen; sigma and mu of
    the lobe, one for each of ``lobes`` where there are several, and [site] where sigma varies.  Of
    diffuse paint they have kd alone.  What is not to be trusted is marked in ``texture``.
    ``ambiguity`` says up to what the values are known, and is "" where they are absolute;
    ``gauge`` says in what units the light is.  ``light`` is a light that was found, and
    ``variation`` sigma at every site where it varies; a lobe's sigma is then a mean.  ``normals``
    are those of the sites, where ``maps``, which sites have for themselves, say so.
    ``misfit`` is what the photographs of the largest region hold above their noise, and
    ``diagnosis`` what would explain it; ``calibration`` is what was freed of the capture.
    """

    material: UnknownMaterial
    texture: Texture
    lobes: tuple[RegionLobe, ...]
    sites: SurfaceSites
    noise: NoiseModel
    outcome: Outcome
    reasons: tuple[str, ...]
    gauge: str = "given"
    ambiguity: str = ""
    light: LightCoefficients | None = None
    variation: SigmaMap | None = None
    normals: NormalMap | None = None
    maps: tuple[str, ...] = ()
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()
    calibration: Calibration | None = None

    @property
    def title(self) -> str:
        """Name the model."""
        return f"texture of {self.material.model or type(self.material.lobe).__name__}"

    @property
    def diffuse(self) -> bool:
        """Whether the paint was taken to have no specular lobe."""
        return self.material.model == "lambertian"

    @property
    def lobe_names(self) -> tuple[str, ...]:
        """The numbers of the lobe: sigma and mu, sigma alone of a metal, none of diffuse paint."""
        if self.diffuse:
            return ()
        return ("sigma", "mu") if self.material.lobe.mu is not None else ("sigma",)

    @property
    def relative_rms(self) -> float:
        """What is left unexplained, beside the radiance."""
        return self.texture.relative_rms

    @property
    def values(self) -> dict[str, Float[np.ndarray, "..."]]:
        """The maps of kd and ks, and the numbers of the lobe."""
        found = {name: getattr(self.texture, name) for name in self._amplitudes}
        for name in self.lobe_names:
            found[name] = _alone([getattr(lobe, name) for lobe in self.lobes])
        return found if self.variation is None else found | {"sigma": self.variation.sigma}

    @property
    def standard_error(self) -> dict[str, Float[np.ndarray, "..."]]:
        """Standard errors of those values whose errors are known, infinite where unseen."""
        found = {name: getattr(self.texture, f"{name}_error") for name in self._amplitudes}
        for name in self.lobe_names:
            errors = [getattr(lobe, f"{name}_error") for lobe in self.lobes]
            if None not in errors:
                found[name] = _alone(errors)
        return found if self.variation is None else found | {"sigma": self.variation.error}

    @property
    def interval90(self) -> dict[str, Float[np.ndarray, "... 2"]]:
        """90 % intervals of the same; those of kd and ks end at zero."""
        values, found = self.values, {}
        for name, error in self.standard_error.items():
            if name in ORIGIN:
                found[name] = interval90(name, values[name], error)
                continue
            low, high = (np.maximum(values[name] + s * NORMAL_90 * error, 0) for s in (-1, 1))
            found[name] = np.stack([low, high], axis=-1)
        return found

    @property
    def if_exact(self) -> "TextureEstimate":
        """The same with the errors that it would have if the model were exact."""
        lobes = tuple(lobe.if_exact() for lobe in self.lobes)
        return replace(self, texture=self.texture.if_exact(), lobes=lobes)

    @property
    def identifiable(self) -> dict[str, bool]:
        """Whether free sigma and mu are identifiable, of all materials."""
        known, unknowns = self.standard_error, self.material.unknowns()
        return {
            name: all(lobe.tells(name) for lobe in self.lobes)
            for name in self.lobe_names
            if name in known and unknowns[name].free
        }

    @property
    def seen(self) -> Bool[np.ndarray, "site"]:
        """Which sites were seen."""
        return np.asarray(self.texture.seen > 0)

    @property
    def sentence(self) -> str:
        """Say what the sites are, and what became of them."""
        seen, texture = self.seen, self.texture
        kd, ks = (np.count_nonzero(m & seen) for m in (texture.kd_marked, texture.ks_marked))
        return (
            f"{self.sites.sentence}; {np.count_nonzero(seen)} seen, {np.count_nonzero(~seen)} not; "
            f"kd is marked at {kd} of those seen, ks at {ks}"
        )

    def brdf_of(self, lobe: RegionLobe) -> Microfacet:
        """Build the lobe of a material; its amplitudes do not matter."""
        variant = facets_of(self.material)
        return variant.with_roughness(lobe.sigma, None if variant.mu is None else lobe.mu)

    def images(self) -> dict[str, Float[np.ndarray, "row column channel"]]:
        """Lay values and errors of texels out as images, NaN where unseen or unlit."""
        assert self.sites.image is not None
        images = {}
        for name in _MAPS:
            values = getattr(self.texture, name)
            # What was seen but never lit has a value that means nothing: its error is infinite.
            error = getattr(self.texture, f"{name.removesuffix('_error')}_error")
            known = _finite(values) & _finite(error) & self.seen
            images[name] = image_of_sites(values, self.sites.image, known)
        if self.variation is not None:
            known = np.isfinite(self.variation.sigma)
            for name, values in zip(("sigma", "sigma_error"), self.variation):
                images[name] = image_of_sites(values, self.sites.image, known)
        if self.normals is not None:
            known = np.isfinite(self.normals.error)
            named = {"normal": self.normals.normal, "normal_error": self.normals.error}
            for name, values in named.items():
                images[name] = image_of_sites(values, self.sites.image, known)
        return images

    @property
    def marked(self) -> dict[str, Bool[np.ndarray, "site"]]:
        """Say where what sites have of their own is not to be trusted."""
        found = {}
        if self.texture.ks_colour_marked is not None:
            found["ks_colour_marked"] = self.texture.ks_colour_marked
        if self.variation is not None and "sigma" in self.maps:
            found["sigma_marked"] = self.variation.marked
        if self.normals is not None:
            found["normal_marked"] = self.normals.marked
        return found

    def marks(self) -> dict[str, Float[np.ndarray, "row column _"]]:
        """Lay out as images what is not to be trusted.

        ``marks`` has K_d, K_s and what was not seen as its channels; numbers that sites have of
        their own have images of their own.
        """
        assert self.sites.image is not None
        marks = np.stack([self.texture.kd_marked, self.texture.ks_marked, ~self.seen], axis=-1)
        every = {"marks": marks, **{name: one[:, None] for name, one in self.marked.items()}}
        return {
            name: image_of_sites(one.astype(float), self.sites.image) for name, one in every.items()
        }

    @property
    def files(self) -> dict[str, str]:
        """Name the files that ``write_maps`` writes, by what they hold."""
        if self.sites.image is None:
            return {"vertices": "textures/vertices.ply"}
        names = _MAPS if self.variation is None else (*_MAPS, "sigma", "sigma_error")
        names = names if self.normals is None else (*names, "normal", "normal_error")
        marks = ("marks", *self.marked)
        pictures = {name: f"textures/{name}.png" for name in marks}
        return {name: f"textures/{name}.exr" for name in names} | pictures

    def write_maps(self, folder: Path, reach: int = _REACH) -> None:
        """Write the maps into ``folder/textures``, or the mesh with a number for each vertex.

        Maps are continued ``reach`` texels beyond what was seen and are 0 from there on;
        ``marks.png`` is red where K_d is not to be trusted, green where K_s is not, blue where
        nothing was seen; ``sigma_marked.png``, ``normal_marked.png`` and ``ks_colour_marked.png``
        are white where these are not to be trusted.  Unseen vertices have NaN.
        """
        (folder / "textures").mkdir(exist_ok=True)
        if self.sites.image is None:
            assert isinstance(self.sites.shape, Mesh)
            write_mesh(folder / self.files["vertices"], self.sites.shape, self._columns())
            return
        write_maps(folder, self.files, self.images(), self.marks(), reach, self.sites.wraps)

    @property
    def _amplitudes(self) -> tuple[str, ...]:
        return ("kd",) if self.diffuse else ("kd", "ks")

    @property
    def _maps(self) -> tuple[str, ...]:
        """The maps are saved as images or as a mesh."""
        return self._amplitudes if self.variation is None else (*self._amplitudes, "sigma")

    def _rows(self) -> list[str]:
        rows, seen = [f"  {self.sentence}"], self.seen
        for name in self._maps:
            value, error = (part[name][seen] for part in (self.values, self.standard_error))
            middle = " ".join(f"{v:.4g}" for v in np.ravel(np.nanmedian(value, axis=0)))
            spread = " ".join(f"{v:.2g}" for v in np.ravel(np.nanmedian(error, axis=0)))
            rows.append(f"  {name:<12} median {middle}  its standard error {spread}")
        rows += super()._rows()
        if self.ambiguity and self.ambiguity not in self.reasons:
            rows.append(f"  {self.ambiguity}")
        return rows

    def _write(self, folder: Path) -> dict[str, Any]:
        """Write the maps; name them, and lay out the light that was found."""
        self.write_maps(folder)
        light = [] if self.light is None else [{"coefficients": plain(self.light.coefficients)}]
        return {
            "maps": self.files,
            "sites": self.sentence,
            "regions": list(self.sites.regions.names),
            "gauge": self.gauge,
            "ambiguity": self.ambiguity,
            "light": light,
        }

    def _columns(self) -> dict[str, np.ndarray]:
        """List what a mesh's vertices have."""
        texture = self.texture
        columns = {}
        for name in _MAPS:
            values = getattr(texture, name)
            if values.ndim == 1:
                columns[name] = values
                continue
            for channel, letter in zip(values.T, "rgb"):
                columns[f"{name}_{letter}"] = channel
        columns |= {"kd_marked": texture.kd_marked, "ks_marked": texture.ks_marked}
        if self.variation is not None:
            columns |= {"sigma": self.variation.sigma, "sigma_error": self.variation.error}
        if self.normals is not None:
            columns |= dict(zip(("normal_x", "normal_y", "normal_z"), self.normals.normal.T))
            columns["normal_error"] = self.normals.error
        return columns | self.marked


def facets_of(material: UnknownMaterial) -> Microfacet:
    """Pick the lobe of a material of facets, or of diffuse paint; else ``ValueError``."""
    if not isinstance(material.lobe, Microfacet):
        name = material.model or type(material.lobe).__name__
        raise ValueError(
            f"{name}: a texture fits facets (microfacet, ggx, beckmann) or lambertian; choose one"
        )
    return material.lobe


def worst_outcome(outcomes: list[Outcome]) -> Outcome:
    """Pick the outcome that a reader has to know of."""
    order = (
        Outcome.NOT_CONVERGED,
        Outcome.AT_BOUND,
        Outcome.MISFIT,
        Outcome.NOT_IDENTIFIABLE,
        Outcome.CONVERGED,
    )
    return next(outcome for outcome in order if outcome in outcomes)


def _alone(values: list[float]) -> Float[np.ndarray, "*region"]:
    """One number for one region, an array for several."""
    return np.asarray(values[0] if len(values) == 1 else values)


def _finite(values: Float[np.ndarray, "site *channel"]) -> Bool[np.ndarray, "site"]:
    finite: np.ndarray = np.isfinite(np.asarray(values))
    return np.asarray(finite.reshape(len(values), -1).all(axis=1))
