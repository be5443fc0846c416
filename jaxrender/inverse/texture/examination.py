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
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.misfit import LEAST, Left, Misfit, measure_misfit, rows_of_three
from jaxrender.inverse.models import ExactModel, LinearisedModel, Model
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.prepared_light import DUAL_ERROR
from jaxrender.inverse.texture.account import TextureFit
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.mixed import mixed
from jaxrender.inverse.texture.paint_slopes import PaintSlopes
from jaxrender.inverse.texture.reach import Reach
from jaxrender.inverse.texture.site_detail import without_detail
from jaxrender.inverse.texture.site_numbers import OwnSigma
from jaxrender.inverse.texture.site_sums import by_channel
from jaxrender.inverse.texture.sites import middles
from jaxrender.inverse.texture.texture import TRUSTED_MISFIT, Texture
from jaxrender.inverse.texture.varying import VaryingSigma
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import AnyArray, Array, Float, Int

# Pixels that tell the noise, and those that say what is left above it.
_NEIGHBOURS, _FITTED = 6000, 12_000
# Pixels and sites that causes are tested on, and photographs that must show such a site.
_TESTED, _MOST_SITES, _FEWEST_VIEWS = 700, 80, 3
# A site's K_d and K_s are found, and its edges of paint look like a blur.
_NOT_TESTED = ("sites", "blur", "convention")


class Painted(NamedTuple):
    """Photographs of a painted object under a known light, and the site of each pixel.

    ``model_of`` is what the sites were solved on; ``seed`` is that of the pixels that are tested.
    ``freed`` are nuisances by which photographs and light are corrected; ``told`` are the
    photographs before that, where they are.
    """

    observations: Observations
    site: Int[np.ndarray, "sample"]
    light: KnownLight
    variant: Microfacet
    shape: Shape | None
    model_of: ModelOf
    seed: int = 0
    freed: tuple[str, ...] = ()
    told: Observations | None = None

    def predicted(self, fit: TextureFit) -> Float[np.ndarray, "sample channel"]:
        """What each pixel should be; NaN where nothing is known."""
        surface, radiance = fit.surface, np.asarray(self.observations.radiance, float)
        predicted = np.full(radiance.shape, np.nan)
        predicted[surface.index] = radiance[surface.index] - surface.left
        return predicted


def examined(painted: Painted, fit: TextureFit, noise_given: bool, diagnosing: bool) -> TextureFit:
    """Say what a fit leaves, and let its errors reach as far as the best explanation moves it."""
    radiance, predicted = np.asarray(painted.observations.radiance, float), painted.predicted(fit)
    model = painted.model_of(fit.surface.index[:1])
    misfit = misfit_of(
        painted.observations,
        painted.site,
        predicted,
        fit.texture,
        fit.noise if noise_given else None,
        LEAST if isinstance(without_detail(model), ExactModel) else DUAL_ERROR,
        painted.seed,
    )
    if misfit is None:
        return fit
    diagnosis: tuple[Diagnosis, ...] = ()
    tested = chosen_pixels(painted, fit)
    if diagnosing and len(tested):
        some = Tested.of(painted, fit, tested)
        suspect = some.suspect(painted, fit.noise)
        diagnosis = diagnose(suspect, misfit)
        shifts = likeliest(diagnosis)
        if shifts:
            fit = reaching(fit, np.stack(shifts, axis=1), some)
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
    least: float = LEAST,
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
    fitted = channels + (by_channel(texture.ks).shape[1] if np.any(texture.ks > 0) else 0)
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


def chosen_pixels(painted: Painted, fit: TextureFit, times: int = 1) -> Int[np.ndarray, "tested"]:
    """Choose pixels: one of each photograph that shows a site, of sites that many show.

    So many ``times`` as many are chosen as causes are tested on.
    """
    frame, index = np.asarray(painted.observations.frame), fit.surface.index
    return pixels_of_sites(index, painted.site, frame, fit.texture, painted.seed, times)


