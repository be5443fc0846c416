"""A texture under known light (T 6.13, 6.14): sigma and mu of all, K_d and K_s of every site.

1. Some whole sites are drawn.  With one K_s for all of them, sigma and mu are searched from many
   starts; then each site's own K_s tells how they are spread (:mod:`.specular_prior`), and the
   search goes on with a K_s a site.  Noise is estimated from what is left, and all of it repeated.
2. Where sigma varies slowly over the surface, it is searched for once more at control points
   (:mod:`.varying`), from one sigma for all.
3. Every site is solved exactly, a chunk at a time, with standard errors that include those of sigma
   and mu; what cannot be trusted is marked.

``method="thesis"`` does it as T 6.4.2 does: phase 1 by simplex, then the alternation.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.models import Model
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.texture.forward import Forward
from jaxrender.inverse.texture.measurements import SiteData, SiteObservations, whole_sites
from jaxrender.inverse.texture.search import (
    LobeFit,
    TextureProblem,
    first_phase,
    free_textures,
    lobe_information,
    refine,
    search,
)
from jaxrender.inverse.texture.site_systems import SpecularPrior
from jaxrender.inverse.texture.specular_prior import spread_of
from jaxrender.inverse.texture.varying import SigmaField, SigmaMap, VaryingSigma
from jaxrender.inverse.texture.whole_surface import Lobe, Texture, solve_surface
from jaxrender.inverse.unknowns import MicrofacetUnknowns
from jaxrender.shapes import Float, Int

METHODS = ("joint", "thesis")
# The noise settles in two or three rounds.
_ROUNDS, _NOISE_SETTLED = 4, 0.02
# Noise is never taken to be less than this part of the mean radiance: exact data have none.
_LEAST_NOISE = 1e-6
# Half the width of a 90 % interval, in standard errors; and how narrow it must be (DESIGN 5).
_NORMAL_90, _IDENTIFIABLE_WITHIN = 1.6448536269514722, 0.25


class TextureSettings(NamedTuple):
    """How a texture is fitted.

    ``noise`` is estimated where it is None.  ``search_samples`` are drawn for sigma and mu (whole
    sites), ``exact_samples`` for their refinement by the exact model where there is one.
    """

    noise: NoiseModel | None = None
    method: str = "joint"
    starts: int = 4
    search_samples: int = 16_000
    exact_samples: int = 2_000
    seed: int = 0


class TextureFit(NamedTuple):
    """A recovered texture, its lobe, and what is known about both.

    ``sigma_error`` and ``mu_error`` are standard errors; mu is NaN for a metal.
    """

    texture: Texture
    sigma: float
    mu: float
    sigma_error: float
    mu_error: float
    outcome: Outcome
    prior: SpecularPrior
    noise: NoiseModel
    lobe: Lobe
    reasons: tuple[str, ...]

    @property
    def variation(self) -> SigmaMap | None:
        """sigma at every site with its standard error, where it varies; ``sigma`` is its mean."""
        return self.lobe.variation()


class _Searched(NamedTuple):
    """The sites drawn for the search, weighted, and where it ended on them."""

    fit: LobeFit
    problem: TextureProblem
    data: SiteData
    noise: NoiseModel


def fit_texture(
    measured: SiteObservations,
    forward: Forward,
    unknowns: MicrofacetUnknowns,
    settings: TextureSettings | None = None,
    start: Float[np.ndarray, "unknown"] | None = None,
    *,
    field: SigmaField | None = None,
) -> TextureFit:
    """Recover sigma, mu, and K_d and K_s of every site.

    ``start`` replaces the several starting points; with ``field`` sigma varies over the surface.
    Raises ``ValueError`` for an unknown method, for kd or ks that are fixed (they are the texture),
    for a sigma that is fixed and varies, or where no site is seen often enough.
    """
    settings = settings or TextureSettings()
    _check(measured, unknowns, settings)
    if field is not None:
        _check_variation(unknowns, settings)
    some = whole_sites(measured, settings.search_samples, settings.seed)
    model = forward.search(some.index)
    starts = unknowns.starts(settings.starts) if start is None else start[None]
    searched = _search_in_rounds(some, model, unknowns, starts, settings)
    if field is not None:
        model = forward.final(some.index)
        searched = _let_vary(searched, (measured, some), model, field, settings)
    elif forward.exact is not None and settings.method == "joint" and unknowns.names:
        few = whole_sites(some, settings.exact_samples, settings.seed)
        data = _weighted(few, searched.noise, _prediction_for(few, some, searched))
        model = forward.exact(few.index)
        searched = searched._replace(
            fit=refine(searched.problem, model, data, searched.fit), data=data
        )
    lobe, scatter = _lobe(searched, model, settings.noise is not None)
    lobe = lobe._replace(field=field)
    noise = NoiseModel(searched.noise.relative * scatter, searched.noise.floor * scatter)
    texture = solve_surface(
        measured, forward.final, lobe, searched.problem.prior, (noise, settings.method)
    )
    return _account(texture, lobe, searched, noise)


def fit_texture_by_region(
    measured: SiteObservations,
    region: Int[np.ndarray, "site"],
    forward: Forward,
    unknowns: MicrofacetUnknowns,
    settings: TextureSettings | None = None,
) -> tuple[Texture, dict[int, TextureFit]]:
    """Recover a texture with a sigma and a mu (and a spread of K_s) for each region of a mask.

    ``region`` numbers the material of every site; negative ones are left out.  Sites of different
    regions share nothing, so each region is a fit of its own; the textures are put together.
    """
    fits = {
        int(name): fit_texture(measured.of_sites(region == name), forward, unknowns, settings)
        for name in np.unique(region[(region >= 0) & (measured.seen > 0)])
    }
    if not fits:
        raise ValueError("no region has observations: number the material of each site from 0 up")
    joined = None
    for name, fit in fits.items():
        joined = fit.texture if joined is None else joined.with_sites(region == name, fit.texture)
    assert joined is not None
    return joined, fits


def _search_in_rounds(
    some: SiteObservations,
    model,
    unknowns: MicrofacetUnknowns,
    starts: Float[np.ndarray, "start unknown"],
    settings: TextureSettings,
) -> _Searched:
    """Search, learn the spread of K_s and the noise from the result, search again."""
    none = SpecularPrior(np.zeros(()), np.zeros(()))
    problem = TextureProblem(unknowns, none, np.asarray(True))
    data = _weighted(some, None, None)
    if settings.method == "thesis":
        fit = first_phase(problem, model, data, some.exit_cosines, starts)
    else:
        fit = search(problem, model, data, starts)
    noise = settings.noise or _noise_left(some, model, fit, unknowns)
    for _ in range(_ROUNDS):
        data = _weighted(some, noise, np.asarray(fit.predicted))
        prior = _spread(model, data, fit, unknowns)
        problem = TextureProblem(unknowns, prior, np.asarray(False))
        if settings.method == "thesis":
            break
        fit = search(problem, model, data, np.asarray(fit.point)[None])
        before, noise = noise, settings.noise or _noise_left(some, model, fit, unknowns)
        if _close(before, noise, np.asarray(fit.predicted)):
            break
    return _Searched(fit, problem, data, noise)


def _let_vary(
    searched: _Searched,
    measured: tuple[SiteObservations, SiteObservations],
    model: Model,
    field: SigmaField,
    settings: TextureSettings,
) -> _Searched:
    """Go on from one sigma for all; the noise and the spread of K_s become less for it."""
    whole, some = measured
    site = np.full(int(whole.index.max()) + 1, -1)
    site[whole.index] = whole.site
    one = searched.problem.unknowns
    assert isinstance(one, MicrofacetUnknowns)
    unknowns = field.unknowns(one, site[some.index])
    fit, prior, data, noise = searched.fit, searched.problem.prior, searched.data, searched.noise
    fit = fit._replace(point=jnp.asarray(unknowns.spread(np.asarray(fit.point))))
    problem = TextureProblem(unknowns, prior, np.asarray(False))
    for _ in range(_ROUNDS):
        fit = refine(problem, model, data, fit)
        before, noise = noise, settings.noise or _noise_left(some, model, fit, unknowns)
        if _close(before, noise, np.asarray(fit.predicted)):
            break
        data = _weighted(some, noise, np.asarray(fit.predicted))
        prior = _spread(model, data, fit, unknowns)
        problem = TextureProblem(unknowns, prior, np.asarray(False))
    return _Searched(fit, problem, data, noise)


def _spread(
    model: Model, data: SiteData, fit: LobeFit, unknowns: MicrofacetUnknowns | VaryingSigma
) -> SpecularPrior:
    material, precision, _ = free_textures(unknowns, model, data, fit.point)
    return spread_of(np.asarray(material.ks, float), np.asarray(precision, float))


def _noise_left(
    some: SiteObservations,
    model: Model,
    fit: LobeFit,
    unknowns: MicrofacetUnknowns | VaryingSigma,
) -> NoiseModel:
    """Estimate the noise from what a material for every site leaves over.

    Each site's material has fitted some of its noise away, which is made up for.
    """
    level = float(np.sqrt(np.mean(np.asarray(some.radiance) ** 2)))
    data = _weighted(some, NoiseModel(1.0, 0.1 * level), np.asarray(fit.predicted))
    predicted = np.asarray(free_textures(unknowns, model, data, fit.point)[2])
    measured = some.seen[some.site] * some.radiance.shape[1]
    fitted = some.radiance.shape[1] + 1
    told = measured > fitted
    if not told.any():
        raise ValueError(
            "no site is seen more than once, so noise cannot be told from texture: "
            "give more photographs, larger texels, or the noise"
        )
    inflation = np.sqrt(measured[told] / (measured[told] - fitted))[:, None]
    left = (some.radiance - predicted)[told] * inflation
    return estimate_noise(left, np.maximum(predicted[told], 0))


def _weighted(
    some: SiteObservations,
    noise: NoiseModel | None,
    predicted: Float[np.ndarray, "sample channel"] | None,
) -> SiteData:
    """Weigh by the noise of the prediction; evenly where there is none."""
    scale = float(np.sqrt(np.mean(some.radiance**2))) or 1.0
    deviation = np.full_like(some.radiance, scale)
    if noise is not None and predicted is not None:
        deviation = np.asarray(noise.standard_deviation(np.maximum(predicted, 0)))
        deviation = np.hypot(deviation, _LEAST_NOISE * scale)
    weights = np.sqrt(some.share)[:, None] / deviation
    return SiteData(some.radiance, weights, some.site, some.count)


def _prediction_for(
    few: SiteObservations, some: SiteObservations, searched: _Searched
) -> Float[np.ndarray, "sample channel"]:
    """Look up what was predicted for a part of the sites of the search."""
    # Both are sorted by site and then by index, so rows can be found by their place ...
    rows = np.flatnonzero(np.isin(some.index, few.index))
    if len(rows) != len(few.site):
        # ... unless observations are shared among sites; then they weigh as they were measured.
        return few.radiance
    return np.asarray(searched.fit.predicted)[rows]


def _lobe(searched: _Searched, model, noise_given: bool) -> tuple[Lobe, float]:
    """Put together point and covariance, and by how much the residuals exceed the noise."""
    problem, data, fit = searched.problem, searched.data, searched.fit
    left = np.asarray(data.weights) * (data.radiance - np.asarray(fit.predicted))
    fitted = (data.radiance.shape[1] + 1) * len(np.unique(data.site)) + len(problem.unknowns.names)
    scatter = float(np.sum(left**2)) / max(left.size - fitted, 1)
    widening = max(scatter, 1.0) if noise_given else scatter
    information = np.asarray(lobe_information(problem, model, data, fit.point))
    covariance = widening * np.linalg.pinv(information, hermitian=True)
    one = problem.unknowns
    one = one.one if isinstance(one, VaryingSigma) else one
    return Lobe(one, np.asarray(fit.point), covariance), float(np.sqrt(widening))


def _account(texture: Texture, lobe: Lobe, searched: _Searched, noise: NoiseModel) -> TextureFit:
    sigma, mu = lobe.values()
    sigma_error, mu_error = lobe.errors()
    sought = searched.problem.unknowns
    bounded = sought.at_bound(jnp.asarray(lobe.point))
    reasons = [f"{name} ended at its bound" for name, at in zip(sought.names, bounded) if at]
    outcome = Outcome.CONVERGED
    if _kd_is_lost(texture):
        outcome = Outcome.NOT_IDENTIFIABLE
        reasons.append(
            "kd is not told at most sites: each is seen too seldom to tell gloss from matt; give "
            "more photographs"
        )
    for name, value, error in (("sigma", sigma, sigma_error), ("mu", mu - 1, mu_error)):
        if _NORMAL_90 * error > _IDENTIFIABLE_WITHIN * value:
            outcome = Outcome.NOT_IDENTIFIABLE
            reasons.append(f"{name} is not told: its standard error is {error:.2g}")
    if bounded.any():
        outcome = Outcome.AT_BOUND
    if not bool(searched.fit.converged):
        outcome = Outcome.NOT_CONVERGED
        reasons.append("the search for sigma and mu did not converge")
    return TextureFit(
        texture,
        sigma,
        mu,
        sigma_error,
        mu_error,
        outcome,
        searched.problem.prior,
        noise,
        lobe,
        tuple(reasons),
    )


def _kd_is_lost(texture: Texture) -> bool:
    """Tell whether at most of the sites seen the error of K_d is too large to speak of a value."""
    error, kd = (
        np.asarray(part)[np.asarray(texture.seen) > 0] for part in (texture.kd_error, texture.kd)
    )
    lost = _NORMAL_90 * error > _IDENTIFIABLE_WITHIN * np.maximum(kd.mean(axis=0), kd)
    return bool(lost.any(axis=1).mean() > 0.5)


def _close(before: NoiseModel, after: NoiseModel, predicted: Float[np.ndarray, "s c"]) -> bool:
    level = np.sqrt(np.mean(predicted**2, keepdims=True))
    one, other = (float(noise.standard_deviation(level).item()) for noise in (before, after))
    return bool(abs(np.log(max(one, 1e-300) / max(other, 1e-300))) < _NOISE_SETTLED)


def _check_variation(unknowns: MicrofacetUnknowns, settings: TextureSettings) -> None:
    if not unknowns.sigma.free:
        raise ValueError("sigma is fixed, and to vary over the surface: let one of the two go")
    if settings.method != "joint":
        raise ValueError(f"method={settings.method!r} knows one sigma: choose joint")


def _check(
    measured: SiteObservations, unknowns: MicrofacetUnknowns, settings: TextureSettings
) -> None:
    if settings.method not in METHODS:
        raise ValueError(f"method={settings.method!r}: choose one of {', '.join(METHODS)}")
    if not (unknowns.kd.free and unknowns.ks.free):
        raise ValueError("kd and ks are the texture that is sought: leave both free")
    if unknowns.ks_per_channel or unknowns.free_gains or unknowns.free_scale:
        raise ValueError(
            "a texture has one K_s for all channels and known exposures: "
            "turn ks_per_channel, free gains and free scale off"
        )
    most = int(measured.seen.max())
    if unknowns.names and most < 2:
        raise ValueError(
            "no site is seen more than once, so sigma and mu cannot be told from texture: "
            "give more photographs, larger texels, or fix sigma and mu"
        )
