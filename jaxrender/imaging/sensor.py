"""The noise of one stored value: photons, readout and rounding, through the camera's response.

    variance(L) = photon L + read^2 + (dL/dv)^2 step^2 / 12

L is linear radiance with 1 at full scale.  ``photon`` is one over the electrons at full scale,
``read`` the standard deviation in the dark, ``step`` the distance of two stored values v, which
the slope of the response turns into radiance.
"""

import math

import equinox as eqx
import numpy as np
from jaxtyping import Float

from jaxrender.imaging.response import Linear, Response
from jaxrender.shapes import checked

# Half the distance over which the slope of a response is taken, in stored values.
_HALF_STEP = 0.5 / 255


class SensorNoise(eqx.Module):
    """Noise of a sensor whose full scale is radiance 1.

    The defaults are those of a small camera at its base sensitivity: ten thousand electrons at full
    scale, a floor of a two-thousandth, and 8 bits.
    """

    photon: float = 1e-4
    read: float = 5e-4
    step: float = 1 / 255

    def __check_init__(self):
        for name in ("photon", "read", "step"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"noise {name} is {value}: give a finite number, 0 or more")
        if not (self.photon or self.read or self.step):
            raise ValueError("a sensor without any noise: give photon, read or step")

    @checked
    def variance(
        self, radiance: Float[np.ndarray, "*image"], response: Response | None = None
    ) -> Float[np.ndarray, "*image"]:
        """Of each radiance, whose values were stored through the response (None: linear)."""
        radiance = np.asarray(radiance, np.float64)
        slope = _slope(response or Linear(), radiance)
        return self.photon * np.maximum(radiance, 0) + self.read**2 + (slope * self.step) ** 2 / 12


def rounding(bit_depth: int) -> float:
    """Return the distance of two stored values of so many bits, as a part of full scale.

    Raises ``ValueError`` for less than one bit.
    """
    if bit_depth < 1:
        raise ValueError(f"bit_depth={bit_depth}: give 1 or more")
    return 1 / (2.0**bit_depth - 1)


def _slope(response: Response, radiance: np.ndarray) -> np.ndarray:
    """Differentiate radiance by stored value, over one step of 8 bits inside 0 to 1."""
    if isinstance(response, Linear):
        return np.ones_like(radiance)
    ends = np.full(radiance.shape[-1:], np.inf)
    # A measured curve answers what lies beyond it with its ends.
    low, high = np.maximum(response.encode(-ends), 0), np.minimum(response.encode(ends), 1)
    centre = np.clip(response.encode(radiance), low + _HALF_STEP, high - _HALF_STEP)
    rise = response.linearise(centre + _HALF_STEP) - response.linearise(centre - _HALF_STEP)
    return rise / (2 * _HALF_STEP)
