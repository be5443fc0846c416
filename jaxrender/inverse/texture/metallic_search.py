"""The search of the sites of glTF's material, each as metal, as plastic, and as something between.

Most things are metal or not, and few are half of either.  So kinds of sites are told apart by their
shares of metal, each with a mean and a spread (:func:`.kinds_of`).  Every site is searched as one
of each kind, and where its roughness is not sure then, from other roughnesses too.  The likeliest
end is kept, and the errors know of all (:mod:`.site_minima`): who saw little of a site does not
know its kind.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.texture.clustered import Excess
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.measurements import SiteObservations
from jaxrender.inverse.texture.site_equations import Expected
from jaxrender.inverse.texture.site_errors import left_of_sites
from jaxrender.inverse.texture.site_minima import inverses, joined_minima
from jaxrender.inverse.texture.site_numbers import NUMBERS
from jaxrender.inverse.texture.site_search import own_estimates
from jaxrender.inverse.texture.site_solver import (
    Asked,
    Solved,
    solve_at,
    solve_numbers_of,
)
from jaxrender.inverse.texture.specular_prior import kinds_of
from jaxrender.shapes import Float

# Means and spreads of the shares of metal of plastics, of what is between, and of metals, before
# these are known; and the least spread of any.
_KINDS, _LEAST_SPREAD = ((0.0, 0.1), (0.5, 0.3), (1.0, 0.1)), 0.05
# Where the standard error of log roughness is larger, or the values are fewer, other minima are
# looked for.
_SURE, _MANY = 0.03, 40


class Kind(NamedTuple):
    """What is expected of a site of one kind, and what counts against a site's being of it."""

    expected: Expected
    cost: float


class Found(NamedTuple):
    """What was found of some sites, and how sure.

    ``squares`` are those of the weighted residuals of each site, ``excess`` what photographs leave
    of its base colour and of each number together.
    """

    solved: Solved
    covariance: Float[np.ndarray, "site number number"]
    color_error: Float[np.ndarray, "site channel"]
    squares: Float[np.ndarray, "site"]
    excess: Excess


def learn_kinds(some: SiteObservations, model_of: ModelOf, asked: Asked) -> list[Kind]:
    """Learn what kinds of sites there are; one alone without a map of metalness."""
    if "metallic" not in asked.names:
        return [Kind(asked.expected, 0.0)]
    at, (mean, precision) = asked.names.index("metallic"), asked.expected
    solved = solve_numbers_of(some, model_of, asked, None)
    variance = np.diagonal(inverses(np.asarray(solved.local.matrix)), axis1=1, axis2=2)
    own = variance[:, at - len(asked.names)]
    value, told = own_estimates(solved.value[:, at], own, mean[at], precision[at])
    found = []
    for share, middle, spread in zip(*kinds_of(value, told, _KINDS, _LEAST_SPREAD)):
        expected = Expected(mean.copy(), precision.copy())
        expected.mean[at], expected.precision[at] = middle, 1 / spread**2
        found.append(Kind(expected, -2 * float(np.log(share / spread))))
    return found


def search_kinds(
    block: SiteObservations, model_of: ModelOf, asked: Asked, kinds: list[Kind]
) -> Found:
    """Search every site; a channel that is black has the error of what was measured."""
    ends = [_as_kind(block, model_of, asked, kind, None) for kind in kinds]
    best, covariance = joined_minima(ends, asked.prior, block.site)
    ends += _from_other_roughness(block, model_of, asked, kinds, covariance)
    best, covariance = joined_minima(ends, asked.prior, block.site)
    left, channels = left_of_sites(block, model_of, asked, best), block.radiance.shape[1]
    variance = np.diagonal(covariance, axis1=1, axis2=2)[:, :channels]
    dark = (np.asarray(best.local.material.kd) == 0) & (block.seen > 0)[:, None]
    # What is held at zero has 1 on the diagonal.
    variance = np.where(dark, np.maximum(left.diffuse, variance - 1), variance)
    own = covariance[:, channels:, channels:]
    return Found(best, own, np.sqrt(variance), left.squares, left.excess)


def _as_kind(
    block: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    kind: Kind,
    start: Float[np.ndarray, "site number"] | None,
) -> Solved:
    """Search sites as those of one kind, from everywhere or from one start."""
    own = asked._replace(expected=kind.expected)
    search = solve_numbers_of if start is None else solve_at
    end = search(block, model_of, own, start)
    return end._replace(local=end.local._replace(cost=end.local.cost + kind.cost))


def _from_other_roughness(
    block: SiteObservations,
    model_of: ModelOf,
    asked: Asked,
    kinds: list[Kind],
    covariance: Float[np.ndarray, "site unknown unknown"],
) -> list[Solved]:
    """Search anew what is not sure of its roughness, from a low and from a high one."""
    if "roughness" not in asked.names:
        return []
    at = asked.names.index("roughness")
    place = covariance.shape[1] - len(asked.names) + at
    few = block.seen * block.radiance.shape[1] < _MANY
    rows = np.flatnonzero((few | (covariance[:, place, place] > _SURE**2))[block.site])
    if not len(rows):
        return []
    part, ends = block.take(rows), []
    for kind in kinds:
        for beside in NUMBERS["roughness"].again:
            start = np.tile(kind.expected.mean, (block.count, 1))
            start[:, at] += beside
            end = _as_kind(part, model_of, asked, kind, np.clip(start, *asked.bounds))
            whole = np.zeros_like(block.radiance)
            whole[rows] = end.predicted
            ends.append(end._replace(predicted=whole))
    return ends
