"""Task ``brdf-spectrum``: the BRDF as coefficients from photographs under known light (T 6.4.2)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxrender.geometry import SurfaceSamples, SurfaceView
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.brdf_spectrum import (
    BRDFSpectrum,
    DegreeOfLobe,
    HarmonicBRDF,
    SpectrumBasis,
    SpectrumEstimate,
    SpectrumSettings,
    estimate_spectrum,
    lobe_error,
)
from jaxrender.inverse.observations import random_subset
from jaxrender.io import write_environment
from jaxrender.io.netcdf import Group, Variable, opened
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig, SpectrumConfig
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.result import (
    ARRAYS,
    ARRAYS_FORMAT,
    FinishedRun,
    Result,
    causes_of,
)
from jaxrender.pipelines.scene import fault_of, settings_of
from jaxrender.pipelines.subject import Subject
from jaxrender.pipelines.tasks.recovery import Evidence, Recovery
from jaxrender.pipelines.tasks.task import Task
from jaxrender.reflection import ForwardModel, ShadowedModel, render_view
from jaxrender.shapes import Float

if TYPE_CHECKING:
    from jaxrender.pipelines.report import FramePictures, Page

_UNKNOWN = ("unknown",)
# An image of a light is summed as finely as a lobe of this part of the finest wave asks for.
_WIDTH_PER_WAVE = 0.5


class SpectrumRecovery(Recovery):
    """A run's estimate of the coefficients, and what it was made from."""

    def __init__(self, estimate: SpectrumEstimate, evidence: Evidence):
        self.estimate, self.evidence = estimate, evidence
        self.photographs = evidence.photographs

    def result(self) -> Result:
        """Sum up how well the photographs tell the lobe."""
        estimate = self.estimate
        return Result(
            task="brdf-spectrum",
            outcome=estimate.outcome,
            reasons=estimate.reasons,
            brdf={"model": "spectrum"},
            interval90={},
            standard_error={},
            identifiable=estimate.identifiable,
            relative_rms=estimate.relative_rms,
            samples=self.evidence.observations.count,
            noise=estimate.noise,
            lighting={
                "gauge": "given",
                "band_limit": estimate.spectrum.basis.band_limit,
                "coefficients_total": estimate.light.tolist(),
            },
            photographs=self.photographs,
            own={
                "diagnosis": causes_of(estimate.diagnosis, {"order": "spectrum.order"}),
                "spectrum": _summary(estimate),
            },
            misfit=estimate.misfit,
        )

    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph by the convolution (T 2.55)."""
        images = []
        for photograph in self.photographs:
            view = photograph.view
            samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
            radiance = self.estimate.spectrum.radiance(self.estimate.light, samples)
            image = np.zeros((*view.hit.shape, radiance.shape[1]))
            # A truncated series may dip below zero.
            image[view.hit] = np.maximum(radiance, 0)
            images.append(image)
        return images

    def arrays(self) -> dict[str, Group]:
        """Lay out the coefficients with their covariance, and the light."""
        spectrum = self.estimate.spectrum
        names = ("degree", "outgoing_degree", "order")
        variables = {
            name: Variable(_UNKNOWN, index, "1", f"{name.replace('_', ' ')} of a coefficient")
            for name, index in zip(names, spectrum.basis.indices)
        }
        for name, values, units, words in (
            ("value", spectrum.values, "1/sr", "coefficients of the lobe"),
            ("standard_error", spectrum.standard_error, "1/sr", "standard errors of value"),
            ("resolution", spectrum.resolution, "1", "part that the data have in a coefficient"),
        ):
            variables[name] = Variable((*_UNKNOWN, "channel"), values, units, words)
        every = ("channel", *_UNKNOWN, "other_unknown")
        words = "covariance of value"
        variables["covariance"] = Variable(every, spectrum.covariance, "1/sr^2", words)
        exact, words = spectrum.if_exact(), "covariance of value if the model were exact"
        variables["exact_covariance"] = Variable(every, exact.covariance, "1/sr^2", words)
        total = Variable(
            ("coefficient", "channel"), self.estimate.light, "radiance", "coefficients of the light"
        )
        reciprocal = {"reciprocal": int(spectrum.basis.reciprocal)}
        return {"spectrum": Group(variables, reciprocal), "light": Group({"total": total})}

    def write_images(self, folder: Path) -> None:
        """Write the light."""
        light = self.evidence.light
        if light is not None and light.environment is not None:
            write_environment(folder / "lighting.exr", light.environment)

    def page(self, title: str, result: dict[str, Any], frames: tuple[FramePictures, ...]) -> Page:
        """Lay out the report."""
        from jaxrender.pipelines.report.brdf_spectrum import SpectrumContents, spectrum_page

        energy = self.estimate.light_amplitudes**2
        contents = SpectrumContents(title, result, self.estimate.orders, energy, frames)
        return spectrum_page(contents)


def recover_spectrum(
    config: RunConfig, evidence: Evidence, clock: Clock, progress: Progress
) -> SpectrumRecovery:
    """Recover the coefficients; ``InputError`` as ``estimate_spectrum`` has ``ValueError``."""
    asked, given = config.spectrum or SpectrumConfig(), config.samples
    noise = settings_of(config).noise
    settings = SpectrumSettings(asked.order, asked.reciprocal, noise, given.count, given.seed)

    def note(found: BRDFSpectrum) -> None:
        left = 100 * found.relative_rms
        progress.note(f"order {found.basis.band_limit}: {left:.2f} % unexplained")

    assert evidence.light is not None
    with clock.stage("spectrum"), fault_of(str(config.capture.transforms)):
        estimate = estimate_spectrum(
            evidence.observations, evidence.shape, evidence.light, settings, note
        )
    return SpectrumRecovery(estimate, evidence)


class SpectrumSubject(Subject):
    """A BRDF known by coefficients.  The series may ring; negative radiance is shown black."""

    def __init__(self, spectrum: BRDFSpectrum):
        self.lobe, self.brdf = None, HarmonicBRDF.of(spectrum)
        self.width = _WIDTH_PER_WAVE * np.pi / max(spectrum.basis.band_limit, 1)

    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render a view."""
        return np.maximum(render_view(self.brdf, view, model), 0)


