"""What a texture leaves above the noise, and what would explain it.

Neighbouring pixels of one site tell the noise.  Causes are tested on some of the sites, one pixel
of each in every photograph: of these K_d, K_s, sigma and mu may all answer to a cause.
"""

from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Shape
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.diagnosis import CLIPPED, Diagnosis, Suspect, diagnose, likeliest
from jaxrender.inverse.diagnosis.derivatives import Derivatives
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.inverse.known_light import DUAL_ERROR, KnownLight
from jaxrender.inverse.misfit import LEAST, Left, Misfit, measure_misfit, rows_of_three
from jaxrender.inverse.models import ExactModel, LinearisedModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.texture.account import TextureFit
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.mixed import mixed
from jaxrender.inverse.texture.texture import TRUSTED_MISFIT, Texture
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import Float, Int

# Pixels that tell the noise, and those that say what is left above it.
_NEIGHBOURS, _FITTED = 6000, 12_000
# Pixels and sites that causes are tested on, and photographs that must show such a site.
_TESTED, _MOST_SITES, _FEWEST_VIEWS = 700, 80, 3
# What is darker than this part of the typical site says nothing of relative errors.
_DARK = 0.1
# The part of the sites that is within one standard deviation.
_MOST = 0.68
# A site's K_d and K_s are found, and its edges of paint look like a blur.
_NOT_TESTED = ("sites", "blur", "convention")


class Painted(NamedTuple):
    """Photographs of a painted object under a known light, and the site of each pixel.

    ``model_of`` is what the sites were solved on; ``seed`` is that of the pixels that are tested.
    """

    observations: Observations
    site: Int[np.ndarray, "sample"]
    light: KnownLight
    variant: Microfacet
    shape: Shape | None
    model_of: ModelOf
    seed: int = 0


def examined(painted: Painted, fit: TextureFit, noise_given: bool, diagnosing: bool) -> TextureFit:
    """Say what a fit leaves, and let its errors reach as far as the best explanation moves it."""
    surface, radiance = fit.surface, np.asarray(painted.observations.radiance, float)
    predicted = np.full(radiance.shape, np.nan)
    predicted[surface.index] = radiance[surface.index] - surface.left
    misfit = misfit_of(
        painted.observations,
        painted.site,
        predicted,
        fit.texture,
        fit.noise if noise_given else None,
        LEAST if isinstance(painted.model_of(surface.index[:1]), ExactModel) else DUAL_ERROR,
        painted.seed,
    )
    if misfit is None:
        return fit
    diagnosis: tuple[Diagnosis, ...] = ()
    tested = _tested(painted, fit)
    if diagnosing and len(tested):
        suspect, names = _suspect(painted, fit, tested)
        diagnosis = diagnose(suspect, misfit)
        fit = _reaching(fit, diagnosis, names)
        deviation = standard_deviations(misfit.noise, np.nan_to_num(predicted))
        values = len(tested) * radiance.shape[1]
        left = radiance - predicted
        found = mixed(painted.observations, painted.site, left, deviation, values)
        every = (*diagnosis, *found)
        diagnosis = tuple(sorted(every, key=lambda one: (one.cause != CLIPPED, -one.bic)))
    reasons = [misfit.sentence()] if misfit.found else []
    reasons += [best.reason for best in diagnosis[:1]]
    outcome = fit.outcome
    if reasons and outcome in (Outcome.CONVERGED, Outcome.NOT_IDENTIFIABLE):
        outcome = Outcome.MISFIT
    return fit._replace(
        misfit=misfit, diagnosis=diagnosis, outcome=outcome, reasons=(*reasons, *fit.reasons)
    )


