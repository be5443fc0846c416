"""Task ``brdf``: the material from photographs under known light."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.geometry import Shape
from jaxrender.inverse import KnownLight, Observations, fit_brdf
from jaxrender.inverse.variants import fit_variants
from jaxrender.io import write_environment
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.photographs import Photograph
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.recovery import Recovery
from jaxrender.pipelines.result import Finding, result_of, write_arrays
from jaxrender.pipelines.scene import settings_of, sources_of_frame, unknowns_of, variant_of
from jaxrender.pipelines.shadows import TransferField, interreflection, sentence_on
from jaxrender.reflection import DualForward, ShadowedDual, dual_light, render_view, render_views


class MaterialRecovery(Recovery):
    """A recovered material."""

    def __init__(self, finding: Finding):
        self.finding, self.photographs = finding, finding.photographs

    def result(self) -> dict[str, Any]:
        """Build the summary of ``result.json``."""
        return result_of(self.finding)

    def write(self, folder: Path) -> None:
        """Write the arrays, and the light that was given with its slow part."""
        finding = self.finding
        write_arrays(folder / "result.nc", finding)
        if finding.light.environment is not None:
            write_environment(folder / "lighting.exr", finding.light.environment)
        if finding.fit.light.split is not None:
            write_environment(folder / "lighting_slow.exr", finding.fit.light.split.slow)

    def contents(self, title: str, result: dict[str, Any], frames: tuple) -> Any:
        """Gather what the report shows."""
        from jaxrender.pipelines.report import ReportContents

        return ReportContents(title, result, self.finding.fit, self.finding.light, frames)

    def predict(self) -> list[np.ndarray]:
        """Render every photograph again with the recovered material, by the dual model."""
        finding = self.finding
        material, prepared = finding.fit.brdf, finding.fit.light
        gains = np.asarray(finding.fit.parameters.value.gains)
        scale = float(finding.fit.parameters.value.scale)
        views = [photograph.view for photograph in finding.photographs]

        def light_of(number: int) -> DualForward | ShadowedDual:
            own = sources_of_frame(finding.light, number)
            dual = dual_light(prepared.split, own, prepared.dual.band_limit)
            if finding.transfer is None:
                return DualForward(dual)
            return ShadowedDual(finding.transfer.shape, dual, finding.transfer.at)

        if finding.light.per_frame is None:
            images = render_views(material, views, light_of(0))
        else:
            images = [render_view(material, view, light_of(k)) for k, view in enumerate(views)]
        gain = gains if len(gains) > 1 else np.ones(len(images))
        return [scale * gain[k] * image for k, image in enumerate(images)]


def recover_material(
    config: RunConfig,
    known: tuple[Observations, KnownLight],
    seen: tuple[list[Photograph], Shape],
    clock: Clock,
    progress: Progress,
) -> MaterialRecovery:
    """Fit the material, and its variants where the config asks for them."""
    (observations, light), (photographs, shape) = known, seen
    settings = settings_of(config)
    unknowns = unknowns_of(config, len(photographs))
    transfer = None
    if not shape.is_convex():
        with clock.stage("shadows"):
            # Those of the fit, and all pixels of the predicted images.
            places = observations.count
            places += sum(int(np.count_nonzero(p.view.hit)) for p in photographs)
            transfer = TransferField.of(shape, light.diffuse_degrees, places)
            assert observations.places is not None
            vectors = transfer.at(observations.places, np.asarray(observations.samples.normals))
            observations = observations._replace(transfer=vectors)
    found = fit_brdf(
        observations,
        light,
        unknowns,
        variant_of(config.brdf),
        settings,
        clock.stage,
        shape=shape,
    )
    variants = ()
    if config.solve.variants and config.brdf.model != "lambertian" and settings.refine:
        with clock.stage("variants"):
            variants = fit_variants(found, light, settings, shape)
    if transfer is not None:
        progress.note(sentence_on(interreflection(found)))
    finding = Finding(
        found,
        variants,
        light,
        photographs,
        config.brdf.model,
        config.brdf.ks_per_channel,
        transfer,
    )
    return MaterialRecovery(finding)
