"""Which inverse problems are well posed, by degree, before any photograph (T 2.4.2).

For a lobe about one central direction the reflected light is B_lm = A_l L_lm, so the light can be
had back where A_l does not vanish, and the BRDF where some L_lm does not.  With measurements of
limited precision "does not vanish" means "is above the noise": the coefficients of n samples spread
over the sphere, each with a standard deviation s, have the standard deviation s sqrt(4 pi / n).
Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.harmonics import band_limit_of, degrees
from jaxrender.shapes import AnyArray, Bool, Float

# A degree counts as recoverable when its relative standard error is below this, as a parameter of
# a fit does when its interval is.
RECOVERABLE = 0.25


class Posedness(NamedTuple):
    """Spectra by degree, and the relative standard errors that a recovery would have.

    ``light`` is the root of the sum over orders of L_lm^2 (all channels together), ``reflected``
    that of A_l L_lm, ``noise`` that of the errors of the latter.  ``light_error`` is the relative
    error of the light of that degree when the BRDF is known, ``brdf_error`` that of A_l when the
    light is known; infinite where the photographs say nothing at all.
    """

    light: Float[np.ndarray, "degree"]
    transfer: Float[np.ndarray, "degree"]
    reflected: Float[np.ndarray, "degree"]
    noise: Float[np.ndarray, "degree"]
    light_error: Float[np.ndarray, "degree"]
    brdf_error: Float[np.ndarray, "degree"]

    @property
    def light_recoverable(self) -> Bool[np.ndarray, "degree"]:
        """Which degrees of the light can be had back (inverse lighting)."""
        return self.light_error < RECOVERABLE

    @property
    def brdf_recoverable(self) -> Bool[np.ndarray, "degree"]:
        """Which degrees of the BRDF can be had back (inverse BRDF)."""
        return self.brdf_error < RECOVERABLE


def posedness(
    coefficients: Float[AnyArray, "coefficient channel"],
    transfer: Float[AnyArray, "degree"],
    noise: float = 0.01,
    samples: int = 12_000,
) -> Posedness:
    """Weigh the spectra of a light and of a lobe against measurement noise.

    ``noise`` is the standard deviation of a sample as a part of the reflected light's root mean
    square.  Raises ``ValueError`` for spectra of different degree, a light of nothing, noise that
    is not above 0, or no samples.
    """
    light, transfer = np.asarray(coefficients, float), np.asarray(transfer, float)
    band_limit = band_limit_of(len(light))
    if len(transfer) != band_limit + 1:
        raise ValueError(
            f"the light is known to degree {band_limit}, the lobe to {len(transfer) - 1}: "
            "give both to the same degree"
        )
    if not noise > 0 or samples < 1:
        raise ValueError(
            f"noise={noise}, samples={samples}: give noise above 0 and 1 sample or more"
        )
    if not np.any(light):
        raise ValueError("the light is zero: give one with radiance")
    of_degree = np.add.reduceat(
        np.sum(light**2, axis=1), np.flatnonzero(np.diff(degrees(band_limit), prepend=-1))
    )
    reflected = of_degree * transfer**2
    channels = light.shape[1]
    # Mean square of the reflected light over the sphere, per channel; white noise of each
    # coefficient beside it.
    deviation = noise * np.sqrt(reflected.sum() / (4 * np.pi) / channels * 4 * np.pi / samples)
    orders = channels * (2 * np.arange(band_limit + 1) + 1)
    noise_of_degree, size = deviation * np.sqrt(orders), np.sqrt(reflected)
    with np.errstate(divide="ignore"):
        errors = noise_of_degree / size, deviation / size
    return Posedness(np.sqrt(of_degree), transfer, size, noise_of_degree, *errors)
