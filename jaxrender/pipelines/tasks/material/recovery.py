"""Task ``brdf``: the material from photographs under known light."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxrender.brdf import BRDF, Bank, Glossy, Parametric
from jaxrender.inverse import BRDFFit, KnownLight, fit_brdf
from jaxrender.inverse.brdf import check_free_numbers
from jaxrender.inverse.brdf_table import check_correctable, correct_by_table
from jaxrender.inverse.comparison import Candidate, Comparison, compare_models
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.forecast import forecast_of_fit
from jaxrender.inverse.prepared_light import PreparedLight, prepare_light
from jaxrender.inverse.variants import fit_variants
from jaxrender.io import write_environment
from jaxrender.io.netcdf import Group
from jaxrender.pipelines.calibration import mended, write_cameras
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.exact_light import exact_forward, with_points
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.ranking import sentence_of
from jaxrender.pipelines.result import Result
from jaxrender.pipelines.scene import (
    fault_of,
    lobe_of,
    settings_of,
    unknowns_of,
)
from jaxrender.pipelines.shadows import interreflection, sentence_on, transfer_field
from jaxrender.pipelines.tasks.material.result import (
    Finding,
    environment_files,
    groups_of,
    result_of,
)
from jaxrender.pipelines.tasks.material.table import brdf_of_run, subject_of_run
from jaxrender.pipelines.tasks.recovery import Evidence, Recovery
from jaxrender.pipelines.tasks.task import Task, check_samples, draw_samples, would_fit
from jaxrender.reflection import (
    DualForward,
    ExactForward,
    ForwardModel,
    ShadowedDual,
    ShadowedModel,
    dual_light,
    render_view,
    render_views,
)

if TYPE_CHECKING:
    from jaxrender.pipelines.report import FramePictures, Page


class MaterialRecovery(Recovery):
    """A recovered material."""

    def __init__(self, finding: Finding):
        self.finding, self.photographs = finding, finding.photographs

    def result(self) -> Result:
        """Sum up what was found."""
        return result_of(self.finding)

    def arrays(self) -> dict[str, Group]:
        """Lay out the samples of both passes, the covariance and the light."""
        return groups_of(self.finding)

    def write_images(self, folder: Path) -> None:
        """Write the light that was given, its slow part, and a corrected material's table."""
        finding = self.finding
        for name, image in environment_files(finding.light).items():
            write_environment(folder / name, image)
        if finding.fit.light.split is not None:
            write_environment(folder / "lighting_slow.exr", finding.fit.light.split.slow)
        if finding.correction is not None:
            finding.correction.write_merl(folder)
        calibration = finding.fit.calibration
        if calibration is not None:
            write_cameras(folder, calibration, finding.photographs, finding.shape)

    def page(self, title: str, result: dict[str, Any], frames: tuple[FramePictures, ...]) -> Page:
        """Lay out the report."""
        from jaxrender.pipelines.report.known_light import MaterialContents, material_page

        found = self.finding
        contents = MaterialContents(title, result, found.fit, found.light, frames, found.correction)
        return material_page(contents)

    def predict(self) -> list[np.ndarray]:
        """Render every photograph again, by the dual model if the material has it."""
        finding = self.finding
        material, prepared = finding.fit.brdf, finding.fit.light
        calibration = finding.fit.calibration
        if calibration is not None and isinstance(material, Glossy) and prepared.split is not None:
            # Light that was mended is split as finely as before.
            prepared = self._prepared(finding.light, material)
        of_image: dict[int, PreparedLight] = {}

        def prepared_for(number: int) -> PreparedLight:
            if finding.light.environments is None:
                return prepared
            assert isinstance(material, Glossy)
            key = id(finding.light.environments[number])
            if key not in of_image:
                of_image[key] = self._prepared(finding.light.of_frame(number), material)
            return of_image[key]

        gains = np.asarray(finding.fit.parameters.value.gains)
        scale = float(finding.fit.parameters.value.scale)
        views = [photograph.view for photograph in finding.photographs]

        def light_of(number: int, part: BRDF) -> ForwardModel | ShadowedModel:
            points = finding.light.points_of(number)
            others = far_light_of(number, part)
            return others if points is None else with_points(others, points, finding.shape)

        def far_light_of(number: int, part: BRDF) -> ForwardModel | ShadowedModel:
            own = finding.light.far_of(number)
            if not isinstance(part, Glossy):
                environment = finding.light.environment_of(number)
                if environment is None and not np.any(own.irradiance):
                    return ExactForward(own.nodes())
                light = KnownLight(environment, own)
                width = part.width if isinstance(part, Parametric) else material.width
                return exact_forward(light, float(width), finding.shape, condensed=True)
            divided = prepared_for(number)
            dual = dual_light(divided.split, own, divided.dual.band_limit)
            if finding.transfer is None:
                return DualForward(dual)
            return ShadowedDual(finding.transfer.shape, dual, finding.transfer.at)

        def rendered(part: BRDF) -> list[np.ndarray]:
            if not finding.light.varies:
                return [np.asarray(image) for image in render_views(part, views, light_of(0, part))]
            return [
                np.asarray(render_view(part, view, light_of(k, part)))
                for k, view in enumerate(views)
            ]

        parts: tuple[BRDF, ...] = (material,)
        if finding.correction is not None:
            parts = (finding.correction.brdf,)
        elif isinstance(material, Bank):
            parts = material.by_width
        images = [np.sum(of_view, axis=0) for of_view in zip(*map(rendered, parts), strict=True)]
        bounced = finding.fit.bounced
        if bounced is not None:
            images = [np.array(image) for image in images]
            for k, view in enumerate(views):
                images[k][view.hit] += bounced.radiance(material, view, k)
        gain = gains if len(gains) > 1 else np.ones(len(images))
        images = [scale * gain[k] * image for k, image in enumerate(images)]
        if calibration is None:
            return images
        for k, view in enumerate(views):
            found = calibration.corrections.photographed(images[k], k, view.hit)
            images[k] = np.where(view.hit[..., None], found, 0)
        return images

    def _prepared(self, light: KnownLight, material: Glossy) -> PreparedLight:
        """Split a light for the dual model as the fit would."""
        observations, settings = self.finding.fit.final.observations, self.finding.settings
        return prepare_light(light, observations, material, settings.split, settings.band_limit)


