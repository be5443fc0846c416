"""The recovery of a light, and of the material where that is not known."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.inverse import Factorization, Observations, factorize
from jaxrender.inverse.comparison import compare_factorizations
from jaxrender.inverse.factorization import Round, predict
from jaxrender.io import write_environment
from jaxrender.io.netcdf import Group
from jaxrender.lighting import Environment
from jaxrender.pipelines.arrays import light_group, sample_arrays
from jaxrender.pipelines.calibration import mended, write_cameras
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.deviation import covariance_groups
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.ranking import sentence_of
from jaxrender.pipelines.result import Result
from jaxrender.pipelines.scene import fault_of
from jaxrender.pipelines.shadows import transfer_field
from jaxrender.pipelines.tasks.light.asked import (
    asked_models,
    band_limit,
    factor_settings,
    in_given_units,
)
from jaxrender.pipelines.tasks.light.images import LightImages, light_images
from jaxrender.pipelines.tasks.light.result import Recovered, result_of
from jaxrender.pipelines.tasks.recovery import Evidence, Recovery
from jaxrender.pipelines.tasks.task import Task, check_samples, draw_samples, would_fit
from jaxrender.reflection import (
    DualForward,
    DualLight,
    ForwardModel,
    ShadowedDual,
    ShadowedModel,
    render_views,
)
from jaxrender.shapes import Float

if TYPE_CHECKING:
    from jaxrender.pipelines.report import FramePictures, Page

# Pixels whose radiance is integrated at once.
_PIXELS_AT_ONCE = 2**14


class LightRecovery(Recovery):
    """A recovered light with its material, known beforehand or recovered along with it."""

    def __init__(self, recovered: Recovered, shape: Shape):
        self.recovered, self.shape = recovered, shape
        self.found, self.photographs = recovered.found, recovered.photographs

    @property
    def light(self) -> DualLight:
        """The recovered light as the dual model sees it."""
        scene = self.found.scene
        return DualLight(jnp.asarray(scene.slow), scene.points)

    def result(self) -> Result:
        """Sum up light and material."""
        return result_of(self.recovered, self._images.sources)

    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph with the recovered light and material."""
        views = [photograph.view for photograph in self.photographs]
        if isinstance(self.found.brdf, Glossy):
            images = render_views(self.found.brdf, views, self._forward())
        else:
            images = [self._integrated(view) for view in views]
        # A sum of few degrees may dip below zero where the light is dark.
        images = [np.maximum(image, 0) for image in images]
        if self.found.calibration is None:
            return images
        corrections = self.found.calibration.corrections
        for number, view in enumerate(views):
            shown = corrections.photographed(np.asarray(images[number]), number, view.hit)
            images[number] = np.where(view.hit[..., None], shown, 0)
        return images

    def arrays(self) -> dict[str, Group]:
        """Lay out the light, the samples that it explains and the material's covariance."""
        scene, sources = self.found.scene, self.found.scene.sources
        light = light_group(
            scene.slow,
            slow_error=scene.slow_error,
            total=scene.total,
            direction=sources.directions,
            irradiance=sources.irradiance,
            irradiance_error=scene.energy_error,
            direction_error=scene.direction_error,
            width=scene.widths if scene.widths is not None and scene.widths.any() else None,
        )
        samples = Group(sample_arrays(self.found.observations, self.found.predicted))
        covariance = covariance_groups(self.found.parameters)
        return {"light": light, "samples": samples, **covariance}

    def write_images(self, folder: Path) -> None:
        """Write the whole light, its slow part without the sources, and how well that is known."""
        write_environment(folder / "lighting.exr", Environment(self._images.whole))
        write_environment(folder / "lighting_slow.exr", Environment(self._images.slow))
        write_environment(folder / "lighting_deviation.exr", Environment(self._images.deviation))
        calibration = self.found.calibration
        if calibration is not None:
            write_cameras(folder, calibration, self.photographs, self.shape)

    def page(self, title: str, result: dict[str, Any], frames: tuple[FramePictures, ...]) -> Page:
        """Lay out the report."""
        from jaxrender.pipelines.report.recovered_light import LightContents, light_page

        return light_page(LightContents(title, result, self.found, self._images, frames))

    @cached_property
    def _images(self) -> LightImages:
        return light_images(self.found.scene, self.found.rounds[-1].sigma)

    def _integrated(self, view: SurfaceView) -> Float[np.ndarray, "row column channel"]:
        places = SurfacePlaces.of_views([view])
        count, channels = len(places.points), self.found.scene.slow.shape[1]
        samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
        unseen = Observations(samples, np.zeros((count, channels)), np.zeros(count, int), places)
        shown = np.zeros((count, channels))
        # On a concave object each pixel has its own visibility of thousands of nodes.
        for first in range(0, count, _PIXELS_AT_ONCE):
            part = np.arange(first, min(first + _PIXELS_AT_ONCE, count))
            some = unseen.take(part)
            shown[part] = predict(self.found.brdf, self.found.scene, some, self.shape)
        image = np.zeros((*view.hit.shape, channels))
        image[view.hit] = shown
        return image

    def _forward(self) -> ForwardModel | ShadowedModel:
        if self.shape.is_convex():
            return DualForward(self.light)
        pixels = sum(int(np.count_nonzero(p.view.hit)) for p in self.photographs)
        field = transfer_field(self.shape, self.light.band_limit, pixels)
        return ShadowedDual(self.shape, self.light, field.at)


