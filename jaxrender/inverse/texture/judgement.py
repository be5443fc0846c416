"""What an answer under unknown light leaves, and what of it can be trusted."""

from dataclasses import replace

import numpy as np

from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.models import Columns
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.prepared_light import DUAL_ERROR
from jaxrender.inverse.texture.clustered import excess_of_surface, widening
from jaxrender.inverse.texture.estimate import TextureEstimate
from jaxrender.inverse.texture.examination import misfit_of
from jaxrender.inverse.texture.measurements import by_site

# An answer that leaves more than this part unexplained has not converged.
_MUCH_LEFT = 0.2
# Observations looked at together.
_CHUNK = 2**14


def noise_left(
    observations: Observations, estimate: TextureEstimate, columns: Columns
) -> NoiseModel:
    """Estimate the noise, making up for what each site's material has fitted away."""
    radiance, site = np.asarray(observations.radiance), estimate.sites.of_observation
    predicted = estimate.texture.radiance(columns, site)
    seen = np.where(site >= 0, estimate.texture.seen[site], 0)
    channels = radiance.shape[1]
    measured, fitted = seen * channels, channels + 1
    usable = (measured > fitted) & (predicted > 0).all(axis=1)
    inflation = np.sqrt(measured[usable] / (measured[usable] - fitted))[:, None]
    left = (radiance - predicted)[usable] * inflation
    return estimate_noise(left, predicted[usable], observations.rounding)


def judged(
    estimate: TextureEstimate,
    columns: Columns,
    observations: Observations,
    noise: NoiseModel | None,
) -> TextureEstimate:
    """Add each site's misfit and marks, and what is left unexplained of all.

    ``noise`` is that which was given, if any.
    """
    radiance, texture = np.asarray(observations.radiance), estimate.texture
    site = estimate.sites.of_observation
    unexplained = radiance - texture.radiance(columns, site)
    off, known = unexplained[site >= 0], site[site >= 0]
    level = np.maximum(radiance[site >= 0] - off, 0)
    deviation = np.asarray(estimate.noise.standard_deviation(level)) + 1e-12
    squares = np.sum((off / deviation) ** 2, axis=1)
    channels = radiance.shape[1]
    freedom = np.maximum(texture.seen * channels - channels - 1, 1)
    total = np.bincount(known, squares, estimate.sites.count)
    misfit = np.where(texture.seen > 0, np.sqrt(total / freedom), np.nan)
    energy = float(np.sum(radiance[site >= 0] ** 2))
    left = float(np.sqrt(np.sum(off**2) / energy)) if energy > 0 else 0.0
    if left > _MUCH_LEFT:
        assert estimate.light is not None
        limit = int(np.sqrt(len(estimate.light.coefficients))) - 1
        much = (
            f"{100 * left:.0f} % of the photographs is left unexplained: light to degree {limit} "
            "is too soft for what lit the object, such as small sources, or the surface is not as "
            "supposed; give the light, or another band limit"
        )
        reasons = (much, *estimate.reasons)
        estimate = replace(estimate, outcome=Outcome.NOT_CONVERGED, reasons=reasons)
    measured = by_site(observations, site, estimate.sites.count)
    excess = excess_of_surface(measured, columns, unexplained, estimate.noise, _CHUNK)
    wider = widening(excess)
    texture = texture._replace(
        misfit=misfit,
        kd_error=texture.kd_error * wider[:, :1],
        ks_error=texture.ks_error * wider[:, 1],
    )
    above = misfit_of(observations, site, radiance - unexplained, texture, noise, DUAL_ERROR)
    if above is not None and above.found:
        reasons = (above.sentence(), *estimate.reasons)
        outcome = estimate.outcome
        outcome = Outcome.MISFIT if outcome is Outcome.CONVERGED else outcome
        estimate = replace(estimate, outcome=outcome, reasons=reasons)
    return replace(
        estimate,
        misfit=above,
        texture=texture._replace(
            ks_marked=~(NORMAL_90 * texture.ks_error <= IDENTIFIABLE_WITHIN * texture.ks),
            relative_rms=left,
        ).marked(),
    )
