"""Numbers and a coloured K_s of every site, whichever are asked for.

What all sites share (mu, and sigma where only normals are their own) is solved for on some sites,
with all numbers of these eliminated.  Their noise and the spread of their numbers are learned
there, too.  The spread is then what is expected of each site: who saw no highlight of a site knows
nothing of its sigma.  The whole surface comes last (:mod:`.site_surface`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.clusters import widened
from jaxrender.inverse.texture.coloured_sites import ColouredPrior, KsPrior
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.measurements import SiteObservations
from jaxrender.inverse.texture.site_equations import Common, Expected, common_equations
from jaxrender.inverse.texture.site_minima import inverses
from jaxrender.inverse.texture.site_numbers import MAPS, METALLIC_MAPS, NUMBERS
from jaxrender.inverse.texture.site_solver import (
    LEAST_NOISE,
    Asked,
    Solved,
    parts_of,
    solve_at,
    solve_numbers_of,
)
from jaxrender.inverse.texture.site_sums import by_channel
from jaxrender.inverse.texture.site_systems import KnownSpecular, SpecularPrior
from jaxrender.inverse.texture.specular_prior import normal_spread, spread_of
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.inverse.weights import deviations, noise_settled
from jaxrender.shapes import AnyArray, Float

# Rounds of noise and spread, and steps of what all sites share in each of them.
_ROUNDS, _TURNS, _SETTLED = 4, 6, 0.1


class Shared(NamedTuple):
    """What all sites share, as search variables, with its covariances."""

    unknowns: Unknowns
    point: Float[np.ndarray, "unknown"]
    covariance: Float[np.ndarray, "unknown unknown"]
    exact_covariance: Float[np.ndarray, "unknown unknown"]


class SiteFit(NamedTuple):
    """What was found on the sites of a search, and what that tells of all others."""

    shared: Shared
    expected: Expected | None
    prior: KsPrior
    noise: NoiseModel

    def asked(self, maps: tuple[str, ...]) -> Asked:
        """Ask for the numbers of every site."""
        assert self.expected is not None
        shared = self.shared
        return Asked(
            numbers_of(maps), shared.unknowns, shared.point, self.prior, self.expected, self.noise
        )

    @classmethod
    def begin(
        cls,
        unknowns: Unknowns,
        point: Float[AnyArray, "unknown"],
        prior: SpecularPrior | KnownSpecular,
        noise: NoiseModel,
        coloured: bool = False,
    ) -> "SiteFit":
        """Begin with one lobe for all sites, at the search variables ``point``."""
        nothing = np.zeros((len(point), len(point)))
        if coloured:
            assert isinstance(prior, SpecularPrior)
            known = ColouredPrior.begin(float(prior.mean), float(prior.precision))
            return cls(Shared(unknowns, np.asarray(point), nothing, nothing), None, known, noise)
        return cls(Shared(unknowns, np.asarray(point), nothing, nothing), None, prior, noise)


def numbers_of(maps: tuple[str, ...]) -> tuple[str, ...]:
    """Name the numbers that sites have for themselves."""
    return tuple(
        name for one, names in {**MAPS, **METALLIC_MAPS}.items() if one in maps for name in names
    )


def search_sites(
    some: SiteObservations,
    model_of: ModelOf,
    maps: tuple[str, ...],
    begin: SiteFit,
    noise_given: bool,
) -> SiteFit:
    """Find what all sites share, the noise, and how the sites' numbers are spread."""
    names, unknowns, point = numbers_of(maps), begin.shared.unknowns, begin.shared.point
    typical = {n: float(v) for n, v in unknowns.unpack(jnp.asarray(point)).numbers.items()}
    mean = np.array([_searched(name, typical.get(name, 0.0)) for name in names])
    spread = np.array([NUMBERS[name].spread for name in names])
    expected = Expected(mean, spread**-2)
    asked = Asked(names, unknowns, point, begin.prior, expected, begin.noise)
    start = None
    for _ in range(_ROUNDS):
        asked, solved, common = _share(some, model_of, asked, start)
        start, before = solved.value, asked.noise
        if not noise_given:
            asked = asked._replace(noise=_noise_left(some, solved, asked.own(some)))
        asked = _learned(asked, solved)
        if noise_settled(before, asked.noise, solved.predicted):
            break
    return SiteFit(_shared(some, asked, solved, common), asked.expected, asked.prior, asked.noise)