def recover_light(
    config: RunConfig, evidence: Evidence, clock: Clock, progress: Progress
) -> LightRecovery:
    """Recover the light, and the material where that is not known."""
    shape, observations = evidence.shape, evidence.observations
    models = asked_models(config)
    # A model summed over directions needs no transfer vectors.
    filtered = any(isinstance(asked.variant, Glossy) for asked in models)
    if filtered and observations.transfer is None and not shape.is_convex():
        with clock.stage("shadows"):
            field = transfer_field(shape, band_limit(config), observations.count)
            observations = field.of_observations(observations)
    known, model, comparison = config.task == "lighting", config.brdf.model, None
    options = {
        "gauge": "per-channel" if known else config.brdf.gauge,
        "shape": shape,
        "pool": evidence.pool,
        "stage": clock.stage,
        "watch": lambda round_: progress.note(_sentence(round_, known or model == "lambertian")),
    }
    settings = factor_settings(config)
    if config.brdf.compare:
        with fault_of("brdf.compare"):
            held_out, seed = config.solve.held_out, config.samples.seed
            comparison = compare_factorizations(
                observations, models, settings, held_out, seed, **options
            )
        found, model = comparison.best.fit, comparison.best.name
        assert isinstance(found, Factorization)
        progress.note(sentence_of(comparison))
    else:
        key = "solve.free" if config.solve.free else str(config.capture.transforms)
        with fault_of(key):
            (asked,) = models
            found = factorize(observations, asked.variant, settings, asked.known, **options)
    gauge = "given" if known else config.brdf.gauge
    if known:
        found = in_given_units(config, found)
    photographs, calibration = evidence.photographs, found.calibration
    if calibration is not None:
        photographs = mended(photographs, calibration, shape)
        progress.note(f"freed: {', '.join(calibration.free)}")
    recovered = Recovered(config.task, model, gauge, found, photographs, comparison)
    return LightRecovery(recovered, shape)


def _sentence(round_: Round, width_is_known: bool) -> str:
    width = "" if width_is_known else f", sigma {round_.sigma:.4f}"
    noun = "source" if round_.sources == 1 else "sources"
    degrees = f"degrees to {round_.band_limit}, {round_.sources} {noun}"
    return f"{degrees}: {100 * round_.relative_rms:.2f} % unexplained{width}"


TASK = Task(draw_samples, check_samples, would_fit, recover_light)
