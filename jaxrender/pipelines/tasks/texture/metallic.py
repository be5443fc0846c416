"""A run's recovery of maps of glTF's material: what is written and shown, and rendered again."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import MetallicRoughness
from jaxrender.errors import InputError
from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.geometry.texels import surface_sites
from jaxrender.inverse.texture import LitMetallic, MetallicEstimate
from jaxrender.io import write_environment
from jaxrender.io.netcdf import Group, Variable, opened
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.result import ARRAYS, ARRAYS_FORMAT, FinishedRun, Result
from jaxrender.pipelines.scene import lobe_of
from jaxrender.pipelines.subject import Subject
from jaxrender.pipelines.tasks.recovery import Evidence, Recovery
from jaxrender.pipelines.tasks.texture.asked import texture_of
from jaxrender.reflection import ForwardModel, ShadowedModel, render_widths
from jaxrender.shapes import Float

if TYPE_CHECKING:
    from jaxrender.pipelines.report import FramePictures, Page

_MEANINGS = {
    "base_color": "colour of the diffuse base, and of the metal's reflection",
    "roughness": "root of the width alpha of the lobe",
    "metallic": "share of the base that is metal",
    "ior": "refractive index of the clear interface",
}
# The range of what varies is that of most sites: percentiles.
_MOST_OF = (5, 95)
# The sharpest of most sites is what a light is prepared for.
_FINEST_PART = 0.05


class MetallicRecovery(Recovery):
    """Recovered maps of glTF's material."""

    def __init__(self, config: RunConfig, evidence: Evidence, estimate: MetallicEstimate):
        self.config, self.evidence, self.estimate = config, evidence, estimate
        self.photographs = evidence.photographs

    def result(self) -> Result:
        """Sum up the maps, and what all sites share."""
        estimate, shared = self.estimate, self.estimate.found.shared
        intervals, errors = estimate.interval90, estimate.standard_error
        free = [name for name in shared if name in errors]
        means = {name: _mean(one.value, one.marked) for name, one in estimate.maps.items()}
        values = means | {name: value for name, (value, _) in shared.items()}
        return Result(
            task="texture",
            outcome=estimate.outcome,
            reasons=estimate.reasons,
            brdf={"model": self.config.brdf.model, **values},
            interval90={name: intervals[name].tolist() for name in free},
            standard_error={name: float(errors[name]) for name in free},
            identifiable=estimate.identifiable,
            relative_rms=estimate.relative_rms,
            samples=int(np.sum(estimate.found.seen)),
            noise=estimate.noise,
            lighting={"gauge": "given"},
            photographs=self.photographs,
            own={"texture": self._texture()},
            misfit=estimate.misfit,
        )

    def arrays(self) -> dict[str, Group]:
        """Lay out every site, and what all share."""
        estimate, names, size = self.estimate, ("row", "column"), self.estimate.sites.image
        if size is None:
            names, size = ("vertex",), (estimate.sites.count,)
        variables = {}

        def add(name: str, values: np.ndarray, meaning: str) -> None:
            inner = ("channel",) if np.ndim(values) == 2 else ()
            shaped = np.reshape(values, (*size, *np.shape(values)[1:]))
            variables[name] = Variable((*names, *inner), shaped, "1", meaning)

        for name, one in estimate.maps.items():
            add(name, one.value, _MEANINGS[name])
            add(f"{name}_error", one.error, f"standard error of {name}")
            add(f"{name}_marked", one.marked, f"whether {name} is not to be trusted")
        add("seen", estimate.found.seen, "observations of a site")
        add("misfit", estimate.found.misfit, "rms of a site's residuals over the noise")
        shared = {}
        for name, pair in estimate.found.shared.items():
            shared[name] = Variable((), pair[0], "1", _MEANINGS[name])
            shared[f"{name}_error"] = Variable((), pair[1], "1", f"standard error of {name}")
        return {"texture": Group(variables), "shared": Group(shared)}

    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph with the recovered maps, as the sites were solved."""
        light = self.evidence.light
        assert light is not None
        lit = LitMetallic(self.estimate, light, self.evidence.pool.count)
        return lit.predict([one.view for one in self.photographs])

    def write_images(self, folder: Path) -> None:
        """Write the maps and the light."""
        self.estimate.write_maps(folder, texture_of(self.config).dilate)
        light = self.evidence.light
        if light is not None and light.environment is not None:
            write_environment(folder / "lighting.exr", light.environment)

    def page(
        self, title: str, result: dict[str, Any], frames: "tuple[FramePictures, ...]"
    ) -> "Page":
        """Lay out the report."""
        from jaxrender.pipelines.report.metallic import metallic_page
        from jaxrender.pipelines.report.texture import TextureContents

        maps = None
        if self.estimate.sites.image is not None:
            maps = self.estimate.images() | self.estimate.marks()
        return metallic_page(TextureContents(title, result, maps, None, frames))

    def _texture(self) -> dict[str, Any]:
        estimate, seen = self.estimate, self.estimate.seen
        color = estimate.maps["base_color"]
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.max(color.error / color.value, axis=1)[seen]
        found: dict[str, Any] = {
            "sites": estimate.sites.kind,
            "sentence": estimate.sites.sentence,
            "count": estimate.sites.count,
            "seen": int(np.count_nonzero(seen)),
            "unseen": int(np.count_nonzero(~seen)),
            "median_relative_error_base_color": float(np.median(relative)),
            "median_observations": float(np.median(estimate.found.seen[seen])),
        }
        for name, one in estimate.maps.items():
            found[f"{name}_marked"] = int(np.count_nonzero(one.marked & seen))
            if name == "base_color":
                continue
            trusted = one.value[seen & ~one.marked]
            if trusted.size:
                found[f"{name}_range"] = np.percentile(trusted, _MOST_OF).tolist()
            found[f"{name}_error"] = float(np.median(one.error[seen]))
            if name == "metallic" and trusted.size:
                found["metals"] = float(np.mean(trusted > 0.5))
        if estimate.sites.image is not None:
            found |= {"rows": estimate.sites.image[0], "columns": estimate.sites.image[1]}
        return found | {"files": estimate.files}


def _mean(values: Float[np.ndarray, "site *channel"], marked: np.ndarray) -> Any:
    """Average over the sites that can be trusted, or over all that were seen where none can."""
    known = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    good = known & ~marked
    return np.mean(values[good if good.any() else known], axis=0).tolist()


class MetallicSubject(Subject):
    """glTF's material of every texel or vertex; unseen sites are black.

    Raises ``InputError`` where the result's arrays have gone or are damaged.
    """

    def __init__(self, run: FinishedRun, shape: Shape):
        with opened(run.folder / ARRAYS, ARRAYS_FORMAT) as file:
            group, shared = file.group("texture"), file.group("shared")
            color, seen = group.array("base_color"), group.array("seen")
            numbers = {
                name: (group if name in group else shared).array(name)
                for name in ("roughness", "metallic", "ior")
            }
        self.shape, self.size = shape, seen.shape if seen.ndim == 2 else (1, 1)
        self.seen = seen.ravel() > 0
        self.color = np.nan_to_num(color.reshape(len(self.seen), -1))
        self.numbers_of = {
            name: np.broadcast_to(value.ravel(), self.seen.shape) for name, value in numbers.items()
        }
        rough = float(np.nanquantile(self.numbers_of["roughness"], _FINEST_PART))
        ior = float(self.numbers_of["ior"][0])
        self.lobe = None
        variant = lobe_of(run.config.brdf)
        assert isinstance(variant, MetallicRoughness)
        numbers = {"roughness": jnp.asarray(rough), "ior": jnp.asarray(ior)}
        self.variant = variant.with_numbers(numbers)
        self.width = float(self.variant.width)

    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render B = b F_b + F_c, each pixel with the numbers of its site."""
        found = surface_sites(self.shape, view, self.size)
        if found.count != len(self.seen):
            raise InputError(
                f"{found.sentence} of the shape, {len(self.seen)} in the result: its geometry has "
                "changed since; run fit again with --force"
            )
        site = found.of_pixel[view.hit]
        rows = np.flatnonzero((site >= 0) & self.seen[site])
        own = site[rows]
        samples = SurfaceSamples(view.normals[view.hit][rows], view.outgoing[view.hit][rows])
        places = SurfacePlaces(*(part[rows] for part in SurfacePlaces.of_views([view])))
        widths = self.variant.shape.width_of(self.numbers_of["roughness"][own])
        metallic, color = self.numbers_of["metallic"][own], self.color[own]
        one, none = np.ones(color.shape[1]), np.zeros(color.shape[1])
        values = np.zeros((len(site), color.shape[1]))
        # What is half metal is half of the one and half of the other.
        for end, share in ((0.0, 1 - metallic), (1.0, metallic)):
            lobe = self.variant.with_numbers({"metallic": jnp.asarray(end)})
            for amplitudes, weigh in (((one, none), color), ((none, one), 1.0)):
                lit = lobe.with_amplitudes(*amplitudes)
                sent = np.asarray(render_widths(lit, widths, samples, model, places))
                values[rows] += share[:, None] * weigh * sent
        image = np.zeros((*view.hit.shape, values.shape[1]))
        image[view.hit] = values
        return image