def search_again(
    some: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    start: Float[np.ndarray, "site number"],
    noise_given: bool,
) -> tuple[Asked, Shared]:
    """Find what all sites share and the noise anew, where more is known of each site."""
    for _ in range(_ROUNDS):
        asked, solved, common = _share(some, model_of, asked, start)
        start, before = solved.value, asked.noise
        if not noise_given:
            asked = asked._replace(noise=_noise_left(some, solved, asked.own(some)))
        if noise_settled(before, asked.noise, solved.predicted):
            break
    return asked, _shared(some, asked, solved, common)


def _share(
    some: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    start: Float[np.ndarray, "site number"] | None,
) -> tuple[Asked, Solved, Common]:
    """Step what all sites share, and search the sites anew, until neither moves."""
    # What has been searched once goes on from where that ended.
    search = solve_numbers_of if start is None else solve_at
    solved = search(some, model_of, asked, start)
    common = _in_common(some, model_of, asked, solved)
    for _ in range(_TURNS):
        if not len(asked.shared):
            break
        step = np.linalg.lstsq(common.matrix, common.gradient, rcond=None)[0]
        if step @ common.gradient < _SETTLED**2:
            break
        moved = asked.point.copy()
        moved[asked.shared] += np.clip(step, -1, 1)
        trial = asked._replace(point=moved)
        other = solve_at(some, model_of, trial, solved.value)
        if np.sum(other.local.cost) >= np.sum(solved.local.cost):
            break
        asked, solved = trial, other
        common = _in_common(some, model_of, asked, solved)
    return asked, solved, common


def _in_common(some: SiteObservations, model_of: ModelOf, asked: Asked, solved: Solved) -> Common:
    """Add up the equations of what all sites share, with the sites' own unknowns eliminated."""
    count = len(asked.shared)
    matrix, gradient = np.zeros((count, count)), np.zeros(count)
    scores = np.zeros((len(some.site), count))
    if not count:
        return Common(matrix, gradient, scores)
    point = jnp.asarray(asked.point)
    slopes = jax.jacfwd(lambda p: asked.unknowns.unpack(p).numbers)(point)
    shared = tuple(n for n in asked.unknowns.free_numbers if n not in asked.names)
    chain = np.stack([np.asarray(slopes[name])[asked.shared] for name in shared])
    every, weigh = (*asked.names, *shared), solved.predicted
    for part in parts_of(some, model_of, asked, solved.value, weigh, every):
        found = common_equations(
            part.near, part.data, asked.prior, part.expected, part.value, every, chain
        )
        matrix, gradient = matrix + np.asarray(found.matrix), gradient + np.asarray(found.gradient)
        scores[part.rows] = np.asarray(found.scores)[: part.kept]
    return Common(matrix, gradient, scores)


def _noise_left(some: SiteObservations, solved: Solved, fitted: int) -> NoiseModel:
    """Estimate the noise from what is left; what the sites have fitted away is made up for."""
    channels = some.radiance.shape[1]
    measured = some.seen[some.site] * channels
    usable = measured > fitted
    if not usable.any():
        raise ValueError(
            "no site is seen often enough to tell its own numbers from noise: give more "
            "photographs, larger texels, or fewer maps"
        )
    inflation = np.sqrt(measured[usable] / (measured[usable] - fitted))[:, None]
    left = (some.radiance - solved.predicted)[usable] * inflation
    return estimate_noise(left, np.maximum(solved.predicted[usable], 0), some.rounding)


