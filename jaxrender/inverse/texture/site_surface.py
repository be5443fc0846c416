"""The numbers of all sites of a surface, with errors, and what neighbours tell of each.

1. Every site is searched by itself, about what is typical of all.
2. Neighbours are told alike (:mod:`.site_fields`): what they make one expect of each site takes the
   place of what is typical, and how they go on within a site that of one number for all its pixels
   (:mod:`.site_detail`), where that leaves less of it.
3. What all sites share, and the noise, are found anew, and then every site once more.
4. Errors are larger where neighbours contradict each other by more than these say.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.texture.clustered import widening
from jaxrender.inverse.texture.coloured_sites import ColouredPrior, KsPrior
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.measurements import SiteObservations
from jaxrender.inverse.texture.site_detail import Detail
from jaxrender.inverse.texture.site_equations import Expected, chi_squared
from jaxrender.inverse.texture.site_errors import left_of_sites
from jaxrender.inverse.texture.site_fields import Field, places_of_sites
from jaxrender.inverse.texture.site_minima import inverses, joined_minima
from jaxrender.inverse.texture.site_numbers import SiteNumbers
from jaxrender.inverse.texture.site_search import own_estimates
from jaxrender.inverse.texture.site_solver import (
    Asked,
    Solved,
    parts_of,
    solve_at,
    solve_numbers_of,
)
from jaxrender.inverse.texture.site_sums import by_channel
from jaxrender.inverse.texture.site_systems import KnownSpecular
from jaxrender.shapes import Float

# A site so many standard deviations from what its neighbours tell is searched from there, too.
_UNLIKE = 1.5
# Factors of K_d and K_s within a site, and the part of the typical value that they are beside.
_MOST_FACTOR, _DARK = 3.0, 0.05


class SurfaceNumbers(NamedTuple):
    """What was found of every site: all unknowns, and their covariance, which knows of misfit."""

    solved: Solved
    covariance: Float[np.ndarray, "site unknown unknown"]
    numbers: SiteNumbers


class Nearby(NamedTuple):
    """What sites near each other have in common: K_d, K_s, and what sites have for themselves."""

    kd: Field
    ks: Field
    sigma: Field | None
    offset: Field | None

    def widened(self, numbers: SiteNumbers) -> SiteNumbers:
        """Make errors larger where neighbours contradict each other by more than these say."""
        scales = {"sigma": self.sigma, "tilt_x": self.offset, "tilt_y": self.offset}
        own = (scales[name] for name in numbers.names)
        by = np.array([1.0 if field is None else field.scale for field in own])
        return numbers._replace(
            covariance=numbers.covariance * np.outer(by, by),
            wider=numbers.wider * [self.kd.scale, self.ks.scale],
        )

    def expected(self, asked: Asked, axes: Float[np.ndarray, "site 2 3"]) -> Expected:
        """Say what neighbours make one expect of every site's numbers."""
        count = len(axes)
        mean, precision = (np.tile(part, (count, 1)) for part in asked.expected)
        for at, name in enumerate(asked.names):
            field = self.sigma if name == "sigma" else self.offset
            if field is None:
                continue
            foreseen, variance = field.expected()
            precision[:, at] = 1 / variance
            if name == "sigma":
                mean[:, at] = foreseen[:, 0]
            else:
                axis = axes[:, ("tilt_x", "tilt_y").index(name)]
                mean[:, at] = np.einsum("si,si->s", foreseen, axis)
        return Expected(mean, precision)

    def detail(
        self,
        points: Float[np.ndarray, "sample 3"],
        measured: SiteObservations,
        asked: Asked,
        count: int,
    ) -> tuple[Detail, Float[np.ndarray, "site unknown"]]:
        """Say how ``count`` observations, those measured at ``points``, vary within their sites.

        Beside it stands the variance of each unknown that this leaves.  It is none of K_d, to which
        all pixels count alike.
        """
        channels = measured.radiance.shape[1]
        coloured = self.ks.value.shape[1] > 1
        whole = Detail.none(count, channels, coloured, self.sigma is not None)
        at, variances = measured.index, {}
        for name, factors, field in (("kd", whole.kd, self.kd), ("ks", whole.ks, self.ks)):
            within = field.within(points, measured.site)
            least = _DARK * np.maximum(field.mean, 0) + np.finfo(float).tiny
            factor = 1 + within.more / np.maximum(within.mean, least)[measured.site]
            factor = np.clip(factor, 1 / _MOST_FACTOR, _MOST_FACTOR)
            factors[at], variances[name] = factor.reshape(factors[at].shape), within.variance
        if self.sigma is not None:
            assert whole.log_sigma is not None
            within = self.sigma.within(points, measured.site)
            whole.log_sigma[at], variances["sigma"] = within.more[:, 0], within.variance
        if self.offset is not None:
            within = self.offset.within(points, measured.site)
            whole.offset[at] = within.more
            variances |= dict.fromkeys(("tilt_x", "tilt_y"), within.variance)
        of_ks = [variances["ks"]] * asked.prior.amplitudes(channels)
        every = [np.zeros(measured.count)] * channels + of_ks
        return whole, np.stack([*every, *(variances[name] for name in asked.names)], axis=1)


