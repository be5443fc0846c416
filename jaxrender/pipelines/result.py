"""What a fit found, as data: ``result.json`` for the summary, ``result.nc`` for the arrays."""

import hashlib
import json
import math
import platform
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import h5netcdf
import numpy as np

from jaxrender import __version__
from jaxrender.brdf import Glossy
from jaxrender.errors import InputError
from jaxrender.geometry import Shape
from jaxrender.harmonics import degrees, orders
from jaxrender.inverse import BRDFFit, KnownLight
from jaxrender.inverse.comparison import Comparison, Score
from jaxrender.inverse.forecast import MaterialForecast
from jaxrender.inverse.own_words import OwnWords
from jaxrender.inverse.passes import Stop, values_of
from jaxrender.inverse.photographs import Photograph
from jaxrender.inverse.variants import Variant, model_sensitive
from jaxrender.pipelines.deviation import write_covariance
from jaxrender.pipelines.shadows import TransferField, interreflection, sentence_on
from jaxrender.spectra import light_coefficients

_LIBRARIES = ("jax", "equinox", "optimistix", "lineax", "numpy", "scipy", "OpenImageIO", "embreex")


class Finding(NamedTuple):
    """A finished fit with everything that its result is made of."""

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


def result_of(finding: Finding) -> dict[str, Any]:
    """Build the summary: values, intervals, what is identifiable, light, residuals."""
    fit = finding.fit
    words = _words(finding)
    final, own = fit.final, fit.parameters
    result: dict[str, Any] = {
        "task": "brdf",
        "outcome": fit.outcome.value,
        "meaning": fit.outcome.sentence,
        "reasons": list(fit.reasons),
        "brdf": {"model": finding.model, **words.material(own.value)},
        "interval90": words.intervals(own.lower, own.upper),
        "standard_error": words.values(own.standard_error),
        "identifiable": fit.identifiable,
        "model_sensitive": model_sensitive(fit, finding.variants),
        "variants": [_variant(finding, variant) for variant in finding.variants],
        "residual": _residual(final),
        "noise": {"relative": final.noise.relative, "floor": final.noise.floor},
        "lighting": _lighting(finding),
        "pixels": pixels_of(finding.photographs),
    }
    result["brdf"] |= words.choices()
    if finding.model != "lambertian" and fit.evidence is not None:
        result["evidence"] = {**fit.evidence._asdict(), "sentence": fit.evidence.sentence()}
    if finding.comparison is not None:
        result["comparison"] = ranking_of(finding.comparison, not finding.ks_per_channel)
    if finding.forecast is not None:
        result["forecast"] = _forecast(finding, finding.forecast)
    if fit.exact is not None and isinstance(fit.brdf, Glossy):
        result["frequency"] = {
            "brdf": words.material(values_of(fit.frequency)),
            "residual": _residual(fit.frequency),
            "bias": words.biases(fit.bias),
        }
    bounced = interreflection(fit)
    if bounced:
        result["interreflection"] = {**bounced, "sentence": sentence_on(bounced)}
    unknowns = final.problem.unknowns
    if unknowns.free_gains:
        gains = np.asarray(fit.parameters.value.gains)
        result["gains"] = {p.frame.name: float(g) for p, g in zip(finding.photographs, gains)}
    if unknowns.free_scale:
        result["scale"] = float(fit.parameters.value.scale)
    return finite(result)


def provenance_of(inputs: list[Path], seed: int) -> dict[str, Any]:
    """Say what the result was made with and from."""
    return {
        "jaxrender": __version__,
        "python": platform.python_version(),
        "libraries": {name: metadata.version(name) for name in _LIBRARIES},
        "machine": platform.machine(),
        "seed": seed,
        "inputs": {path.name: _digest(path) for path in inputs},
    }


def write_json(path: Path, result: dict[str, Any]) -> None:
    """Write a result as strict JSON."""
    path.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_result(folder: Path) -> dict[str, Any]:
    """Read the summary of a finished run; ``InputError`` where it has gone or is damaged."""
    path = folder / "result.json"
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); make the result anew with fit --force"
        ) from None


