"""The lobe of one material of a texture, with its intervals."""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.outcomes import Outcome
from jaxrender.shapes import Float

# Where an interval is symmetric in the logarithm of value - origin.
ORIGIN = {"sigma": 0.0, "mu": 1.0}
# An interval that reaches beyond this factor above its origin has no end there.
_ENDLESS = 1e4


class RegionLobe(NamedTuple):
    """One material's lobe, and how many of its sites were seen.

    ``number`` and ``name`` are those of ``SurfaceSites.regions``.  Errors are None where they are
    not known; mu is NaN where there is none.  ``exact_errors`` are those of sigma and mu if the
    model were exact, where these know of misfit.
    """

    number: int
    name: str
    sites: int
    sigma: float
    mu: float
    sigma_error: float | None
    mu_error: float | None
    outcome: Outcome
    exact_errors: tuple[float, float] | None = None

    def interval90(self, name: str) -> Float[np.ndarray, "2"] | None:
        """Return the 90 % interval of ``sigma`` or ``mu``; None where the error is not known."""
        value, error = getattr(self, name), getattr(self, f"{name}_error")
        return None if error is None else interval90(name, value, error)

    def if_exact(self) -> "RegionLobe":
        """Take the model to be exact."""
        if self.exact_errors is None:
            return self
        sigma, mu = self.exact_errors
        return self._replace(sigma_error=sigma, mu_error=mu)

    @property
    def errors(self) -> tuple[float, float]:
        """The errors of sigma and mu; NaN where they are not known."""
        sigma, mu = (np.nan if one is None else one for one in (self.sigma_error, self.mu_error))
        return sigma, mu

    def tells(self, name: str) -> bool:
        """Whether the interval of ``sigma`` or ``mu`` is narrow enough to speak of a value."""
        size = getattr(self, name) - ORIGIN[name]
        return bool(NORMAL_90 * getattr(self, f"{name}_error") <= IDENTIFIABLE_WITHIN * size)


def interval90(
    name: str, value: float | Float[np.ndarray, "..."], error: float | Float[np.ndarray, "..."]
) -> Float[np.ndarray, "... 2"]:
    """Return the 90 % interval, symmetric in the logarithm of sigma or of mu - 1."""
    size = np.asarray(value) - ORIGIN[name]
    with np.errstate(invalid="ignore", divide="ignore"):
        log = NORMAL_90 * np.asarray(error) / size
        factor = np.where(log < np.log(_ENDLESS), np.exp(np.minimum(log, np.log(_ENDLESS))), np.inf)
        factor = np.where(size > 0, factor, 1.0)
    return np.stack([ORIGIN[name] + size / factor, ORIGIN[name] + size * factor], axis=-1)
