"""The result of task ``brdf``: the data of ``result.json`` and the arrays of ``result.nc``."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.geometry import Shape
from jaxrender.inverse import BRDFFit, KnownLight
from jaxrender.inverse.brdf_table import Correction
from jaxrender.inverse.comparison import Comparison
from jaxrender.inverse.curves import DEGREES, Curve, curves_of
from jaxrender.inverse.forecast import MaterialForecast
from jaxrender.inverse.misfit import Left
from jaxrender.inverse.nuisances import NUISANCES
from jaxrender.inverse.own_words import OwnWords, plain
from jaxrender.inverse.passes import DEFAULTS, FitSettings, Stop, values_of
from jaxrender.inverse.photographs import Photograph
from jaxrender.inverse.transfer_field import TransferField
from jaxrender.inverse.variants import Variant, model_sensitive, preferred
from jaxrender.io.netcdf import Group, Variable
from jaxrender.lighting import Environment
from jaxrender.pipelines.arrays import light_group, sample_arrays
from jaxrender.pipelines.calibration import by_photograph, calibration_document
from jaxrender.pipelines.deviation import covariance_groups
from jaxrender.pipelines.ranking import ranking_of
from jaxrender.pipelines.result import Result, causes_of
from jaxrender.pipelines.shadows import interreflection, sentence_on
from jaxrender.pipelines.tasks.material.table import table_document, table_groups
from jaxrender.spectra import light_coefficients

# Keys of a config that make up for a cause.
_KEYS = {name: f"solve.free: [{name}]" for name in NUISANCES} | {
    "saturation": "capture.saturation",
    "convention": "lighting.environment.convention",
    "lobe": "brdf.compare",
    "interreflection": "solve.interreflection",
}


class Finding(NamedTuple):
    """A finished fit, and everything else that its result states."""

    fit: BRDFFit
    variants: tuple[Variant, ...]
    light: KnownLight
    shape: Shape
    photographs: list[Photograph]
    model: str
    ks_per_channel: bool
    transfer: TransferField | None = None
    comparison: Comparison | None = None
    forecast: MaterialForecast | None = None
    settings: FitSettings = DEFAULTS
    correction: Correction | None = None


def result_of(finding: Finding) -> Result:
    """Sum up values, intervals, what is identifiable, light, residuals."""
    fit, words = finding.fit, _words(finding)
    final, parameters = fit.final, fit.parameters.summed(fit.brdf.sums)
    material = {"model": finding.model, **words.material(parameters.value)}
    return Result(
        task="brdf",
        outcome=fit.outcome,
        reasons=(*_headline(finding.variants), *fit.reasons),
        brdf=material | words.choices(),
        interval90=words.intervals(parameters.lower, parameters.upper),
        standard_error=words.values(parameters.standard_error),
        identifiable=fit.identifiable,
        relative_rms=final.relative_rms,
        samples=final.observations.count,
        noise=fit.noise,
        lighting=_lighting(finding),
        photographs=finding.photographs,
        own=_own(finding),
        misfit=fit.misfit,
        correlations=words.correlations(parameters),
    )


def _headline(variants: tuple[Variant, ...]) -> tuple[str, ...]:
    """Say first that another choice of the same model is better, where it is."""
    better = preferred(variants)
    return () if better is None else (better.sentence(),)


def _own(finding: Finding) -> dict[str, Any]:
    """Gather the keys that only this task has."""
    fit, words = finding.fit, _words(finding)
    parameters = fit.parameters.summed(fit.brdf.sums)
    exact = parameters.if_exact or parameters
    own: dict[str, Any] = {
        "interval90_if_exact": words.intervals(exact.lower, exact.upper),
        "diagnosis": causes_of(fit.diagnosis, _KEYS),
        "model_sensitive": model_sensitive(fit, finding.variants),
        "variants": [_variant(finding, variant) for variant in finding.variants],
    }
    if finding.model != "lambertian" and fit.evidence is not None:
        sentence = fit.evidence.sentence()
        own["evidence"] = {**fit.evidence._asdict(), "sentence": sentence}
    curves = curves_of(fit.brdf, fit.parameters)
    if curves:
        own["curves"] = {curve.name: _curve(curve) for curve in curves}
    if finding.comparison is not None:
        own["comparison"] = ranking_of(finding.comparison, not finding.ks_per_channel)
    if finding.correction is not None:
        own["table"] = table_document(finding.correction)
    if finding.forecast is not None:
        own["forecast"] = _forecast(finding, finding.forecast)
    if fit.exact is not None and fit.light.for_dual:
        frequency = fit.frequency
        samples = frequency.observations.count
        own["frequency"] = {
            "brdf": words.material(values_of(frequency)),
            "residual": {"relative_rms": frequency.relative_rms, "samples": samples},
            "bias": words.biases(fit.bias),
        }
    bounced = interreflection(fit)
    if bounced:
        own["interreflection"] = {**bounced, "sentence": sentence_on(bounced)}
    unknowns = fit.final.problem.unknowns
    gains = np.asarray(fit.parameters.value.gains) if unknowns.free_gains else None
    if gains is not None:
        own["gains"] = {p.frame.name: float(g) for p, g in zip(finding.photographs, gains)}
    fitted = Left(fit.final.observations, np.asarray(fit.final.fit.predicted))
    own["photographs"] = by_photograph(fitted, finding.photographs, fit.calibration, gains)
    if fit.calibration is not None:
        own["calibration"] = calibration_document(fit.calibration, finding.photographs)
    if unknowns.free_scale:
        own["scale"] = float(fit.parameters.value.scale)
    return own


def _curve(curve: Curve) -> dict[str, Any]:
    return {
        "degrees": plain(DEGREES),
        "values": plain(curve.values),
        "interval90": plain(np.stack([curve.lower, curve.upper], axis=1)),
        "nearest": {"model": curve.nearest, "values": plain(curve.nearest_values)},
    }


def environment_files(light: KnownLight) -> dict[str, Environment]:
    """Name the files of a light's environments: one of all photographs, or several by number."""
    if light.environment is not None:
        return {"lighting.exr": light.environment}
    return {f"lighting_{at}.exr": image for at, image in enumerate(light.images, 1)}


