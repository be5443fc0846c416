"""Blinn's version of Phong's model: a power of the cosine to the half vector.

rho = kd + ks (s + 2) (s + 4) / (8 pi (2^(-s/2) + s)) (N . h)^s

The factor makes the directional albedo at normal exitance exactly ks (Blinn 1977 left the lobe
unnormalised); towards grazing the albedo falls.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.glossy import Glossy
from jaxrender.brdf.half_vector import half_vector, lifted, power_of_cosine
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    matching,
    refuse_outside,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import ByOwnNumber, ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

# Beyond the half angle whose cosine is exp(-25 / s) the power s is below exp(-25).
_NEGLIGIBLE = 25.0


class BlinnPhong(ByOwnNumber, Glossy):
    """The half vector's power over a Lambertian base, with a real ``exponent`` s >= 0."""

    # cos^s t_h is about exp(-s t_h^2 / 2), so s = 2 / sigma^2.
    shape: ClassVar[ShapeParameter] = ShapeParameter("exponent", 2.0, -2.0)

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    exponent: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        refuse_outside("exponent", self.exponent, "[0, inf)", "larger is narrower, 32 is glossy")

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When pi kd + ks is at most 1."""
        return share_of_energy_is_bounded(np.pi * self.kd, self.ks)

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def reach(self) -> Float[Array, ""]:
        """Twice the half angle at which the power has vanished."""
        return 2 * jnp.arccos(jnp.exp(-_NEGLIGIBLE / jnp.asarray(self.exponent)))

    @property
    def energy(self) -> float:
        """One: ks is about the lobe's albedo at normal exitance."""
        return 1.0

    def specular_transfer(
        self, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate the normalised power times cos t_i."""
        versine = half_vector(lifted(incoming), lifted(outgoing)).versine
        exponent = matching(self.exponent, versine)
        return blinn_normalisation(exponent) * power_of_cosine(versine, exponent) * incoming.z


def blinn_normalisation(exponent: Float[Array, ""]) -> Float[Array, ""]:
    """Evaluate 1 / int (N . h)^s cos t dw at normal exitance, (s+2) (s+4) / (8 pi (2^(-s/2)+s))."""
    flat = jnp.exp2(-exponent / 2)
    return (exponent + 2) * (exponent + 4) / (8 * np.pi * (flat + exponent))