def write_arrays(path: Path, finding: Finding) -> None:
    """Write the samples of both fits and the light's coefficients as NetCDF, dimensions named."""
    fit = finding.fit
    with h5netcdf.File(path, "w") as file:
        _write_stop(file, "frequency", fit.frequency)
        if fit.exact is not None:
            _write_stop(file, "exact", fit.exact)
        write_covariance(file, fit.parameters)
        dual = fit.light.dual
        light = file.create_group("light")
        light.dimensions = {
            "coefficient": dual.slow.shape[0],
            "channel": dual.slow.shape[1],
            "source": max(dual.sources.directions.shape[0], 1),
            "component": 3,
        }
        write_variable(light, "degree", ("coefficient",), degrees(dual.band_limit))
        write_variable(light, "order", ("coefficient",), orders(dual.band_limit))
        write_variable(light, "slow", ("coefficient", "channel"), dual.slow)
        if dual.sources.directions.shape[0]:
            write_variable(light, "direction", ("source", "component"), dual.sources.directions)
            write_variable(light, "irradiance", ("source", "channel"), dual.sources.irradiance)


def _words(finding: Finding) -> OwnWords:
    return OwnWords(finding.model, finding.fit.brdf, not finding.ks_per_channel)


def ranking_of(comparison: Comparison, one_ks: bool = False) -> dict[str, Any]:
    """List the models that were compared, the best first; ``one_ks`` as in ``OwnWords``."""

    def one(score: Score) -> dict[str, Any]:
        words = OwnWords(score.name, score.fit.brdf, one_ks)
        parameters = score.fit.parameters
        return {
            "model": score.name,
            "outcome": score.fit.outcome.value,
            "brdf": words.material(parameters.value),
            "standard_error": words.values(parameters.standard_error),
            "chi_squared": score.chi_squared,
            "relative_rms": score.relative_rms,
            "behind": score.behind,
            "behind_error": score.behind_error,
            "told_apart": score.told_apart,
        }

    return {
        "held_out": comparison.held_out,
        "ranking": [one(score) for score in comparison.scores],
    }


def sentence_of(comparison: Comparison) -> str:
    """Name the best model, and those that the held-out samples cannot tell from it."""
    best, *others = comparison.scores
    as_good = [score.name for score in others if not score.told_apart]
    sentence = f"{best.name} explains {comparison.held_out} held-out samples best"
    return f"{sentence}; {', '.join(as_good)} as well" if as_good else sentence


def _forecast(finding: Finding, forecast: MaterialForecast) -> dict[str, Any]:
    """Say what the material that was found could have been expected to tell."""
    brdf = finding.fit.brdf
    return {
        "standard_error": _words(finding).values(forecast.parameters.standard_error),
        "recoverable_degree": forecast.highest_degree,
        "singular_values": forecast.singular_values.tolist(),
        "unknowns": [brdf.called(name) for name in forecast.unknowns],
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
    }


def _residual(stop: Stop) -> dict[str, Any]:
    return {"relative_rms": stop.relative_rms, "samples": stop.observations.count}


def _lighting(finding: Finding) -> dict[str, Any]:
    fit, light = finding.fit, finding.light
    dual, split = fit.light.dual, fit.light.split
    free = fit.final.problem.unknowns.free_scale
    gauge = "mean of kd + ks is 1; the light as given, times scale, made the photographs"
    lighting: dict[str, Any] = {"gauge": gauge if free else "given"}
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


def pixels_of(photographs: list[Photograph]) -> dict[str, Any]:
    """Count the usable pixels, and those that each rule removed."""
    removed: dict[str, int] = {}
    for photograph in photographs:
        for rule, count in photograph.selection.removed.items():
            removed[rule] = removed.get(rule, 0) + int(count)
    usable = sum(int(np.count_nonzero(p.selection.usable)) for p in photographs)
    return {"photographs": len(photographs), "usable": usable, "removed": removed}


def _write_stop(file: h5netcdf.File, name: str, stop: Stop) -> None:
    group = file.create_group(name)
    observations = stop.observations
    channels = observations.radiance.shape[1]
    group.dimensions = {"sample": observations.count, "channel": channels, "component": 3}
    write_variable(group, "normal", ("sample", "component"), observations.samples.normals)
    write_variable(group, "outgoing", ("sample", "component"), observations.samples.outgoing)
    write_variable(group, "radiance", ("sample", "channel"), observations.radiance)
    write_variable(group, "predicted", ("sample", "channel"), stop.fit.predicted)
    write_variable(group, "weight", ("sample", "channel"), stop.data.weights)
    write_variable(group, "frame", ("sample",), observations.frame)
    write_variable(group, "pixels", ("sample",), observations.pixels)


def write_variable(group, name: str, dimensions: tuple[str, ...], values) -> None:
    """Write an array under named dimensions of a NetCDF group."""
    group.create_variable(name, dimensions, data=np.asarray(values))


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def finite(value: Any) -> Any:
    """Replace what JSON has no number for by null."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return bool(value) if isinstance(value, np.bool_) else value