def groups_of(finding: Finding) -> dict[str, Group]:
    """Lay out the samples of both passes, the covariance and the light's coefficients."""
    fit, dual = finding.fit, finding.fit.light.dual
    groups = {"frequency": _samples(fit.frequency)}
    if fit.exact is not None:
        groups["exact"] = _samples(fit.exact)
    sources = dual.sources
    light = light_group(dual.slow, direction=sources.directions, irradiance=sources.irradiance)
    if finding.correction is not None:
        groups |= table_groups(finding.correction)
    return groups | covariance_groups(fit.parameters) | {"light": light}


def _words(finding: Finding) -> OwnWords:
    return OwnWords(finding.model, finding.fit.brdf, not finding.ks_per_channel)


def _forecast(finding: Finding, forecast: MaterialForecast) -> dict[str, Any]:
    """Lay out the predicted errors of the recovered material."""
    return {
        "standard_error": _words(finding).values(forecast.parameters.standard_error),
        "recoverable_degree": forecast.highest_degree,
        "singular_values": forecast.singular_values.tolist(),
        "unknowns": [*forecast.unknowns],
        "weakest": forecast.weakest.tolist(),
        "sentences": list(forecast.sentences),
    }


def _variant(finding: Finding, variant: Variant) -> dict[str, Any]:
    return {
        "fresnel": variant.fresnel,
        "masking": variant.masking,
        **_words(finding).material(variant.parameters),
        "chi_squared": variant.chi_squared,
        "rejected": variant.rejected,
        "preferred": variant.preferred,
    }


def _lighting(finding: Finding) -> dict[str, Any]:
    fit, light = finding.fit, finding.light
    dual, split = fit.light.dual, fit.light.split
    free = fit.final.problem.unknowns.free_scale
    gauge = "mean of kd + ks is 1; the light of the photographs is the given light times scale"
    lighting: dict[str, Any] = {"gauge": gauge if free else "given"}
    if light.environments is not None:
        lighting["environments"] = [
            {
                "file": name,
                "photographs": [
                    photograph.frame.name
                    for photograph, own in zip(finding.photographs, light.environments)
                    if own is image
                ],
            }
            for name, image in environment_files(light).items()
        ]
    if light.environment is not None:
        sources = light_coefficients(dual.sources, dual.band_limit)
        lighting |= {
            "band_limit": dual.band_limit,
            "coefficients": np.asarray(dual.slow).tolist(),
            "coefficients_total": (np.asarray(dual.slow) + np.asarray(sources)).tolist(),
            "environment": "lighting.exr",
        }
    if split is not None:
        lighting["split"] = {
            "sigma": split.sigma,
            "sources": int(split.sources.directions.shape[0]),
            "slow_energy": split.slow_energy,
        }
        if fit.light.needed is not None:
            lighting["split"] |= {
                "error": fit.light.needed.error,
                "error_without": fit.light.needed.error_without,
            }
    lighting["directional"] = [
        {"direction": d.tolist(), "irradiance": e.tolist()}
        for d, e in zip(*(np.asarray(part) for part in dual.sources.nodes()))
    ]
    return lighting


def _samples(stop: Stop) -> Group:
    weights, pixels = stop.data.weights, stop.observations.pixels
    variables = sample_arrays(stop.observations, stop.fit.predicted)
    each = ("sample", "channel")
    variables["weight"] = Variable(each, weights, "1/radiance", "weight of a residual")
    variables["pixels"] = Variable(("sample",), pixels, "1", "pixels that a sample stands for")
    return Group(variables)
