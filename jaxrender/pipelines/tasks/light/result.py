"""The recovered light and material as data for ``result.json``."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.harmonics import band_limit_of
from jaxrender.inverse import Factorization, factorization
from jaxrender.inverse.comparison import Comparison
from jaxrender.inverse.factorization import RecoveredScene
from jaxrender.inverse.misfit import Left
from jaxrender.inverse.nuisances import NUISANCES
from jaxrender.inverse.own_words import OwnWords
from jaxrender.inverse.photographs import Photograph
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.calibration import by_photograph, calibration_document
from jaxrender.pipelines.ranking import ranking_of
from jaxrender.pipelines.result import Result, causes_of
from jaxrender.shapes import Float

# A degree is identifiable if the photographs determine more than this share of it.
_MOSTLY = 0.5
# Keys of a config that make up for a cause.
_KEYS = {
    name: f"solve.free: [{name}]" for name in NUISANCES if name not in factorization.OF_LIGHT
} | {"saturation": "capture.saturation", "lobe": "brdf.compare"}
_GAUGES = {
    "per-channel": "kd + ks = 1 in each channel; light scaled to match",
    "dielectric": "one ks for all channels, mean of kd + ks = 1; light scaled to match",
    "metal": "light of one mean radiance in all channels, mean of kd + ks = 1",
    "given": "given by the material",
}


class Recovered(NamedTuple):
    """A finished recovery: the task, the model's name, the gauge and the fit."""

    task: str
    model: str
    gauge: str
    found: Factorization
    photographs: list[Photograph]
    comparison: Comparison | None = None


def result_of(recovered: Recovered, shown: DirectionalSources) -> Result:
    """Sum up light and material, and the steps of the fit.

    ``shown`` are the sources beside the slow light's picture, which is nowhere negative.
    """
    found = recovered.found
    words = OwnWords(recovered.model, found.brdf)
    parameters = found.parameters
    exact = parameters.if_exact or parameters
    own: dict[str, Any] = {
        "interval90_if_exact": words.intervals(exact.lower, exact.upper),
        "diagnosis": causes_of(found.diagnosis, _KEYS),
        "path": [
            {
                "band_limit": one.band_limit,
                "sources": one.sources,
                "ks_share": one.share.tolist(),
                "sigma": one.sigma,
                found.brdf.index.name: found.brdf.index.of_index(one.mu),
                "relative_rms": one.relative_rms,
            }
            for one in found.rounds
        ],
    }
    fitted = Left(found.observations, found.predicted)
    own["photographs"] = by_photograph(fitted, recovered.photographs, found.calibration)
    if found.calibration is not None:
        own["calibration"] = calibration_document(found.calibration, recovered.photographs)
    if recovered.comparison is not None:
        own["comparison"] = ranking_of(recovered.comparison)
    return Result(
        task=recovered.task,
        outcome=found.outcome,
        reasons=found.reasons,
        brdf={
            "model": recovered.model,
            **words.material(parameters.value),
            **words.choices(),
        },
        interval90=words.intervals(parameters.lower, parameters.upper),
        standard_error=words.values(parameters.standard_error),
        identifiable=found.identifiable,
        relative_rms=found.relative_rms,
        samples=found.observations.count,
        noise=found.noise,
        lighting=_lighting(recovered, shown),
        photographs=recovered.photographs,
        own=own,
        misfit=found.misfit,
        correlations=words.correlations(parameters),
    )


def _sentence_on(determined: Float[np.ndarray, "degree"]) -> str:
    """Say which degrees of the light are identifiable; the prior fills in the rest."""
    spans: list[list[int]] = []
    for degree in np.flatnonzero(determined > _MOSTLY).tolist():
        if spans and degree == spans[-1][1] + 1:
            spans[-1][1] = degree
        else:
            spans.append([degree, degree])
    if spans == [[0, len(determined) - 1]]:
        return f"all degrees of the slow light, 0 to {len(determined) - 1}, are identifiable"
    *most, last = (f"{a}" if a == b else f"{a} to {b}" for a, b in spans)
    named = f"{', '.join(most)} and {last}" if most else last
    subject = f"degree {named} is" if spans == [[0, 0]] else f"degrees {named} are"
    return f"of the slow light {subject} identifiable; smoothness fills in the rest"


def _lighting(recovered: Recovered, shown: DirectionalSources) -> dict[str, Any]:
    scene = recovered.found.scene
    return {
        "gauge": _GAUGES[recovered.gauge],
        "band_limit": band_limit_of(scene.slow.shape[0]),
        "coefficients": scene.slow.tolist(),
        "coefficients_error": scene.slow_error.tolist(),
        "coefficients_total": scene.total.tolist(),
        "told": scene.determined.tolist(),
        "sentence": _sentence_on(scene.determined),
        "environment": "lighting.exr",
        "deviation": "lighting_deviation.exr",
        "directional": _directional(scene, shown),
        "clusters": [
            {
                "members": one.members.tolist(),
                "direction": one.direction.tolist(),
                "direction_error_degrees": float(np.degrees(one.direction_error)),
                "width_degrees": float(np.degrees(one.width)),
                "width_error_degrees": float(np.degrees(one.width_error)),
                "irradiance": one.irradiance.tolist(),
                "irradiance_error": one.irradiance_error.tolist(),
            }
            for one in scene.clusters
        ],
    }


def _directional(scene: RecoveredScene, shown: DirectionalSources) -> list[dict[str, Any]]:
    """List the sources, each with the cluster that it is in."""
    cluster = {int(at): k for k, one in enumerate(scene.clusters) for at in one.members}
    rows = zip(
        scene.sources.directions,
        scene.sources.irradiance,
        scene.energy_error,
        scene.direction_error,
        shown.irradiance,
        np.zeros(len(scene.direction_error)) if scene.widths is None else scene.widths,
    )
    return [
        {
            "direction": np.asarray(direction).tolist(),
            "irradiance": np.asarray(energy).tolist(),
            "irradiance_error": error.tolist(),
            "direction_error_degrees": float(np.degrees(step)),
            "irradiance_shown": np.asarray(beside).tolist(),
            "width_degrees": float(np.degrees(width)),
            "cluster": cluster.get(at),
        }
        for at, (direction, energy, error, step, beside, width) in enumerate(rows)
    ]