def pixels_of_sites(
    index: Int[np.ndarray, "known"],
    site: Int[np.ndarray, "sample"],
    frame: Int[np.ndarray, "sample"],
    texture: Texture,
    seed: int,
    times: int = 1,
) -> Int[np.ndarray, "tested"]:
    """Choose among some pixels: one of each photograph that shows a site, of trusted sites."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(index)
    site, frame = site[order], frame[order]
    _, first = np.unique(np.stack([site, frame], axis=1), axis=0, return_index=True)
    order, site = order[first], site[first]
    views = np.bincount(site, minlength=len(texture.seen))
    good = (views >= _FEWEST_VIEWS) & (texture.misfit <= TRUSTED_MISFIT)
    chosen = rng.permutation(np.flatnonzero(good))[: times * _MOST_SITES]
    most = times * _TESTED
    kept = chosen[: int(np.searchsorted(np.cumsum(views[chosen]), most, side="right"))]
    return np.sort(order[np.isin(site, kept)])


class Tested(NamedTuple):
    """Some pixels, the sites that they show, numbered anew, and a material for each of these.

    ``sites`` are the places of these sites on the surface, ``number`` says which of them each pixel
    shows; ``point`` are the search variables of the lobe, whose numbers ``names`` are free.
    ``found`` are causes that the fit does not take for granted.
    ``slopes`` say how paint changes beside the sites, where it is known where pixels lie, and
    ``beside`` what pixels send for that.
    """

    observations: Observations
    sites: Int[np.ndarray, "tested"]
    number: Int[np.ndarray, "sample"]
    model: Model
    unknowns: Unknowns | VaryingSigma | OwnSigma
    point: Float[AnyArray, "unknown"]
    kd: Float[np.ndarray, "tested channel"]
    ks: Float[np.ndarray, "tested *channel"]
    names: tuple[str, ...]
    found: tuple[str, ...] = _NOT_TESTED
    slopes: PaintSlopes | None = None
    beside: Float[np.ndarray, "sample channel"] | None = None

    @classmethod
    def of(cls, painted: Painted, fit: TextureFit, index: Int[np.ndarray, "sample"]) -> "Tested":
        """Take some pixels of a fit."""
        sites, number = np.unique(painted.site[index], return_inverse=True)
        places, slopes = painted.observations.places, None
        if places is not None:
            every = middles(np.asarray(places.points), painted.site, len(fit.texture.seen))
            slopes = PaintSlopes.of(fit.texture, every, sites)
        return cls(
            painted.observations.take(index),
            sites,
            number,
            painted.model_of(index),
            fit.lobe.of_sites(painted.site[index]),
            fit.lobe.point,
            fit.texture.kd[sites],
            fit.texture.ks[sites],
            fit.lobe.unknowns.names,
            _NOT_TESTED if fit.lobe.normals is None else (*_NOT_TESTED, "normals"),
            slopes,
        )

    @property
    def near(self) -> LinearisedModel:
        """Linearise the model."""
        return LinearisedModel.about(self.model, self.unknowns.unpack(self._point).numbers)

    @property
    def _point(self) -> Array:
        return jnp.asarray(self.point)

    def suspect(
        self,
        painted: Painted,
        noise: NoiseModel,
        weights: Float[np.ndarray, "sample channel"] | None = None,
    ) -> Suspect:
        """Suspect a fit of what it leaves; ``weights`` are those of the noise if not given."""
        near, number = self.near, self.number
        diffuse, specular = np.asarray(near.at.diffuse), np.asarray(near.at.specular)
        kd, ks = self.kd[number], by_channel(self.ks[number])
        predicted = kd * diffuse + ks * specular
        if self.beside is not None:
            predicted = predicted + self.beside
        (count, channels), sites = diffuse.shape, len(self.sites)
        of_site = np.eye(sites)[number]
        by_kd = np.einsum("sc,sn,cd->scnd", diffuse, of_site, np.eye(channels))
        columns = [by_kd.reshape(count, channels, -1)]
        if np.any(specular):
            through = np.eye(channels) if self.ks.ndim == 2 else np.ones((channels, 1))
            by_ks = np.einsum("sc,sn,cd->scnd", specular, of_site, through)
            columns.append(by_ks.reshape(count, channels, -1))
            columns += [(ks * np.asarray(near.slopes[name][0]))[:, :, None] for name in self.names]
        by_unknown = np.concatenate(columns, axis=2)
        radiance = np.asarray(self.observations.radiance, float)
        if weights is None:
            weights = 1 / np.maximum(standard_deviations(noise, predicted), 1e-12)
        left, by_unknown = weights * (radiance - predicted), weights[:, :, None] * by_unknown
        known = Derivatives(left, by_unknown, weights, (), np.eye(by_unknown.shape[2]))
        paint = np.stack([kd, np.broadcast_to(ks, kd.shape)], axis=1)
        return Suspect(
            self.observations,
            predicted,
            np.ones(count),
            self._lobe(painted.variant),
            LightParts.known(painted.light),
            painted.shape,
            self.observations if painted.told is None else painted.told,
            painted.observations,
            partial(_of, known),
            painted.seed,
            freed=painted.freed,
            unknown=self.found,
            paint=paint,
            by_place=None if self.slopes is None else self.slopes.of_samples(near.at, number),
        )

    def _lobe(self, variant: Microfacet) -> Microfacet:
        """Make one material of all: the lobe, and mean amplitudes."""
        numbers = self.unknowns.unpack(self._point).numbers
        sigma = float(np.mean(np.asarray(numbers["sigma"])))
        mu = None if variant.mu is None else jnp.asarray(numbers.get("mu", variant.mu))
        kd, ks = np.nanmean(self.kd, axis=0), np.nanmean(by_channel(self.ks), axis=0)
        return variant.with_roughness(sigma, mu).with_amplitudes(kd, np.broadcast_to(ks, kd.shape))


def _of(known: Derivatives, index: Int[np.ndarray, "sample"]) -> Derivatives:
    """Take the derivatives of some of the tested pixels."""
    return Derivatives(
        known.residual[index], known.by_unknown[index], known.weights[index], (), known.parameters
    )


def reaching(
    fit: TextureFit,
    shifts: Float[np.ndarray, "number cause"],
    some: Tested,
    *,
    both: bool = False,
) -> TextureFit:
    """Widen errors by how far causes move what they are of, a column each.

    ``both`` widens the errors of a model that is exact as well.
    """
    reach = Reach.of(fit.texture, some.sites, some.names, shifts)
    sigma, mu = reach.of_number("sigma"), reach.of_number("mu")
    if both:
        of_sigma, of_mu = fit.if_exact
        exact = float(np.hypot(of_sigma, sigma)), float(np.hypot(of_mu, mu))
        fit = fit._replace(if_exact=exact)
    return fit._replace(
        surface=fit.surface._replace(texture=reach.texture(fit.texture, both=both)),
        sigma_error=float(np.hypot(fit.sigma_error, sigma)),
        mu_error=float(np.hypot(fit.mu_error, mu)),
    )
