"""Blinn's version of Phong's model: a power of the cosine to the half vector.

rho = kd + ks (s + 2) (s + 4) / (8 pi (2^(-s/2) + s)) (N . h)^s

The factor makes the directional albedo at normal exitance exactly ks (Blinn 1977 left the lobe
unnormalised); towards grazing the albedo falls.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible, half_vector, lifted, power
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    matching,
    refuse_outside,
    share_of_energy_is_bounded,
)
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float


class BlinnPhong(BRDF):
    """The half vector's power over a Lambertian base, with a real ``exponent`` s >= 0."""

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    exponent: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        refuse_outside("exponent", self.exponent, "[0, inf)", "larger is narrower, 32 is glossy")

    @property
    def amplitudes(self) -> Float[AnyArray, "2 channel"]:
        """The clamped cosine's and the lobe's: kd and ks."""
        return jnp.stack([jnp.asarray(self.kd), jnp.asarray(self.ks)])

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

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate the clamped cosine, and the normalised power times the clamped cosine."""
        visible = are_visible(incoming, outgoing)
        cosine = half_vector(lifted(incoming), lifted(outgoing)).direction.z
        exponent = matching(self.exponent, cosine)
        lobe = blinn_normalisation(exponent) * power(cosine, exponent) * incoming.z
        return jnp.where(visible, incoming.z, 0), jnp.where(visible, lobe, 0)


def blinn_normalisation(exponent: Float[Array, ""]) -> Float[Array, ""]:
    """Evaluate 1 / int (N . h)^s cos t dw at normal exitance, (s+2) (s+4) / (8 pi (2^(-s/2)+s))."""
    flat = jnp.exp2(-exponent / 2)
    return (exponent + 2) * (exponent + 4) / (8 * np.pi * (flat + exponent))
