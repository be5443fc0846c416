"""A run's recovery of a texture: the call, what is written, and what is shown."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.errors import InputError
from jaxrender.geometry import Shape
from jaxrender.inverse.texture import (
    METALLIC,
    LitTexture,
    TextureEstimate,
    metallic_under_known_light,
    under_known_light,
    under_unknown_light,
)
from jaxrender.io import write_environment
from jaxrender.io.netcdf import Group
from jaxrender.lighting import positive_environment
from jaxrender.pipelines.calibration import mended, write_cameras
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.result import FinishedRun, Result
from jaxrender.pipelines.scene import fault_of, material_of
from jaxrender.pipelines.shadows import transfer_field
from jaxrender.pipelines.subject import Subject
from jaxrender.pipelines.tasks.recovery import Evidence, Recovery
from jaxrender.pipelines.tasks.task import Task
from jaxrender.pipelines.tasks.texture.arrays import texture_groups
from jaxrender.pipelines.tasks.texture.asked import (
    asked_sites,
    control_points,
    known_light_settings,
    texture_of,
    unknown_light_settings,
)
from jaxrender.pipelines.tasks.texture.metallic import MetallicRecovery, MetallicSubject
from jaxrender.pipelines.tasks.texture.subject import TexturedSubject
from jaxrender.pipelines.tasks.texture.summary import summary_of_texture
from jaxrender.shapes import Float

if TYPE_CHECKING:
    from jaxrender.pipelines.report import FramePictures, Page

# Rows of a recovered light's image.
_ROWS = 64


class TextureRecovery(Recovery):
    """A recovered texture; ``evidence`` is corrected by what was freed."""

    def __init__(self, config: RunConfig, evidence: Evidence, lit: LitTexture):
        self.config, self.evidence, self.lit = config, evidence, lit
        self.photographs = evidence.photographs

    @property
    def estimate(self) -> TextureEstimate:
        """The texture, and how well it is known."""
        return self.lit.estimate

    def result(self) -> Result:
        """Sum up the texture."""
        return summary_of_texture(self.config, self.estimate, self.photographs)

    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph with the recovered texture, by the dual model."""
        views, calibration = [p.view for p in self.photographs], self.estimate.calibration
        images = self.lit.predict(views)
        if calibration is None:
            return images
        taken = (
            calibration.corrections.photographed(image, number, view.hit)
            for number, (image, view) in enumerate(zip(images, views))
        )
        return [np.where(view.hit[..., None], one, 0) for one, view in zip(taken, views)]

    def arrays(self) -> dict[str, Group]:
        """Lay out every site, the lobe of each region, and the light if it was recovered."""
        return texture_groups(self.estimate)

    def write_images(self, folder: Path) -> None:
        """Write the maps, the light, and cameras and exposures that were mended."""
        calibration = self.estimate.calibration
        if calibration is not None:
            write_cameras(folder, calibration, self.photographs, self.evidence.shape)
        self.estimate.write_maps(folder, texture_of(self.config).dilate)
        if self.estimate.light is not None:
            light = positive_environment(*self.estimate.light, _ROWS)
            write_environment(folder / "lighting.exr", light)
            write_environment(folder / "lighting_slow.exr", light)
        elif self.evidence.light is not None and self.evidence.light.environment is not None:
            write_environment(folder / "lighting.exr", self.evidence.light.environment)

    def page(self, title: str, result: dict[str, Any], frames: tuple[FramePictures, ...]) -> Page:
        """Lay out the report."""
        from jaxrender.pipelines.report.texture import TextureContents, texture_page

        maps = None
        if self.estimate.sites.image is not None:
            maps = self.estimate.images() | self.estimate.marks()
        light = self.estimate.light
        coefficients = None if light is None else light.coefficients
        return texture_page(TextureContents(title, result, maps, coefficients, frames))


def recover_texture(
    config: RunConfig, evidence: Evidence, clock: Clock, progress: Progress
) -> Recovery:
    """Recover the material of every texel or vertex from all usable pixels.

    Raises ``InputError`` where nothing is identifiable.
    """
    observations, light, shape = evidence.pool, evidence.light, evidence.shape
    place = str(config.capture.transforms)
    with fault_of(place):
        sites = asked_sites(config, shape, evidence.photographs)
    progress.note(f"texture: {sites.sentence}")
    if config.brdf.model == METALLIC:
        assert light is not None
        with clock.stage("texture"), fault_of(place):
            settings, material = known_light_settings(config), material_of(config)
            found = metallic_under_known_light(observations, sites, light, material, settings)
        progress.note(f"texture: {found.sentence}")
        return MetallicRecovery(config, evidence, found)
    field = None
    if light is not None and not shape.is_convex():
        with clock.stage("shadows"):
            places = observations.count
            places += sum(int(np.count_nonzero(p.view.hit)) for p in evidence.photographs)
            field = transfer_field(shape, light.diffuse_degrees, places)
            observations = field.of_observations(observations)
    key = "solve.free" if config.solve.free else place
    with clock.stage("texture"), fault_of(key):
        material = material_of(config)
        if light is None:
            settings = unknown_light_settings(config)
            estimate = under_unknown_light(observations, sites, material, settings)
        else:
            settings, points = known_light_settings(config), control_points(config)
            estimate = under_known_light(observations, sites, light, material, settings, points)
    progress.note(f"texture: {estimate.sentence}")
    exact, calibration = config.solve.refine == "exact", estimate.calibration
    if calibration is not None:
        photographs = mended(evidence.photographs, calibration, shape)
        light = None if light is None else calibration.light.upright
        observations = calibration.observations
        evidence = evidence._replace(photographs=photographs, light=light)
        progress.note(f"freed: {', '.join(calibration.free)}")
    lit = LitTexture(estimate, observations, light, exact, field)
    return TextureRecovery(config, evidence, lit)


def _subject(run: FinishedRun, shape: Shape) -> Subject:
    return (MetallicSubject if run.config.brdf.model == METALLIC else TexturedSubject)(run, shape)


def _would(config: RunConfig, evidence: Evidence) -> str:
    sites = asked_sites(config, evidence.shape, evidence.photographs)
    return (
        f"recover the material of {sites.sentence}, from "
        f"{evidence.observations.count} pixels of {len(evidence.photographs)} photographs"
    )


def _no_brdf(run: FinishedRun) -> BRDF:
    raise InputError(f"{run.folder}: a texture has a material for each texel; give a uniform one")


TASK = Task(
    # A texture needs every pixel; samples.count are those that sigma and mu are searched by.
    draw=lambda config, pool, light: pool,
    # The sites are checked when they are seen.
    check=lambda config, evidence: None,
    would=_would,
    recover=recover_texture,
    brdf=_no_brdf,
    subject=_subject,
)
