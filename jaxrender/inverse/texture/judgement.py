"""What an answer under unknown light leaves, what would explain that, and what can be trusted."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.diagnosis import CLIPPED, diagnose, likeliest
from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.models import Columns
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.texture.clustered import excess_of_surface, widening
from jaxrender.inverse.texture.estimate import TextureEstimate
from jaxrender.inverse.texture.examination import misfit_of, pixels_of_sites
from jaxrender.inverse.texture.measurements import by_site
from jaxrender.inverse.texture.mixed import mixed
from jaxrender.inverse.texture.suspicion import LitPixels
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import Float

# An answer that leaves more than this part unexplained has not converged.
_MUCH_LEFT = 0.2
# The light ends at some degree: less of the radiance than this it may leave without being wrong.
_LEAST_MISFIT = 0.005
# Observations looked at together; the seed of the pixels that causes are tested on.
_CHUNK, _SEED = 2**14, 0


class Judging(NamedTuple):
    """How an answer is judged: the noise if it was given, and what is known beside it.

    ``exact`` says whether columns are of the integral, ``diagnosing`` whether causes are named.
    ``freed`` are nuisances by which photographs were corrected, ``told`` these as they were told.
    """

    noise: NoiseModel | None
    exact: bool
    diagnosing: bool
    freed: tuple[str, ...] = ()
    told: Observations | None = None


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
    asked: Judging,
) -> TextureEstimate:
    """Add each site's misfit and marks, what is left unexplained of all, and what explains it."""
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
    predicted = radiance - unexplained
    above = misfit_of(observations, site, predicted, texture, asked.noise, _LEAST_MISFIT)
    estimate = replace(
        estimate,
        misfit=above,
        texture=texture._replace(
            ks_marked=~(NORMAL_90 * texture.ks_error <= IDENTIFIABLE_WITHIN * texture.ks),
            relative_rms=left,
        ).marked(),
    )
    if asked.diagnosing:
        estimate = _explained(estimate, observations, unexplained, asked)
    reasons = [above.sentence()] if above is not None and above.found else []
    reasons += [best.reason for best in estimate.diagnosis[:1]]
    outcome = estimate.outcome
    outcome = Outcome.MISFIT if reasons and outcome is Outcome.CONVERGED else outcome
    return replace(estimate, outcome=outcome, reasons=(*reasons, *estimate.reasons))


def _explained(
    estimate: TextureEstimate,
    observations: Observations,
    unexplained: Float[np.ndarray, "sample channel"],
    asked: Judging,
) -> TextureEstimate:
    """Name what would explain the rest; errors reach as far as that moves what they are of."""
    site, texture, misfit = estimate.sites.of_observation, estimate.texture, estimate.misfit
    known, frame = np.flatnonzero(site >= 0), np.asarray(observations.frame)
    tested = pixels_of_sites(known, site, frame, texture, _SEED)
    if misfit is None or not len(tested):
        return estimate
    some = LitPixels.of(estimate, observations, tested, asked.exact)
    told = (asked.told or observations).take(tested)
    shape, noise = estimate.sites.shape, estimate.noise
    suspect = some.suspect(shape, told, observations, noise, asked.freed)
    diagnosis = diagnose(suspect, misfit)
    shifts = likeliest(diagnosis)
    if shifts:
        estimate = some.reaching(estimate, np.stack(shifts, axis=1))
    predicted = np.asarray(observations.radiance) - unexplained
    deviation = standard_deviations(misfit.noise, predicted)
    values = len(tested) * predicted.shape[1]
    every = (*diagnosis, *mixed(observations, site, unexplained, deviation, values))
    ranked = sorted(every, key=lambda one: (one.cause != CLIPPED, -one.bic))
    return replace(estimate, diagnosis=tuple(ranked))
