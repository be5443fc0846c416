"""Daylight from published models: the overcast and the clear sky, zero below the horizon.

All give the distribution relative to the zenith, whose radiance (a colour) is the caller's:

- overcast: Moon and Spencer 1942, the CIE overcast sky, L = L_z (1 + 2 cos Z) / 3;
- clear: the CIE general sky (CIE S 011, the form of Perez 1993) with the sun at angle Z_s from
  the zenith and the direction at angle Z from the zenith, X from the sun,

      L = L_z f(X) g(Z) / (f(Z_s) g(0)),    g(Z) = 1 + a exp(b / cos Z),
      f(X) = 1 + c (exp(d X) - exp(d pi / 2)) + e cos^2 X.

The sun's own disc is no part of the sky: add a directional source.  World frame, +Z the zenith.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.geometry.directions import normalise, squared_angle
from jaxrender.lighting.base import LightNodes
from jaxrender.lighting.function import FunctionLight
from jaxrender.shapes import AnyArray, Array, Directions, Float, checked

# Rows of a sky's own nodes between zenith and horizon.
_ROWS = 32
# Keeps 1 / cos Z finite; exp(b / cos Z) is far below rounding there.
_HORIZON_COSINE = 1e-3


class Distribution(NamedTuple):
    """Gradation a, b from zenith to horizon and indicatrix c, d, e about the sun.

    ``offset`` is what the indicatrix subtracts: exp(d pi / 2) in the CIE's form, 0 in Perez's.
    """

    a: float
    b: float
    c: float
    d: float
    e: float
    offset: float

    @classmethod
    def cie(cls, gradation: tuple[float, float], indicatrix: tuple[float, float, float]):
        """Take a, b and c, d, e from a line of the table of CIE S 011."""
        return cls(*gradation, *indicatrix, float(np.exp(indicatrix[1] * np.pi / 2)))


# Types 12 and 13 of CIE S 011: low turbidity (the CIE standard clear sky) and polluted air.
CLEAR_SKIES = {
    "clear": Distribution.cie((-1.0, -0.32), (10.0, -3.0, 0.45)),
    "polluted": Distribution.cie((-1.0, -0.32), (16.0, -3.0, 0.30)),
}


def preetham(turbidity: float) -> Distribution:
    """Give the luminance distribution of Preetham, Shirley and Smits 1999 for a turbidity.

    Raises ``ValueError`` outside 1.8 to 10, where that fit does not hold.
    """
    if not 1.8 <= turbidity <= 10:
        raise ValueError(f"turbidity={turbidity}: the model holds from 1.8 (clearest) to 10 (hazy)")
    slope = np.array([0.1787, -0.3554, -0.0227, 0.1206, -0.0670])
    start = np.array([-1.4630, 0.4275, 5.3251, -2.5771, 0.3703])
    a, b, c, d, e = (float(value) for value in slope * turbidity + start)
    return Distribution(a, b, c, d, e, 0.0)


def _distribution(given: str | Distribution) -> Distribution:
    if isinstance(given, str) and given not in CLEAR_SKIES:
        raise ValueError(f"distribution={given!r}: choose {' or '.join(CLEAR_SKIES)}")
    return CLEAR_SKIES[given] if isinstance(given, str) else given


class Sky(FunctionLight):
    """Light from the upper half of the sphere, as a function of direction."""

    def nodes(self) -> LightNodes:
        """Place Gauss-Legendre rows from zenith to horizon: exact there for smooth products."""
        cosines, weights = np.polynomial.legendre.leggauss(_ROWS)
        cosines, weights = (cosines + 1) / 2, weights / 2
        azimuths = (np.arange(4 * _ROWS) + 0.5) * np.pi / (2 * _ROWS)
        sines = np.sqrt(1 - cosines**2)[:, None]
        x, y = sines * np.cos(azimuths), sines * np.sin(azimuths)
        towards = np.stack([x, y, np.broadcast_to(cosines[:, None], x.shape)], axis=-1)
        weight = np.repeat(weights * np.pi / (2 * _ROWS), 4 * _ROWS)
        radiance = self.radiance(towards.reshape(-1, 3))
        irradiance = jnp.asarray(weight, radiance.dtype)[:, None] * radiance
        return LightNodes(jnp.asarray(towards.reshape(-1, 3), radiance.dtype), irradiance)


class OvercastSky(Sky):
    """The CIE overcast sky, L = L_z (1 + 2 cos Z) / 3: three times as bright above as around."""

    zenith: Float[AnyArray, "channel"]

    @checked
    def radiance(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate the radiance from unit world directions; zero below the horizon."""
        zenith = jnp.asarray(self.zenith)
        cosine = jnp.asarray(directions, zenith.dtype)[..., 2]
        return jnp.einsum("...,c->...c", jnp.where(cosine > 0, (1 + 2 * cosine) / 3, 0), zenith)


class ClearSky(Sky):
    """The CIE clear sky, or another of that form, with the sun in a direction above the horizon.

    ``distribution`` may be one of the names of ``CLEAR_SKIES``.

    Raises ``ValueError`` for a sun that is below the horizon or no direction, and for a name of no
    sky.
    """

    sun: Float[AnyArray, "3"]
    zenith: Float[AnyArray, "channel"]
    distribution: Distribution = eqx.field(
        static=True, converter=_distribution, default=CLEAR_SKIES["clear"]
    )

    def __check_init__(self):
        if isinstance(self.sun, Tracer):
            return
        sun = np.asarray(self.sun)
        if not (np.all(np.isfinite(sun)) and sun[2] >= 0 and np.any(sun)):
            raise ValueError(f"sun={sun}: give a direction at or above the horizon, z >= 0")

    @checked
    def radiance(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Evaluate the radiance from unit world directions; zero below the horizon."""
        zenith = jnp.asarray(self.zenith)
        towards = jnp.asarray(directions, zenith.dtype)
        return jnp.einsum("...,c->...c", self.relative(towards), zenith)

    @checked
    def relative(self, directions: Float[AnyArray, "*batch 3"]) -> Float[Array, "*batch"]:
        """Evaluate L / L_z."""
        towards = jnp.asarray(directions)
        sun = normalise(jnp.asarray(self.sun, towards.dtype))
        cosine = jnp.einsum("...i,i->...", towards, sun, precision="highest")
        value = self._indicatrix(cosine) * self._gradation(towards[..., 2])
        overhead = self._indicatrix(sun[2]) * self._gradation(jnp.ones((), towards.dtype))
        return jnp.where(towards[..., 2] > 0, value / overhead, 0)

    def _gradation(self, cosine: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        shape = self.distribution
        return 1 + shape.a * jnp.exp(shape.b / jnp.maximum(cosine, _HORIZON_COSINE))

    def _indicatrix(self, cosine: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        shape = self.distribution
        squared = squared_angle(jnp.clip(cosine, -1, 1))
        # The angle itself has a kink at the sun; a floor keeps its derivative finite there.
        angle = jnp.sqrt(jnp.maximum(squared, float(jnp.finfo(squared.dtype).eps) ** 2))
        peak = shape.c * (jnp.exp(shape.d * angle) - shape.offset)
        return 1 + peak + shape.e * cosine**2
