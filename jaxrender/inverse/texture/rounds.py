"""The search for sigma and mu in rounds.

The search uses sites drawn at random.  A fit weighs every observation by the noise of its
prediction, and holds K_s by its spread over the sites.  Both are known only after a fit.  So each
round gives noise and spread to the next; two or three rounds settle both.
"""

from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.clusters import Clusters
from jaxrender.inverse.models import Model
from jaxrender.inverse.texture.measurements import SiteData, SiteObservations
from jaxrender.inverse.texture.search import (
    LobeFit,
    TextureProblem,
    first_phase,
    free_textures,
    refine,
    search,
)
from jaxrender.inverse.texture.site_systems import SpecularPrior
from jaxrender.inverse.texture.specular_prior import spread_of
from jaxrender.inverse.texture.varying import SigmaField, VaryingSigma
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.inverse.weights import deviations, noise_settled
from jaxrender.shapes import Float

# The noise settles in two or three rounds.
_ROUNDS = 4


class TextureSettings(NamedTuple):
    """How a texture is fitted.

    ``noise`` is estimated where it is None.  ``method`` is ``joint``, or ``thesis`` for the
    iteration of T 6.4.2.  ``search_samples`` of whole sites are drawn to find sigma and mu.
    ``exact_samples`` are drawn to refine both on the exact model; 0: no exact model is used.
    ``diagnose`` says whether causes of a misfit are looked for.  ``free`` names nuisances that are
    found with the texture, or is ``"auto"``.  ``maps`` are what each site has for itself beside its
    K_d and one K_s: ``sigma``, ``normal``, and ``color``, which is a K_s of each channel.
    """

    noise: NoiseModel | None = None
    method: str = "joint"
    starts: int = 4
    search_samples: int = 16_000
    exact_samples: int = 2_000
    seed: int = 0
    diagnose: bool = True
    free: tuple[str, ...] | Literal["auto"] = ()
    maps: tuple[str, ...] = ()


class Searched(NamedTuple):
    """The sites drawn for the search, weighted, and where it ended on them."""

    fit: LobeFit
    problem: TextureProblem
    data: SiteData
    noise: NoiseModel
    clusters: Clusters


def search_in_rounds(
    some: SiteObservations,
    model,
    unknowns: Unknowns,
    starts: Float[np.ndarray, "start unknown"],
    settings: TextureSettings,
) -> Searched:
    """Search, learn the spread of K_s and the noise from the result, search again."""
    none = SpecularPrior(np.zeros(()), np.zeros(()))
    problem = TextureProblem(unknowns, none, np.asarray(True))
    data = weighted(some, None, None)
    if settings.method == "thesis":
        fit = first_phase(problem, model, data, some.exit_cosines, starts)
    else:
        fit = search(problem, model, data, starts)
    noise = settings.noise or _noise_left(some, model, fit, unknowns)
    for _ in range(_ROUNDS):
        data = weighted(some, noise, np.asarray(fit.predicted))
        prior = _spread(model, data, fit, unknowns)
        problem = TextureProblem(unknowns, prior, np.asarray(False))
        if settings.method == "thesis":
            break
        fit = search(problem, model, data, np.asarray(fit.point)[None])
        before, noise = noise, settings.noise or _noise_left(some, model, fit, unknowns)
        if noise_settled(before, noise, np.asarray(fit.predicted)):
            break
    return Searched(fit, problem, data, noise, some.clusters)


def let_vary(
    searched: Searched,
    whole: SiteObservations,
    some: SiteObservations,
    model: Model,
    field: SigmaField,
    settings: TextureSettings,
) -> Searched:
    """Go on from one sigma for all sites to a sigma that varies.

    ``some`` are the observations of the ``whole`` surface that the search used.  The noise and the
    spread of K_s are estimated anew.
    """
    site = np.full(int(whole.index.max()) + 1, -1)
    site[whole.index] = whole.site
    one = searched.problem.unknowns
    assert isinstance(one, Unknowns)
    unknowns = field.unknowns(one, site[some.index])
    fit, prior, data, noise = searched.fit, searched.problem.prior, searched.data, searched.noise
    fit = fit._replace(point=jnp.asarray(unknowns.spread(np.asarray(fit.point))))
    problem = TextureProblem(unknowns, prior, np.asarray(False))
    for _ in range(_ROUNDS):
        fit = refine(problem, model, data, fit)
        before, noise = noise, settings.noise or _noise_left(some, model, fit, unknowns)
        if noise_settled(before, noise, np.asarray(fit.predicted)):
            break
        data = weighted(some, noise, np.asarray(fit.predicted))
        prior = _spread(model, data, fit, unknowns)
        problem = TextureProblem(unknowns, prior, np.asarray(False))
    return Searched(fit, problem, data, noise, some.clusters)


def _spread(
    model: Model, data: SiteData, fit: LobeFit, unknowns: Unknowns | VaryingSigma
) -> SpecularPrior:
    free = free_textures(unknowns, model, data, fit.point)
    return spread_of(np.asarray(free.material.ks, float), np.asarray(free.precision, float))


def _noise_left(
    some: SiteObservations,
    model: Model,
    fit: LobeFit,
    unknowns: Unknowns | VaryingSigma,
) -> NoiseModel:
    """Estimate the noise from what a material for every site leaves over.

    Each site's material has fitted some of its noise away, which is made up for.
    """
    level = float(np.sqrt(np.mean(np.asarray(some.radiance) ** 2)))
    data = weighted(some, NoiseModel(1.0, 0.1 * level), np.asarray(fit.predicted))
    predicted = np.asarray(free_textures(unknowns, model, data, fit.point).predicted)
    measured = some.seen[some.site] * some.radiance.shape[1]
    fitted = some.radiance.shape[1] + 1
    usable = measured > fitted
    if not usable.any():
        raise ValueError(
            "no site is seen more than once, so noise cannot be told from the texture: "
            "give more photographs, larger texels, or the noise"
        )
    inflation = np.sqrt(measured[usable] / (measured[usable] - fitted))[:, None]
    left = (some.radiance - predicted)[usable] * inflation
    return estimate_noise(left, np.maximum(predicted[usable], 0), some.rounding)


def weighted(
    some: SiteObservations,
    noise: NoiseModel | None,
    predicted: Float[np.ndarray, "sample channel"] | None,
) -> SiteData:
    """Weigh by the noise of the prediction; evenly where there is none."""
    scale = float(np.sqrt(np.mean(some.radiance**2))) or 1.0
    deviation = np.full_like(some.radiance, scale)
    if noise is not None and predicted is not None:
        deviation = deviations(noise, predicted, scale)
    weights = np.sqrt(some.share)[:, None] / deviation
    return SiteData(some.radiance, weights, some.site, some.count)


def prediction_for(
    few: SiteObservations, some: SiteObservations, searched: Searched
) -> Float[np.ndarray, "sample channel"]:
    """Look up what was predicted for a part of the sites of the search."""
    # Both are sorted by site and then by index, so rows can be found by their place ...
    rows = np.flatnonzero(np.isin(some.index, few.index))
    if len(rows) != len(few.site):
        # ... unless observations are shared among sites; then they weigh as they were measured.
        return few.radiance
    return np.asarray(searched.fit.predicted)[rows]