def solve_numbers(
    measured: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    start: Float[np.ndarray, "site number"] | None = None,
    *,
    again: bool = True,
    unsure: Float[np.ndarray, "site unknown"] | None = None,
) -> SurfaceNumbers:
    """Find the numbers of every site of a surface, and how sure they are.

    ``again`` says whether what is not explained is searched from elsewhere.  ``unsure`` is the
    variance of each unknown that is not of the photographs' noise.
    """
    search = solve_numbers_of if again else solve_at
    ends = [search(measured, model_of, asked, start)]
    if asked.nearby is not None:
        ends += _from_nearby(measured, model_of, asked, ends[0])
    solved, covariance = joined_minima(ends, asked.prior, measured.site)
    left = left_of_sites(measured, model_of, asked, solved)
    channels, seen = measured.radiance.shape[1], measured.seen
    freedom = np.maximum(seen * channels - asked.own(measured), 1)
    misfit = np.sqrt(left.squares / freedom)
    wider = np.maximum(misfit[:, None], widening(left.excess))
    wider[seen == 0] = 1
    unsure = np.zeros(covariance.shape[:2]) if unsure is None else unsure
    return _stated(measured, asked, solved, covariance, wider, unsure)


def nearby_of(
    points: Float[np.ndarray, "sample 3"],
    measured: SiteObservations,
    asked: Asked,
    found: SurfaceNumbers,
    seed: int,
) -> Nearby | None:
    """Learn how alike neighbours are; None where too few sites tell.  ``points`` are observed."""
    places = places_of_sites(points, measured.site, measured.count)
    solved, channels = found.solved, measured.radiance.shape[1]
    of_ks, seen = asked.prior.amplitudes(channels), measured.seen > 0
    variance = np.array(np.diagonal(found.covariance, axis1=1, axis2=2))
    variance[~seen] = np.inf
    before = asked.nearby or Expected(*(np.tile(p, (measured.count, 1)) for p in asked.expected))

    def learn(value, error, mean=None) -> Field | None:
        value = np.where(seen[:, None], value.reshape(measured.count, -1), np.nan)
        return Field.learn(places, value, np.where(seen, error, np.inf), seed, mean)

    kd = learn(np.asarray(solved.local.material.kd), np.sqrt(variance[:, :channels].mean(axis=1)))
    ks, error = _own_ks(np.asarray(solved.local.material.ks), asked.prior, variance, channels)
    fields: dict[str, Field | None] = {"sigma": None, "offset": None}
    at, every = channels + of_ks, []
    for place, name in enumerate(asked.names):
        value, told = own_estimates(
            solved.value[:, place],
            variance[:, at + place],
            before.mean[:, place],
            before.precision[:, place],
        )
        error_of = np.where(told > 0, 1 / np.sqrt(np.maximum(told, 1e-300)), np.inf)
        if name == "sigma":
            fields["sigma"] = learn(value, error_of, asked.expected.mean[place : place + 1])
        else:
            every.append((value, error_of))
    if every:
        tilts = np.stack([value for value, _ in every], axis=1)
        offset = np.einsum("sk,ski->si", tilts, solved.axes)
        fields["offset"] = learn(offset, np.hypot(*(e for _, e in every)) / np.sqrt(2), np.zeros(3))
    of_ks_field = learn(ks, error)
    if kd is None or of_ks_field is None:
        return None
    return Nearby(kd, of_ks_field, fields["sigma"], fields["offset"])


