"""How K_s is spread over the surface, learned from the sites that show it (empirical Bayes).

Each site's own estimate k_i with standard error s_i is a draw from N(m, t^2 + s_i^2): m and t^2
follow by maximum likelihood, and then say what to expect of a site whose highlights nobody saw.
The thesis takes the mean value of the specular texture there (T 6.4.2); a site that shows a little
now gets a little of both.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.texture.site_systems import SpecularPrior
from jaxrender.shapes import Float

_STEPS, _SETTLED = 200, 1e-10
# The spread is not taken to be less than this part of the mean: no prior is to be a certainty.
_LEAST_SPREAD = 1e-3


def spread_of(
    estimates: Float[np.ndarray, "site"], precision: Float[np.ndarray, "site"]
) -> SpecularPrior:
    """Estimate mean and spread of K_s from free estimates and their precisions (1 / s^2).

    Sites of precision 0 have no say.  Without any other there is no prior.
    """
    mean, variance = normal_spread(estimates, precision)
    if not np.isfinite(variance):
        return SpecularPrior(np.zeros(()), np.zeros(()))
    return SpecularPrior(np.asarray(max(mean, 0.0)), np.asarray(1 / variance))


def normal_spread(
    estimates: Float[np.ndarray, "site"], precision: Float[np.ndarray, "site"], least: float = 0.0
) -> tuple[float, float]:
    """Do the same of any number: its mean, and its variance over the sites, infinite if unknown.

    The spread is ``least`` at least.
    """
    measured = precision > 0
    if not measured.any():
        return 0.0, np.inf
    values, variances = estimates[measured], 1 / precision[measured]
    mean = float(np.average(values, weights=1 / variances))
    spread = float(np.median((values - mean) ** 2))
    for _ in range(_STEPS):
        weights = 1 / (spread + variances)
        before = mean, spread
        mean = float(np.average(values, weights=weights))
        excess = float(np.average((values - mean) ** 2 - variances, weights=weights**2))
        lowest = max(least, _LEAST_SPREAD * abs(mean)) ** 2
        spread = max(excess, lowest, np.finfo(float).tiny)
        if np.allclose(before, (mean, spread), rtol=_SETTLED, atol=0):
            break
    return mean, spread


class Kinds(NamedTuple):
    """Normal distributions of which every site's number is drawn, each with its share of sites."""

    share: Float[np.ndarray, "kind"]
    mean: Float[np.ndarray, "kind"]
    spread: Float[np.ndarray, "kind"]


def kinds_of(
    estimates: Float[np.ndarray, "site"],
    precision: Float[np.ndarray, "site"],
    begin: tuple[tuple[float, float], ...],
    least: float,
) -> Kinds:
    """Tell kinds of sites apart by a number, as metals from plastics: a mixture of normals.

    The likelihood is climbed by expectation and maximisation from means and spreads ``begin``; no
    spread is less than ``least``.  Every kind begins with one site more, so that none dies out.
    """
    count, (first, wide) = len(begin), np.array(begin).T
    kinds = Kinds(np.full(count, 1 / count), first, wide)
    measured = precision > 0
    values, variances = estimates[measured, None], 1 / precision[measured, None]
    if not measured.any():
        return kinds
    for _ in range(_STEPS):
        before, whole = kinds, kinds.spread**2 + variances
        logs = np.log(kinds.share) - ((values - kinds.mean) ** 2 / whole + np.log(whole)) / 2
        of_kind = np.exp(logs - logs.max(axis=1, keepdims=True))
        of_kind /= of_kind.sum(axis=1, keepdims=True)
        # What a site's own number is, if it is of a kind.
        inside = 1 / (1 / kinds.spread**2 + 1 / variances)
        own = inside * (kinds.mean / kinds.spread**2 + values / variances)
        total = of_kind.sum(axis=0) + 1
        mean = (np.sum(of_kind * own, axis=0) + first) / total
        squares = np.sum(of_kind * ((own - mean) ** 2 + inside), axis=0)
        square = (squares + (first - mean) ** 2 + wide**2) / total
        spread = np.maximum(np.sqrt(square), least)
        kinds = Kinds(total / total.sum(), mean, spread)
        if all(np.allclose(one, other, atol=1e-6) for one, other in zip(before, kinds)):
            break
    return kinds
