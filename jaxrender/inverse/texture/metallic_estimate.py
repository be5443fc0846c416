"""A recovered map of glTF's material: what every site is made of, printed, saved and predicted."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import MetallicRoughness
from jaxrender.geometry import Mesh, SurfacePlaces, SurfaceView
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.any_estimate import AnyEstimate
from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.photographs import camera_samples
from jaxrender.inverse.shadowing import concave
from jaxrender.inverse.texture.examination import misfit_of
from jaxrender.inverse.texture.maps import image_of_sites, write_maps
from jaxrender.inverse.texture.metallic import MetallicSites, recover_metallic
from jaxrender.inverse.texture.metallic_table import finest_cell, tabulated
from jaxrender.inverse.texture.rounds import TextureSettings
from jaxrender.inverse.texture.sites import SurfaceSites
from jaxrender.inverse.texture.texture import Texture
from jaxrender.inverse.unknown_material import UnknownMaterial
from jaxrender.io import write_mesh
from jaxrender.shapes import Bool, Float

# A share of metal is marked where its 90 % interval reaches further to either side.
_TRUSTED_SHARE = 0.25
# A roughness this near to the least that was looked for has ended there.
_AT_END = 1.01
_REACH = 2
# Pixels that are predicted at once.
_BLOCK = 2**15


class SiteMap(NamedTuple):
    """One number, or one of each channel, of every site: value, standard error, and mark.

    NaN, infinite and marked where nothing is known.
    """

    value: Float[np.ndarray, "site *channel"]
    error: Float[np.ndarray, "site *channel"]
    marked: Bool[np.ndarray, "site"]


@dataclass(frozen=True, eq=False)
class MetallicEstimate(AnyEstimate):
    """A recovered map of glTF's material, and how well it is known.

    ``values`` have ``base_color`` [site, channel], ``roughness`` and ``metallic``, [site] where
    they are maps and one number where not, and ``ior``.  ``maps`` are those that sites have.
    """

    material: UnknownMaterial
    found: MetallicSites
    maps: dict[str, SiteMap]
    sites: SurfaceSites
    outcome: Outcome
    reasons: tuple[str, ...]
    misfit: Misfit | None = None

    @property
    def title(self) -> str:
        """Name the model."""
        return f"texture of {self.material.model}"

    @property
    def relative_rms(self) -> float:
        """What is left unexplained, beside the radiance."""
        return self.found.relative_rms

    @property
    def noise(self) -> NoiseModel:
        """The noise of the photographs."""
        return self.found.noise

    @property
    def values(self) -> dict[str, Float[np.ndarray, "..."]]:
        """The maps, and what all sites share."""
        shared = {name: np.asarray(value) for name, (value, _) in self.found.shared.items()}
        return {name: one.value for name, one in self.maps.items()} | shared

    @property
    def standard_error(self) -> dict[str, Float[np.ndarray, "..."]]:
        """Standard errors of these, infinite where unseen, and of shared numbers that are free."""
        shared = {name: np.asarray(error) for name, (_, error) in self.found.shared.items()}
        free = {
            name: error for name, error in shared.items() if self.material.unknowns()[name].free
        }
        return {name: one.error for name, one in self.maps.items()} | free

    @property
    def interval90(self) -> dict[str, Float[np.ndarray, "... 2"]]:
        """90 % intervals of the same, which end where a number does: a share at 0 and 1."""
        values, found = self.values, {}
        for name, error in self.standard_error.items():
            most = np.inf if name in ("base_color", "ior") else 1.0
            ends = (np.clip(values[name] + s * NORMAL_90 * error, 0, most) for s in (-1, 1))
            found[name] = np.stack([*ends], axis=-1)
        return found

    @property
    def identifiable(self) -> dict[str, bool]:
        """Whether free numbers that all sites share are identifiable."""
        known, unknowns = self.found.shared, self.material.unknowns()
        return {
            name: bool(NORMAL_90 * error <= IDENTIFIABLE_WITHIN * _size(name, value))
            for name, (value, error) in known.items()
            if unknowns[name].free
        }

    @property
    def seen(self) -> Bool[np.ndarray, "site"]:
        """Which sites were seen."""
        return np.asarray(self.found.seen > 0)

    @property
    def marked(self) -> dict[str, Bool[np.ndarray, "site"]]:
        """Say where each map is not to be trusted."""
        return {f"{name}_marked": one.marked for name, one in self.maps.items()}

    @property
    def sentence(self) -> str:
        """Say what the sites are, and what became of them."""
        seen = self.seen
        marks = (
            f"{name} is marked at {np.count_nonzero(one.marked & seen)}"
            for name, one in self.maps.items()
        )
        return (
            f"{self.sites.sentence}; {np.count_nonzero(seen)} seen, {np.count_nonzero(~seen)} not; "
            f"of those seen {', '.join(marks)}"
        )

    def images(self) -> dict[str, Float[np.ndarray, "row column channel"]]:
        """Lay values and errors of texels out as images, NaN where unseen."""
        assert self.sites.image is not None
        images = {}
        for name, one in self.maps.items():
            known = np.isfinite(one.error.reshape(len(one.marked), -1)).all(axis=1) & self.seen
            for key, values in ((name, one.value), (f"{name}_error", one.error)):
                images[key] = image_of_sites(values, self.sites.image, known)
        return images

    def marks(self) -> dict[str, Float[np.ndarray, "row column _"]]:
        """Lay out as images what is not to be trusted, and what was not seen."""
        assert self.sites.image is not None
        every = {**self.marked, "unseen": ~self.seen}
        return {
            name: image_of_sites(one.astype(float), self.sites.image) for name, one in every.items()
        }

    @property
    def files(self) -> dict[str, str]:
        """Name the files that ``write_maps`` writes, by what they hold."""
        if self.sites.image is None:
            return {"vertices": "textures/vertices.ply"}
        names = [key for name in self.maps for key in (name, f"{name}_error")]
        pictures = {name: f"textures/{name}.png" for name in (*self.marked, "unseen")}
        return {name: f"textures/{name}.exr" for name in names} | pictures

    def write_maps(self, folder: Path, reach: int = _REACH) -> None:
        """Write the maps into ``folder/textures``, or the mesh with numbers for each vertex.

        Maps are continued ``reach`` texels beyond what was seen and are 0 from there on; marks are
        white where a number is not to be trusted.  Unseen vertices have NaN.
        """
        (folder / "textures").mkdir(exist_ok=True)
        if self.sites.image is None:
            assert isinstance(self.sites.shape, Mesh)
            write_mesh(folder / self.files["vertices"], self.sites.shape, self._columns())
            return
        write_maps(folder, self.files, self.images(), self.marks(), reach, self.sites.wraps)

    @property
    def _maps(self) -> tuple[str, ...]:
        """The maps are saved as images or as a mesh."""
        return tuple(self.maps)

    def _rows(self) -> list[str]:
        rows, seen = [f"  {self.sentence}"], self.seen
        for name, one in self.maps.items():
            middle, spread = (
                " ".join(f"{v:.{digits}g}" for v in np.ravel(np.nanmedian(part[seen], axis=0)))
                for part, digits in ((one.value, 4), (one.error, 2))
            )
            rows.append(f"  {name:<12} median {middle}  its standard error {spread}")
        return rows + super()._rows()

    def _write(self, folder: Path) -> dict[str, Any]:
        """Write the maps, and name them."""
        self.write_maps(folder)
        return {"maps": self.files, "sites": self.sentence}

    def _columns(self) -> dict[str, np.ndarray]:
        """List what a mesh's vertices have."""
        columns: dict[str, np.ndarray] = {}
        for name, one in self.maps.items():
            for key, values in ((name, one.value), (f"{name}_error", one.error)):
                if values.ndim == 1:
                    columns[key] = values
                else:
                    columns |= {f"{key}_{c}": part for c, part in zip("rgb", values.T)}
        return columns | self.marked