def read_spectrum(path: Path) -> BRDFSpectrum:
    """Read the coefficients of a result; ``InputError`` where it has none or is damaged."""
    by_channel = (*_UNKNOWN, "channel")
    with opened(path, ARRAYS_FORMAT) as file:
        group = file.group("spectrum")
        limit = int(group.array("degree", _UNKNOWN).max())
        basis = SpectrumBasis(limit, bool(group.one_of("reciprocal", (0, 1))))
        value, resolution = (group.array(name, by_channel) for name in ("value", "resolution"))
        covariance = group.array("covariance", ("channel", *_UNKNOWN, "other_unknown"))
    return BRDFSpectrum(basis, value, covariance, resolution)


def _degree(one: DegreeOfLobe) -> dict[str, Any]:
    return {
        "degree": one.degree,
        "light": one.light,
        "told": one.determined,
        "rms_value": one.rms_value,
        "rms_standard_error": one.rms_standard_error,
    }


def _summary(estimate: SpectrumEstimate) -> dict[str, Any]:
    spectrum = estimate.spectrum
    return {
        "order": spectrum.basis.band_limit,
        "reciprocal": spectrum.basis.reciprocal,
        "unknowns": spectrum.basis.count,
        "determined": float(spectrum.resolution.sum(axis=0).mean()),
        "lobe_relative_error": lobe_error(spectrum),
        "lobe_relative_error_if_exact": lobe_error(spectrum.if_exact()),
        "by_degree": [_degree(one) for one in estimate.by_degree()],
        "orders": [
            {
                "order": one.basis.band_limit,
                "unknowns": one.basis.count,
                "relative_rms": one.relative_rms,
                "lobe_relative_error": lobe_error(one),
            }
            for one in estimate.orders
        ],
    }


def _draw(config: RunConfig, pool: Observations, light: KnownLight | None) -> Observations:
    return random_subset(pool, config.samples.count, config.samples.seed)


def _would(config: RunConfig, evidence: Evidence) -> str:
    order = (config.spectrum or SpectrumConfig()).order
    return (
        f"recover coefficients to order {order} from "
        f"{evidence.observations.count} samples of {len(evidence.photographs)} photographs"
    )


def _of_run(run: FinishedRun) -> BRDFSpectrum:
    return read_spectrum(run.folder / ARRAYS)


# The degrees of the light are checked when it is analysed.
TASK = Task(
    draw=_draw,
    check=lambda config, evidence: None,
    would=_would,
    recover=recover_spectrum,
    brdf=lambda run: HarmonicBRDF.of(_of_run(run)),
    subject=lambda run, shape: SpectrumSubject(_of_run(run)),
)