def _learned(asked: Asked, solved: Solved) -> Asked:
    """Learn what to expect of the numbers of a site, and of its K_s."""
    inverse, count = inverses(np.asarray(solved.local.matrix)), len(asked.names)
    variances = np.diagonal(inverse, axis1=1, axis2=2)
    mean, precision = asked.expected.mean.copy(), asked.expected.precision.copy()
    lit = np.any(by_channel(np.asarray(solved.local.material.ks)) > 0, axis=1)
    for at, name in enumerate(asked.names):
        of_data, told = own_estimates(
            solved.value[:, at], variances[:, at - count], mean[at], precision[at]
        )
        number = NUMBERS[name]
        own = np.ones(len(lit), bool) if number.of_shape else lit
        found, variance = normal_spread(of_data, np.where(own, told, 0), number.least)
        if np.isfinite(variance):
            mean[at] = 0.0 if number.of_shape else found
            precision[at] = 1 / variance
    channels, size = solved.predicted.shape[1], inverse.shape[1]
    ks, prior = np.asarray(solved.local.material.ks), asked.prior
    if isinstance(prior, ColouredPrior):
        of_ks = slice(channels, size - count)
        prior = prior.learned(ks, inverse[:, of_ks, of_ks])
    elif isinstance(prior, SpecularPrior):
        known = float(prior.mean), float(prior.precision)
        ks, told = own_estimates(ks, variances[:, channels], *known)
        prior = spread_of(ks, np.where(lit, told, 0))
    return asked._replace(expected=Expected(mean, precision), prior=prior)


def own_estimates(
    value: Float[np.ndarray, "site"],
    variance: Float[np.ndarray, "site"],
    mean: Float[np.ndarray, "site"] | float,
    precision: Float[np.ndarray, "site"] | float,
) -> tuple[Float[np.ndarray, "site"], Float[np.ndarray, "site"]]:
    """Take what was expected out of what was found: the photographs' own estimate and precision."""
    whole = 1 / np.maximum(variance, 1e-300)
    told = np.where(whole > (1 + 1e-6) * precision, whole - precision, 0)
    of_data = np.where(
        told > 0, (whole * value - precision * mean) / np.where(told > 0, told, 1), mean
    )
    return of_data, told


def _shared(some: SiteObservations, asked: Asked, solved: Solved, common: Common) -> Shared:
    """Put covariances together; of a number of every site that of their mean."""
    unknowns, at = asked.unknowns, asked.shared
    point, size = asked.point.copy(), len(unknowns.names)
    exact, robust = np.zeros((2, size, size))
    if len(at):
        inverse = np.linalg.pinv(np.asarray(common.matrix), hermitian=True)
        fitted = len(np.unique(some.site)) * asked.own(some) + len(at)
        scale = float(np.sqrt(np.mean(some.radiance**2)))
        deviation = deviations(asked.noise, np.maximum(solved.predicted, 0), scale)
        deviation = np.hypot(deviation, LEAST_NOISE * scale)
        left = np.sqrt(some.share)[:, None] * (some.radiance - solved.predicted) / deviation
        scatter = max(float(np.sum(left**2)) / max(left.size - fitted, 1), 1.0)
        exact[np.ix_(at, at)] = scatter * inverse
        clustered = some.clusters.covariance(np.asarray(common.scores) @ inverse)
        robust[np.ix_(at, at)] = widened(scatter * inverse, clustered)
    numbers = {n: float(v) for n, v in asked.numbers(np.zeros((1, 0))).items()}
    for place, name in enumerate(asked.names):
        if name not in unknowns.names:
            continue
        mean, own = float(asked.expected.mean[place]), unknowns.names.index(name)
        mean = float(np.exp(mean)) if NUMBERS[name].logarithmic else mean
        # What is typical of sites that are far apart may lie where none of them can.
        mean = float(np.clip(mean, *unknowns.range_of(name)))
        point[own] = unknowns.pack(numbers | {name: mean})[own]
        slopes = jax.jacfwd(lambda p, name=name: _searched(name, unknowns.unpack(p).numbers[name]))
        slope = float(slopes(jnp.asarray(point))[own])
        told = 1 / (asked.expected.precision[place] * max(some.count, 1))
        exact[own, own] = robust[own, own] = told / slope**2
    return Shared(unknowns, point, robust, exact)


def _searched(name: str, value: Any) -> Any:
    """Turn a number into what is searched for."""
    return jnp.log(value) if NUMBERS[name].logarithmic else value
