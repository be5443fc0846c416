"""A recovered texture as the data of ``result.json``."""

from typing import Any

import numpy as np

from jaxrender.harmonics import band_limit_of
from jaxrender.inverse.photographs import Photograph
from jaxrender.inverse.texture import Texture
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.result import Result
from jaxrender.pipelines.texture.sites import SurfaceSites
from jaxrender.pipelines.texture.surface import IDENTIFIABLE_WITHIN, NORMAL_90, Region, Surface

# Where an interval is symmetric in the logarithm of value - origin.
_ORIGIN = {"sigma": 0.0, "mu": 1.0}
_LARGEST_LOG = 20.0
# The range of what varies is that of most sites: percentiles.
_MOST_OF = (5, 95)


def summary_of_surface(
    config: RunConfig,
    surface: Surface,
    sites: SurfaceSites,
    photographs: list[Photograph],
    files: dict[str, str],
) -> Result:
    """Sum up sigma and mu with intervals, what the texture is like, and what is marked."""
    texture, brdf = surface.texture, config.brdf
    known = texture.seen[sites.of_observation[sites.of_observation >= 0]]
    own: dict[str, Any] = {
        "texture": _texture(texture, sites) | _variation(surface) | {"files": files}
    }
    if any(region.name for region in surface.regions):
        own["regions"] = [_region(region) for region in surface.regions]
    if surface.ambiguity:
        own["ambiguity"] = surface.ambiguity
    return Result(
        task="texture",
        outcome=surface.outcome,
        reasons=surface.reasons,
        brdf={"model": brdf.model, **_means(config, texture), **_lobe(config, surface)},
        **_errors(config, surface),
        relative_rms=texture.relative_rms,
        samples=len(known),
        noise=surface.noise,
        lighting=_lighting(surface),
        photographs=photographs,
        own=own,
    )


def _lighting(surface: Surface) -> dict[str, Any]:
    """Say in what units the light is, and which it is where it was recovered."""
    lighting: dict[str, Any] = {"gauge": surface.gauge}
    if surface.light is not None:
        lighting |= {
            "band_limit": band_limit_of(len(surface.light.coefficients)),
            "coefficients": surface.light.coefficients.tolist(),
            "environment": "lighting.exr",
            "directional": [],
        }
        if surface.light.standard_error is not None:
            lighting["coefficients_error"] = surface.light.standard_error.tolist()
    return lighting


def interval(name: str, value: float, error: float) -> list[float]:
    """Return the 90 % interval, symmetric in the logarithm of sigma or of mu - 1."""
    size = value - _ORIGIN[name]
    # An error beyond all measure need not be said to the digit.
    factor = np.exp(min(NORMAL_90 * error / size, _LARGEST_LOG)) if size > 0 else 1.0
    return [_ORIGIN[name] + size / factor, _ORIGIN[name] + size * factor]


def sentence_on(texture: dict[str, Any]) -> str:
    """Say what became of the sites, in one sentence."""
    return (
        f"texture: {texture['sentence']}; {texture['seen']} seen, {texture['unseen']} not; kd is "
        f"marked at {texture['kd_marked']} of those seen, ks at {texture['ks_marked']}"
    )


def _means(config: RunConfig, texture: Texture) -> dict[str, Any]:
    """Average over the sites that can be trusted, or over all where none can."""
    seen = texture.seen > 0
    good = seen & ~texture.kd_marked
    kd = np.nanmean(texture.kd[good if good.any() else seen], axis=0)
    if config.brdf.model == "lambertian":
        return {"kd": kd.tolist()}
    told = seen & ~texture.ks_marked
    return {"kd": kd.tolist(), "ks": float(np.nanmean(texture.ks[told if told.any() else seen]))}


def _lobe(config: RunConfig, surface: Surface) -> dict[str, Any]:
    """One sigma and mu, or a list of them by region."""
    brdf, regions = config.brdf, surface.regions
    if brdf.model == "lambertian":
        return {}
    values: dict[str, Any] = {"sigma": _alone([region.sigma for region in regions])}
    metal = brdf.known("mu") is None
    values["mu"] = "none" if metal else _alone([region.mu for region in regions])
    return values | {"fresnel": brdf.fresnel, "masking": brdf.masking}


def _errors(config: RunConfig, surface: Surface) -> dict[str, Any]:
    """Intervals, standard errors and what is identifiable of sigma and mu, where they are known."""
    sections: dict[str, Any] = {"interval90": {}, "standard_error": {}, "identifiable": {}}
    if config.brdf.model == "lambertian":
        return sections
    for name in ("sigma", "mu"):
        parameter = config.brdf.known(name)
        if parameter is None:
            continue
        values = [getattr(region, name) for region in surface.regions]
        errors = [getattr(region, f"{name}_error") for region in surface.regions]
        if None in errors:
            continue
        pairs = zip(values, errors)
        sections["interval90"][name] = _alone([interval(name, v, e) for v, e in pairs])
        sections["standard_error"][name] = _alone(errors)
        if parameter.free:
            sections["identifiable"][name] = all(
                NORMAL_90 * e <= IDENTIFIABLE_WITHIN * (v - _ORIGIN[name])
                for v, e in zip(values, errors)
            )
    return sections


def _texture(texture: Texture, sites: SurfaceSites) -> dict[str, Any]:
    seen = texture.seen > 0
    relative = texture.relative_error[seen]
    counts = {"kd_marked": texture.kd_marked, "ks_marked": texture.ks_marked}
    found: dict[str, Any] = {
        "sites": sites.kind,
        "sentence": sites.sentence,
        "count": sites.count,
        "seen": int(np.count_nonzero(seen)),
        "unseen": int(np.count_nonzero(~seen)),
        **{name: int(np.count_nonzero(marked & seen)) for name, marked in counts.items()},
        "median_relative_error_kd": float(np.median(relative)),
        "median_observations": float(np.median(texture.seen[seen])),
    }
    if sites.image is not None:
        found |= {"rows": sites.image[0], "columns": sites.image[1]}
    return found


def _variation(surface: Surface) -> dict[str, Any]:
    """Say how far sigma ranges where it varies."""
    if surface.variation is None:
        return {}
    sigma, error = (part[np.isfinite(surface.variation.sigma)] for part in surface.variation)
    low, high = np.percentile(sigma, _MOST_OF)
    return {"sigma_range": [float(low), float(high)], "sigma_error": float(np.median(error))}


def _region(region: Region) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": region.name,
        "sites": region.sites,
        "outcome": region.outcome.value,
        "sigma": region.sigma,
        "mu": region.mu,
    }
    for name in ("sigma", "mu"):
        error, value = getattr(region, f"{name}_error"), getattr(region, name)
        if error is not None and np.isfinite(value):
            found[f"{name}_interval90"] = interval(name, value, error)
    return found


def _alone(values: list) -> Any:
    """One value for one region, a list for several."""
    return values[0] if len(values) == 1 else values