def metallic_under_known_light(
    observations: Observations,
    sites: SurfaceSites,
    light: KnownLight,
    material: UnknownMaterial,
    settings: TextureSettings,
) -> MetallicEstimate:
    """Recover glTF's material of every site, and judge what was found.

    ``observations`` are all usable pixels of the photographs that ``sites`` are of.  Raises
    ``ValueError`` as ``recover_metallic`` does, and for a surface of several regions.
    """
    if len(sites.regions.names) > 1:
        raise ValueError("metallic-roughness has one material model everywhere: leave regions out")
    variant, unknowns = variant_of(material), material.unknowns()
    site, count = sites.of_observation, sites.count
    found = recover_metallic(
        observations, site, count, light, variant, unknowns, settings, sites.shape
    )
    texture = _as_texture(found)
    predicted = np.full(np.shape(observations.radiance), np.nan)
    predicted[found.index] = np.asarray(observations.radiance)[found.index] - found.left
    misfit = misfit_of(observations, site, predicted, texture, settings.noise, seed=settings.seed)
    maps = {"base_color": SiteMap(found.base_color, found.color_error, texture.kd_marked)}
    for name, one in found.numbers.items():
        trusted = _TRUSTED_SHARE if name == "metallic" else IDENTIFIABLE_WITHIN * one.value
        maps[name] = SiteMap(one.value, one.error, ~(NORMAL_90 * one.error <= trusted))
    outcome, reasons = _judged(found, texture, misfit, unknowns["roughness"].lower)
    return MetallicEstimate(material, found, maps, sites, outcome, reasons, misfit)


