"""A recovered texture as the data of ``result.json``."""

from typing import Any

import numpy as np

from jaxrender.harmonics import band_limit_of
from jaxrender.inverse.nuisances import NUISANCES
from jaxrender.inverse.photographs import Photograph
from jaxrender.inverse.texture import (
    FREED_WITH_LIGHT,
    NEVER,
    RegionLobe,
    Texture,
    TextureEstimate,
)
from jaxrender.pipelines.calibration import calibration_document
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.result import Result, causes_of

# Keys of a config that make up for a cause.
_KEYS = {
    "saturation": "capture.saturation",
    "lobe": "brdf.model",
    "sites": "texture.size",
}
# The range of what varies is that of most sites: percentiles.
_MOST_OF = (5, 95)


def summary_of_texture(
    config: RunConfig, estimate: TextureEstimate, photographs: list[Photograph]
) -> Result:
    """Sum up sigma and mu with intervals, what the texture is like, and what is marked."""
    texture = estimate.texture
    files = {"files": estimate.files}
    own: dict[str, Any] = {"texture": _texture(estimate) | _variation(estimate) | files}
    if any(lobe.name for lobe in estimate.lobes):
        own["regions"] = [_region(lobe) for lobe in estimate.lobes]
    own["diagnosis"] = causes_of(estimate.diagnosis, _KEYS | _keys_of_freeing(estimate))
    if estimate.calibration is not None:
        own["calibration"] = calibration_document(estimate.calibration, photographs)
    exact = _errors(estimate.if_exact)
    own["interval90_if_exact"] = exact["interval90"]
    if estimate.ambiguity:
        own["ambiguity"] = estimate.ambiguity
    model = {"model": config.brdf.model}
    return Result(
        task="texture",
        outcome=estimate.outcome,
        reasons=estimate.reasons,
        brdf=model | _means(texture, estimate.diffuse) | _lobe(config, estimate),
        **_errors(estimate),
        relative_rms=texture.relative_rms,
        samples=int(np.sum(texture.seen)),
        noise=estimate.noise,
        lighting=_lighting(estimate),
        photographs=photographs,
        own=own,
        misfit=estimate.misfit,
    )


def _keys_of_freeing(estimate: TextureEstimate) -> dict[str, str]:
    """Say how to free what can be freed under known light, or with a light that is found."""
    names = [name for name in NUISANCES if name not in NEVER]
    if estimate.light is not None:
        names = FREED_WITH_LIGHT
    return {name: f"solve.free: [{name}]" for name in names}


def _lighting(estimate: TextureEstimate) -> dict[str, Any]:
    """Say in what units the light is, and which it is where it was recovered."""
    lighting: dict[str, Any] = {"gauge": estimate.gauge}
    if estimate.light is not None:
        lighting |= {
            "band_limit": band_limit_of(len(estimate.light.coefficients)),
            "coefficients": estimate.light.coefficients.tolist(),
            "environment": "lighting.exr",
            "directional": [],
        }
        if estimate.light.standard_error is not None:
            lighting["coefficients_error"] = estimate.light.standard_error.tolist()
    return lighting


def _means(texture: Texture, diffuse: bool) -> dict[str, Any]:
    """Average over the sites that can be trusted, or over all where none can."""
    seen = texture.seen > 0
    good = seen & ~texture.kd_marked
    kd = np.nanmean(texture.kd[good if good.any() else seen], axis=0)
    if diffuse:
        return {"kd": kd.tolist()}
    good = seen & ~texture.ks_marked
    ks = np.nanmean(texture.ks[good if good.any() else seen], axis=0)
    return {"kd": kd.tolist(), "ks": ks.tolist()}


def _lobe(config: RunConfig, estimate: TextureEstimate) -> dict[str, Any]:
    """One sigma and mu, or a list of them by region."""
    if estimate.diffuse:
        return {}
    lobes, names = estimate.lobes, estimate.lobe_names
    values: dict[str, Any] = {"sigma": _alone([lobe.sigma for lobe in lobes])}
    values["mu"] = _alone([lobe.mu for lobe in lobes]) if "mu" in names else "none"
    return values | {"fresnel": config.brdf.fresnel, "masking": config.brdf.masking}


def _errors(estimate: TextureEstimate) -> dict[str, Any]:
    """Intervals, standard errors and what is identifiable of sigma and mu, where they are known."""
    sections: dict[str, Any] = {"interval90": {}, "standard_error": {}}
    for name in estimate.lobe_names:
        errors = [getattr(lobe, f"{name}_error") for lobe in estimate.lobes]
        if None not in errors:
            intervals = [_interval(lobe, name) for lobe in estimate.lobes]
            sections["interval90"][name] = _alone(intervals)
            sections["standard_error"][name] = _alone(errors)
    return sections | {"identifiable": estimate.identifiable}


def _interval(lobe: RegionLobe, name: str) -> list[float] | None:
    """Lay out an interval; None where there is none to speak of."""
    found = lobe.interval90(name)
    return None if found is None else found.tolist()


def _texture(estimate: TextureEstimate) -> dict[str, Any]:
    texture, sites, seen = estimate.texture, estimate.sites, estimate.seen
    counts = {"kd_marked": texture.kd_marked, "ks_marked": texture.ks_marked}
    found: dict[str, Any] = {
        "sites": sites.kind,
        "sentence": sites.sentence,
        "count": sites.count,
        "seen": int(np.count_nonzero(seen)),
        "unseen": int(np.count_nonzero(~seen)),
        **{name: int(np.count_nonzero(marked & seen)) for name, marked in counts.items()},
        "median_relative_error_kd": float(np.median(texture.relative_error[seen])),
        "median_observations": float(np.median(texture.seen[seen])),
    }
    if sites.image is not None:
        found |= {"rows": sites.image[0], "columns": sites.image[1]}
    return found


def _variation(estimate: TextureEstimate) -> dict[str, Any]:
    """Say how far sigma ranges where it varies, and how far normals are tilted."""
    found, seen = {}, estimate.seen
    if estimate.variation is not None:
        sigma, error = (part[np.isfinite(estimate.variation.sigma)] for part in estimate.variation)
        low, high = np.percentile(sigma, _MOST_OF)
        found |= {"sigma_range": [float(low), float(high)], "sigma_error": float(np.median(error))}
    if estimate.normals is not None:
        tilt = np.arctan(np.linalg.norm(estimate.normals.offset, axis=1))[seen]
        found |= {
            "tilt_degrees": float(np.degrees(np.median(tilt))),
            "normal_error_degrees": float(np.degrees(np.median(estimate.normals.error[seen]))),
        }
    counts = {name: int(np.count_nonzero(one & seen)) for name, one in estimate.marked.items()}
    return found | counts


def _region(lobe: RegionLobe) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": lobe.name,
        "sites": lobe.sites,
        "outcome": lobe.outcome.value,
        "sigma": lobe.sigma,
        "mu": lobe.mu,
    }
    for name in ("sigma", "mu"):
        interval = _interval(lobe, name)
        if interval is not None and np.isfinite(getattr(lobe, name)):
            found[f"{name}_interval90"] = interval
    return found


def _alone(values: list) -> Any:
    """One value for one region, a list for several."""
    return values[0] if len(values) == 1 else values
