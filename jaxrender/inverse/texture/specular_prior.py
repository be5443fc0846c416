"""How K_s is spread over the surface, learned from the sites that show it (empirical Bayes).

Each site's own estimate k_i with standard error s_i is a draw from N(m, t^2 + s_i^2): m and t^2
follow by maximum likelihood, and then say what to expect of a site whose highlights nobody saw.
The thesis takes the mean value of the specular texture there (T 6.4.2); a site that shows a little
now gets a little of both.
"""

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
