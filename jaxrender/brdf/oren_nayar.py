"""Oren and Nayar's model of 1994: V-shaped grooves with Lambertian sides.

With a = max(t_i, t_o), b = min(t_i, t_o), p the azimuth between the directions, rho the albedo:
rho_1 = rho / pi (C1 + C2 cos p tan b + C3 (1 - |cos p|) tan((a + b) / 2))             (their 27)
rho_2 = .17 rho^2 / pi s^2 / (s^2 + .13) (1 - cos p (2 b / pi)^2)                      (their 28)
and, as the qualitative model, rho / pi (A + B max(cos p, 0) sin a tan b)              (their 30)
``kd`` is rho / pi, so the lobe of light reflected twice has the amplitude pi kd^2.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    matching,
    refuse_outside,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import ShapeParameter, WithoutIndex
from jaxrender.geometry import Components, squared_acute_angle
from jaxrender.shapes import AnyArray, Array, Float

# Sines below it count as the pole, where the azimuth is nothing to differentiate by.
_SMALLEST_SQUARED_SINE = 1e-12

# The lobe is as smooth as a cosine, which the horizon cuts.
_WIDTH = 0.4

# The largest directional albedo of white sides over all sigma and angles, found numerically.
_FULL_OVERSHOOT, _QUALITATIVE_OVERSHOOT = 1.052, 1.017


class OrenNayar(BRDF):
    """A rough Lambertian surface; ``sigma`` in radians, the deviation of the sides' angle.

    ``qualitative=True`` is the shorter model without interreflection.  Raises ``ValueError`` for
    sigma outside [0, pi/2).
    """

    kd: Float[AnyArray, "channel"]
    sigma: Scalar = eqx.field(converter=as_scalar)
    qualitative: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        refuse_outside("sigma", self.sigma, "[0, 1.5708)", "it is in radians, 30 degrees are .52")

    @property
    def albedo(self) -> Float[AnyArray, "channel"]:
        """The albedo of the grooves' sides, pi kd."""
        return self.kd * np.pi

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """Light reflected once and, in the full model, twice: kd and pi kd^2."""
        kd = jnp.asarray(self.kd)
        return kd[None, :] if self.qualitative else jnp.stack([kd, np.pi * kd**2])

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When the albedo is low enough for the fitted formulas, which overshoot at grazing.

        Of white sides the full model reflects up to 1.051 (sigma = .3), the qualitative 1.016
        (sigma = .2); without roughness exactly 1.
        """
        if not np.any(self.sigma):
            return share_of_energy_is_bounded(self.albedo)
        overshoot = _QUALITATIVE_OVERSHOOT if self.qualitative else _FULL_OVERSHOOT
        return share_of_energy_is_bounded(self.albedo * overshoot)

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each lobe times the clamped cosine."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        sigma = matching(self.sigma, incoming.z)
        lobes = _qualitative if self.qualitative else _full
        return tuple(
            jnp.where(visible, lobe * incoming.z, 0)
            for lobe in lobes(sigma * sigma, incoming, outgoing)
        )


class OrenNayarLobe(WithoutIndex):
    """The qualitative model as a fit knows it: one lobe, and no base under it."""

    shape: ClassVar[ShapeParameter] = ShapeParameter("sigma")
    amplitude_names: ClassVar[tuple[str, ...]] = ("kd",)
    bases: ClassVar[tuple[str, ...]] = ()

    kd: Float[AnyArray, "channel"]
    sigma: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        refuse_outside("sigma", self.sigma, "[0, 1.5708)", "it is in radians, 30 degrees are .52")

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When the albedo is low enough for the fitted formula, which overshoots at grazing."""
        return share_of_energy_is_bounded(self.kd * np.pi * _QUALITATIVE_OVERSHOOT)

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def energy(self) -> float:
        """About pi: kd is an albedo over pi."""
        return np.pi

    @property
    def width(self) -> float:
        """That of a cosine, whatever the grooves."""
        return _WIDTH

    def transfer(self, incoming: Components, outgoing: Components) -> tuple[Float[Array, "*batch"]]:
        """Evaluate the lobe times the clamped cosine."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        sigma = matching(self.sigma, incoming.z)
        (lobe,) = _qualitative(sigma * sigma, incoming, outgoing)
        return (lobe * jnp.where(visible, incoming.z, 0),)


def _qualitative(
    variance: Float[Array, ""], incoming: Components, outgoing: Components
) -> tuple[Float[Array, "*batch"]]:
    a = 1 - 0.5 * variance / (variance + 0.33)
    b = 0.45 * variance / (variance + 0.09)
    # sin a tan b cos p is the product of the parts along the surface, over the larger cosine.
    along = incoming.x * outgoing.x + incoming.y * outgoing.y
    return (a + b * jnp.maximum(along, 0) / jnp.maximum(incoming.z, outgoing.z),)


def _full(
    variance: Float[Array, ""], incoming: Components, outgoing: Components
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    larger = _angle(jnp.minimum(incoming.z, outgoing.z))
    smaller = _angle(jnp.maximum(incoming.z, outgoing.z))
    along = incoming.x * outgoing.x + incoming.y * outgoing.y
    cosine = along / jnp.maximum(jnp.sin(larger) * jnp.sin(smaller), _SMALLEST_SQUARED_SINE)
    cosine = jnp.clip(cosine, -1, 1)
    towards = 0.45 * variance / (variance + 0.09)
    side = 0.125 * variance / (variance + 0.09) * (4 * larger * smaller / np.pi**2) ** 2
    away = jnp.where(cosine < 0, (2 * smaller / np.pi) ** 3, 0)
    once = (
        1
        - 0.5 * variance / (variance + 0.33)
        + cosine * towards * (jnp.sin(larger) - away) * jnp.tan(smaller)
        + (1 - jnp.abs(cosine)) * side * jnp.tan((larger + smaller) / 2)
    )
    twice = 0.17 * variance / (variance + 0.13) * (1 - cosine * (2 * smaller / np.pi) ** 2)
    return once, twice


def _angle(cosine: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    squared = squared_acute_angle(jnp.minimum(cosine, 1))
    return jnp.sqrt(jnp.maximum(squared, _SMALLEST_SQUARED_SINE))