def recover_material(
    config: RunConfig, evidence: Evidence, clock: Clock, progress: Progress
) -> MaterialRecovery:
    """Fit the material, and its variants where the config asks for them.

    The refinement may draw from all pixels where the shape does not shadow itself.
    """
    photographs, shape, light, pool, observations = evidence
    assert light is not None
    settings = settings_of(config)
    if config.brdf.table:
        with fault_of("brdf.table"):
            check_correctable(pool, None if config.brdf.compare else lobe_of(config.brdf))
    transfer = None
    if not shape.is_convex():
        with clock.stage("shadows"):
            # Those of the fit, and all pixels of the predicted images.
            places = observations.count
            places += sum(int(np.count_nonzero(p.view.hit)) for p in photographs)
            transfer = transfer_field(shape, light.diffuse_degrees, places)
            observations = transfer.of_observations(observations)
    comparison, model = None, config.brdf.model
    if config.brdf.compare:
        comparison = _compared(config, evidence._replace(observations=observations), clock)
        found, model = comparison.best.fit, comparison.best.name
        assert isinstance(found, BRDFFit)
        progress.note(sentence_of(comparison))
    else:
        unknowns = unknowns_of(config, len(photographs))
        lobe = lobe_of(config.brdf)
        # What may be freed depends on photographs and light, of which the config knows nothing.
        with fault_of("solve.free") if config.solve.free else nullcontext():
            found = fit_brdf(
                observations, light, unknowns, lobe, settings, clock.stage, shape=shape, pool=pool
            )
    calibration = found.calibration
    if calibration is not None:
        light, photographs = calibration.light.upright, mended(photographs, calibration, shape)
        progress.note(f"freed: {', '.join(calibration.free)}")
    variants = ()
    if config.solve.variants and model != "lambertian" and settings.refine:
        with clock.stage("variants"):
            variants = fit_variants(found, light, settings, shape)
    correction = None
    if config.brdf.table:
        with fault_of("brdf.table"):
            correction = correct_by_table(
                found, light, settings, clock.stage, shape=shape, pool=pool
            )
    if transfer is not None:
        progress.note(sentence_on(interreflection(found)))
    forecast = None
    # Of a bank nobody could have supposed the lobes beforehand.
    if not isinstance(found.brdf, Bank):
        with clock.stage("forecast"):
            forecast = forecast_of_fit(found, light.far)
    finding = Finding(
        found,
        variants,
        light,
        shape,
        photographs,
        model,
        config.brdf.ks_per_channel,
        transfer,
        comparison,
        forecast,
        settings,
        correction,
    )
    return MaterialRecovery(finding)


def _compared(config: RunConfig, evidence: Evidence, clock: Clock) -> Comparison:
    """Fit every model that the config names, each with what the config says of its parameters."""
    assert evidence.light is not None
    photographs, candidates = len(evidence.photographs), []
    for model in config.brdf.models:
        own = config.model_copy(update={"brdf": config.brdf.as_model(model)})
        candidates.append(Candidate(model, lobe_of(own.brdf), unknowns_of(own, photographs)))
    with fault_of("brdf.compare"):
        return compare_models(
            evidence.observations,
            evidence.light,
            tuple(candidates),
            settings_of(config),
            config.solve.held_out,
            ladder=config.brdf.compare == "auto",
            stage=clock.stage,
            shape=evidence.shape,
        )


def _check(config: RunConfig, evidence: Evidence) -> None:
    """Refuse a material of which nothing is free, and samples that no fit can be made from."""
    channels = evidence.observations.radiance.shape[1]
    with fault_of("brdf"):
        unknowns = unknowns_of(config, len(evidence.photographs))
        check_free_numbers(Problem.of(unknowns, channels))
    check_samples(config, evidence)


TASK = Task(draw_samples, _check, would_fit, recover_material, brdf_of_run, subject_of_run)