def misfit_of(
    pool: Observations,
    site: Int[np.ndarray, "sample"],
    predicted: Float[np.ndarray, "sample channel"],
    texture: Texture,
    noise: NoiseModel | None,
    least: float,
    seed: int = 0,
) -> Misfit | None:
    """Measure noise and misfit where sites can be trusted: where not, they are marked.

    ``predicted`` is NaN where nothing is known.  The rest is as ``measure_misfit`` has it.
    """
    radiance, rng = np.asarray(pool.radiance, float), np.random.default_rng(seed)
    trusted = texture.misfit <= TRUSTED_MISFIT
    own = (site >= 0) & trusted[site] & np.isfinite(predicted).all(axis=1)
    rows = rows_of_three(pool, pool.count, seed)
    alike = own[rows].all(axis=1) & (np.ptp(site[rows], axis=1) == 0)
    rows = _some(rows[alike], _NEIGHBOURS // 3, rng).ravel()
    # What a site's material has fitted away is made up for.
    channels = radiance.shape[1]
    measured = texture.seen * channels
    fitted = channels + int(np.any(texture.ks > 0))
    some = _some(np.flatnonzero(own & (measured > fitted)[site]), _FITTED, rng)
    if not len(some):
        return None
    count = measured[site[some]]
    left = (radiance - predicted)[some] * np.sqrt(count / (count - fitted))[:, None]
    return measure_misfit(
        Left(pool.take(some), radiance[some] - left),
        Left(pool.take(rows), predicted[rows]),
        noise,
        least,
    )


def _some(rows: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    return rows if len(rows) <= most else rows[np.sort(rng.choice(len(rows), most, replace=False))]


def _tested(painted: Painted, fit: TextureFit) -> Int[np.ndarray, "tested"]:
    """Choose pixels: one of each photograph that shows a site, of sites that many show."""
    texture, rng = fit.texture, np.random.default_rng(painted.seed)
    order = rng.permutation(fit.surface.index)
    site, frame = painted.site[order], np.asarray(painted.observations.frame)[order]
    _, first = np.unique(np.stack([site, frame], axis=1), axis=0, return_index=True)
    order, site = order[first], site[first]
    views = np.bincount(site, minlength=len(texture.seen))
    good = (views >= _FEWEST_VIEWS) & (texture.misfit <= TRUSTED_MISFIT)
    chosen = rng.permutation(np.flatnonzero(good))[:_MOST_SITES]
    kept = chosen[: int(np.searchsorted(np.cumsum(views[chosen]), _TESTED, side="right"))]
    return np.sort(order[np.isin(site, kept)])


class _Names(NamedTuple):
    """What the columns of a fit's derivatives stand for: sites by channel, sites, and numbers."""

    sites: Int[np.ndarray, "tested"]
    numbers: tuple[str, ...]
    glossy: bool


def _suspect(
    painted: Painted, fit: TextureFit, index: Int[np.ndarray, "tested"]
) -> tuple[Suspect, _Names]:
    """Suspect a fit of what it leaves of some pixels."""
    observations, texture = painted.observations.take(index), fit.texture
    sites, number = np.unique(painted.site[index], return_inverse=True)
    unknowns = fit.lobe.of_sites(painted.site[index])
    physical = unknowns.unpack(jnp.asarray(fit.lobe.point)).numbers
    near = LinearisedModel.about(painted.model_of(index), physical)
    diffuse, specular = np.asarray(near.at.diffuse), np.asarray(near.at.specular)
    kd, ks = texture.kd[sites][number], texture.ks[sites][number]
    predicted = kd * diffuse + ks[:, None] * specular
    names = _Names(sites, fit.lobe.unknowns.names, bool(np.any(specular)))
    count, channels = diffuse.shape
    of_site = np.eye(len(sites))[number]
    columns = [
        np.einsum("sc,sn,cd->scnd", diffuse, of_site, np.eye(channels)).reshape(count, channels, -1)
    ]
    if names.glossy:
        columns.append(specular[:, :, None] * of_site[:, None, :])
        slopes = [ks[:, None] * np.asarray(near.slopes[name][0]) for name in names.numbers]
        columns += [slope[:, :, None] for slope in slopes]
    by_unknown = np.concatenate(columns, axis=2)
    radiance = np.asarray(observations.radiance, float)
    weights = 1 / np.maximum(standard_deviations(fit.noise, predicted), 1e-12)
    known = Derivatives(
        weights * (radiance - predicted),
        weights[:, :, None] * by_unknown,
        weights,
        (),
        np.eye(by_unknown.shape[2]),
    )
    lobe = painted.variant.with_roughness(
        fit.sigma, None if painted.variant.mu is None else jnp.asarray(fit.mu)
    ).with_amplitudes(np.nanmean(kd, axis=0), np.full(channels, np.nanmean(ks)))
    paint = np.stack([kd, np.repeat(ks[:, None], channels, axis=1)], axis=1)
    suspect = Suspect(
        observations,
        predicted,
        np.ones(count),
        lobe,
        LightParts.known(painted.light),
        painted.shape,
        observations,
        painted.observations,
        partial(_of, known),
        painted.seed,
        unknown=_NOT_TESTED,
        paint=paint,
    )
    return suspect, names


def _of(known: Derivatives, index: Int[np.ndarray, "sample"]) -> Derivatives:
    """Take the derivatives of some of the tested pixels."""
    return Derivatives(
        known.residual[index], known.by_unknown[index], known.weights[index], (), known.parameters
    )


def _reaching(fit: TextureFit, diagnosis: tuple[Diagnosis, ...], names: _Names) -> TextureFit:
    """Widen errors by how far the best explanations move what they are of.

    Every site's K_d and K_s are taken to move by the part that those of the tested ones do.
    """
    shifts = likeliest(diagnosis)
    if not shifts:
        return fit
    texture, sites = fit.texture, names.sites
    channels = texture.kd.shape[1]
    kd, ks, sigma, mu = np.zeros(channels), 0.0, 0.0, 0.0
    # Where the photographs do not tell K_s, its prior holds both, and the columns know of none.
    told = ~texture.ks_marked[sites] | (not names.glossy)
    for shift in shifts:
        of_kd, rest = np.split(shift, [len(sites) * channels])
        kd += _part(of_kd.reshape(-1, channels)[told], texture.kd[sites[told]]) ** 2
        if names.glossy:
            of_ks, numbers = np.split(rest, [len(sites)])
            ks += float(_part(of_ks[told, None], texture.ks[sites[told], None])[0]) ** 2
            moved = dict(zip(names.numbers, numbers))
            sigma += float(moved.get("sigma", 0)) ** 2
            mu += float(moved.get("mu", 0)) ** 2
    wider = texture._replace(
        kd_error=np.hypot(texture.kd_error, np.sqrt(kd) * texture.kd),
        ks_error=np.hypot(texture.ks_error, np.sqrt(ks) * texture.ks),
    ).marked()
    return fit._replace(
        surface=fit.surface._replace(texture=wider),
        sigma_error=float(np.hypot(fit.sigma_error, np.sqrt(sigma))),
        mu_error=float(np.hypot(fit.mu_error, np.sqrt(mu))),
    )


def _part(
    shift: Float[np.ndarray, "site channel"], value: Float[np.ndarray, "site channel"]
) -> Float[np.ndarray, "channel"]:
    """Compare shifts with values: more than most sites move, of those that are not dark.

    A few sites may move beyond all measure, where one pixel a photograph does not tell K_s.
    """
    lit = value > _DARK * np.median(value, axis=0) if len(value) else value > 0
    parts = [np.abs(by[at] / of[at]) for by, of, at in zip(shift.T, value.T, lit.T)]
    return np.array([np.quantile(part, _MOST) if len(part) else 0.0 for part in parts])