def variant_of(material: UnknownMaterial) -> MetallicRoughness:
    """Pick the lobe of glTF's material, with the index where the search begins."""
    assert isinstance(material.lobe, MetallicRoughness)
    index = material.unknowns()["ior"].first(float(material.lobe.ior))
    return material.lobe.with_numbers({"ior": jnp.asarray(index)})


def _size(name: str, value: float) -> float:
    """Tell beside what an error of a shared number is large."""
    return {"metallic": 1.0, "ior": value - 1}.get(name, value)


def _as_texture(found: MetallicSites) -> Texture:
    """Let the base colour stand for K_d, whose marks it has, beside an interface that is known."""
    count = len(found.seen)
    known, color = np.zeros(count), (found.base_color, found.color_error)
    return Texture(
        color[0],
        np.ones(count),
        color[1],
        known,
        found.misfit,
        found.seen,
        np.ones(count, bool),
        np.zeros(count, bool),
        color[1],
        known,
        found.relative_rms,
    ).marked()


def _judged(
    found: MetallicSites, texture: Texture, misfit: Misfit | None, lowest: float
) -> tuple[Outcome, tuple[str, ...]]:
    """Say how the fit ended, and why."""
    outcome, reasons, seen = Outcome.CONVERGED, [], found.seen > 0
    if np.mean(texture.kd_marked[seen]) > 0.5:
        outcome = Outcome.NOT_IDENTIFIABLE
        reasons.append(
            "the base colour is not to be trusted at most sites: each is seen too seldom to tell "
            "it, roughness and metalness apart; give more photographs, or larger texels"
        )
    ended = np.count_nonzero(found.number("roughness")[seen] <= _AT_END * found.sharpest)
    if ended:
        finer = found.sharpest > _AT_END * lowest
        why = "the least that the cells of the light can tell" if finer else "its bound"
        reasons.append(
            f"roughness ended at {found.sharpest:.3g}, {why}, at {ended} of {seen.sum()} sites: "
            "they may be sharper"
        )
    if misfit is not None and misfit.found:
        outcome = Outcome.MISFIT
        reasons.insert(0, misfit.sentence())
    return outcome, tuple(reasons)


class LitMetallic(NamedTuple):
    """A map of glTF's material under the light that it was recovered under."""

    estimate: MetallicEstimate
    light: KnownLight
    observations: int

    def predict(
        self, views: Sequence[SurfaceView]
    ) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph, given what its camera sees, as the sites were solved."""
        return [self._image(number, view) for number, view in enumerate(views)]

    def _image(self, number: int, view: SurfaceView) -> Float[np.ndarray, "row column channel"]:
        found, sites = self.estimate.found, self.estimate.sites
        site, channels = sites.of_view(view)[view.hit], found.base_color.shape[1]
        samples, places = camera_samples(view), SurfacePlaces.of_views([view])
        dark = np.zeros((len(site), channels))
        seen = Observations(samples, dark, np.full(len(site), number), places)
        known = np.flatnonzero((site >= 0) & self.estimate.seen[site])
        rough = found.number("roughness")
        span = found.sharpest, max(float(np.nanmax(rough)), 1.01 * found.sharpest)
        values, finest = dark.copy(), finest_cell(self.light, self.observations)
        variant, shape = variant_of(self.estimate.material), concave(sites.shape)
        for first in range(0, len(known), _BLOCK):
            rows = known[first : first + _BLOCK]
            own = site[rows]
            table = tabulated(variant, self.light, seen.take(rows), span, finest, shape)
            numbers = {name: found.number(name)[own] for name in ("roughness", "metallic")}
            numbers["ior"] = np.asarray(found.shared["ior"][0])
            base, clear = table.columns({n: jnp.asarray(v) for n, v in numbers.items()})
            values[rows] = found.base_color[own] * np.asarray(base) + np.asarray(clear)
        image = np.zeros((*view.hit.shape, channels))
        image[view.hit] = values
        return image