def better_detail(
    measured: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    solved: Solved,
    detail: Detail,
) -> Detail:
    """Keep what leaves less of a site than one number for all its pixels does."""
    costs = []
    for model in (model_of, detail.applied(model_of)):
        cost = np.full(measured.count, np.inf)
        for part in parts_of(measured, model, asked, solved.value, solved.predicted, ()):
            found, _ = chi_squared(part.near, part.data, asked.prior, part.expected, part.value)
            cost[part.sites] = np.asarray(found)[: len(part.sites)]
        costs.append(cost)
    chosen = np.zeros(len(detail.kd), bool)
    chosen[measured.index] = (costs[1] < costs[0])[measured.site]
    return detail.only(chosen)


def _own_ks(
    ks: Float[np.ndarray, "site *channel"],
    prior: KsPrior,
    variance: Float[np.ndarray, "site unknown"],
    channels: int,
) -> tuple[Float[np.ndarray, "site one"], Float[np.ndarray, "site"]]:
    """Take what was expected out of K_s; what it is held at zero tells nothing."""
    assert not isinstance(prior, KnownSpecular)
    precision = float(prior.precision)
    if isinstance(prior, ColouredPrior):
        colour = float(prior.colour_precision)
        # The variance of a channel is that of the level and that of the colour.
        precision = precision * colour / (precision + colour) if precision and colour else 0.0
    mean, values, errors = float(prior.mean), [], []
    for at, column in enumerate(np.asarray(by_channel(ks)).T):
        value, told = own_estimates(column, variance[:, channels + at], mean, precision)
        told = np.where(column > 0, told, 0)
        values.append(value)
        errors.append(np.where(told > 0, 1 / np.sqrt(np.maximum(told, 1e-300)), np.inf))
    return np.stack(values, axis=1), np.sqrt(np.mean(np.square(errors), axis=0))


def _from_nearby(
    measured: SiteObservations, model_of: ModelOf, asked: Asked, end: Solved
) -> list[Solved]:
    """Search from what neighbours tell where a site ended far from it."""
    assert asked.nearby is not None
    off = np.abs(end.value - asked.nearby.mean) * np.sqrt(asked.nearby.precision)
    rows = np.flatnonzero(np.any(off > _UNLIKE, axis=1)[measured.site])
    if not len(rows):
        return []
    start = np.clip(asked.nearby.mean, *asked.bounds)
    other = solve_at(measured.take(rows), model_of, asked, start)
    whole = np.zeros_like(measured.radiance)
    whole[rows] = other.predicted
    return [other._replace(predicted=whole)]


def _stated(
    measured: SiteObservations,
    asked: Asked,
    solved: Solved,
    covariance: Float[np.ndarray, "site unknown unknown"],
    wider: Float[np.ndarray, "site kind"],
    unsure: Float[np.ndarray, "site unknown"],
) -> SurfaceNumbers:
    """State values and errors; nothing is known of what was not seen."""
    count, seen, channels = len(asked.names), measured.seen > 0, measured.radiance.shape[1]
    size = covariance.shape[1] - count
    alone = inverses(np.asarray(solved.local.matrix)[:, :size, :size])
    # As many times as there are channels.
    kinds = np.repeat(np.arange(2), [channels, size - channels])
    by = wider[:, np.concatenate([kinds, np.arange(2, 2 + count)])]
    covariance = covariance * by[:, :, None] * by[:, None, :]
    covariance = covariance + unsure[:, :, None] * np.eye(size + count)
    whole, own = (np.diagonal(part, axis1=1, axis2=2) for part in (covariance, alone))
    inflation = np.sqrt(np.maximum(whole[:, :size] / by[:, :size] ** 2 / own, 1))
    of_numbers = covariance[:, size:, size:].copy()
    of_numbers[~seen] = np.diag(np.full(count, np.inf))
    numbers = SiteNumbers(
        asked.names,
        np.where(seen[:, None], solved.value, np.nan),
        of_numbers,
        np.where(seen[:, None], inflation, 1.0),
        solved.axes,
        wider[:, :2],
    )
    return SurfaceNumbers(solved, covariance, numbers)
